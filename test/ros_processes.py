"""Real processes of nodes, for what only these show: kills, signals and exit codes."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from ros_graph import DEADLINE, NODES, Suite, new_namespace


class Process:
    """A program in a separate process group; its output goes to a file."""

    def __init__(self, command, folder):
        self._output = folder / 'output.txt'
        with self._output.open('wb') as file:
            self._popen = subprocess.Popen(
                command,
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
        """Return the pids of all alive processes of the group, without zombies."""
        found = []
        for folder in Path('/proc').glob('[0-9]*'):
            with suppress(FileNotFoundError, ProcessLookupError):  # it may end at any time
                fields = (folder / 'stat').read_text().rpartition(')')[2].split()
                if fields[0] != 'Z' and int(fields[2]) == self.pid:
                    found.append(int(folder.name))
        return found

    def send_to_workers(self, number):
        """Send a signal to the worker processes; return their number."""
        workers = 0
        for pid in self.group():
            with suppress(FileNotFoundError, ProcessLookupError):  # it may end at any time
                if 'simulation.workers ' in Path(f'/proc/{pid}/cmdline').read_text():
                    os.kill(pid, number)
                    workers += 1
        return workers


@pytest.fixture(scope='module')
def run_command(tmp_path_factory):
    """Start a command."""
    started = []

    def run_command(*command):
        folder = tmp_path_factory.mktemp('output')
        started.append(Process([str(word) for word in command], folder))
        return started[-1]

    yield run_command
    for process in started:
        process.destroy()


@pytest.fixture(scope='module')
def start_process(run_command, wait):
    """Start a node in a process, which is killed at the end of the module.

    ``constants`` are set before: {'ros.goal_client.ARRIVAL_TIMEOUT': 1.0}.
    """

    def start_process(kind, namespace, parameters=(), constants=(), ready='ready', arguments=()):
        words = [kind, '--ros-args', '-r', f'__ns:={namespace}', *map(str, arguments)]
        for name, value in dict(parameters).items():
            words += ['-p', f'{name}:={value}']
        lines = [f'import sys, {NODES[kind].__name__} as node', f'sys.argv = {words!r}']
        for name, value in dict(constants).items():
            module, _, constant = name.rpartition('.')
            lines += [
                f'import resting_aspects_ros.{module} as changed',
                f'assert hasattr(changed, {constant!r})',
                f'changed.{constant} = {value!r}',
            ]
        lines += ["if __name__ == '__main__':", '    raise SystemExit(node.main())']
        process = run_command(sys.executable, '-u', '-c', '\n'.join(lines))
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
        suite = Suite(new_namespace(), logs, start_process, constants, **simulator)
        return suite.seen_by(connect(suite.namespace))

    return processes
