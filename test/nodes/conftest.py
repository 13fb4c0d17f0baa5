"""Fixtures that run each node in a separate process, with a client node in this process."""

import copy
import functools
import itertools
import multiprocessing
import os
import re
import signal
import subprocess
import time
import weakref
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import FeederAction, RestingPoses
from resting_aspects_interfaces.srv import GetDistribution, GetTransitions, ListParts

from resting_aspects_ros.client import pending_request
from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import conditions_msg, part_msg, poses_msg, time_msg
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DIAGNOSTICS,
    MIN_BATCH,
    POSES,
    RESTING_POSES,
    SERVICES,
)
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range

SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
# Timeout of every wait, s; with free cores, a fraction of it is enough.
DEADLINE = 300.0
OUTCOMES = {
    GoalStatus.STATUS_SUCCEEDED: 'succeeded',
    GoalStatus.STATUS_CANCELED: 'canceled',
    GoalStatus.STATUS_ABORTED: 'aborted',
}
_serial = itertools.count()
# All groups of processes of this test worker.
_groups = weakref.WeakSet()


# An interpreter that has imported the nodes is forked for each process: the imports take 2 s.
FORKSERVER = multiprocessing.get_context('forkserver')
FORKSERVER.set_forkserver_preload(
    [
        f'resting_aspects_ros.nodes.{node}.node'
        for node in (*SUITE, 'log_replayer', 'feeder_controller')
    ]
)
# First statements of a forked process; it also forks the process in which a node reads files.
FORKED = """
import faulthandler, multiprocessing, os, signal, sys
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
faulthandler.enable(file=2)
faulthandler.register(signal.SIGUSR2, file=2)
forkserver._forkserver.ensure_running = lambda: None
file_worker.get_context = lambda _: multiprocessing.get_context('forkserver')
"""


def program_of(node):
    """Return the module of the program of a node."""
    return f'nodes.{node}.node'


class ForkedNode:
    """A process that runs a script in a forked interpreter; it has the interface of Popen."""

    def __init__(self, script, output):
        output.touch()
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

    def send_signal(self, number):
        if self.poll() is None:
            with suppress(ProcessLookupError):  # it may just have ended
                os.kill(self.pid, number)

    def wait(self, seconds=None):
        self._process.join(seconds)
        assert self.poll() is not None, f'it has not ended within {seconds} s'
        return self.poll()


def start_command(command, output):
    with output.open('wb') as file:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


class Process:
    """A program of the suite in a separate process group; its output goes to a file."""

    def __init__(self, popen, output):
        self._popen, self.output_file, self.pid = popen, output, popen.pid

    @property
    def output(self):
        return self.output_file.read_text()

    @property
    def running(self):
        return self._popen.poll() is None

    def send(self, number):
        self._popen.send_signal(number)

    def print_stack(self):
        """Let a forked interpreter print the stacks of its threads."""
        if isinstance(self._popen, ForkedNode):
            self.send(signal.SIGUSR2)

    def send_to_group(self, number):
        """Send a signal to the process group, as a terminal does on Ctrl-C."""
        os.killpg(self.pid, number)

    def end(self, number=signal.SIGINT, seconds=DEADLINE):
        """Send a signal and return the exit code."""
        if self.running:
            self.send(number)
        return self._popen.wait(seconds)

    def destroy(self):
        """Kill the process and its group, also after a failure."""
        if self.running:  # otherwise its pid may have been reused
            with suppress(ProcessLookupError):  # its process group may not exist yet
                os.killpg(self.pid, signal.SIGKILL)
            self.send(signal.SIGKILL)
            self._popen.wait()

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

    def cpu(self):
        """Return the processor time of the group, s."""
        ticks = [
            int(fields[11]) + int(fields[12])
            for _, fields in _processes()
            if int(fields[2]) == self.pid
        ]
        return sum(ticks) / os.sysconf('SC_CLK_TCK')


def _processes():
    """Yield pid and the fields of /proc/<pid>/stat after the name of all processes but zombies."""
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            fields = (folder / 'stat').read_text().rpartition(')')[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if fields[0] != 'Z':
            yield int(folder.name), fields


class Processes:
    """Starts programs, and kills all of them at the end."""

    def __init__(self, tmp_path_factory, wait):
        self._folder, self._wait = tmp_path_factory, wait
        self._started = []
        _groups.add(self)

    def command(self, *command):
        """Start a command and return its process."""
        return self._begin(start_command, [str(word) for word in command])

    def script(self, code, *arguments):
        """Run a Python script in an interpreter that has imported the nodes."""
        return self._begin(ForkedNode, f'sys.argv = {["-c", *map(str, arguments)]!r}\n{code}')

    def node(self, node, namespace, parameters=(), constants=(), ready='ready', arguments=()):
        """Start a node, wait until it is ready, and return its process.

        ``constants`` are set before: {'nodes.run_tracking.tracker.GRACE': 1.0}.
        """
        arguments = [node, '--ros-args', '-r', f'__ns:={namespace}', *map(str, arguments)]
        for name, value in dict(parameters).items():
            arguments += ['-p', f'{name}:={value}']
        lines = [
            f'sys.argv = {arguments!r}',
            f'import resting_aspects_ros.{program_of(node)} as node',
        ]
        for name, value in dict(constants).items():
            module, _, constant = name.rpartition('.')
            lines += [
                f'import resting_aspects_ros.{module} as changed',
                f'assert hasattr(changed, {constant!r})',
                f'changed.{constant} = {value!r}',
            ]
        process = self._begin(ForkedNode, '\n'.join([*lines, 'raise SystemExit(node.main())']))
        if ready:
            self.ready(process, node, ready)
        return process

    def ready(self, process, what, word='ready'):
        """Wait until the output of a process contains a word."""
        self._wait(lambda: word in process.output or not process.running, f'{what} ready')
        assert process.running, process.output

    def _begin(self, start, what):
        output = self._folder.mktemp('output') / 'output.txt'
        self._started.append(Process(start(what, output), output))
        return self._started[-1]

    def outputs(self):
        """Yield the output of each running program, which ends with what a node is doing."""
        running = [process for process in self._started if process.running]
        for process in running:
            process.print_stack()
        time.sleep(0.5)  # for a report only
        for process in running:
            yield str(process.output_file), process.output[-3000:]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self._started:
            process.destroy()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Show the programs that run when a test fails."""
    report = yield
    if report.failed:
        for processes in list(_groups):
            report.sections += processes.outputs()
    return report


@pytest.fixture(scope='module')
def processes(tmp_path_factory, wait):
    """Start programs that are killed at the end of the module."""
    with Processes(tmp_path_factory, wait) as processes:
        yield processes


@pytest.fixture(scope='module')
def run_command(processes):
    """Start a command that is killed at the end of the module."""
    return processes.command


@pytest.fixture(scope='module')
def run_script(processes):
    """Run a Python script that is killed at the end of the module."""
    return processes.script


@pytest.fixture
def ahead(monkeypatch):
    """Advance the clock of the requests of a client, in seconds."""
    offset = 0.0

    def ahead(seconds):
        nonlocal offset
        offset += seconds

    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + offset)
    monkeypatch.setattr(pending_request, 'time', clock)
    return ahead


@pytest.fixture(scope='module')
def start(processes):
    """Start a node that is killed at the end of the module."""
    return processes.node


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
    """A ROS client of one suite."""

    def __init__(self, namespace, wait):
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(
            f'test_{next(_serial)}', namespace=namespace, context=self._context
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._wait = wait
        self._ask = self.node.create_client(
            GetDistribution, 'get_distribution', qos_profile=SERVICES
        )
        self._list = self.node.create_client(ListParts, 'list_parts')
        self._met = set()
        self._drop = ActionClient(self.node, DropPart, 'drop_part', **ACTION_SERVICES)
        self._reorient = self._transitions = None

    def destroy(self):
        self._drop.destroy()
        if self._reorient is not None:
            self._reorient.destroy()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def wait(self, condition, what, seconds=DEADLINE):
        """Spin until a condition holds."""
        return self._wait(
            condition, what, seconds, lambda: self._executor.spin_once(timeout_sec=0.05)
        )

    def spin(self, seconds):
        """Spin for a time, for measurements over time."""
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

    def parts(self):
        """Return the summaries of list_parts by name, in their order."""
        return {part.name: part for part in self.call(self._list, ListParts.Request()).parts}

    def dropping(self, part='tetrahedron', drops=100, **fields):
        nothing = DropPart.Goal()
        send = functools.partial(self._drop.send_goal_async, nothing)
        self.meet('drop_part', self._drop.server_is_ready, send)
        return Drop(self._drop, DropPart.Goal(part=part, drops=drops, **fields), self.wait)

    def drop(self, part='tetrahedron', drops=100, **fields):
        drop = self.dropping(part, drops, **fields)
        self.wait(lambda: drop.done, f'drop of {part}')
        return drop

    def dropping_in_bullet(self, part='tetrahedron', drops=100, **fields):
        """Start a goal whose drops are made by worker processes; the kernel has threads."""
        return self.dropping(part, drops, surroundings='bowl_track', **fields)

    def reorienting(self, part='tetrahedron', action='tap', per_aspect=60, drops=100, **fields):
        """Start a goal; the action is a name or a FeederAction."""
        if self._reorient is None:
            self._reorient = ActionClient(
                self.node, ReorientPart, 'reorient_part', **ACTION_SERVICES
            )
        send = functools.partial(self._reorient.send_goal_async, ReorientPart.Goal())
        self.meet('reorient_part', self._reorient.server_is_ready, send)
        action = FeederAction(name=action) if isinstance(action, str) else action
        fields |= {'part': part, 'action': action, 'per_aspect': per_aspect, 'drops': drops}
        return Drop(self._reorient, ReorientPart.Goal(**fields), self.wait)

    def reorient(self, *arguments, **fields):
        goal = self.reorienting(*arguments, **fields)
        self.wait(lambda: goal.done, 'transitions')
        return goal

    def transitions(self, part='tetrahedron', action=''):
        """Return the response of get_transitions."""
        if self._transitions is None:
            self._transitions = self.node.create_client(
                GetTransitions, 'get_transitions', qos_profile=SERVICES
            )
        return self.call(self._transitions, GetTransitions.Request(part=part, action=action))

    def poses(self):
        return self.listen(RestingPoses, RESTING_POSES, POSES)


@pytest.fixture(scope='module')
def connect(wait):
    """Return a function that creates a client of the suite in a namespace."""
    clients = []

    def connect(namespace):
        clients.append(Client(namespace, wait))
        return clients[-1]

    yield connect
    for client in clients:
        client.destroy()


@pytest.fixture
def namespace():
    """Return an unused namespace."""
    return f'/test_{os.getpid()}_{next(_serial)}'


class Suite:
    """The three nodes, each in a process, and a client."""

    def __init__(self, namespace, logs, processes, constants=(), **simulator):
        self.namespace, self.logs = namespace, logs
        self.client = None
        parameters = {
            'drop_simulator': simulator,
            'aspect_classifier': {'log_folder': logs},
            'drop_recorder': {'log_folder': logs},
        }

        def start_node(node, **options):
            return processes.node(
                node, namespace, parameters.get(node, {}), dict(constants).get(node, {}), **options
            )

        self._start = start_node
        # Concurrently: each starts further processes.
        self.processes = {node: start_node(node, ready='') for node in SUITE}
        for node, process in self.processes.items():
            processes.ready(process, node)

    def seen_by(self, client):
        """Return the same nodes with another client."""
        suite = copy.copy(self)
        suite.client = client
        return suite

    def start_again(self, node):
        """Restart a stopped node with the same parameters."""
        assert not self.processes[node].running
        self.processes[node] = self._start(node)
        self.client.forget()

    @property
    def alive(self):
        return all(process.running for process in self.processes.values())

    def log_of(self, run_id):
        """Return the folder of the log of a run, once it is complete."""

        def whole():
            return list(self.logs.glob(f'*_{run_id}/metadata.yaml'))

        return self.client.wait(whole, f'log of run {run_id}')[0].parent


@pytest.fixture(scope='session')
def shared_nodes(tmp_path_factory, wait):
    """Start the nodes of the test worker for all modules that do not end them."""
    with Processes(tmp_path_factory, wait) as processes:
        yield Suite(f'/test_{os.getpid()}', tmp_path_factory.mktemp('logs'), processes)


@pytest.fixture(scope='module')
def suite(shared_nodes, connect):
    """Return the nodes that all modules share, with a client of the module."""
    assert shared_nodes.alive, [each.output for each in shared_nodes.processes.values()]
    return shared_nodes.seen_by(connect(shared_nodes.namespace))


@pytest.fixture(scope='module')
def fresh_suite(processes, connect, tmp_path_factory):
    """Return a function that starts new nodes, which are killed at the end of the module."""

    def fresh_suite(constants=(), **simulator):
        namespace = f'/test_{os.getpid()}_{next(_serial)}'
        logs = tmp_path_factory.mktemp('logs')
        suite = Suite(namespace, logs, processes, constants, **simulator)
        return suite.seen_by(connect(namespace))

    return fresh_suite


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
            assert status.hardware_id == 'none'
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
        results = self._call(SetParameters, 'set_parameters', parameters=messages(values)).results
        assert len(results) == len(values)
        return [result.reason for result in results if not result.successful]

    def set_all_or_nothing(self, **values):
        result = self._call(
            SetParametersAtomically, 'set_parameters_atomically', parameters=messages(values)
        ).result
        return [] if result.successful else [result.reason]


def messages(values):
    return [RosParameter(name, value=value).to_parameter_msg() for name, value in values.items()]


@pytest.fixture(scope='session')
def parameters_of():
    """Return the class that accesses the parameters of a running node."""
    return Parameters


@pytest.fixture(scope='session')
def counts():
    """Return all counts of a distribution as one tuple."""

    def counts(distribution):
        of_aspects = tuple(aspect.count for aspect in distribution.aspects)
        return (
            *of_aspects,
            distribution.unclassified,
            distribution.unsettled,
            distribution.failed,
        )

    return counts


@pytest.fixture
def quick(surfaces):
    """Return conditions for short drops: from a low height, without bounces."""
    return [conditions_msg(surfaces.get().changed(height=1e-3, restitution=0.0))]


@pytest.fixture(scope='session')
def traceback():
    """Return a function that finds a traceback in an output."""
    return lambda text: re.search(r'Traceback|Exception ignored|never retrieved', text)


@pytest.fixture(scope='session')
def batches(part, surfaces):
    """Create serialized batches of a run of the tetrahedron; each repeats the first drops."""

    def plan(count, run_id):
        return plan_run(
            part('tetrahedron'),
            surfaces.get(),
            seed=1,
            drops=count * MIN_BATCH,
            run_id=run_id,
            started=10**18,
        )

    job, _ = plan(1, '')
    poses = drop_range(job, 0, MIN_BATCH)

    def batches(count, run_id='recorded'):
        batch = poses_msg(poses, plan(count, run_id)[1], time_msg(7), last=False)
        for k in range(count):
            batch.first_drop = k * MIN_BATCH
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

    def replay(log, ready='ready', constants=(), **parameters):
        given = {name: str(value).lower() for name, value in parameters.items()}
        return start('log_replayer', namespace, {'log': log, **given}, constants, ready)

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
