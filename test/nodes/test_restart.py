"""A restarted classifier knows the distributions in the logs of earlier runs."""

import shutil

import pytest
from resting_aspects_interfaces.msg import (
    Status,
)

from resting_aspects_ros.simulation.conditions import parts_folder

SEED = 5


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('parts')
    for name in ('box_10x20x30.stl', 'tetrahedron.stl'):
        shutil.copy(parts_folder() / name, folder)
    return folder


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    return fresh_suite(
        {
            'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2},
            'aspect_classifier': {
                'ros.goal_client.STARTUP_TIMEOUT': 1.0,
                'nodes.aspect_classifier.known.QUIET_PERIOD': 1.0,
            },
        },
        parts_folder=folder,
        workers=1,
    )


@pytest.fixture(scope='module')
def first(suite):
    """Return the distribution from the first classifier."""
    answer = suite.client.ask('tetrahedron', 300, seed=[SEED])
    assert answer.status.code == Status.OK
    suite.log_of(answer.distribution.run.run_id)
    return answer.distribution


@pytest.fixture(scope='module')
def restarted(suite, first):
    suite.restart('drop_simulator', 'aspect_classifier')
    return suite


def without_stamp(distribution):
    distribution.header.stamp.sec = distribution.header.stamp.nanosec = 0
    return distribution


def known(suite, part='tetrahedron', drops=300, **fields):
    return suite.client.ask(part, drops, only_known=True, **fields)


def test_known_distribution_is_returned_at_once(restarted, first):
    answer = known(restarted, seed=[SEED])
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    assert without_stamp(answer.distribution) == without_stamp(first)
    # Without only_known, nothing is dropped either: the run is the old one.
    again = restarted.client.ask('tetrahedron', 200)
    assert again.distribution.run.run_id == first.run.run_id


def test_known_distribution_needs_no_simulator(restarted, first):
    restarted.nodes['drop_simulator'].end()
    restarted.restart('aspect_classifier')
    answer = known(restarted, surface='rubber_mat')
    assert without_stamp(answer.distribution) == without_stamp(first)
    restarted.start_again('drop_simulator')
