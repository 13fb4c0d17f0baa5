"""docs/ros.md: what it shows is run, and what it lists is what there is."""

import ast
import re
import shlex
import sys
from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ListParts

from resting_aspects_ros.examples import feeder
from resting_aspects_ros.nodes.aspect_classifier import node as aspect_classifier
from resting_aspects_ros.nodes.drop_recorder import node as drop_recorder
from resting_aspects_ros.nodes.drop_simulator import node as drop_simulator
from resting_aspects_ros.nodes.log_replayer import node as log_replayer
from resting_aspects_ros.ros import interface
from resting_aspects_ros.ros.parameters import Parameter

DOC = (Path(__file__).resolve().parents[2] / 'docs' / 'ros.md').read_text(encoding='utf-8')
LOG = 'out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50'
TOPICS = {
    interface.RESTING_POSES: interface.POSES,
    f'{interface.ASPECT_DISTRIBUTIONS}/<part>': interface.LATCHED,
    f'{interface.PARTS}/<part>': interface.LATCHED,
    interface.MARKERS: interface.LATCHED,
    interface.RECORDED_RUNS: interface.ALL_LATCHED,
    interface.CURRENT_POSES: interface.LATCHED,
    interface.DEFAULT_CONDITIONS: interface.LATCHED,
}


def blocks(language):
    return re.findall(rf'^```{language}\n(.*?)^```', DOC, re.MULTILINE | re.DOTALL)


def snippet(word):
    """The Python that has a word."""
    (found,) = [block for block in blocks('python') if word in block]
    return found


SNIPPETS = (
    'create_subscription',
    'ReentrantCallbackGroup',
    'list_parts',
    'remove_pending_request',
    'CancelGoal',
    'AnyReader',
    'mcap_ros2',
)


@pytest.fixture
def run_snippet(run_script, suite):
    """Run Python in the namespace of the suite, as in a program of one's own."""

    def run_snippet(code):
        namespace = ('--ros-args', '-r', f'__ns:={suite.namespace}')
        return run_script(code, *namespace)

    return run_snippet


@pytest.fixture(scope='module')
def dropped(suite):
    """A run of 50 drops."""
    return suite.client.ask('l_bracket', 50, seed=[5050]).distribution


def test_all_snippets_are_known_to_the_tests_below():
    assert [snippet(word) for word in SNIPPETS] == blocks('python')


def test_a_subscription_has_what_is_latched(suite, dropped, run_snippet):
    process = run_snippet(snippet('create_subscription'))
    suite.client.wait(lambda: '\n' in process.said or not process.running, 'a line')
    first = dropped.aspects[0]
    row = (first.id, first.probability, first.lower, first.upper)
    assert process.said.startswith(f'50 drops on rubber_mat [{row}, ')


def test_a_node_asks(suite, run_snippet):
    code = snippet('ReentrantCallbackGroup').replace('drops=1000', 'drops=60')
    process = run_snippet(code)
    suite.client.wait(lambda: 'mostly' in process.said or not process.running, 'its words')
    assert process.running, process.said
    assert re.search(r'cell\]: \d+ drops, mostly in aspect \d', process.said)
    assert process.end() == 0
    assert 'Traceback' not in process.said


def test_a_client_without_a_node_asks_in_the_namespace_it_is_given(suite, run_command):
    code = snippet('list_parts')
    assert '/cell_1' in code
    process = run_command(sys.executable, '-c', code.replace('/cell_1', suite.namespace))
    suite.client.wait(lambda: not process.running, 'the end')
    assert process.said == f'{list(suite.client.parts())}\n'


def test_or_in_that_of_the_command_line(suite, run_snippet):
    code = snippet('list_parts')
    given = "ros_args=['-r', '__ns:=/cell_1']"
    assert given in code
    process = run_snippet(code.replace(given, ''))
    suite.client.wait(lambda: not process.running, 'the end')
    assert process.said == f'{list(suite.client.parts())}\n'


def test_a_plain_service_client_is_answered(suite, dropped, run_snippet):
    code = snippet('remove_pending_request').replace('drops=1000', 'drops=50')
    process = run_snippet(code)
    suite.client.wait(lambda: not process.running, 'the end')
    rows = ast.literal_eval(process.said)  # of this run, or of one with more drops
    assert [k for k, _ in rows] == [a.id for a in dropped.aspects]
    assert 0.9 < sum(probability for _, probability in rows) < 1 + 1e-9


def test_the_documented_depth_keeps_many_answers_at_once(suite, connect):
    """All answers of a service go to all of its clients, and the default depth is 10."""
    (depth,) = re.findall(r'QoSProfile\(depth=(\d+)\)', snippet('remove_pending_request'))
    assert f'keep_last({depth})' in DOC
    other = connect(suite.namespace)
    client = other.node.create_client(
        ListParts, interface.LIST_PARTS, qos_profile=QoSProfile(depth=int(depth))
    )
    suite.client.wait(client.service_is_ready, 'service')
    mine = client.call_async(ListParts.Request())
    # Answered one after the other, while this client does not spin.
    for _ in range(50):
        suite.client.parts()
    other.wait(mine.done, 'answer')
    assert mine.result().parts


def test_an_empty_request_cancels_what_runs_and_keeps_its_drops(suite, run_snippet):
    poses = suite.client.poses()
    asked = suite.client.asking('tetrahedron', 500_000, seed=[9])
    suite.client.wait(lambda: any(batch.run.seed == 9 for batch in poses), 'a batch')
    run_snippet(snippet('CancelGoal'))
    suite.client.wait(asked.done, 'answer')
    status = asked.result().status
    assert (status.code, status.message.split()[0]) == (Status.CANCELED, 'canceled')

    def kept():
        return suite.client.ask('tetrahedron', 1, seed=[9], only_known=True).distribution.drops

    assert 0 < suite.client.wait(kept, 'the drops so far') < 500_000


@pytest.mark.parametrize('word', ['AnyReader', 'mcap_ros2'])
def test_a_log_is_read(suite, dropped, run_snippet, word):
    code = snippet(word)
    assert LOG in code
    process = run_snippet(code.replace(LOG, str(suite.log_of(dropped.run.run_id))))
    suite.client.wait(lambda: not process.running, 'the end')
    assert process.said.startswith('0 50 ')
    assert word == 'mcap_ros2' or process.said.endswith('rubber_mat true\n')


def test_the_keys_of_the_metadata_are_there(suite, dropped):
    text = (suite.log_of(dropped.run.run_id) / 'metadata.yaml').read_text()
    paragraph = DOC.split('What is not a message')[1].split('\n\n')[0]
    keys = re.findall(r'`((?:run|outcome)\.\w+)`', paragraph)
    assert len(keys) == 9
    assert all(f' {key}: ' in text for key in keys)


@pytest.mark.parametrize('line', [line for block in blocks('bash') for line in block.splitlines()])
def test_a_node_starts_with_such_parameters(line, run_command, wait, namespace):
    program, *words = shlex.split(line)
    program = Path(sys.executable).parent / program.removeprefix('.venv/bin/')
    process = run_command(program, *words, '-r', f'__ns:={namespace}')
    wait(lambda: re.search('ready|waits for', process.said) or not process.running, 'ready')
    assert process.running, process.said
    assert process.end() == 0


@pytest.mark.parametrize(
    'node', [drop_simulator, aspect_classifier, drop_recorder, feeder, log_replayer]
)
def test_parameters_are_listed(node):
    name = 'feeder_example' if node is feeder else node.__name__.split('.')[-2]
    section = DOC.split(f'\n| `{name}` | `')[1]
    rows = re.match(r'(?:.*\n)(?:\| \| .*\n)*', f'| `{section}')[0]
    listed = re.findall(r'\| `(\w+)` (\*?) ?\|', rows)
    declared = [
        # The example's are as ROS has them.
        (p.name, '*' if p.changeable else '') if isinstance(p, Parameter) else (p[0], '')
        for p in node.PARAMETERS
    ]
    assert listed == declared


def test_the_interface_is_listed():
    rows = re.findall(
        r'^\| `([\w/<>]+)` \| (?:service|topic|action) \S+ \|([^|]*)\|', DOC, re.MULTILINE
    )
    assert [name for name, _ in rows] == [
        interface.GET_DISTRIBUTION,
        interface.CLASSIFY_POSE,
        interface.LIST_PARTS,
        interface.DROP_PART,
        interface.RESTING_POSES,
        f'{interface.ASPECT_DISTRIBUTIONS}/<part>',
        f'{interface.PARTS}/<part>',
        interface.MARKERS,
        interface.RECORDED_RUNS,
        interface.DIAGNOSTICS,
        interface.PAUSE.replace('~', 'log_replayer'),
        interface.RESUME.replace('~', 'log_replayer'),
        interface.CURRENT_POSES,
        interface.DEFAULT_CONDITIONS,
        feeder.EXPECTED_PICK_RATE,
    ]
    said = dict(rows)
    assert {name for name, qos in said.items() if 'latched' in qos} == {
        *TOPICS, feeder.EXPECTED_PICK_RATE
    }  # fmt: skip


@pytest.mark.parametrize('name', TOPICS)
def test_the_quality_of_service_is_the_publisher_s(suite, dropped, name):
    profile = TOPICS[name]
    words = 'latched, ' + str(profile.depth)
    assert f'| `{name}` | topic ' in DOC
    assert f'| {words} |' in DOC.split(f'| `{name}` | topic ')[1].splitlines()[0]
    topic = suite.client.node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
    found = suite.client.wait(
        lambda: suite.client.node.get_publishers_info_by_topic(topic), f'publisher of {name}'
    )
    assert {each.qos_profile.durability for each in found} == {DurabilityPolicy.TRANSIENT_LOCAL}
    assert {each.qos_profile.reliability for each in found} == {profile.reliability}
