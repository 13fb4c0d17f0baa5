"""A restarted classifier knows the distributions in the logs of earlier runs."""

import shutil

import pytest
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    DropConditions,
    PartDescription,
    RestingPoses,
    Status,
)

from resting_aspects_ros.cli.main import main
from resting_aspects_ros.client import pending_request
from resting_aspects_ros.ros.conversions import part_msg, poses_msg, time_msg
from resting_aspects_ros.ros.interface import LATCHED, POSES, RESTING_POSES
from resting_aspects_ros.simulation.conditions import parts_folder
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range

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
                'nodes.aspect_classifier.drop_part_requests.STARTUP_TIMEOUT': 1.0,
                'nodes.aspect_classifier.part_registry.QUIET_PERIOD': 1.0,
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


def start_again(suite, *nodes):
    """Restart the nodes, which then have no data in memory and no latched messages."""
    for node in nodes:
        assert suite.processes[node].end() == 0
    for node in nodes:
        suite.start_again(node)


@pytest.fixture(scope='module')
def restarted(suite, first):
    start_again(suite, 'drop_simulator', 'aspect_classifier')
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
    assert restarted.client.parts()['tetrahedron'].known


def test_known_distribution_is_published(restarted, first):
    received = restarted.client.listen(
        AspectDistribution, 'aspect_distributions/tetrahedron', LATCHED
    )
    restarted.client.wait(lambda: received, 'distribution')
    assert without_stamp(received[0]) == without_stamp(first)


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


def test_changed_mesh_is_another_version(restarted, first, folder):
    shutil.copy(parts_folder() / 'hex_nut.stl', folder / 'tetrahedron.stl')

    def offered():
        part = restarted.client.parts().get('tetrahedron')
        return part is not None and part.part_sha256 != first.run.part_sha256

    restarted.client.wait(offered, 'new version')
    answer = known(restarted)
    assert answer.status.code == Status.NOT_AVAILABLE
    assert answer.status.message.endswith(
        '; known distributions: 300 drops on rubber_mat of another version of the part'
    )
    assert not restarted.client.parts()['tetrahedron'].known
    shutil.copy(parts_folder() / 'tetrahedron.stl', folder)
    restarted.client.wait(lambda: not offered(), 'old version')
    assert known(restarted).status.code == Status.OK


def test_known_distribution_needs_no_simulator(restarted, first):
    assert restarted.processes['drop_simulator'].end() == 0
    start_again(restarted, 'aspect_classifier')
    answer = known(restarted, surface='rubber_mat')
    assert without_stamp(answer.distribution) == without_stamp(first)
    restarted.start_again('drop_simulator')


@pytest.fixture
def request_of(restarted, capfd, monkeypatch):
    """Run the request command; return the exit code and the output of both streams."""
    monkeypatch.setattr(pending_request, 'SIMULATOR_TIMEOUT', 1.0)

    def request_of(*arguments):
        ros = ('--ros-args', '-r', f'__ns:={restarted.namespace}')
        code = main(['request', 'tetrahedron', *arguments, *ros])
        return code, *capfd.readouterr()

    return request_of


@pytest.mark.slow
def test_request_command_uses_logs_without_a_simulator(restarted, first, request_of):
    assert restarted.processes['drop_simulator'].end() == 0
    start_again(restarted, 'aspect_classifier')
    surface = ('--surface', 'rubber_mat')
    _, table, _ = request_of('--drops', '200', *surface)
    name, arguments, *_ = (line.rstrip() for line in table.splitlines())
    assert name == 'tetrahedron'  # of a log; its size is known to the simulator
    assert arguments == f'300 drops on rubber_mat, seed {SEED}'
    code, _, printed = request_of('--drops', '200', '--json', *surface)
    assert code == 0
    # On a busy machine it may also print that it waits for the classifier.
    assert printed.endswith('no drop_simulator offers tetrahedron\n')
    code, _, printed = request_of('--drops', '301', *surface)
    assert code == 1
    assert printed.endswith(
        f'error: no drop_simulator answers on {restarted.namespace}/drop_part, waited 1 s: '
        'start drop_simulator; no known distribution of tetrahedron under these conditions '
        'has at least 301 drops; known distributions: 300 drops on rubber_mat\n'
    )
    restarted.start_again('drop_simulator')


# Runs of the box in the order in which they end: id, seed, drops, and start time, from clocks that
# stop or go backwards.
RUNS = [
    ('b_same', 31, 60, 10**18),
    ('a_same', 31, 60, 10**18),
    ('newer', 32, 60, 2 * 10**18),
    ('older', 32, 60, 10**18),
    ('long', 33, 60, 10**18),
    ('short', 33, 40, 3 * 10**18),
    ('first', 34, 70, 10**18),
    ('last', 35, 70, 10**18),
]
# Requests, and the run that is returned, by requested seed; None: without a seed.
ANSWERS = {31: 'b_same', 32: 'newer', 33: 'long', 34: 'first', 35: 'last', None: 'last'}


@pytest.mark.slow
def test_selected_run_is_the_same_after_a_restart(
    part, surfaces, start, connect, namespace, tmp_path
):
    box, client = part('box_10x20x30'), connect(namespace)
    parameters = {'log_folder': tmp_path}
    recorder = start('drop_recorder', namespace, parameters)
    classifier = start('aspect_classifier', namespace, parameters)
    conditions = surfaces.get()

    def answers(client):
        found = {}
        for seed in ANSWERS:
            seeds = [] if seed is None else [seed]
            answer = client.ask(box.name, 1, only_known=True, seed=seeds, surface='rubber_mat')
            assert answer.status.code == Status.OK, answer.status.message
            found[seed] = answer.distribution
        return found

    described = client.node.create_publisher(PartDescription, f'parts/{box.name}', LATCHED)
    described.publish(part_msg(box))
    poses = client.node.create_publisher(RestingPoses, RESTING_POSES, POSES)
    for run_id, seed, drops, started in RUNS:
        job, run = plan_run(
            box, conditions, seed=seed, drops=drops, run_id=run_id, started=started
        )
        poses.publish(poses_msg(drop_range(job, 0, drops), run, time_msg(1), True))
        client.wait(
            lambda run_id=run_id: list(tmp_path.glob(f'*_{run_id}/metadata.yaml')), 'closed log'
        )
    before = answers(client)
    assert {seed: found.run.run_id for seed, found in before.items()} == ANSWERS
    assert (recorder.end(), classifier.end()) == (0, 0)
    # In another namespace, which has no latched messages.
    again = f'{namespace}_again'
    start('aspect_classifier', again, parameters)
    after = answers(connect(again))
    assert {seed: found.run.run_id for seed, found in after.items()} == ANSWERS
    for seed, found in after.items():
        assert without_stamp(found) == without_stamp(before[seed])
