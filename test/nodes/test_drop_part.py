"""The action drop_part: its results, and the batches on resting_poses."""

import dataclasses
import functools

import numpy as np
import pytest
from resting_aspects_interfaces.msg import RestingPose, Status

from resting_aspects_ros.ros.conversions import nanoseconds, poses_from
from resting_aspects_ros.ros.interface import FRAME, MIN_BATCH, POSES_DEPTH, batch_size
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

DROPS = 2 * MIN_BATCH + 30


@pytest.fixture(scope='module')
def received(suite):
    """Return a list of all batches of the module."""
    return suite.client.poses()


@pytest.fixture(scope='module')
def batches_of(suite, received):
    """Wait for the last batch of a run, and return all of them."""

    def batches_of(run_id):
        def batches():
            return [batch for batch in received if batch.run.run_id == run_id]

        suite.client.wait(lambda: any(b.last for b in batches()), f'end of run {run_id}')
        return batches()

    return batches_of


@pytest.fixture(scope='module')
def drop(suite, received):
    """Return a finished goal."""
    return suite.client.drop('tetrahedron', DROPS, seed=11)


@pytest.fixture(scope='module')
def batches(drop, batches_of):
    return batches_of(drop.result.run_id)


@pytest.fixture(scope='module')
def engine(part, surfaces):
    """Return the poses of the engine without a node."""

    @functools.cache
    def engine(name, first, end, seed):
        job, _ = plan_run(part(name), surfaces.get(), seed=seed, drops=end, run_id='', started=0)
        return drop_range(job, first, end)

    return engine


def assert_same_poses(batches, expected):
    poses = RestingPoses.join([poses_from(batch) for batch in batches])
    assert (poses.first_drop, poses.end) == (expected.first_drop, expected.end)
    for field in dataclasses.fields(RestingPoses)[1:]:
        np.testing.assert_array_equal(getattr(poses, field.name), getattr(expected, field.name))


def test_result_counts_every_drop(drop, batches):
    result = drop.result
    assert drop.outcome == 'succeeded'
    assert result.status == Status(code=Status.OK)
    assert result.drops == DROPS
    codes = [pose.status for batch in batches for pose in batch.poses]
    assert result.settled == codes.count(RestingPose.SETTLED)
    assert result.unsettled == codes.count(RestingPose.UNSETTLED)
    assert result.failed == codes.count(RestingPose.FAILED)
    assert result.settled + result.unsettled + result.failed == DROPS
    assert result.settled > 0


def test_feedback_grows_towards_the_total(drop):
    # rclpy discards feedback that arrives after the result: the last may be missing.
    done = [feedback.done for feedback in drop.feedback]
    assert done
    assert done == sorted(set(done))
    assert done[-1] <= DROPS
    assert {feedback.total for feedback in drop.feedback} == {DROPS}
    assert all(feedback.drops_per_second > 0 for feedback in drop.feedback)


def test_batches_are_full_and_consecutive(batches):
    assert [len(batch.poses) for batch in batches] == [MIN_BATCH, MIN_BATCH, 30]
    assert [batch.first_drop for batch in batches] == [0, MIN_BATCH, 2 * MIN_BATCH]
    assert [batch.last for batch in batches] == [False, False, True]


def test_every_batch_describes_its_run(drop, batches, part, surfaces):
    run = batches[0].run
    assert all(batch.run == run for batch in batches)
    assert run.run_id == drop.result.run_id
    assert (run.part, run.part_sha256) == ('tetrahedron', part('tetrahedron').part_sha256)
    assert (run.seed, run.first_drop, run.drops, run.precision) == (11, 0, DROPS, 0.0)
    assert run.conditions.height == surfaces.get().height
    assert run.conditions.surface == 'rubber_mat'
    assert run.time_step > 0
    for batch in batches:
        assert batch.header.frame_id == FRAME == 'tray'
        assert nanoseconds(batch.header.stamp) >= nanoseconds(run.started) > 0


def test_published_poses_equal_those_of_the_engine(batches, engine):
    assert_same_poses(batches, engine('tetrahedron', 0, DROPS, seed=11))


def test_drops_from_the_middle_equal_a_slice_of_the_run(suite, batches_of, engine):
    drop = suite.client.drop('tetrahedron', 40, first_drop=230, seed=11)
    batches = batches_of(drop.result.run_id)
    assert batches[0].run.first_drop == 230
    assert_same_poses(batches, engine('tetrahedron', 0, DROPS, seed=11).between(230, 270))


def test_exactly_full_batch_can_be_the_last(suite, batches_of):
    drop = suite.client.drop('tetrahedron', MIN_BATCH, seed=12)
    batches = batches_of(drop.result.run_id)
    assert [(len(batch.poses), batch.last) for batch in batches] == [(MIN_BATCH, True)]


@pytest.mark.parametrize(
    ('drops', 'size'),
    [(1, 250), (500_000, 250), (500_001, 251), (2_000_000, 1000), (1_999_999, 1000)],
)
def test_number_of_batches_is_at_most_the_qos_depth(drops, size):
    assert batch_size(drops) == size
    assert -(-drops // size) <= POSES_DEPTH


def test_drops_before_a_cancel_are_published(suite, batches_of, engine):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=13)
    suite.client.wait(lambda: drop.feedback, 'first feedback')
    drop.cancel()
    suite.client.wait(lambda: drop.done, 'canceled goal')
    result = drop.result
    assert drop.outcome == 'canceled'
    assert result.status.code == Status.CANCELED
    assert result.status.message == (
        f'canceled after {result.drops} of 2000000 drops; these are kept'
    )
    assert 0 < result.drops < 2_000_000
    batches = batches_of(result.run_id)
    assert [batch.last for batch in batches] == [False] * (len(batches) - 1) + [True]
    assert all(batch.run.drops == 2_000_000 for batch in batches)
    poses = RestingPoses.join([poses_from(batch) for batch in batches])
    assert (poses.first_drop, len(poses)) == (0, result.drops)
    assert result.settled == int((poses.status == RestStatus.SETTLED).sum())
    assert_same_poses(batches[:1], engine('tetrahedron', 0, len(batches[0].poses), seed=13))


def test_drops_before_a_cancel_are_known(suite, counts):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=14)
    suite.client.wait(lambda: drop.feedback, 'first feedback')
    drop.cancel()
    suite.client.wait(lambda: drop.done, 'canceled goal')

    def known():
        answer = suite.client.ask(drops=drop.result.drops, seed=[14], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    distribution = suite.client.wait(known, 'distribution of the canceled run')
    assert distribution.run.run_id == drop.result.run_id
    assert distribution.drops == sum(counts(distribution)) == drop.result.drops
