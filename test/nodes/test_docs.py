"""The pages about ROS: their Python is run, and their tables are compared with the code."""

import ast
import re
import shlex
import sys
import threading
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import rclpy
from doc_pages import PAGES, ROOT, code, first_cells, section
from rclpy.qos import DurabilityPolicy
from resting_aspects_interfaces.msg import PartOutlines, Status

from resting_aspects_ros.client import connection
from resting_aspects_ros.ros import interface

TUTORIAL = 'docs/tutorials/first_controller.md'
GUIDE = 'docs/how_to/integrate_ros.md'
LOGS = 'docs/how_to/logs.md'
DRIFT = 'docs/how_to/watch_for_drift.md'
FORECAST = 'docs/how_to/forecast_a_feeder.md'
PARAMETERS = 'docs/reference/parameters.md'
INTERFACE = 'docs/reference/ros_interface.md'
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
def run_snippet(suite, graphs, monkeypatch):
    """Run Python in a thread, in the namespace of the suite, as in a program of one's own.

    Returns what it has printed and logged once a condition of this text holds; by default at its
    end. A program that spins is then stopped as by Ctrl-C.
    """
    logs, lines, errors = graphs[suite.namespace].logs, [], []
    arguments = ['program', '--ros-args', '-r', f'__ns:={suite.namespace}']
    monkeypatch.setattr(sys, 'argv', arguments)
    # On a busy machine, nodes discover each other late.
    monkeypatch.setattr(connection, 'SIMULATOR_TIMEOUT', 120.0)

    def run_snippet(text, holds=lambda _: False):
        before = len(logs)
        names = {'__name__': 'program', 'print': lambda *v: lines.append(' '.join(map(str, v)))}

        def work():
            try:
                exec(text, names)
            except Exception as error:  # noqa: BLE001 - it is raised below
                errors.append(error)

        def output():
            return '\n'.join([*lines, *(message for _, message in logs[before:])])

        thread = threading.Thread(target=work)
        thread.start()
        suite.client.wait(lambda: holds(output()) or not thread.is_alive(), 'its output')
        rclpy.try_shutdown()
        thread.join()
        for error in errors:
            raise error
        return output()

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


def test_subscription_receives_the_latched_distribution(dropped, run_snippet):
    first = dropped.aspects[0]
    row = (first.id, first.probability, first.lower, first.upper)
    printed = f'50 drops on rubber_mat [{row}, '
    assert printed in run_snippet(snippet('create_subscription'), lambda text: printed in text)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('word', ['ReentrantCallbackGroup', 'remove_pending_request'])
def test_program_requests_a_distribution(run_snippet, word):
    code = snippet(word).replace('drops=1000', 'drops=60')
    output = run_snippet(code, lambda text: 'mostly' in text)
    assert re.search(r'\d+ drops, mostly in aspect \d|^\[\(1, [.\d]+\), ', output)


@pytest.mark.slow
def test_client_identifies_an_outline(suite, run_snippet):
    received = suite.client.listen(PartOutlines, 'outlines/l_bracket', interface.LATCHED)
    suite.client.wait(lambda: received, 'outlines')
    first, second, *_ = run_snippet(snippet('identify_part')).splitlines()
    assert first == 'none: 0.0 touching: 0.0'
    assert second == 'l_bracket [2] 1.000'


def test_the_controller_of_the_tutorial_follows_a_distribution(run_snippet):
    code = snippet('probability_of').replace('drops=1000', 'drops=60')
    # Its topic brings the same distribution, sooner or later.
    output = run_snippet(code, lambda text: 'answered' in text and 'can be picked' in text)
    assert re.search(r'the request is answered: \d+ drops', output)
    assert re.search(r'\d+\.\d% can be picked \(.*% to .*%\), \d+ drops', output)


def test_client_requests_the_transitions_of_an_action(run_snippet):
    small = snippet('transition_matrix_from').replace('per_aspect=100', 'per_aspect=4, drops=20')
    matrix, shares, *_ = run_snippet(small).splitlines()
    rows = ast.literal_eval(matrix.removeprefix('tap '))
    assert [len(row) for row in rows] == [9] * 5
    assert all(row == pytest.approx(1, abs=0.05) for row in map(sum, rows))
    shares = ast.literal_eval(shares.removeprefix('in the long run '))
    assert sum(shares) == pytest.approx(1, abs=0.05)


def test_client_without_a_node_uses_the_ros_arguments(suite, run_snippet):
    suite.client.wait(lambda: len(suite.client.parts()) == 4, 'descriptions of all parts')
    code = snippet('list_parts')
    assert '/cell_1' in code
    printed = run_snippet(code.replace('/cell_1', suite.namespace))
    assert printed.startswith(f'{list(suite.client.parts())}')


@pytest.mark.slow
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
def test_counts_of_a_machine_are_combined_with_the_drops(dropped, run_snippet):
    (code_of_page,) = [text for text in code(DRIFT, 'python') if 'ObservedCounts' in text]
    lines = run_snippet(code_of_page).splitlines()
    shares = [float(line.split(': ')[1]) for line in lines if line.startswith('class ')]
    assert len(shares) == 5, lines
    assert sum(shares) == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_client_requests_a_forecast(run_snippet):
    (code_of_page,) = [text for text in code(FORECAST, 'python') if 'Client' in text]
    small = code_of_page.replace('per_aspect=100, drops=1000', 'per_aspect=4, drops=50')
    assert small != code_of_page
    sentence, *rows = run_snippet(small).splitlines()
    assert 'parts per minute' in sentence
    words = ['robot', 'vibrate', 'settle', 'image', 'supply']
    assert [row.split()[0] for row in rows[:5]] == words


@pytest.mark.parametrize('word', ['AnyReader', 'mcap_ros2'])
def test_log_snippets_run(suite, dropped, run_snippet, word):
    code = snippet(word)
    assert LOG in code
    output = run_snippet(code.replace(LOG, str(suite.log_of(dropped.run.run_id))))
    assert output.startswith('0 50 ')
    assert word == 'mcap_ros2' or 'rubber_mat true' in output


@pytest.mark.parametrize('line', NODE_LINES)
def test_documented_parameters_start_a_node(line, start, namespace):
    program, _, *arguments = shlex.split(line)
    start(Path(program).name, namespace, arguments=arguments)


# -- tables ---------------------------------------------------------------------------------------


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


def test_types_are_those_of_the_running_nodes(suite, dropped):
    assert dropped.drops
    node = suite.client.node
    outlines = node.resolve_topic_name('outlines/l_bracket')  # computed after the drops
    suite.client.wait(lambda: outlines in dict(node.get_topic_names_and_types()), 'outlines')
    types = dict(node.get_topic_names_and_types()) | dict(node.get_service_names_and_types())
    rows = interface_rows()
    assert {name for name, *_ in rows} >= FEEDER
    for name, kind, type_name, _ in rows:
        if name.startswith('log_replayer/') or name in FEEDER:
            continue  # neither of these runs here
        # The page leaves out the package of the suite.
        package, _, short = type_name.rpartition('/')
        folder = {'topic': 'msg', 'service': 'srv', 'action': 'action'}[kind]
        expected = f'{package or "resting_aspects_interfaces"}/{folder}/{short}'
        path = node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
        if kind == 'action':
            assert types[f'{path}/_action/send_goal'] == [f'{expected}_SendGoal']
        else:
            assert types[path] == [expected]


def test_every_topic_and_service_of_the_nodes_is_listed(suite, dropped):
    assert dropped.drops
    node, namespace = suite.client.node, f'{suite.namespace}/'
    listed = {name.removesuffix('/<part>') for name, *_ in interface_rows()}
    for program in suite.nodes:
        names = [
            *node.get_publisher_names_and_types_by_node(program, suite.namespace),
            *node.get_service_names_and_types_by_node(program, suite.namespace),
        ]
        own = {name.removeprefix(namespace) for name, _ in names if name.startswith(namespace)}
        public = [name for name in own if not name.startswith((f'{program}/', '_'))]
        found = {name.partition('/_action/')[0].partition('/')[0] for name in public}
        assert found or program == 'drop_recorder'
        assert found <= listed, program


def test_documented_qos_matches_the_publishers(suite, dropped):
    documented = {name: qos for name, _, _, qos in interface_rows()}
    for name, profile in TOPICS.items():
        assert documented[name] == f'latched, {profile.depth}'
        topic = suite.client.node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
        publishers = suite.client.node.get_publishers_info_by_topic(topic)
        offered = {each.qos_profile.durability for each in publishers}
        assert offered == {DurabilityPolicy.TRANSIENT_LOCAL}


def test_every_status_code_is_listed():
    listed = re.findall(r'^\| `(\w+)` \| (\d+) ', PAGES[INTERFACE], re.MULTILINE)
    text = (ROOT / 'resting_aspects_interfaces' / 'msg' / 'Status.msg').read_text()
    assert listed == re.findall(r'^uint8 (\w+)=(\d+)', text, re.MULTILINE)


def test_every_program_is_listed():
    scripts = {
        entry.name
        for entry in entry_points(group='console_scripts')
        if entry.value.startswith('resting_aspects_ros.')
    }
    listed = {cell.strip('`') for cell in first_cells(section(INTERFACE, '## Programs'))}
    assert listed == scripts - {'resting_aspects'}
