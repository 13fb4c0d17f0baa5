"""The action drop_part: its results, and the batches on resting_poses."""

import dataclasses

import numpy as np
import pytest
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.ros.conversions import nanoseconds, poses_from, run_from
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

DROPS = 1000


@pytest.fixture(scope='module')
def received(suite):
    """Return a list of all batches of the module."""
    return suite.client.poses()


@pytest.fixture(scope='module')
def drop(suite, received):
    """Return a finished goal."""
    return suite.client.drop('tetrahedron', DROPS, seed=11)


@pytest.fixture(scope='module')
def batches(suite, drop, received):
    return suite.client.batches_of(received, drop.result.run_id)


def assert_same_poses(batches, expected):
    poses = RestingPoses.join([poses_from(batch) for batch in batches])
    assert (poses.first_drop, poses.end) == (expected.first_drop, expected.end)
    for field in dataclasses.fields(RestingPoses)[1:]:
        np.testing.assert_array_equal(getattr(poses, field.name), getattr(expected, field.name))


def test_goal_publishes_the_drops_of_the_engine(drop, batches, engine, part, surfaces):
    result = drop.result
    assert (drop.outcome, result.status) == ('succeeded', Status(code=Status.OK))
    codes = [code for batch in batches for code in batch.status]
    for state in ('SETTLED', 'UNSETTLED', 'FAILED'):
        assert getattr(result, state.lower()) == codes.count(getattr(RestingPosesMsg, state))
    assert result.settled + result.unsettled + result.failed == result.drops == DROPS
    assert [batch.last for batch in batches] == [False] * (len(batches) - 1) + [True]
    # On a busy machine, a message can be published before it has all drops of the run.
    assert len(batches) <= 2
    assert_same_poses(batches, engine(DROPS, 11))

    # Every batch describes the run.
    started = nanoseconds(batches[0].run.started)
    given = {'seed': 11, 'drops': DROPS, 'run_id': result.run_id, 'started': started}
    expected = plan_run(part('tetrahedron'), surfaces.get(), **given)[1]
    for batch in batches:
        assert run_from(batch.run) == expected
        assert batch.header.frame_id == FRAME == 'tray'
        assert nanoseconds(batch.header.stamp) >= started > 0


def test_drops_before_a_cancel_are_published(suite, received, engine):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=13)
    suite.client.wait(lambda: drop.feedback, 'first feedback')
    result = suite.client.canceled(drop).result
    assert (drop.outcome, result.status.code) == ('canceled', Status.CANCELED)
    assert 0 < result.drops < 2_000_000
    batches = suite.client.batches_of(received, result.run_id)
    assert batches[-1].last
    assert all(batch.run.drops == 2_000_000 for batch in batches)
    poses = RestingPoses.join([poses_from(batch) for batch in batches])
    assert (poses.first_drop, len(poses)) == (0, result.drops)
    assert result.settled == int((poses.status == RestStatus.SETTLED).sum())
    assert_same_poses(batches[:1], engine(len(batches[0].status), 13))


def test_drops_of_a_run_are_published_again(suite, received, drop, batches):
    run_id = drop.result.run_id
    again = suite.client.drop('tetrahedron', 30, first_drop=20, seed=11, run_id=run_id).result
    assert (again.status.code, again.run_id, again.drops) == (Status.OK, run_id, 30)

    def newest():
        return next((b for b in reversed(received) if b.run.run_id == run_id), None)

    suite.client.wait(lambda: newest().first_drop == 20, 'drops')
    assert (newest().run, newest().last, len(newest().status)) == (batches[0].run, False, 30)


def test_only_drops_of_runs_of_this_simulator_are_published_again(suite, drop):
    for run_id, code in (
        ('another', Status.NOT_AVAILABLE),
        (drop.result.run_id, Status.INVALID),  # of another seed
        ('../../escape', Status.INVALID),
    ):
        refused = suite.client.drop(drops=5, seed=12, run_id=run_id)
        assert (refused.outcome, refused.result.status.code) == ('aborted', code)
