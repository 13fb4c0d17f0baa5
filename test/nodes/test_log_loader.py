"""The distributions that the classifier reads from the logs of earlier runs."""

import asyncio
import os
import shutil
from types import SimpleNamespace

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import InvalidValueError, LogError
from resting_aspects_ros.logs.bag import LogOutcome
from resting_aspects_ros.nodes.aspect_classifier.known import LogLoader, load_log, logs_in
from resting_aspects_ros.ros.conversions import poses_msgs, time_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import count_poses

SEED = 5


@pytest.fixture(scope='module')
def run(part, surfaces):
    given = {'seed': SEED, 'drops': 125, 'run_id': '4f1c', 'started': 10**18}
    return plan_run(part('tetrahedron'), surfaces.get(), **given)[1]


@pytest.fixture(scope='module')
def counted(part, engine):
    """Return the distribution of the first drops of the run."""
    aspects = find_aspects(part('tetrahedron'))
    return lambda end=125: count_poses(aspects, engine(125, SEED).between(0, end))


@pytest.fixture
def write(tmp_path, run, counted, engine, write_run):
    """Return a function that writes a log and returns its folder."""

    def write(pieces=((0, 125),), *, whole=True, described='', **changes):
        message = distribution_msg(counted(), run, time_msg(1), complete=True)
        for name, value in changes.items():
            setattr(message, name, value)
        poses = [engine(125, SEED).between(*piece) for piece in pieces]
        batches = [b for each in poses for b in poses_msgs(each, run, time_msg(1), last=False)]
        outcome = LogOutcome(125, whole)
        return write_run(tmp_path, run, outcome, batches, message if whole else None, described)

    return write


@pytest.mark.parametrize('numbering', [ASPECT_NUMBERING, ASPECT_NUMBERING + 1])
def test_drops_are_recounted_only_for_another_numbering(write, run, counted, numbering):
    # The distribution differs from the drops of the log.
    aspects = distribution_msg(counted(), run, time_msg(1), complete=True).aspects
    aspects[0].count += 125
    written = {'aspects': aspects, 'drops': 250, 'aspect_numbering': numbering}
    found_run, found = load_log(write(**written))
    recounted = numbering != ASPECT_NUMBERING
    assert (found_run, found.drops) == (run, 125 if recounted else 250)
    assert (found.counts.tolist() == counted().counts.tolist()) == recounted


def test_first_drops_of_a_log_with_gaps_are_counted(write, run, counted):
    """The pieces are in any order, without drops 100 to 109."""
    found_run, found = load_log(write([(0, 40), (110, 125), (40, 100)], whole=False))
    assert found_run == run
    assert found.counts.tolist() == counted(100).counts.tolist()


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'pieces': [(10, 20)], 'whole': False}, 'it does not contain the first drops'),
        ({'described': 'washer', 'whole': False}, 'it does not describe its part'),
        ({'drops': 1}, 'expected 1 drops in aspects'),
    ],
)
def test_incomplete_or_inconsistent_log_is_rejected(write, given, expected):
    with pytest.raises((LogError, InvalidValueError), match=expected):
        load_log(write(**given))


def test_newest_logs_are_read_first(tmp_path):
    names = ['nut_20220101T000000Z_4', 'box_20210101T000000Z_1', 'nut_20200101T000000Z_2']
    for name in (*sorted(names), 'no_log'):
        (tmp_path / name).mkdir()
    (tmp_path / 'file_20200101T000000Z_5').write_bytes(b'')
    (tmp_path / 'link_20200101T000000Z_6').symlink_to('x' * 300)
    assert [log.name for log in logs_in(tmp_path)] == names
    assert logs_in(tmp_path / 'none') == []


def test_bad_log_is_reported_and_others_are_read(write, start, connect, namespace, tmp_path):
    log = write()
    text = tmp_path / 'nut_20990131T120000Z_4f1c'  # the log that is read first
    text.mkdir()
    (text / 'nut.mcap').write_text('text')
    shutil.copytree(log, tmp_path / 'tetrahedron_20300101T000000Z_cut')
    (cut,) = (tmp_path / 'tetrahedron_20300101T000000Z_cut').glob('*.mcap')
    cut.write_bytes(cut.read_bytes()[:-100])
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    answer = connect(namespace).ask(drops=125, surface='rubber_mat', only_known=True)
    assert answer.distribution.drops == 125
    (warning,) = [line for line in classifier.output.splitlines() if 'cannot be used' in line]
    assert f'2 logs in {tmp_path} cannot be used: {text.name}: ' in warning
    assert f'{cut.parent.name}: it is not closed: ' in warning


def test_requests_are_rejected_until_logs_are_read(start, connect, namespace, tmp_path):
    """The folder hangs, as a network file system can, until something is written to a pipe."""
    os.mkfifo(tmp_path / 'pipe')

    def hang(_):
        (tmp_path / 'pipe').read_text()
        return []

    constants = {'nodes.aspect_classifier.known.logs_in': hang}
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path}, constants, '')
    client = connect(namespace)
    assert client.ask(only_known=True).status.code == Status.NOT_AVAILABLE
    assert 'ready' not in classifier.output
    (tmp_path / 'pipe').write_text('')
    client.wait(lambda: 'ready' in classifier.output, 'end of the logs')


def test_unexpected_error_of_a_log_does_not_hide_the_others(tmp_path):
    class Files:
        async def run(self, function, path):
            return (path.name, None) if function is load_log else [path / 'b', path / 'a']

    class Known(dict):
        def add(self, name, _):
            if name == 'b':
                raise ValueError('operands could not be broadcast')
            self[name] = True

    known, lines = Known(), []
    node = SimpleNamespace(
        get_logger=lambda: SimpleNamespace(info=lines.append, warning=lines.append)
    )
    loader = LogLoader(node, tmp_path, Files(), known, ())
    asyncio.run(loader.load(lambda: None))
    assert loader.ready
    assert known == {'a': True}
    assert 'b: operands could not be broadcast' in lines[1]
