"""`info`, `recover` and `drop --from-log`, which need only a log."""

import csv
import dataclasses
import importlib
import json
from contextlib import closing

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.logs.bag import OUTCOME, LogOutcome
from resting_aspects_ros.logs.mcap_file import McapFile
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import part_msg, poses_msgs
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.run_logs.contents import logged_result
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses
from resting_aspects_ros.system import lock_file

POSES = Topic('/cell/resting_poses', POSES_TYPE, Qos(2000))
PART = Topic('/cell/parts/solid', PART_TYPE, Qos(1))
DISTRIBUTION = Topic('/cell/aspect_distributions/solid', DISTRIBUTION_TYPE, Qos(1))
DROPS = 300


@pytest.fixture(scope='module')
def dropped(part, surfaces):
    """Return a run with special conditions, and its poses."""
    conditions = surfaces.get('steel').changed(height=0.045, friction=0.31)
    job, run = plan_run(
        part('l_bracket'), conditions, seed=77, drops=DROPS, run_id='4f1c', started=10**18
    )
    return run, drop_range(job, 0, DROPS)


@pytest.fixture
def log(tmp_path, part, dropped):
    """Write a log like the recorder, in batches of 100; ``batches``: unfinished after these."""

    def log(name='run', batches=None):
        run, poses = dropped
        written = RunLog(tmp_path, name)
        written.add_metadata('run', {'run_id': run.run_id})
        written.write(PART, serialize_message(part_msg(part('l_bracket'))), 1)
        for k in range(3 if batches is None else batches):
            end = 100 * (k + 1)
            (batch,) = poses_msgs(poses.between(100 * k, end), run, Time(), last=end == DROPS)
            written.write(POSES, serialize_message(batch), 2 + k)
            found = count_poses(find_aspects(part('l_bracket')), poses.between(0, end))
            message = distribution_msg(found, run, Time(), end == DROPS)
            written.write(DISTRIBUTION, serialize_message(message), 2 + k)
            written.flush()
        size = written.path.stat().st_size
        if batches is None:
            written.add_metadata(OUTCOME, LogOutcome(DROPS, whole=True).record())
        written.close()
        if batches is not None:
            (written.path.parent / 'metadata.yaml').unlink()
            written.path.write_bytes(written.path.read_bytes()[:size])
        return written.path.parent

    return log


def test_control_characters_of_a_log_are_not_printed(run, dropped, part, tmp_path):
    odd = dict.fromkeys(
        ('engine', 'engine_version', 'suite_version', 'part_sha256'), '\x1b[2J\x07\r'
    )
    named = dataclasses.replace(dropped[0].conditions, surface='x\x1b]0;title\x07\x9b31m\n')
    run_of = dataclasses.replace(dropped[0], conditions=named, **odd)
    with closing(RunLog(tmp_path, 'run')) as log:
        log.write(PART, serialize_message(part_msg(part('l_bracket'))), 1)
        (batch,) = poses_msgs(dropped[1].between(0, 100), run_of, Time(), last=True)
        log.write(POSES, serialize_message(batch), 2)
    for command in ('info', 'recover', 'report'):
        ended = run(command, 'run')
        for line in (ended.stdout + ended.stderr).split('\n'):
            assert line.isprintable()
    assert '\\x1b[2J' in run('info', 'run').stdout


@pytest.mark.parametrize('words', ['replay', 'drop --from-log'])
def test_log_of_another_version_is_refused(run, log, monkeypatch, words):
    run_log = importlib.import_module('resting_aspects_ros.logs.writer')
    load = run_log.load_schema
    older = 'RIHS01_' + 64 * '0'
    with monkeypatch.context() as patch:
        patch.setattr(
            run_log, 'load_schema', lambda name: dataclasses.replace(load(name), type_hash=older)
        )
        folder = log()
    ended = run(*words.split(), folder)
    (line,) = ended.stderr.splitlines()
    assert ended.returncode in (1, 2)
    assert 'another version' in line
    assert older in line
    assert ended.stdout == ''


def test_ids_of_another_aspect_numbering_are_refused(run, log, dropped, part, tmp_path):
    poses = dropped[1]
    counted = count_poses(find_aspects(part('l_bracket')), poses)
    message = distribution_msg(counted, dropped[0], Time(), True)
    message.aspect_numbering += 1
    with closing(RunLog(tmp_path, 'other')) as other:
        other.write(PART, serialize_message(part_msg(part('l_bracket'))), 1)
        (batch,) = poses_msgs(poses, dropped[0], Time(), last=True)
        other.write(POSES, serialize_message(batch), 2)
        other.write(DISTRIBUTION, serialize_message(message), 3)
    for words in (['info', 'other'], ['compare', 'other', log()]):
        ended = run(*words)
        assert ended.returncode in (1, 2)
        found = f'aspect_numbering {ASPECT_NUMBERING + 1}: expected {ASPECT_NUMBERING} ('
        assert found in ended.stderr
    counts = logged_result(tmp_path / 'other').distribution.counts
    assert counts.tolist() == counted.counts.tolist()


@pytest.mark.parametrize('closed', [True, False])
def test_a_log_is_read_once(run, log, monkeypatch, closed):
    folder = log(batches=None if closed else 2)
    passes = []
    records = McapFile.records
    monkeypatch.setattr(McapFile, 'records', lambda file: passes.append(1) or records(file))
    assert run('info', folder).returncode == 0
    assert len(passes) == (0 if closed else 1)  # by the index if it is closed


def test_info_of_an_unfinished_log(run, log):
    folder = log(batches=2)
    ended = run('info', folder)
    assert ended.returncode == 0
    lines = [' '.join(line.split()) for line in ended.stdout.splitlines()]
    for line in (
        (
            'not closed ("resting_aspects recover" closes it, so that all programs can read it), '
            '5 messages'
        ),
        'drops 200 of 300',
        'Distribution of 200 drops of an unfinished run',
    ):
        assert line in lines
    document = json.loads(run('info', folder, '--json').stdout)
    assert (document['log']['whole'], document['log']['poses']) == (False, 200)
    assert (document['complete'], document['drops'], document['drops_asked']) == (False, 200, 300)


def test_recover_prints_the_contents_of_each_log(run, log, tmp_path):
    whole, two, three = log('whole'), log('two', 2), log('three', 3)
    before = (whole / 'whole_0.mcap').read_bytes()
    too_long = tmp_path / ('x' * 300)
    ended = run('recover', whole, too_long, two, tmp_path / 'nowhere', three)
    of_two = '200 of 300 drops of l_bracket, the others are not in this log'
    assert ended.stdout.splitlines() == [
        f'{whole}: is already closed, 7 messages, 300 of 300 drops of l_bracket',
        f'{two}: 5 messages recovered, {of_two}',
        f'{three}: 7 messages recovered, 300 of 300 drops of l_bracket',
    ]
    assert ended.returncode == 2
    nowhere = str(tmp_path / 'nowhere')
    of_long, of_nowhere = ended.stderr.splitlines()
    assert 'cannot be read: File name too long; expected ' in of_long
    assert of_nowhere == (
        f'error: log {nowhere!r} cannot be read: No such file or directory; expected the folder '
        'of a run, or an .mcap file'
    )
    assert (whole / 'whole_0.mcap').read_bytes() == before
    assert run('recover', two, three).stdout.splitlines() == [
        f'{two}: is already closed, 5 messages, {of_two}',
        f'{three}: is already closed, 7 messages, 300 of 300 drops of l_bracket',
    ]
    lines = [' '.join(line.split()) for line in run('info', two).stdout.splitlines()]
    assert 'closed, 5 messages' in lines
    assert 'drops 200 of 300, the others are not in this log' in lines


def test_recover_does_not_change_a_log_being_written(run, log, tmp_path):
    two, empty = log('two', 2), tmp_path / 'started'
    empty.mkdir()
    writers = [path.open('ab') for path in (two / 'two_0.mcap', empty / 'started_0.mcap')]
    for writer in writers:
        assert lock_file(writer)  # like the recorder
    before = (two / 'two_0.mcap').read_bytes()
    ended = run('recover', two, empty, log('three', 3))
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.splitlines()[:2] == [
        f'{two}: is being written, not changed',
        f'{empty}: is being written, not changed',
    ]
    assert (two / 'two_0.mcap').read_bytes() == before
    assert not (two / 'metadata.yaml').exists()
    for writer in writers:
        writer.close()
    assert 'recovered' in run('recover', two).stdout


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('words', ['compare LOG LOG', 'drop --drops 1 --from-log LOG'])
def test_unfinished_log_is_used_with_a_warning(run, log, words):
    closed, cut = log('closed'), log('cut', 2)

    def said(folder):
        ended = run(*(folder if word == 'LOG' else word for word in words.split()))
        assert ended.returncode == 0, ended.stderr
        return ended.stderr

    assert 'being written' not in said(closed)
    assert 'not closed' not in said(closed)
    assert f"warning: log '{cut}' was not closed" in said(cut)
    (file,) = cut.glob('*.mcap')
    with file.open('rb') as writer:
        lock_file(writer)
        assert f"warning: log '{cut}' is being written" in said(cut)


@pytest.mark.parametrize('command', ['recover', 'drop --from-log'])
def test_a_log_damaged_in_its_middle_is_refused(run, log, command):
    folder = log()
    file = folder / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    at = content.index(b'zstd')
    if command == 'recover':  # the others read only the first batch
        at = content.index(b'zstd', at + 9)
    content[at + 40] ^= 1
    file.write_bytes(content)
    ended = run(*command.split(), folder)
    assert ended.returncode == (2 if command.startswith('drop') else 1)
    (line,) = ended.stderr.splitlines()
    assert f'log {str(file)!r} is damaged: found ' in line
    assert ended.stdout == ''
    assert [path.name for path in sorted(folder.iterdir())] == ['metadata.yaml', 'run_0.mcap']
    assert file.read_bytes() == content


def rows(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


@pytest.fixture
def log_of(tmp_path):
    """Write a closed log that has some drops of a run, like the recorder."""

    def log_of(part, run_of, poses, *, last=True, whole=True):
        with closing(RunLog(tmp_path, 'run')) as log:
            log.write(PART, serialize_message(part_msg(part)), 1)
            for k, batch in enumerate(poses):
                is_last = last and k == len(poses) - 1
                (message,) = poses_msgs(batch, run_of, Time(), last=is_last)
                log.write(POSES, serialize_message(message), 2 + k)
            outcome = LogOutcome(sum(len(batch) for batch in poses), whole=whole)
            log.add_metadata(OUTCOME, outcome.record())
        return log.path.parent

    return log_of


def table(poses):
    """Return the numbers of each drop, in the order of the columns of the CSV."""
    return [
        [poses.first_drop + k, *poses.position[k], *poses.orientation[k], poses.time_to_rest[k]]
        for k in range(len(poses))
    ]


COLUMNS = ('drop', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw', 'time_to_rest')


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('asked', 'ranges', 'whole'),
    [
        ({'drops': 5000, 'precision': 0.1}, [(0, 140)], True),  # canceled before its precision
        ({'drops': 300}, [(0, 70), (110, 210)], False),  # those between are lost
    ],
)
def test_from_log_repeats_the_recorded_drops(
    run, log_of, box, solid, surfaces, tmp_path, asked, ranges, whole
):
    # Part and conditions are not defined by the mesh and the surface alone.
    odd = solid(
        box,
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
    folder = log_of(odd, run_of, poses, last=whole, whole=whole)
    ended = run('drop', '--from-log', folder, '--poses', 'again.csv', '--json')
    assert ended.returncode == 0, ended.stderr
    assert 'warning' not in ended.stderr
    document = json.loads(ended.stdout)
    first, end = ranges[0][0], ranges[-1][1]
    drops = end - first
    assert (document['complete'], document['drops'], document['drops_asked']) == (
        True,
        drops,
        drops,
    )
    assert document['part_sha256'] == odd.part_sha256
    assert document['precision'] == run_of.precision
    found = [[float(row[name]) for name in COLUMNS] for row in rows(tmp_path / 'again.csv')]
    assert found == table(drop_range(job, first, end))


def test_from_log_refuses_a_log_without_drops(log_of, dropped, part, refused):
    folder = log_of(part('l_bracket'), dropped[0], [dropped[1].between(0, 0)])
    assert refused('drop', '--from-log', folder).endswith(
        f'invalid log {str(folder)!r}: expected a log with drops'
    )


def test_a_run_from_a_log_can_be_longer(run, log, dropped, tmp_path):
    ended = run('drop', '--from-log', log(), '--drops', 310, '--poses', 'again.csv')
    assert ended.returncode == 0
    found = [float(row['x']) for row in rows(tmp_path / 'again.csv')]
    assert (len(found), found[:DROPS]) == (310, dropped[1].position[:, 0].tolist())


@pytest.mark.slow
def test_log_of_bullet_is_repeated_with_bullet(run, tmp_path):
    words = ('--engine', 'bullet', '--poses')
    assert run('drop', 'tetrahedron', '--drops', 10, '--log', '.', *words, 'a').returncode == 0
    (log,) = tmp_path.glob('*/*.mcap')
    ended = run('drop', '--from-log', log, *words, 'b')
    assert (ended.returncode, 'warning' in ended.stderr) == (0, False)
    assert (tmp_path / 'a').read_bytes() == (tmp_path / 'b').read_bytes()
    assert 'recorded with bullet' in run('drop', '--from-log', log).stderr


@pytest.mark.parametrize('words', ['info', 'recover', 'replay', 'drop --from-log'])
def test_all_commands_refuse_a_non_log_with_equal_errors(refused, tmp_path, words):
    for folder in ('folder', 'logs/a', 'logs/b'):
        (tmp_path / folder).mkdir(parents=True)
    for name in 'ab':
        (tmp_path / 'logs' / name / f'{name}_0.mcap').touch()
    (tmp_path / 'text.txt').write_text('hello')
    for path, said in {
        'nowhere': 'No such file',
        'folder': 'no .mcap file',
        'logs': '2 of its subfolders',
        'text.txt': "b'hello'",
    }.items():
        line = refused(*words.split(), path)
        assert repr(path) in line
        assert said in line
