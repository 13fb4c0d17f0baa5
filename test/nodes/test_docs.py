"""The pages about ROS: their Python is run, and their tables are compared with the code."""

import ast
import re
import shlex
import sys
from importlib.metadata import entry_points
from itertools import takewhile
from pathlib import Path

import pytest
from doc_pages import PAGES, ROOT, code, first_cells, section
from rclpy.qos import DurabilityPolicy
from resting_aspects_interfaces.msg import PartOutlines, Status

from resting_aspects_ros.nodes.aspect_classifier import node as aspect_classifier
from resting_aspects_ros.nodes.camera_simulator import node as camera_simulator
from resting_aspects_ros.nodes.drop_recorder import node as drop_recorder
from resting_aspects_ros.nodes.drop_simulator import node as drop_simulator
from resting_aspects_ros.nodes.feeder_controller import node as feeder_controller
from resting_aspects_ros.nodes.log_replayer import node as log_replayer
from resting_aspects_ros.nodes.vision_example import node as vision_example
from resting_aspects_ros.ros import interface

TUTORIAL = 'docs/tutorials/first_controller.md'
GUIDE = 'docs/how_to/integrate_ros.md'
LOGS = 'docs/how_to/logs.md'
DRIFT = 'docs/how_to/watch_for_drift.md'
FORECAST = 'docs/how_to/forecast_a_feeder.md'
PARAMETERS = 'docs/reference/parameters.md'
INTERFACE = 'docs/reference/ros_interface.md'
INTERFACES = ROOT / 'resting_aspects_interfaces'
NODE_LINES = [
    line
    for page in (PARAMETERS, TUTORIAL)
    for block in code(page, 'bash')
    for line in block.splitlines()
    if not line.startswith('.venv/bin/resting_aspects ')
]
LOG = 'out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50'
TOPICS = {
    interface.RESTING_POSES: interface.POSES,
    f'{interface.ASPECT_DISTRIBUTIONS}/<part>': interface.LATCHED,
    f'{interface.TRANSITIONS}/<part>': interface.LATCHED,
    f'{interface.OUTLINES}/<part>': interface.LATCHED,
    f'{interface.PARTS}/<part>': interface.LATCHED,
    f'{interface.SURROUNDINGS}/<part>': interface.SURROUNDINGS_QOS,
    interface.MARKERS: interface.LATCHED,
    interface.SURROUNDINGS_MARKERS: interface.LATCHED,
    interface.CURRENT_POSES: interface.LATCHED,
    interface.DEFAULT_CONDITIONS: interface.LATCHED,
}

ADVICE = f'{interface.FEEDER_ADVICE}/<part>'
COUNTS, POSTERIOR = f'{interface.OBSERVED_COUNTS}/<part>', f'{interface.POSTERIOR}/<part>'
FEEDER = {interface.DETECTIONS, interface.PICK_RESULT, ADVICE, COUNTS, POSTERIOR}


# A word of each block of Python, by page.
SNIPPETS = {
    TUTORIAL: ['probability_of'],
    GUIDE: [
        'create_subscription',
        'ReentrantCallbackGroup',
        'transition_matrix_from',
        'identify_part',
        'list_parts',
        'remove_pending_request',
        'CancelGoal',
    ],
    LOGS: ['AnyReader', 'mcap_ros2'],
}


def snippet(word):
    """Return the block of Python that has a word."""
    (page,) = [page for page, words in SNIPPETS.items() if word in words]
    (found,) = [block for block in code(page, 'python') if word in block]
    return found


@pytest.fixture
def run_snippet(run_script, suite):
    """Run Python in the namespace of the suite, as in a program of one's own."""

    def run_snippet(code):
        namespace = ('--ros-args', '-r', f'__ns:={suite.namespace}')
        return run_script(code, *namespace)

    return run_snippet


@pytest.fixture(scope='module')
def dropped(suite):
    """A run of 50 drops; there are transitions of the part too, and a run in surroundings."""
    goal = suite.client.reorient('l_bracket', 'tap', 2, drops=5)
    assert goal.outcome == 'succeeded'
    assert suite.client.ask('l_bracket', 5, surroundings='slope').distribution.drops == 5
    return suite.client.ask('l_bracket', 50, seed=[5050]).distribution


def test_all_snippets_are_tested():
    for page, words in SNIPPETS.items():
        assert [snippet(word) for word in words] == code(page, 'python')


def test_subscription_receives_the_latched_distribution(suite, dropped, run_snippet):
    process = run_snippet(snippet('create_subscription'))
    suite.client.wait(lambda: '\n' in process.output or not process.running, 'a line')
    first = dropped.aspects[0]
    row = (first.id, first.probability, first.lower, first.upper)
    assert process.output.startswith(f'50 drops on rubber_mat [{row}, ')


def test_node_requests_a_distribution(suite, run_snippet):
    code = snippet('ReentrantCallbackGroup').replace('drops=1000', 'drops=60')
    process = run_snippet(code)
    suite.client.wait(lambda: 'mostly' in process.output or not process.running, 'its words')
    assert process.running, process.output
    assert re.search(r'cell\]: \d+ drops, mostly in aspect \d', process.output)
    process.end()


def test_client_identifies_an_outline(suite, run_snippet):
    received = suite.client.listen(PartOutlines, 'outlines/l_bracket', interface.LATCHED)
    suite.client.wait(lambda: received, 'outlines')
    process = run_snippet(snippet('identify_part'))
    suite.client.wait(lambda: not process.running, 'the end')
    first, second, *_ = process.output.splitlines()
    assert first == 'none: 0.0 touching: 0.0'
    assert second == 'l_bracket [2] 1.000'


def test_the_controller_of_the_tutorial_follows_a_distribution(suite, run_snippet):
    code = snippet('probability_of').replace('drops=1000', 'drops=60')
    process = run_snippet(code)
    suite.client.wait(lambda: 'answered' in process.output or not process.running, 'its answer')
    assert process.running, process.output
    assert re.search(r'controller\]: the request is answered: \d+ drops', process.output)
    # Its topic brings the same distribution, sooner or later.
    suite.client.wait(lambda: 'can be picked' in process.output, 'a share')
    assert re.search(r'\]: \d+\.\d% can be picked \(.*% to .*%\), \d+ drops', process.output)
    process.end()


@pytest.mark.slow
def test_client_requests_the_transitions_of_an_action(suite, run_snippet):
    code = snippet('transition_matrix_from')
    process = run_snippet(code.replace('per_aspect=100', 'per_aspect=4, drops=20'))
    suite.client.wait(lambda: not process.running, 'the end')
    matrix, shares = process.output.splitlines()
    rows = ast.literal_eval(matrix.removeprefix('tap '))
    assert [len(row) for row in rows] == [9] * 5
    assert all(row == pytest.approx(1, abs=0.05) for row in map(sum, rows))
    assert sum(ast.literal_eval(shares.removeprefix('in the long run '))) == pytest.approx(
        1, abs=0.05
    )


def described_parts(suite):
    """Wait until all example parts are described, and return their names."""
    suite.client.wait(lambda: len(suite.client.parts()) == 4, 'descriptions of all parts')
    return list(suite.client.parts())


def test_client_without_a_node_uses_the_ros_arguments(suite, run_snippet):
    names = described_parts(suite)
    code = snippet('list_parts')
    given = "ros_args=['-r', '__ns:=/cell_1']"
    assert given in code
    process = run_snippet(code.replace(given, ''))
    suite.client.wait(lambda: not process.running, 'the end')
    assert process.output == f'{names}\n'


def test_empty_request_cancels_the_run_and_keeps_its_drops(suite, run_snippet):
    poses = suite.client.poses()
    asked = suite.client.asking('tetrahedron', 2_000_000, seed=[9])
    suite.client.wait(lambda: any(batch.run.seed == 9 for batch in poses), 'a batch')
    run_snippet(snippet('CancelGoal'))
    suite.client.wait(asked.done, 'answer')
    status = asked.result().status
    assert (status.code, status.message.split()[0]) == (Status.CANCELED, 'canceled')

    def kept():
        return suite.client.ask('tetrahedron', 1, seed=[9], only_known=True).distribution.drops

    assert 0 < suite.client.wait(kept, 'drops before the cancel') < 2_000_000


@pytest.mark.slow
def test_counts_of_a_machine_are_combined_with_the_drops(suite, dropped, run_snippet):
    (code_of_page,) = [text for text in code(DRIFT, 'python') if 'ObservedCounts' in text]
    process = run_snippet(code_of_page)
    suite.client.wait(lambda: not process.running, 'the end')
    shares = [float(line.split(': ')[1]) for line in process.output.splitlines()]
    assert len(shares) == 5, process.output
    assert sum(shares) == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_client_requests_a_forecast(suite, run_snippet):
    (code_of_page,) = [text for text in code(FORECAST, 'python') if 'Client' in text]
    small = code_of_page.replace('per_aspect=100, drops=1000', 'per_aspect=4, drops=50')
    assert small != code_of_page
    process = run_snippet(small)
    suite.client.wait(lambda: not process.running, 'the end')
    sentence, *rows = process.output.splitlines()
    assert 'parts per minute' in sentence, process.output
    assert [row.split()[0] for row in rows] == ['robot', 'vibrate', 'settle', 'image', 'supply']


@pytest.mark.parametrize('word', ['AnyReader', 'mcap_ros2'])
def test_log_snippets_run(suite, dropped, run_snippet, word):
    code = snippet(word)
    assert LOG in code
    process = run_snippet(code.replace(LOG, str(suite.log_of(dropped.run.run_id))))
    suite.client.wait(lambda: not process.running, 'the end')
    assert process.output.startswith('0 50 ')
    assert word == 'mcap_ros2' or process.output.endswith('rubber_mat true\n')


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('line', NODE_LINES)
def test_documented_commands_start_a_node(line, run_command, wait, namespace):
    program, *words = shlex.split(line)
    program = Path(sys.executable).parent / program.removeprefix('.venv/bin/')
    process = run_command(program, *words, '-r', f'__ns:={namespace}')
    wait(lambda: re.search('ready|waiting for', process.output) or not process.running, 'ready')
    assert process.running, process.output
    process.end()


@pytest.mark.parametrize(
    'node',
    [
        drop_simulator,
        aspect_classifier,
        drop_recorder,
        feeder_controller,
        camera_simulator,
        vision_example,
        log_replayer,
    ],
)
def test_documented_parameters_are_complete(node):
    name = node.__name__.split('.')[-2]
    rows = re.findall(r'^\| (.*) \|$', PAGES[PARAMETERS], re.MULTILINE)
    cells = [[cell.strip() for cell in row.split('|')] for row in rows]
    first = [row[0] for row in cells].index(f'`{name}`')
    listed = [cells[first], *takewhile(lambda row: not row[0], cells[first + 1 :])]
    assert len(listed) == len(node.PARAMETERS)
    for (_, shown, default, meaning), parameter in zip(listed, node.PARAMETERS, strict=True):
        assert shown == f'`{parameter.name}`{" *" if parameter.changeable else ""}'
        if isinstance(parameter.default, bool):
            assert default == str(parameter.default).lower()
        else:
            assert default == str(parameter.default)
        if parameter.bounds is not None:
            assert '{:g} to {:g}'.format(*parameter.bounds) in meaning


def interface_rows():
    """The rows of services, the action and topics: name, kind, type, and the QoS of a topic."""
    return [
        (name, kind, type_name, others.split(' | ')[0])
        for name, kind, type_name, others in re.findall(
            r'^\| `([\w/<>]+)` \| (service|topic|action) (\S+) \| (.*) \|$',
            PAGES[INTERFACE],
            re.MULTILINE,
        )
    ]


def test_documented_interface_is_complete():
    rows = interface_rows()
    assert {name for name, *_ in rows} == {
        interface.GET_DISTRIBUTION,
        interface.CLASSIFY_POSE,
        interface.GET_TRANSITIONS,
        interface.IDENTIFY_PART,
        interface.FORECAST,
        interface.DROP_PART,
        interface.REORIENT_PART,
        interface.DIAGNOSTICS,
        interface.PAUSE.replace('~', 'log_replayer'),
        interface.RESUME.replace('~', 'log_replayer'),
        *FEEDER,
        *TOPICS,
    }
    latched = {name for name, kind, _, qos in rows if kind == 'topic' and 'latched' in qos}
    assert latched == {*TOPICS, ADVICE, COUNTS, POSTERIOR}


def full_type(kind, name):
    """The name of a type as ROS has it: the page leaves out the package of the suite."""
    package, _, name = name.rpartition('/')
    folder = {'topic': 'msg', 'service': 'srv', 'action': 'action'}[kind]
    return f'{package or "resting_aspects_interfaces"}/{folder}/{name}'


def test_types_are_those_of_the_running_nodes(suite, dropped):
    assert dropped.drops
    node = suite.client.node
    outlines = node.resolve_topic_name('outlines/l_bracket')  # computed after the drops
    suite.client.wait(lambda: outlines in dict(node.get_topic_names_and_types()), 'outlines')
    types = dict(node.get_topic_names_and_types()) | dict(node.get_service_names_and_types())
    for name, kind, type_name, _ in interface_rows():
        if name.startswith('log_replayer/') or name in FEEDER:
            continue  # neither of these runs here
        expected = full_type(kind, type_name)
        path = node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
        if kind == 'action':
            assert types[f'{path}/_action/send_goal'] == [f'{expected}_SendGoal']
        else:
            assert types[path] == [expected]


def test_every_topic_and_service_of_the_nodes_is_listed(suite, dropped):
    assert dropped.drops
    node, namespace = suite.client.node, f'{suite.namespace}/'
    listed = {name.removesuffix('/<part>') for name, *_ in interface_rows()}
    for program in ('drop_simulator', 'aspect_classifier', 'drop_recorder'):
        names = [
            *node.get_publisher_names_and_types_by_node(program, suite.namespace),
            *node.get_service_names_and_types_by_node(program, suite.namespace),
        ]
        own = {name.removeprefix(namespace) for name, _ in names if name.startswith(namespace)}
        found = {
            name.partition('/_action/')[0].partition('/')[0]
            for name in own
            if not name.startswith((f'{program}/', '_'))
        }
        assert found or program == 'drop_recorder'
        assert found <= listed, program


@pytest.mark.parametrize('name', TOPICS)
def test_documented_qos_matches_the_publisher(suite, dropped, name):
    profile = TOPICS[name]
    ((*_, qos),) = [row for row in interface_rows() if row[0] == name]
    assert qos == f'latched, {profile.depth}'
    topic = suite.client.node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
    found = suite.client.wait(
        lambda: suite.client.node.get_publishers_info_by_topic(topic), f'publisher of {name}'
    )
    assert {each.qos_profile.durability for each in found} == {DurabilityPolicy.TRANSIENT_LOCAL}
    assert {each.qos_profile.reliability for each in found} == {profile.reliability}


def test_every_type_is_listed():
    files = [path for path in INTERFACES.glob('*/*') if path.suffix in ('.msg', '.srv', '.action')]
    names = sorted(f'{path.parent.name}/{path.stem}' for path in files)
    listed = re.findall(r'^\| \[([\w/]+)\]', section(INTERFACE, '## Types'), re.MULTILINE)
    assert listed == names


def test_every_status_code_is_listed():
    listed = re.findall(r'^\| `(\w+)` \| (\d+) ', PAGES[INTERFACE], re.MULTILINE)
    text = (INTERFACES / 'msg' / 'Status.msg').read_text()
    codes = re.findall(r'^uint8 (\w+)=(\d+)', text, re.MULTILINE)
    assert listed == codes


def test_every_program_is_listed():
    scripts = {
        entry.name
        for entry in entry_points(group='console_scripts')
        if entry.value.startswith('resting_aspects_ros.')
    }
    listed = {cell.strip('`') for cell in first_cells(section(INTERFACE, '## Programs'))}
    assert listed == scripts - {'resting_aspects'}
