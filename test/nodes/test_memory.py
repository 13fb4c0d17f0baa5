"""A classifier that is started again knows what the logs of earlier runs hold."""

import os
import shutil

import pytest
from resting_aspects_interfaces.msg import AspectDistribution, DropConditions, Status

from resting_aspects_ros.config_files import parts_folder
from resting_aspects_ros.nodes.interface import LATCHED

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
        {'drop_simulator': {'part_offers.SCAN_PERIOD': 0.2}}, parts_folder=folder, workers=1
    )


@pytest.fixture(scope='module')
def first(suite):
    """What the first classifier answered."""
    answer = suite.client.ask('tetrahedron', 300, seed=[SEED])
    assert answer.status.code == Status.OK
    suite.log_of(answer.distribution.run.run_id)
    return answer.distribution


def start_again(suite, *nodes):
    """All that the nodes had in memory is gone, and what was latched as well."""
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


def known(suite, wait, part='tetrahedron', drops=300, **fields):
    """The answer, once the logs are read."""

    def answered():
        answer = suite.client.ask(part, drops, only_known=True, **fields)
        return answer if answer.status.code != Status.LOADING else None

    return wait(answered, 'logs read')


def test_the_same_answer_comes_at_once(restarted, first, wait):
    answer = known(restarted, wait, seed=[SEED])
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    assert without_stamp(answer.distribution) == without_stamp(first)
    # Also without only_known nothing is dropped: the run is the old one.
    again = restarted.client.ask('tetrahedron', 200)
    assert again.distribution.run.run_id == first.run.run_id
    assert restarted.client.parts()['tetrahedron'].known


def test_who_subscribes_has_it_too(restarted, first):
    heard = restarted.client.listen(
        AspectDistribution, 'aspect_distributions/tetrahedron', LATCHED
    )
    restarted.client.wait(lambda: heard, 'distribution')
    assert without_stamp(heard[0]) == without_stamp(first)


@pytest.mark.parametrize('fields', [{'drops': 301}, {'surface': 'steel'}, {'seed': [SEED + 1]}])
def test_more_drops_other_conditions_or_another_seed_are_not_the_same(
    restarted, first, wait, fields
):
    answer = known(restarted, wait, **fields)
    assert answer.status.code == Status.NOT_AVAILABLE
    assert answer.status.message.endswith('; known are 300 drops on rubber_mat')


def test_conditions_are_compared_by_value(restarted, first, wait):
    conditions = first.run.conditions
    assert known(restarted, wait, conditions=[conditions]).status.code == Status.OK
    fields = {name: getattr(conditions, name) for name in conditions.get_fields_and_field_types()}
    other = DropConditions(**{**fields, 'height': conditions.height * (1 + 1e-15)})
    answer = known(restarted, wait, conditions=[other])
    assert answer.status.code == Status.NOT_AVAILABLE


def test_another_mesh_of_the_same_name_is_not_the_same_part(restarted, first, wait, folder):
    shutil.copy(parts_folder() / 'hex_nut.stl', folder / 'tetrahedron.stl')

    def offered():
        part = restarted.client.parts().get('tetrahedron')
        return part is not None and part.part_sha256 != first.run.part_sha256

    restarted.client.wait(offered, 'new version')
    answer = known(restarted, wait)
    assert answer.status.code == Status.NOT_AVAILABLE
    assert answer.status.message.endswith(
        '; known are 300 drops on rubber_mat of another version of the part'
    )
    assert not restarted.client.parts()['tetrahedron'].known
    shutil.copy(parts_folder() / 'tetrahedron.stl', folder)
    restarted.client.wait(lambda: not offered(), 'old version')
    assert known(restarted, wait).status.code == Status.OK


def test_without_a_simulator_what_is_known_is_answered_still(restarted, first, wait):
    assert restarted.processes['drop_simulator'].end() == 0
    start_again(restarted, 'aspect_classifier')
    answer = known(restarted, wait)
    assert without_stamp(answer.distribution) == without_stamp(first)
    restarted.start_again('drop_simulator')


def test_a_log_that_was_broken_off_is_not_believed_until_it_is_recovered(
    suite, first, wait, start, connect, namespace, tmp_path
):
    log = suite.log_of(first.run.run_id)
    shutil.copytree(log, tmp_path / log.name)
    (file,) = (tmp_path / log.name).glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-100])
    # The first that is read: a pipe, which is not waited for.
    pipe = tmp_path / 'nut_20990131T120000Z_4f1c'
    pipe.mkdir()
    os.mkfifo(pipe / 'nut.mcap')
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    client = connect(namespace)
    client.wait(lambda: '1 logs in' in classifier.said, 'word of it')
    assert 'broken off and are not used' in classifier.said
    answer = client.ask('tetrahedron', 300, only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE


def test_two_hundred_logs_are_read_in_the_background(
    suite, first, start, connect, namespace, tmp_path
):
    log = suite.log_of(first.run.run_id)
    for k in range(200):
        copy = tmp_path / f'tetrahedron_20200101T{k:06}Z_{k}'
        shutil.copytree(log, copy)
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    client = connect(namespace)
    answers = []

    def ready():
        answers.append(client.ask('tetrahedron', 300, only_known=True).status)
        return answers[-1].code == Status.OK

    client.wait(ready, 'logs read')
    client.wait(lambda: '200 distributions of earlier runs' in classifier.said, 'word of it')
