"""`resting_aspects merge`: logs of runs counted together, each drop once."""

import json

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.statistics.distribution import count_poses
from resting_aspects_ros.logs.run_writer import RunLog
from resting_aspects_ros.logs.topic_metadata import Qos, Topic
from resting_aspects_ros.ros.conversions import part_msg, poses_msg
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.plan import plan_run

POSES = Topic('/resting_poses', 'resting_aspects_interfaces/msg/RestingPoses', Qos(2000))
PART = Topic('/parts/tetrahedron', 'resting_aspects_interfaces/msg/PartDescription', Qos(1))
DROPS = 60


@pytest.fixture(scope='module')
def dropped(part, surfaces):
    """Return the poses of the first drops of a seed, and the description of their run."""
    made = {}

    def dropped(seed):
        if seed not in made:
            job, run = plan_run(
                part('tetrahedron'),
                surfaces.get(),
                seed=seed,
                drops=DROPS,
                run_id=f'run{seed}',
                started=10**18,
            )
            made[seed] = drop_range(job, 0, DROPS), run
        return made[seed]

    return dropped


@pytest.fixture
def log(tmp_path, part, dropped):
    """Write a log with some drops of a seed, and with the part if ``described``."""

    def log(name, seed, first=0, end=DROPS, described=True):
        poses, run = dropped(seed)
        with RunLog(tmp_path, name) as written:
            if described:
                written.write(PART, serialize_message(part_msg(part('tetrahedron'))), 1)
            for low, high in ((first, (first + end) // 2), ((first + end) // 2, end)):
                batch = poses_msg(poses.between(low, high), run, Time(), high == end)
                written.write(POSES, serialize_message(batch), 2)
        return name

    return log


@pytest.fixture
def merged(run):
    def merged(*words):
        ended = run('merge', *words, '--json')
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return merged


def counts(poses, part):
    return count_poses(find_aspects(part('tetrahedron')), poses).counts


def test_runs_of_two_seeds_add_up(merged, log, dropped, part):
    found = merged(log('a', 1), log('b', 2))
    assert (found['drops'], found['seeds'], found['runs']) == (120, [1, 2], [['run1'], ['run2']])
    expected = counts(dropped(1)[0], part) + counts(dropped(2)[0], part)
    assert [a['count'] for a in found['aspects']] == expected.tolist()


def test_drop_in_two_logs_counts_once(merged, log, dropped, part):
    found = merged(log('a', 1, 0, 40), log('b', 1, 20, 60), log('c', 1, described=False))
    assert found['drops'] == DROPS
    assert [a['count'] for a in found['aspects']] == counts(dropped(1)[0], part).tolist()


def test_merge_table_shows_number_of_runs(run, log):
    ended = run('merge', log('a', 1), log('b', 2))
    assert ended.returncode == 0
    assert ended.stdout.startswith('tetrahedron, 120 drops of 2 runs on rubber_mat')


def test_logs_without_part_description_are_refused(run, log):
    ended = run('merge', log('a', 1, described=False))
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: no description of the part in 'a': expected ")


def test_merge_refuses_a_file_that_is_not_a_log(run, tmp_path):
    (tmp_path / 'x.mcap').write_text('nothing of the kind', encoding='utf-8')
    ended = run('merge', 'x.mcap')
    assert 'is damaged, or not an MCAP file' in ended.stderr
    assert ended.returncode == 2
    assert 'cannot be read' in run('merge', 'gone.mcap').stderr
