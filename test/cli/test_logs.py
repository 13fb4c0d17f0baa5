"""`info`, `recover` and `drop --from-log`, which need only a log."""

import csv
import dataclasses
import json
import os

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.logs.bag import OUTCOME, LogOutcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros import distribution_conversions
from resting_aspects_ros.ros.conversions import part_msg, poses_msgs
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.run_logs import logged_result
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.system import lock_file

POSES = Topic('/cell/resting_poses', POSES_TYPE, Qos(2000))
PART = Topic('/cell/parts/solid', PART_TYPE, Qos(1))
DISTRIBUTION = Topic('/cell/aspect_distributions/solid', DISTRIBUTION_TYPE, Qos(1))
DROPS = 300


@pytest.fixture(scope='module')
def dropped(part, surfaces):
    """Return a run with special conditions, and its poses in batches of 100."""
    conditions = surfaces.get('steel').changed(height=0.045, friction=0.31)
    job, run = plan_run(
        part('l_bracket'), conditions, seed=77, drops=DROPS, run_id='4f1c', started=10**18
    )
    poses = drop_range(job, 0, DROPS)
    return run, [poses.between(first, first + 100) for first in (0, 100, 200)]


@pytest.fixture
def write_log(tmp_path):
    """Write a log like the recorder: the part, batches of poses, the distribution after each."""

    def write_log(part, run, batches, name='run', *, whole=True, closed=True):
        log = RunLog(tmp_path, name)
        log.add_metadata('run', {'run_id': run.run_id})
        log.write(PART, serialize_message(part_msg(part)), 1)
        counted = no_drops(find_aspects(part))
        for k, batch in enumerate(batches):
            last = whole and k == len(batches) - 1
            (message,) = poses_msgs(batch, run, Time(), last=last)
            log.write(POSES, serialize_message(message), 2 + k)
            counted += count_poses(counted.aspects, batch)
            message = distribution_msg(counted, run, Time(), last)
            log.write(DISTRIBUTION, serialize_message(message), 2 + k)
        log.flush()
        unfinished = log.path.read_bytes()
        outcome = LogOutcome(sum(map(len, batches)), whole=whole)
        log.add_metadata(OUTCOME, outcome.record())
        log.close()
        if not closed:
            log.path.write_bytes(unfinished)
            (log.path.parent / 'metadata.yaml').unlink()
        return log.path.parent

    return write_log


@pytest.fixture
def log(write_log, part, dropped):
    """Write a log of the run; ``batches``: not closed, with this number of batches."""

    def log(name='run', batches=None):
        run, poses = dropped
        given = {'whole': batches in (None, 3), 'closed': batches is None}
        return write_log(part('l_bracket'), run, poses[:batches], name, **given)

    return log


def test_control_characters_of_a_log_are_not_printed(run, write_log, dropped, part):
    named = dataclasses.replace(dropped[0].conditions, surface='x\x1b]0;title\x07\x9b31m\n')
    run_of = dataclasses.replace(dropped[0], conditions=named, engine='\x1b[2J\x07\r')
    write_log(part('l_bracket'), run_of, dropped[1][:1])
    for command in ('info', 'recover', 'report'):
        ended = run(command, 'run')
        for line in (ended.stdout + ended.stderr).split('\n'):
            assert line.isprintable()
    assert '\\x1b[2J' in run('info', 'run').stdout


def test_ids_of_another_aspect_numbering_are_refused(run, log, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(distribution_conversions, 'ASPECT_NUMBERING', ASPECT_NUMBERING + 1)
        other = log('other')
    found = f'aspect_numbering {ASPECT_NUMBERING + 1}: expected {ASPECT_NUMBERING} ('
    for words in (['info', other], ['compare', other, log()]):
        assert found in run(*words).stderr
    assert logged_result(other).distribution.drops == DROPS  # its poses are counted again


def test_info_of_an_unfinished_log(run, log):
    folder = log(batches=2)
    shown = ' '.join(run('info', folder).stdout.split())
    for words in ('not closed', 'drops 200 of 300', 'Distribution of 200 drops of an unfinished'):
        assert words in shown
    document = json.loads(run('info', folder, '--json').stdout)
    assert (document['complete'], document['drops'], document['drops_asked']) == (False, 200, 300)


def test_recover_prints_the_contents_of_each_log(run, log, tmp_path):
    whole, two, three, busy = log('whole'), log('two', 2), log('three', 3), log('busy', 2)
    names = ('whole/whole_0.mcap', 'busy/busy_0.mcap')
    before = [(tmp_path / name).read_bytes() for name in names]
    with (busy / 'busy_0.mcap').open('ab') as writer:
        assert lock_file(writer)  # like the recorder
        ended = run('recover', whole, 'x' * 300, two, 'nowhere', three, busy)
    of_two = '200 of 300 drops of l_bracket, the others are not in this log'
    assert ended.stdout.splitlines() == [
        f'{whole}: is already closed, 7 messages, 300 of 300 drops of l_bracket',
        f'{two}: 5 messages recovered, {of_two}',
        f'{three}: 7 messages recovered, 300 of 300 drops of l_bracket',
        f'{busy}: is being written, not changed',
    ]
    assert ended.returncode == 2
    of_long, of_nowhere = ended.stderr.splitlines()
    assert 'cannot be read: File name too long; expected ' in of_long
    assert "error: log 'nowhere' cannot be read: No such file or directory" in of_nowhere
    assert [(tmp_path / name).read_bytes() for name in names] == before
    assert not (busy / 'metadata.yaml').exists()
    assert run('recover', two).stdout == f'{two}: is already closed, 5 messages, {of_two}\n'


def test_unfinished_log_is_used_with_a_warning(run, log):
    cut = log('cut', 2)
    ended = run('compare', cut, log('closed'))
    assert ended.returncode == 0, ended.stderr
    assert f"warning: log '{cut}' was not closed" in ended.stderr
    assert ended.stderr.count('was not closed') == 1
    with (cut / 'cut_0.mcap').open('rb') as writer:
        lock_file(writer)
        assert f"warning: log '{cut}' is being written" in run('compare', cut, cut).stderr


def test_file_with_a_name_invalid_in_metadata_is_not_recovered(run, log):
    odd = os.fsdecode(b'\xff')
    folder = log(batches=0)
    (folder / 'run_0.mcap').rename(folder / f'{odd}.mcap')
    ended = run('recover', folder)
    assert (ended.returncode, r'\udcff.mcap' in ended.stderr) == (1, True)
    assert [file.name for file in folder.iterdir()] == [f'{odd}.mcap']


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('asked', 'ranges', 'whole'),
    [
        ({'drops': 5000, 'precision': 0.1}, [(0, 140)], True),  # canceled before its precision
        ({'drops': 300}, [(0, 70), (110, 210)], False),  # those between are lost
    ],
)
def test_from_log_repeats_the_recorded_drops(
    run, write_log, solid, solids, surfaces, tmp_path, asked, ranges, whole
):
    # Part and conditions are not defined by the mesh and the surface alone.
    odd = solid(
        solids.box(10, 20, 30),
        'obj',
        unit='in',
        mass=0.731,
        centre_of_mass=[0.013, -0.11, 0.19],
        inertia=[0.0731, 1e-5, 3e-6, 0.061, -2e-5, 0.05],
    )
    conditions = surfaces.get('steel').changed(
        height=1.1, height_of=HeightOf.CENTRE_OF_MASS, speed_horizontal=0.7, spin=3.3
    )
    job, run_of = plan_run(odd, conditions, seed=2**64 - 1, run_id='4f1c', started=1, **asked)
    poses = [drop_range(job, first, end) for first, end in ranges]
    folder = write_log(odd, run_of, poses, whole=whole)
    ended = run('drop', '--from-log', folder, '--poses', 'again.csv', '--json')
    assert ended.returncode == 0, ended.stderr
    assert 'warning' not in ended.stderr
    document = json.loads(ended.stdout)
    first, end = ranges[0][0], ranges[-1][1]
    assert document['complete']
    assert document['drops'] == document['drops_asked'] == end - first
    assert document['part_sha256'] == odd.part_sha256
    assert document['precision'] == run_of.precision
    with (tmp_path / 'again.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['drop']) for row in rows] == list(range(first, end))
    again = [[float(row[name]) for name in ('qx', 'qy', 'qz', 'qw')] for row in rows]
    assert again == drop_range(job, first, end).orientation.tolist()


@pytest.mark.slow
def test_log_of_bullet_is_repeated_with_bullet(run, tmp_path):
    words = ('--engine', 'bullet', '--poses')
    assert run('drop', 'tetrahedron', '--drops', 10, '--log', '.', *words, 'a').returncode == 0
    (log,) = tmp_path.glob('*/*.mcap')
    ended = run('drop', '--from-log', log, *words, 'b')
    assert (ended.returncode, 'warning' in ended.stderr) == (0, False)
    assert (tmp_path / 'a').read_bytes() == (tmp_path / 'b').read_bytes()
    assert 'recorded with bullet' in run('drop', '--from-log', log).stderr
