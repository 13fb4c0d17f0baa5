"""Fixtures for the nodes: most tests run them in this process, on one executor.

`suite` and `start` make nodes in this process, with their real topics and services. Nothing
happens in them unless a test waits for a condition, which spins the executor. `start_process` and
`run_command` start real processes, for what only these show: kills, signals and exit codes.
"""

import copy
import functools
import importlib
import itertools
import multiprocessing
import os
import re
import signal
import subprocess
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import FeederAction, PartDescription, RestingPoses
from resting_aspects_interfaces.srv import GetDistribution, GetTransitions

from resting_aspects_ros.client import connection
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.nodes.aspect_classifier.node import AspectClassifier
from resting_aspects_ros.nodes.camera_simulator.node import CameraSimulator
from resting_aspects_ros.nodes.drop_recorder.node import DropRecorder
from resting_aspects_ros.nodes.drop_simulator.node import DropSimulator
from resting_aspects_ros.nodes.feeder_controller.node import FeederController
from resting_aspects_ros.nodes.log_replayer.node import LogReplayer
from resting_aspects_ros.nodes.vision_example.node import VisionExample
from resting_aspects_ros.ros.conversions import conditions_msg, part_msg, poses_msgs, time_msg
from resting_aspects_ros.ros.discovery import TopicDiscovery
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    ALL_LATCHED,
    DIAGNOSTICS,
    POSES,
    RESTING_POSES,
    SERVICES,
)
from resting_aspects_ros.ros.interface import (
    PARTS as PARTS_TOPIC,
)
from resting_aspects_ros.simulation.conditions import parts_folder
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range

# Number of drops in each message of the fixture ``batches``.
BATCH = 250
SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
NODES = {
    'drop_simulator': DropSimulator,
    'aspect_classifier': AspectClassifier,
    'drop_recorder': DropRecorder,
    'log_replayer': LogReplayer,
    'feeder_controller': FeederController,
    'camera_simulator': CameraSimulator,
    'vision_example': VisionExample,
}
# The parts of the shared suite: their aspects and outlines take a second.
PARTS = ('box_10x20x30', 'l_bracket', 'tetrahedron', 'u_bracket')
# Timeout of every wait, s; with free cores, a fraction of it is enough.
DEADLINE = 300.0
OUTCOMES = {
    GoalStatus.STATUS_SUCCEEDED: 'succeeded',
    GoalStatus.STATUS_CANCELED: 'canceled',
    GoalStatus.STATUS_ABORTED: 'aborted',
}
_serial = itertools.count()
# -- nodes in this process ------------------------------------------------------------------------


def _call_here(self, function, arguments):
    """Run a function of a FileWorker in its thread, without the process: test/ros tests that."""
    if self._stopped:
        raise FileLimitError('the node ends')
    try:
        return function(*arguments)
    except RestingAspectsError:
        raise
    except Exception as error:
        raise FileLimitError(f'unexpected error {error!r:.300}') from error


@pytest.fixture(scope='session', autouse=True)
def file_workers_without_processes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FileWorker, '_call', _call_here)
        yield


class Graph:
    """Nodes and clients in a namespace, on one executor of this process.

    logs : lines of the nodes, as they arrive on /rosout
    """

    def __init__(self, namespace, wait):
        self.namespace, self._wait, self._thread = namespace, wait, None
        self.context = Context()
        rclpy.init(args=[], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.logs = []
        listener = self.add(rclpy.create_node('logs', namespace=namespace, context=self.context))
        listener.create_subscription(Log, '/rosout', self._take, ALL_LATCHED)

    def _take(self, message):
        self.logs.append((message.name, message.msg))

    def add(self, node):
        self.executor.add_node(node)
        return node

    def remove(self, node):
        self.executor.remove_node(node)
        node.destroy_node()

    def step(self):
        if self._thread is None:
            self.executor.spin_once(timeout_sec=0.05)
        else:
            time.sleep(0.01)

    def wait(self, condition, what, seconds=DEADLINE):
        """Spin until a condition holds; return its value."""
        return self._wait(condition, what, seconds, self.step)

    @contextmanager
    def spinning(self):
        """Spin in a thread, for a client that blocks this one."""
        stopped = threading.Event()

        def spin():
            while not stopped.is_set():
                self.executor.spin_once(timeout_sec=0.05)

        self._thread = threading.Thread(target=spin)
        self._thread.start()
        try:
            yield
        finally:
            stopped.set()
            self._thread.join()
            self._thread = None

    def close(self):
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)


class LocalNode:
    """A node in this process."""

    def __init__(self, graph, kind, parameters, constants, arguments):
        self._graph, self.running = graph, True
        self._patch = pytest.MonkeyPatch()
        for name, value in dict(constants).items():
            module, _, constant = name.rpartition('.')
            module = importlib.import_module(f'resting_aspects_ros.{module}')
            self._patch.setattr(module, constant, value)
        words = [
            word for name, value in dict(parameters).items() for word in ('-p', f'{name}:={value}')
        ]
        cli_args = ['--ros-args', *map(str, arguments), *words]
        self.node = NODES[kind](
            namespace=graph.namespace,
            cli_args=cli_args,
            use_global_arguments=False,
            context=graph.context,
        )
        graph.add(self.node)
        self._name = self.node.get_logger().name
        self._before = len(graph.logs)

    @property
    def output(self):
        """The lines that the node has logged."""
        lines = [text for name, text in self._graph.logs[self._before :] if name == self._name]
        return ''.join(f'{line}\n' for line in lines)

    def end(self):
        """Stop the node as a signal does."""
        if self.running:
            self.running = False
            if hasattr(self.node, 'close'):
                self.node.close()
            for publisher in self.node.publishers:
                publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=1.0))
            self._graph.remove(self.node)
            self._patch.undo()


class Drop:
    """An active goal of drop_part or reorient_part."""

    def __init__(self, client, goal, wait):
        self.feedback = []
        self._wait = wait
        self._answer = client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        self._answer.add_done_callback(lambda answer: self._accepted(answer.result()))
        self._handle = self._result = None

    def _accepted(self, handle):
        assert handle.accepted
        self._handle = handle
        self._result = handle.get_result_async()

    @property
    def accepted(self):
        return self._handle is not None

    @property
    def done(self):
        return self._result is not None and self._result.done()

    @property
    def result(self):
        return self._result.result().result

    @property
    def outcome(self):
        """The status of the goal in ROS."""
        return OUTCOMES[self._result.result().status]

    def cancel(self):
        # Feedback can arrive before the response to the goal.
        self._wait(lambda: self.accepted, 'accepted goal')
        return self._handle.cancel_goal_async()


class Client:
    """A ROS client of the nodes in a namespace."""

    def __init__(self, graph):
        self._graph = graph
        self.node = graph.add(
            rclpy.create_node(
                f'test_{next(_serial)}', namespace=graph.namespace, context=graph.context
            )
        )
        self.wait = graph.wait
        self._ask = self.node.create_client(
            GetDistribution, 'get_distribution', qos_profile=SERVICES
        )
        self._parts = {}
        take = self._parts.__setitem__
        TopicDiscovery(self.node, PARTS_TOPIC, PartDescription, take, gone=self._parts.pop)
        self._met = set()
        self._drop = ActionClient(self.node, DropPart, 'drop_part', **ACTION_SERVICES)
        self._reorient = ActionClient(self.node, ReorientPart, 'reorient_part', **ACTION_SERVICES)
        self._transitions = self.node.create_client(
            GetTransitions, 'get_transitions', qos_profile=SERVICES
        )

    def destroy(self):
        self._drop.destroy()
        self._reorient.destroy()
        self._graph.remove(self.node)

    def spin(self, seconds):
        """Spin for a time, for what must not happen within it."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end, 'the end')

    def listen(self, kind, topic, qos):
        """Return a list that receives the messages of a topic while this client waits."""
        received = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def meet(self, name, ready, send):
        """Wait until a server responds: it may be discovered before it discovers this client."""
        if name in self._met:
            return
        self.wait(ready, f'{name} offered')
        answers, last = [], 0.0

        def answered():
            nonlocal last
            if time.monotonic() - last > 1.0:
                last = time.monotonic()
                answers.append(send())
            return any(answer.done() for answer in answers)

        self.wait(answered, f'first answer of {name}')
        self._met.add(name)

    def forget(self):
        """Wait for all servers again after a node was restarted."""
        self._met.clear()

    def meet_service(self, client):
        nothing = client.srv_type.Request()  # without part and drops: rejected
        self.meet(client.srv_name, client.service_is_ready, lambda: client.call_async(nothing))

    def call(self, client, request, seconds=DEADLINE):
        self.meet_service(client)
        answer = client.call_async(request)
        self.wait(answer.done, f'answer of {client.srv_name}', seconds)
        return answer.result()

    def asking(self, part='tetrahedron', drops=100, **fields):
        """Return the future of a response of get_distribution."""
        self.meet_service(self._ask)
        return self._ask.call_async(GetDistribution.Request(part=part, drops=drops, **fields))

    def ask(self, part='tetrahedron', drops=100, seconds=DEADLINE, **fields):
        request = GetDistribution.Request(part=part, drops=drops, **fields)
        return self.call(self._ask, request, seconds)

    def known(self, part='tetrahedron', drops=1, **fields):
        """Return the distribution of a part once this number of its drops is known."""

        def found():
            answer = self.ask(part, drops, only_known=True, **fields)
            return not answer.status.code and answer.distribution

        return self.wait(found, f'{drops} known drops of {part}')

    def parts(self):
        """Return the descriptions of the offered parts that have arrived, by name, sorted."""
        return dict(sorted(self._parts.items()))

    def dropping(self, part='tetrahedron', drops=100, **fields):
        nothing = DropPart.Goal()
        send = functools.partial(self._drop.send_goal_async, nothing)
        self.meet('drop_part', self._drop.server_is_ready, send)
        return Drop(self._drop, DropPart.Goal(part=part, drops=drops, **fields), self.wait)

    def drop(self, part='tetrahedron', drops=100, **fields):
        return self.finished(self.dropping(part, drops, **fields))

    def finished(self, goal):
        self.wait(lambda: goal.done, 'result of the goal')
        return goal

    def canceled(self, goal):
        goal.cancel()
        return self.finished(goal)

    def dropping_in_bullet(self, part='tetrahedron', drops=100, **fields):
        """Start a goal whose drops are made by worker processes; the kernel has threads."""
        return self.dropping(part, drops, surroundings='bowl_track', **fields)

    def reorienting(self, part='tetrahedron', action='tap', per_aspect=60, drops=100, **fields):
        """Start a goal; the action is a name or a FeederAction."""
        send = functools.partial(self._reorient.send_goal_async, ReorientPart.Goal())
        self.meet('reorient_part', self._reorient.server_is_ready, send)
        action = FeederAction(name=action) if isinstance(action, str) else action
        fields |= {'part': part, 'action': action, 'per_aspect': per_aspect, 'drops': drops}
        return Drop(self._reorient, ReorientPart.Goal(**fields), self.wait)

    def reorient(self, *arguments, **fields):
        return self.finished(self.reorienting(*arguments, **fields))

    def transitions(self, part='tetrahedron', action=''):
        """Return the response of get_transitions."""
        return self.call(self._transitions, GetTransitions.Request(part=part, action=action))

    def poses(self):
        return self.listen(RestingPoses, RESTING_POSES, POSES)

    def batches_of(self, received, run_id):
        """Wait for the last message of a run among those received; return all of them."""

        def batches():
            return [batch for batch in received if batch.run.run_id == run_id]

        self.wait(lambda: any(b.last for b in batches()), f'end of run {run_id}')
        return batches()


class Suite:
    """The three nodes and a client; the nodes are all in this process, or each in its own."""

    def __init__(self, namespace, logs, start, constants=(), **simulator):
        self.namespace, self.logs, self.client = namespace, logs, None
        simulator = {'workers': 2, **simulator}
        parameters = {
            'drop_simulator': simulator,
            'aspect_classifier': {'log_folder': logs},
            'drop_recorder': {'log_folder': logs},
        }

        def start_node(node, **options):
            constants_of = dict(constants).get(node, {})
            return start(node, namespace, parameters[node], constants_of, **options)

        self._start = start_node
        # Concurrently: each reads files.
        self.nodes = {node: start_node(node, ready='') for node in SUITE}

    def seen_by(self, client):
        """Return the same nodes with another client, once they are ready."""
        suite = copy.copy(self)
        suite.client = client
        for name, node in self.nodes.items():
            client.wait(lambda node=node: 'ready' in node.output or not node.running, name)
            assert node.running, node.output
        return suite

    def start_again(self, node):
        """Restart a stopped node with the same parameters."""
        assert not self.nodes[node].running
        self.nodes[node] = self._start(node)
        self.client.forget()

    def restart(self, *nodes):
        """Stop nodes, and start them again: without their memory and their latched messages."""
        for node in nodes:
            self.nodes[node].end()
        for node in nodes:
            self.start_again(node)

    def log_of(self, run_id):
        """Return the folder of the log of a run, once it is complete."""

        def whole():
            return list(self.logs.glob(f'*_{run_id}/metadata.yaml'))

        return self.client.wait(whole, f'log of run {run_id}')[0].parent


class Graphs:
    """The graphs by namespace; each ends with the fixture that uses it first."""

    def __init__(self, wait):
        self._wait, self._graphs = wait, {}

    def __getitem__(self, namespace):
        if namespace not in self._graphs:
            self._graphs[namespace] = Graph(namespace, self._wait)
        return self._graphs[namespace]

    @contextmanager
    def use(self):
        """Yield functions that start a node and that create a client, until the block ends."""
        before, ends = set(self._graphs), []

        def start(kind, namespace, parameters=(), constants=(), ready='ready', arguments=()):
            node = LocalNode(self[namespace], kind, parameters, constants, arguments)
            ends.append(node.end)
            if ready:
                self[namespace].wait(lambda: ready in node.output, f'{kind} {ready}')
            return node

        def connect(namespace):
            client = Client(self[namespace])
            ends.append(client.destroy)
            return client

        try:
            yield start, connect
        finally:
            for end in reversed(ends):
                end()
            for namespace in set(self._graphs) - before:
                self._graphs.pop(namespace).close()


@pytest.fixture(scope='session')
def graphs(wait):
    return Graphs(wait)


@pytest.fixture(scope='module')
def local(graphs):
    with graphs.use() as functions:
        yield functions


@pytest.fixture(scope='module')
def start(local):
    """Return a function that starts a node in this process until the end of the module."""
    return local[0]


@pytest.fixture(scope='module')
def connect(local):
    """Return a function that creates a client in a namespace, in this process."""
    return local[1]


@pytest.fixture
def namespace():
    """Return an unused namespace."""
    return _namespace()


def _namespace():
    return f'/test_{os.getpid()}_{next(_serial)}'


@pytest.fixture(scope='session')
def few_parts(tmp_path_factory):
    """Return a function that copies example parts to a new folder."""

    def few_parts(*names):
        folder = tmp_path_factory.mktemp('parts')
        for name in names:
            for file in parts_folder().glob(f'{name}.*'):
                (folder / file.name).write_bytes(file.read_bytes())
        return folder

    return few_parts


@pytest.fixture(scope='session')
def shared_nodes(graphs, tmp_path_factory, few_parts):
    """Start the nodes of the test worker for all modules that do not end them."""
    with graphs.use() as (start, _):
        logs = tmp_path_factory.mktemp('logs')
        yield Suite(_namespace(), logs, start, parts_folder=few_parts(*PARTS))


@pytest.fixture(scope='module')
def suite(shared_nodes, connect):
    """Return the nodes that all modules share, with a client of the module."""
    return shared_nodes.seen_by(connect(shared_nodes.namespace))


@pytest.fixture(scope='module')
def fresh_suite(start, connect, tmp_path_factory, few_parts):
    """Return a function that starts new nodes in this process, with few parts."""

    def fresh_suite(constants=(), **simulator):
        simulator = {'parts_folder': few_parts('box_10x20x30', 'tetrahedron'), **simulator}
        suite = Suite(_namespace(), tmp_path_factory.mktemp('logs'), start, constants, **simulator)
        return suite.seen_by(connect(suite.namespace))

    return fresh_suite


@pytest.fixture
def spinning(graphs, suite):
    """Spin the suite in a thread, for clients that block."""
    with graphs[suite.namespace].spinning():
        yield


# -- nodes in processes ---------------------------------------------------------------------------

# An interpreter that has imported the nodes is forked for each process: the imports take 2 s.
FORKSERVER = multiprocessing.get_context('forkserver')
FORKSERVER.set_forkserver_preload([kind.__module__ for kind in NODES.values()])
# First statements of a forked process; it also forks the process in which a node reads files.
FORKED = """
import multiprocessing, os, sys
from multiprocessing import forkserver
from resting_aspects_ros.ros import file_worker

os.setsid()
os.chdir(folder)
os.environ.clear()
os.environ.update(environment)
file = os.open(output, os.O_WRONLY | os.O_APPEND)
os.dup2(file, 1)
os.dup2(file, 2)
sys.stdout.reconfigure(line_buffering=True)
forkserver._forkserver.ensure_running = lambda: None
file_worker.get_context = lambda _: multiprocessing.get_context('forkserver')
"""


class ForkedProcess:
    """A process that runs a script in a forked interpreter; it has the interface of Popen."""

    def __init__(self, script, output):
        names = {
            '__name__': '__main__',
            'folder': str(Path.cwd()),
            'environment': dict(os.environ),
            'output': str(output),
        }
        self._process = FORKSERVER.Process(target=exec, args=(FORKED + script, names))
        self._process.start()
        self.pid = self._process.pid

    def poll(self):
        return self._process.exitcode

    def wait(self, seconds=None):
        self._process.join(seconds)
        assert self.poll() is not None, f'it has not ended within {seconds} s'
        return self.poll()


class Process:
    """A program in a separate process group; its output goes to a file."""

    def __init__(self, what, folder):
        self._output = folder / 'output.txt'
        self._output.touch()
        if isinstance(what, str):
            self._popen = ForkedProcess(what, self._output)
        else:
            with self._output.open('wb') as file:
                self._popen = subprocess.Popen(
                    what,
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
        self.pid = self._popen.pid

    @property
    def output(self):
        return self._output.read_text()

    @property
    def running(self):
        return self._popen.poll() is None

    def send(self, number):
        if self.running:
            with suppress(ProcessLookupError):  # it may just have ended
                os.kill(self.pid, number)

    def send_to_group(self, number):
        """Send a signal to the process group, as a terminal does on Ctrl-C."""
        os.killpg(self.pid, number)

    def end(self, number=signal.SIGINT):
        """Send a signal and return the exit code."""
        self.send(number)
        return self._popen.wait(DEADLINE)

    def destroy(self):
        """Kill the process and its group, also after a failure."""
        if self.running:  # otherwise its pid may have been reused
            with suppress(ProcessLookupError):  # its process group may not exist yet
                os.killpg(self.pid, signal.SIGKILL)
            self.end(signal.SIGKILL)

    def group(self):
        """Return the pids of all alive processes of the group."""
        return [pid for pid, fields in _processes() if int(fields[2]) == self.pid]

    def send_to_workers(self, number):
        """Send a signal to the worker processes; return their number."""
        workers = 0
        for pid in self.group():
            with suppress(FileNotFoundError, ProcessLookupError):  # it may end at any time
                if 'simulation.workers ' in Path(f'/proc/{pid}/cmdline').read_text():
                    os.kill(pid, number)
                    workers += 1
        return workers


def _processes():
    """Yield pid and the fields of /proc/<pid>/stat after the name of all processes but zombies."""
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            fields = (folder / 'stat').read_text().rpartition(')')[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if fields[0] != 'Z':
            yield int(folder.name), fields


@pytest.fixture(scope='module')
def run_command(tmp_path_factory):
    """Start a command, or a script in an interpreter that has imported the nodes."""
    started = []

    def run_command(*command):
        what = command[0] if len(command) == 1 else [str(word) for word in command]
        started.append(Process(what, tmp_path_factory.mktemp('output')))
        return started[-1]

    yield run_command
    for process in started:
        process.destroy()


@pytest.fixture(scope='module')
def run_script(run_command):
    """Run a Python script with arguments."""
    return lambda code, *arguments: run_command(
        f'sys.argv = {["-c", *map(str, arguments)]!r}\n{code}'
    )


@pytest.fixture(scope='module')
def start_process(run_command, wait):
    """Start a node in a process, which is killed at the end of the module.

    ``constants`` are set before: {'ros.goal_client.ARRIVAL_TIMEOUT': 1.0}.
    """

    def start_process(kind, namespace, parameters=(), constants=(), ready='ready', arguments=()):
        words = [kind, '--ros-args', '-r', f'__ns:={namespace}', *map(str, arguments)]
        for name, value in dict(parameters).items():
            words += ['-p', f'{name}:={value}']
        lines = [f'sys.argv = {words!r}', f'import {NODES[kind].__module__} as node']
        for name, value in dict(constants).items():
            module, _, constant = name.rpartition('.')
            lines += [
                f'import resting_aspects_ros.{module} as changed',
                f'assert hasattr(changed, {constant!r})',
                f'changed.{constant} = {value!r}',
            ]
        process = run_command('\n'.join([*lines, 'raise SystemExit(node.main())']))
        if ready:
            wait(lambda: ready in process.output or not process.running, f'{kind} {ready}')
            assert process.running, process.output
        return process

    return start_process


@pytest.fixture(scope='module')
def processes(start_process, connect, tmp_path_factory, few_parts):
    """Return a function that starts a suite of three processes."""

    def processes(constants=(), **simulator):
        simulator = {'parts_folder': few_parts('box_10x20x30', 'tetrahedron'), **simulator}
        logs = tmp_path_factory.mktemp('logs')
        suite = Suite(_namespace(), logs, start_process, constants, **simulator)
        return suite.seen_by(connect(suite.namespace))

    return processes


@pytest.fixture(scope='session')
def traceback():
    """Return a function that finds a traceback in an output."""
    return lambda text: re.search(r'Traceback|Exception ignored|never retrieved', text)


# -- what tests see and send ----------------------------------------------------------------------


@pytest.fixture
def ahead(monkeypatch):
    """Advance the clock of the requests of a client, in seconds."""
    offset = 0.0

    def ahead(seconds):
        nonlocal offset
        offset += seconds

    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + offset, sleep=time.sleep)
    monkeypatch.setattr(connection, 'time', clock)
    return ahead


class Diagnostics:
    """The newest status of each node of a suite."""

    def __init__(self, client):
        self._client = client
        self._newest = {}
        client.node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._take, 100)

    def _take(self, message):
        self._newest.update({status.name: status for status in message.status})

    def forget(self):
        """Discard the received messages."""
        self._newest.clear()

    def wait(self, node, holds, what):
        """Return level, message and values of the status of a node, once they are as expected."""
        name = f'{self._client.node.get_namespace()[1:]}/{node}'

        def found():
            status = self._newest.get(name)
            if status is None:
                return None
            values = {each.key: each.value for each in status.values}
            reported = (status.level, status.message, values)
            return reported if holds(*reported) else None

        try:
            return self._client.wait(found, what)
        except AssertionError:
            raise AssertionError(f'{what}: {self._newest.get(name)}') from None


@pytest.fixture(scope='session')
def diagnostics_of():
    """Return the class that receives the diagnostics in the namespace of a client."""
    return Diagnostics


class Parameters:
    """Access to the parameters of a running node, through its services."""

    def __init__(self, client, node):
        self._client, self._node, self._services = client, node, {}

    def _call(self, kind, name, **fields):
        if name not in self._services:
            self._services[name] = self._client.node.create_client(kind, f'{self._node}/{name}')
        return self._client.call(self._services[name], kind.Request(**fields))

    def names(self):
        return set(self._call(ListParameters, 'list_parameters').result.names)

    def describe(self, name):
        (found,) = self._call(DescribeParameters, 'describe_parameters', names=[name]).descriptors
        return found

    def get(self, name):
        (value,) = self._call(GetParameters, 'get_parameters', names=[name]).values
        return parameter_value_to_python(value)

    def set(self, **values):
        """Set parameters one by one; return the reasons of rejections."""
        given = [RosParameter(name, value=value) for name, value in values.items()]
        results = self._call(
            SetParameters, 'set_parameters', parameters=[each.to_parameter_msg() for each in given]
        ).results
        return [result.reason for result in results if not result.successful]


@pytest.fixture(scope='session')
def parameters_of():
    """Return the class that accesses the parameters of a running node."""
    return Parameters


@pytest.fixture(scope='session')
def counts():
    """Return all counts of a distribution as one tuple."""

    def counts(distribution):
        of_aspects = tuple(aspect.count for aspect in distribution.aspects)
        others = ('unclassified', 'unsettled', 'failed')
        return (*of_aspects, *(getattr(distribution, name) for name in others))

    return counts


@pytest.fixture
def quick(surfaces):
    """Return conditions for short drops: from a low height, without bounces."""
    return [conditions_msg(surfaces.get().changed(height=1e-3, restitution=0.0))]


@pytest.fixture(scope='session')
def batches(part, surfaces):
    """Create serialized batches of a run of the tetrahedron; each repeats the first drops."""

    def plan(count, run_id):
        return plan_run(
            part('tetrahedron'),
            surfaces.get(),
            seed=1,
            drops=count * BATCH,
            run_id=run_id,
            started=10**18,
        )

    job, _ = plan(1, '')
    poses = drop_range(job, 0, BATCH)

    def batches(count, run_id='recorded'):
        (batch,) = poses_msgs(poses, plan(count, run_id)[1], time_msg(7), last=False)
        for k in range(count):
            batch.first_drop = k * BATCH
            batch.last = k == count - 1
            data = serialize_message(batch)
            yield data + bytes(-len(data) % 4)  # padded as on the wire and in a log

    return batches


@pytest.fixture(scope='session')
def write_log(part):
    """Write a log of the tetrahedron with batches at even intervals; return its folder.

    gap : time between two batches, and between the part and the first batch, s
    """

    def write_log(folder, batches, gap=0.0, depth=2000):
        interfaces = 'resting_aspects_interfaces/msg'
        latched = Qos(1, durability='transient_local')
        described = Topic('/cell/parts/tetrahedron', f'{interfaces}/PartDescription', latched)
        qos = Qos(depth, durability='transient_local')
        poses = Topic('/cell/resting_poses', f'{interfaces}/RestingPoses', qos)
        with RunLog(folder, 'log') as log:
            log.write(described, serialize_message(part_msg(part('tetrahedron'))), 10**18)
            for k, batch in enumerate(batches):
                log.write(poses, batch, 10**18 + round((k + 1) * gap * 10**9))
                log.flush()
        return log.path.parent

    return write_log


@pytest.fixture
def replay(start, namespace):
    """Start a replayer in the namespace of the test."""

    def replay(log, ready='ready', constants=(), arguments=(), **parameters):
        given = {name: str(value).lower() for name, value in parameters.items()}
        given['log'] = log
        return start('log_replayer', namespace, given, constants, ready, arguments)

    return replay


@pytest.fixture(scope='session')
def listen_raw():
    """Return a list that receives the bytes and send times, ns, of the messages of a topic."""

    def listen_raw(client, kind, topic, qos):
        received = []

        def receive(data, info):
            received.append((bytes(data), info['source_timestamp']))

        client.node.create_subscription(kind, topic, receive, qos, raw=True)
        return received

    return listen_raw
