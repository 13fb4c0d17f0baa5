"""Nodes of the suite and clients of them in this process: for the fixtures of test/nodes.

The nodes have their real topics and services. Nothing happens in them unless a test waits for a
condition, which spins the executor of their namespace.
"""

import copy
import functools
import gc
import importlib
import itertools
import os
import threading
import time
from contextlib import contextmanager

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from rclpy.signals import SignalHandlerOptions
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import FeederAction, PartDescription, RestingPoses
from resting_aspects_interfaces.srv import GetDistribution, GetTransitions

from resting_aspects_ros.ros.health import TopicDiscovery
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    ALL_LATCHED,
    DIAGNOSTICS,
    PARTS,
    POSES,
    RESTING_POSES,
    SERVICES,
)

SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
# The modules of the nodes.
NODES = {
    kind: importlib.import_module(f'resting_aspects_ros.nodes.{kind}.node')
    for kind in [*SUITE, 'log_replayer', 'feeder_controller', 'camera_simulator', 'vision_example']
}
# Timeout of every wait, s; with free cores, a fraction of it is enough.
DEADLINE = 300.0
OUTCOMES = {
    GoalStatus.STATUS_SUCCEEDED: 'succeeded',
    GoalStatus.STATUS_CANCELED: 'canceled',
    GoalStatus.STATUS_ABORTED: 'aborted',
}
_serial = itertools.count()


def new_namespace():
    """Return an unused namespace."""
    return f'/test_{os.getpid()}_{next(_serial)}'


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

    def wait(self, condition, what):
        """Spin until a condition holds; return its value."""
        return self._wait(condition, what, DEADLINE, self.step)

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
        self.node = getattr(NODES[kind], kind.title().replace('_', ''))(
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
            # Until it is destructed, which a waiting executor delays, the lines of a new node with
            # its name are published by it, and are lost when it ends.
            self._graph.step()
            gc.collect()
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
        self._wait(lambda: self._handle, 'accepted goal')
        return self._handle.cancel_goal_async()


class Client:
    """A ROS client of the nodes in a namespace."""

    def __init__(self, graph):
        self._graph = graph
        name = f'test_{next(_serial)}'
        node = rclpy.create_node(name, namespace=graph.namespace, context=graph.context)
        self.node = graph.add(node)
        self.wait = graph.wait
        self._ask = self._service(GetDistribution, 'get_distribution')
        self._parts = {}
        take = self._parts.__setitem__
        TopicDiscovery(self.node, PARTS, PartDescription, take, gone=self._parts.pop)
        self.met = set()
        self._drop = ActionClient(self.node, DropPart, 'drop_part', **ACTION_SERVICES)
        self._reorient = ActionClient(self.node, ReorientPart, 'reorient_part', **ACTION_SERVICES)
        self._transitions = self._service(GetTransitions, 'get_transitions')

    def _service(self, kind, name):
        return self.node.create_client(kind, name, qos_profile=SERVICES)

    def destroy(self):
        self._drop.destroy()
        self._reorient.destroy()
        self._graph.remove(self.node)

    def listen(self, kind, topic, qos, *, raw=False):
        """Return a list that receives the messages of a topic while this client waits."""
        received = []
        self.node.create_subscription(kind, topic, received.append, qos, raw=raw)
        return received

    def meet(self, name, ready, send):
        """Wait until a server responds: it may be discovered before it discovers this client."""
        if name in self.met:
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
        self.met.add(name)

    def meet_service(self, client):
        nothing = client.srv_type.Request()  # without part and drops: rejected
        self.meet(client.srv_name, client.service_is_ready, lambda: client.call_async(nothing))

    def call(self, client, request):
        self.meet_service(client)
        answer = client.call_async(request)
        self.wait(answer.done, f'answer of {client.srv_name}')
        return answer.result()

    def asking(self, part='tetrahedron', drops=100, **fields):
        """Return the future of a response of get_distribution."""
        self.meet_service(self._ask)
        return self._ask.call_async(GetDistribution.Request(part=part, drops=drops, **fields))

    def ask(self, part='tetrahedron', drops=100, **fields):
        return self.call(self._ask, GetDistribution.Request(part=part, drops=drops, **fields))

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

    def reorienting(self, part='tetrahedron', action='tap', per_aspect=60, drops=100, **fields):
        """Start a goal; the action is a name or a FeederAction."""
        send = functools.partial(self._reorient.send_goal_async, ReorientPart.Goal())
        self.meet('reorient_part', self._reorient.server_is_ready, send)
        action = FeederAction(name=action) if isinstance(action, str) else action
        fields |= {'part': part, 'action': action, 'per_aspect': per_aspect, 'drops': drops}
        return Drop(self._reorient, ReorientPart.Goal(**fields), self.wait)

    def reorient(self, *arguments, **fields):
        return self.finished(self.reorienting(*arguments, **fields))

    def asking_transitions(self, part, action=''):
        """Return the future of a response of get_transitions."""
        self.meet_service(self._transitions)
        return self._transitions.call_async(GetTransitions.Request(part=part, action=action))

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

    def __init__(self, namespace, logs, start, constants=(), arguments=(), **simulator):
        self.namespace, self.logs, self.client = namespace, logs, None
        simulator = {'workers': 2, **simulator}
        parameters = {
            'drop_simulator': simulator,
            'aspect_classifier': {'log_folder': logs},
            'drop_recorder': {'log_folder': logs},
        }

        def start_node(node, **options):
            constants_of = dict(constants).get(node, {})
            given = {'arguments': arguments, **options}
            return start(node, namespace, parameters[node], constants_of, **given)

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
        self.client.met.clear()  # its servers are waited for again

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

        return self._client.wait(found, what)


class Parameters:
    """Access to the parameters of a running node, through its services."""

    def __init__(self, client, node):
        self._client, self._node, self._services = client, node, {}

    def _call(self, kind, name, **fields):
        if name not in self._services:
            self._services[name] = self._client.node.create_client(kind, f'{self._node}/{name}')
        return self._client.call(self._services[name], kind.Request(**fields))

    def describe(self, name):
        (found,) = self._call(DescribeParameters, 'describe_parameters', names=[name]).descriptors
        return found

    def set(self, **values):
        """Set parameters one by one; return the reasons of rejections."""
        given = [RosParameter(name, value=value) for name, value in values.items()]
        results = self._call(
            SetParameters, 'set_parameters', parameters=[each.to_parameter_msg() for each in given]
        ).results
        return [result.reason for result in results if not result.successful]
