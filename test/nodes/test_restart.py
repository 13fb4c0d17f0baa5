"""A restarted classifier knows the distributions in the logs of earlier runs."""

import shutil

import pytest
from resting_aspects_interfaces.msg import (
    DropConditions,
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
                'nodes.drop_client.STARTUP_TIMEOUT': 1.0,
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


@pytest.mark.parametrize('fields', [{'drops': 301}, {'surface': 'steel'}, {'seed': [SEED + 1]}])
def test_different_requests_are_not_known(restarted, first, fields):
    answer = known(restarted, **fields)
    assert answer.status.code == Status.NOT_AVAILABLE
    with_seed = f' with seed {SEED}' if 'seed' in fields else ''
    assert answer.status.message.endswith(
        f'; known distributions: 300 drops on rubber_mat{with_seed}'
    )


def test_conditions_are_compared_by_value(restarted, first):
    conditions = first.run.conditions
    assert known(restarted, conditions=[conditions]).status.code == Status.OK
    fields = {name: getattr(conditions, name) for name in conditions.get_fields_and_field_types()}
    other = DropConditions(**{**fields, 'height': conditions.height * (1 + 1e-15)})
    answer = known(restarted, conditions=[other])
    assert answer.status.code == Status.NOT_AVAILABLE


def test_known_distribution_needs_no_simulator(restarted, first):
    restarted.nodes['drop_simulator'].end()
    restarted.restart('aspect_classifier')
    answer = known(restarted, surface='rubber_mat')
    assert without_stamp(answer.distribution) == without_stamp(first)
    restarted.start_again('drop_simulator')
