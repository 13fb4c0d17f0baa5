"""A classifier that is started again knows what the logs of earlier runs hold."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    DropConditions,
    PartDescription,
    RestingPoses,
    Status,
)

from resting_aspects_ros import cli
from resting_aspects_ros.client import AnswerTimeoutError, RestingAspectsClient
from resting_aspects_ros.config_files import parts_folder
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import count_poses
from resting_aspects_ros.drops.engine import drop_chunk
from resting_aspects_ros.drops.plan import plan_run
from resting_aspects_ros.drops.release import CHUNK
from resting_aspects_ros.logs.log_reader import last_message
from resting_aspects_ros.logs.outcome import OUTCOME, Outcome
from resting_aspects_ros.logs.run_log import RunLog
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.nodes.convert import part_msg, poses_msg, time_msg
from resting_aspects_ros.nodes.interface import LATCHED, POSES, RESTING_POSES

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
    return answered(suite.client, wait, part, drops, **fields)


def answered(client, wait, part='tetrahedron', drops=300, **fields):
    """The answer, once the logs are read."""

    def answered():
        answer = client.ask(part, drops, only_known=True, **fields)
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
    with_seed = f' with seed {SEED}' if 'seed' in fields else ''
    assert answer.status.message.endswith(f'; known are 300 drops on rubber_mat{with_seed}')


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


def request(namespace, *words):
    command = [sys.executable, '-m', 'resting_aspects_ros.cli', 'request', 'tetrahedron']
    return subprocess.run(
        [*command, *words, '--ros-args', '-r', f'__ns:={namespace}'],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_without_a_simulator_a_request_waits_for_nothing_that_cannot_come(restarted, first, wait):
    assert restarted.processes['drop_simulator'].end() == 0
    start_again(restarted, 'aspect_classifier')
    known(restarted, wait)
    table = request(restarted.namespace, '--drops', '200')
    name, words, *_ = (line.rstrip() for line in table.stdout.splitlines())
    assert name == 'tetrahedron'  # of a log; its size is known to the simulator
    assert words == f'300 drops on rubber_mat, seed {SEED}'
    assert 'drop_simulator' not in table.stderr
    document = request(restarted.namespace, '--drops', '200', '--json')
    assert document.returncode == 0
    # On a busy machine it may also say that it waits for the classifier to be found.
    assert document.stderr.endswith(
        'warning: neither the picture nor mesh_sha256 of the part: no drop_simulator offers '
        'tetrahedron\n'
    )

    def refused_soon():
        """Once the classifier is there for so long that a simulator would be, too."""
        refused = request(restarted.namespace, '--drops', '301')
        assert refused.returncode == 1
        return refused.stderr.endswith(
            f'error: no drop_simulator answers on {restarted.namespace}/drop_part, waited 2 s: '
            'start drop_simulator; known are 300 drops on rubber_mat\n'
        )

    wait(refused_soon, 'words after 2 s')
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
    client.wait(lambda: 'broken off, not used' in classifier.said, 'word of it')
    answer = client.ask('tetrahedron', 300, only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE
    assert classifier.end() == 0
    assert cli.main(['recover', str(tmp_path / log.name)]) == 0
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    client.forget()
    assert answered(client, wait).distribution.drops == 300
    assert 'broken off' not in classifier.said


def test_logs_that_are_no_loss_are_not_told_of(
    suite, first, wait, start, connect, namespace, tmp_path
):
    """One that was broken off beside one with the whole run, and one that is being written."""
    log = suite.log_of(first.run.run_id)
    shutil.copytree(log, tmp_path / log.name)
    shutil.copytree(log, tmp_path / f'{log.name}_2')
    (file,) = (tmp_path / log.name).glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-100])
    being_written = RunLog(tmp_path, 'tetrahedron_20300101T000000Z_4f1c')
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    assert answered(connect(namespace), wait).distribution.drops == 300
    assert 'not used' not in classifier.said
    being_written.close()


def test_of_a_log_without_all_of_its_run_the_first_drops_are_known(
    part, surfaces, wait, start, connect, namespace, tmp_path
):
    tetrahedron = part('tetrahedron')
    job, run = plan_run(
        tetrahedron, surfaces.get(), seed=SEED, drops=300, run_id='4f1c', started=10**18
    )
    poses = drop_chunk(job, 0, CHUNK)
    with RunLog(tmp_path, 'tetrahedron_20200101T000000Z_4f1c') as log:
        described = Topic('/parts/tetrahedron', PART_TYPE, Qos(1))
        log.write(described, serialize_message(part_msg(tetrahedron)), 1)
        for first, end in ((0, 40), (110, CHUNK), (40, 100)):  # 100 to 109 are not there
            batch = poses_msg(poses.between(first, end), run, time_msg(1), False)
            log.write(Topic('/resting_poses', POSES_TYPE, Qos(2000)), serialize_message(batch), 2)
        log.add_metadata(OUTCOME, Outcome(CHUNK - 10, whole=False).record())
    start('aspect_classifier', namespace, {'log_folder': tmp_path})
    client = connect(namespace)
    found = answered(client, wait, drops=100, seed=[SEED]).distribution
    counted = count_poses(find_aspects(tetrahedron), poses.between(0, 100))
    assert (found.drops, found.complete, found.run.drops) == (100, True, 300)
    assert [aspect.count for aspect in found.aspects] == counted.counts.tolist()
    assert answered(client, wait, drops=101).status.code == Status.NOT_AVAILABLE


def with_distribution(log, folder, change):
    """A copy of a log, with another distribution; it is read no further than that."""
    data = last_message(log, DISTRIBUTION_TYPE)
    message = deserialize_message(data, AspectDistribution)
    change(message)
    topic = Topic('/cell/aspect_distributions/tetrahedron', DISTRIBUTION_TYPE, Qos(1))
    with RunLog(folder, f'tetrahedron_20300101T000000Z_{message.run.run_id}') as copy:
        copy.write(topic, serialize_message(message), 10**18)
        copy.add_metadata(OUTCOME, Outcome(message.drops, whole=True).record())


def fewer(message):
    """And more drops than the good one: it would be the answer."""
    last = message.aspects.pop()
    message.unclassified += last.count + 10
    message.drops += 10
    message.run.run_id, message.run.seed = 'fewer', SEED + 10


def turned(message):
    message.aspects[0].down_in_part.x += 0.1
    message.aspects[0].count += 20
    message.drops += 20
    message.run.run_id, message.run.seed = 'turned', SEED + 20


def odd(run_id, field, value):
    """Change what is at a place; 'aspects.count' is of the first."""

    def change(message):
        entry, _, name = field.rpartition('.')
        setattr(message.aspects[0] if entry else message, name, value)
        message.run.run_id = run_id

    return change


ODD = [
    fewer,
    turned,
    odd('none', 'aspects', []),
    odd('sweep', 'aspects.sweep', 200),
    odd('count', 'aspects.count', 2**63),
    odd('interval', 'interval', 'bogus'),
    odd('confidence', 'confidence', 7.0),
]


def test_logs_that_do_not_fit_the_part_are_not_used(
    suite, first, start, connect, namespace, tmp_path, part, wait
):
    log = suite.log_of(first.run.run_id)
    shutil.copytree(log, tmp_path / log.name)
    for change in ODD:
        with_distribution(log, tmp_path, change)
    for odd_log in tmp_path.glob('tetrahedron_2030*'):
        odd_log.rename(odd_log.with_name(f'{odd_log.name}\udcff'))  # a name that is no UTF-8
    client = connect(namespace)
    publisher = client.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
    publisher.publish(part_msg(part('tetrahedron')))
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path})
    client.wait(lambda: 'tetrahedron' in client.parts(), 'part')

    def answered():
        answer = client.ask('tetrahedron', 300, only_known=True)
        return answer if answer.status.code != Status.LOADING else None

    assert wait(answered, 'logs read').distribution.run == first.run
    assert classifier.running
    # Of those that could be read: before the part was described, or after.
    told = 'counts other aspects than tetrahedron has'
    wait(lambda: classifier.said.count(told) == 2, 'word of it')


def test_of_too_many_logs_the_newest_of_each_part_are_read(
    suite, first, start, connect, namespace, tmp_path
):
    box = suite.client.ask('box_10x20x30', 5).distribution.run
    for run_id in (first.run.run_id, box.run_id):
        log = suite.log_of(run_id)
        shutil.copytree(log, tmp_path / log.name)
    log = suite.log_of(first.run.run_id)
    for k in range(5):
        shutil.copytree(log, tmp_path / f'tetrahedron_20300101T{k:06}Z_{k}')
    limit = {'memory.MOST_LOGS': 2}
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path}, limit)
    client = connect(namespace)
    client.wait(lambda: 'not read: ' in classifier.said, 'word of it')
    assert f'5 logs in {tmp_path}, not read: ' in classifier.said
    answer = client.ask('box_10x20x30', 5, only_known=True)
    assert answer.distribution.run == box
    assert client.ask('tetrahedron', 300, only_known=True).status.code == Status.OK


def test_until_the_logs_are_read_the_answer_is_that_they_are_being_read(
    suite, first, start, connect, namespace, tmp_path, wait
):
    for k in range(3):
        shutil.copytree(
            suite.log_of(first.run.run_id), tmp_path / f'tetrahedron_20200101T{k:06}Z_{k}'
        )
    # None is read before the test is over.
    never = {'memory.READ_PERIOD': 3600.0, 'known_parts.QUIET': 0.0}
    classifier = start('aspect_classifier', namespace, {'log_folder': tmp_path}, never)
    client = connect(namespace)
    for only_known in (True, False):
        status = client.ask('tetrahedron', 300, only_known=only_known).status
        assert status.code == Status.LOADING
        assert status.message == ('loading: 0 of 3 logs of earlier runs are read, ask again soon')
    with RestingAspectsClient(ros_args=['-r', f'__ns:={namespace}']) as other:

        def words():
            """What a client says that waited for nothing."""
            with pytest.raises(AnswerTimeoutError) as error:
                other.get_distribution('tetrahedron', drops=300, timeout=1)
            return str(error.value)

        # Before it has found the classifier it says that there is none.
        ending = ', waited 1 s: loading: 0 of 3 logs of earlier runs are read, ask again soon'
        wait(lambda: words().endswith(ending), 'words of the client')
    assert classifier.running


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
    # The same drops 200 times.
    told = rf'200 logs of earlier runs in {tmp_path} read in [\d.]+ s: 1 distribution is known, '
    client.wait(lambda: re.search(told, classifier.said), 'word of it')


# Runs of the box in the order in which they end: id, seed, drops, and when they began by clocks
# that stand still and go backwards.
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
# What is asked of them, and which run is the answer, by the seeds asked for; None: without one.
ANSWERS = {31: 'b_same', 32: 'newer', 33: 'long', 34: 'first', 35: 'last', None: 'last'}


def test_which_of_several_runs_is_the_answer_is_the_same_before_and_after_a_restart(
    part, surfaces, wait, start, connect, namespace, tmp_path
):
    box, client = part('box_10x20x30'), connect(namespace)
    parameters = {'log_folder': tmp_path}
    recorder = start('drop_recorder', namespace, parameters)
    classifier = start('aspect_classifier', namespace, parameters)
    conditions = surfaces.get()

    def answers(client):
        found = {}
        for seed in ANSWERS:
            answer = answered(
                client,
                wait,
                box.name,
                1,
                seed=[] if seed is None else [seed],
                surface='rubber_mat',
            )
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
        poses.publish(poses_msg(drop_chunk(job, 0, drops), run, time_msg(1), True))
        client.wait(
            lambda run_id=run_id: list(tmp_path.glob(f'*_{run_id}/metadata.yaml')), 'closed log'
        )
    before = answers(client)
    assert {seed: found.run.run_id for seed, found in before.items()} == ANSWERS
    assert (recorder.end(), classifier.end()) == (0, 0)
    # In another namespace, where nothing is latched.
    again = f'{namespace}_again'
    start('aspect_classifier', again, parameters)
    after = answers(connect(again))
    assert {seed: found.run.run_id for seed, found in after.items()} == ANSWERS
    for seed, found in after.items():
        assert without_stamp(found) == without_stamp(before[seed])
