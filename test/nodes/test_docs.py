"""The pages about ROS: their Python is run, and their tables are compared with the code."""

import re
import shlex
import sys
import threading
from pathlib import Path

import pytest
import rclpy
from doc_pages import PAGES, code
from resting_aspects_interfaces.msg import PartOutlines, Status

from resting_aspects_ros.client import connection
from resting_aspects_ros.ros import interface

TUTORIAL = 'docs/tutorials/first_controller.md'
GUIDE = 'docs/how_to/integrate_ros.md'
LOGS = 'docs/how_to/logs.md'
SOME = ('docs/how_to/watch_for_drift.md', 'docs/how_to/forecast_a_feeder.md')
INTERFACE = 'docs/reference/ros_interface.md'
NODE_LINES = [
    line
    for page in ('docs/reference/parameters.md', TUTORIAL)
    for block in code(page, 'bash')
    for line in block.splitlines()
    if not line.startswith('.venv/bin/resting_aspects ')
]
FEEDER = {
    *(interface.DETECTIONS, interface.PICK_RESULT),
    *(f'{each}/<part>' for each in ('feeder_advice', 'observed_counts', 'posterior')),
}

# Words of the blocks of Python, and what each prints.
SNIPPETS = {
    'probability_of': r'(?s)(?=.*is answered: \d+ drops).*\d% can be picked \(.*%\), \d+ drops',
    'own conditions': r'^\d+ drops on rubber_mat \[\(1, 0\.\d+, 0\.\d+, 0\.\d+\), ',
    'mostly in aspect': r'\d+ drops, mostly in aspect \d',
    'transition_matrix_from': r'^tap (\[+[\d., ]+\][\], ]+){5}\nin the long run \[',
    'identify_part': r'^none: 0.0 touching: 0.0\nl_bracket \[2\] 1.000',
    'list_parts': r"^\['box_10x20x30', 'l_bracket', 'tetrahedron', 'u_bracket'\]",
    'remove_pending_request': r'^\[\(1, [.\d]+\), ',
    'AnyReader': r'^0 50 .*\nrubber_mat true$',
    'mcap_ros2': r'^0 50 ',
    'ObservedCounts': r'^(class \d: 0\.\d+\n?){5}',
    'client.forecast': r'parts per minute[^\n]*(\n(robot|vibrate|settle|image|supply) .* %){5}',
}
SHORTER = {
    'per_aspect=100, drops=1000': 'per_aspect=4, drops=60',
    'per_aspect=100': 'per_aspect=4, drops=60',
    'drops=1000': 'drops=60',
}
LOG = 'out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50'


def snippets(*pages):
    return [block for page in pages for block in code(page, 'python')]


def snippet(word):
    """Return the block of Python that has a word."""
    (found,) = [block for block in snippets(TUTORIAL, GUIDE, LOGS, *SOME) if word in block]
    return found


@pytest.fixture
def run_snippet(suite, graphs, monkeypatch):
    """Run Python in a thread, in the namespace of the suite, as in a program of one's own.

    Returns what it has printed and logged, at its end or once a condition of this text holds. A
    program that spins is then stopped as by Ctrl-C.
    """
    logs, lines, errors = graphs[suite.namespace].logs, [], []
    arguments = ['program', '--ros-args', '-r', f'__ns:={suite.namespace}']
    monkeypatch.setattr(sys, 'argv', arguments)
    # On a busy machine, nodes discover each other late.
    monkeypatch.setattr(connection, 'SIMULATOR_TIMEOUT', 120.0)

    def run_snippet(text, holds):
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
    """A run of 50 drops; there are transitions and outlines too, and a run in surroundings."""
    goal = suite.client.reorient('l_bracket', 'tap', 2, drops=5)
    assert goal.outcome == 'succeeded'
    assert suite.client.ask('l_bracket', 5, surroundings='slope').distribution.drops == 5
    received = suite.client.listen(PartOutlines, 'outlines/l_bracket', interface.LATCHED)
    suite.client.wait(lambda: received, 'outlines')
    return suite.client.ask('l_bracket', 50, seed=[5050]).distribution


def test_all_snippets_are_tested():
    tested = {snippet(word) for word in (*SNIPPETS, 'CancelGoal')}
    assert tested > {*snippets(TUTORIAL, GUIDE, LOGS)}


@pytest.mark.parametrize('word', SNIPPETS)
def test_snippet_prints_what_it_says(suite, dropped, run_snippet, word):
    text = snippet(word).replace('/cell_1', suite.namespace)
    text = text.replace(LOG, str(suite.log_of(dropped.run.run_id)))
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    expected = re.compile(SNIPPETS[word], re.MULTILINE)
    # One that spins does not end by itself.
    output = run_snippet(text, expected.search if 'rclpy.spin(' in text else lambda _: False)
    assert expected.search(output), output


@pytest.mark.slow
def test_empty_request_cancels_the_run_and_keeps_its_drops(suite, run_snippet):
    poses = suite.client.poses()
    asked = suite.client.asking('tetrahedron', 2_000_000, seed=[9])
    suite.client.wait(lambda: any(batch.run.seed == 9 for batch in poses), 'a batch')
    run_snippet(snippet('CancelGoal'), lambda _: False)
    suite.client.wait(asked.done, 'answer')
    assert asked.result().status.code == Status.CANCELED
    assert suite.client.known(seed=[9]).drops < 2_000_000


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


def test_documented_topics_and_services_are_those_of_the_nodes(suite, dropped):
    assert dropped.drops
    node = suite.client.node
    types = dict(node.get_topic_names_and_types()) | dict(node.get_service_names_and_types())
    rows = interface_rows()
    assert {name for name, *_ in rows} >= FEEDER
    for name, kind, type_name, qos in rows:
        if name.startswith('log_replayer/') or name in FEEDER:
            continue  # neither of these runs here
        # The page leaves out the package of the suite.
        package, _, short = type_name.rpartition('/')
        folder = {'topic': 'msg', 'service': 'srv', 'action': 'action'}[kind]
        expected = f'{package or "resting_aspects_interfaces"}/{folder}/{short}'
        path = node.resolve_topic_name(name.replace('<part>', 'l_bracket'))
        if kind == 'action':
            path, expected = f'{path}/_action/send_goal', f'{expected}_SendGoal'
        assert types[path] == [expected]
        if kind == 'topic':
            publishers = node.get_publishers_info_by_topic(path)
            is_latched = {p.qos_profile.durability.name == 'TRANSIENT_LOCAL' for p in publishers}
            assert is_latched == {qos.startswith('latched, ')}
    listed = {name.removesuffix('/<part>') for name, *_ in rows}
    start = f'{suite.namespace}/'
    for program in suite.nodes:
        names = [
            *node.get_publisher_names_and_types_by_node(program, suite.namespace),
            *node.get_service_names_and_types_by_node(program, suite.namespace),
        ]
        own = {name.removeprefix(start) for name, _ in names if name.startswith(start)}
        public = {name for name in own if not name.startswith((f'{program}/', '_'))}
        assert {name.partition('/')[0] for name in public} <= listed, program
