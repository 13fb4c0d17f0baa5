"""Fixtures of all tests, their ROS domain, and their distribution over test workers."""

import os

# Before NumPy is imported: threads of small matrix products would only wait for each other.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import dataclasses
import importlib
import logging
import signal
import time
from collections import defaultdict
from pathlib import Path

import domain_coordinator
import hypothesis
import numpy as np
import pytest
from solids import solids  # noqa: F401  # a fixture

from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.simulation.conditions import Surfaces
from resting_aspects_ros.statistics.poses import RestingPoses

ROOT = Path(__file__).resolve().parents[1]

# Timeout of every wait, s; with free cores, a fraction of it is enough.
DEADLINE = 600.0

# The processes that tests start are ended by signals. `nohup make test` would let them ignore
# SIGHUP, and `make test &` in a script SIGINT and SIGQUIT, because a process inherits what is
# ignored.
for number in (signal.SIGHUP, signal.SIGQUIT):
    signal.signal(number, signal.SIG_DFL)
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# On a loaded machine, slow examples and slow generation of examples are not failures.
hypothesis.settings.register_profile(
    'quick',
    max_examples=20,
    derandomize=True,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.register_profile(
    'all', hypothesis.settings.get_profile('quick'), max_examples=25, derandomize=False
)
hypothesis.settings.load_profile(os.environ.get('HYPOTHESIS_PROFILE', 'quick'))


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the marks
def pytest_collection_modifyitems(items):
    """Keep the tests of a file on one worker if they share a fixture of module scope.

    All other tests are distributed one by one, after these files. Of a test with the marker
    quick_cases(n), all but n cases become slow; these are spread evenly over the list.
    """
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker('quick_cases') and not item.get_closest_marker('slow'):
            cases[item.nodeid.partition('[')[0]].append(item)
    for found in cases.values():
        (number,) = found[0].get_closest_marker('quick_cases').args
        quick = {len(found) * k // number for k in range(number)}
        for k, item in enumerate(found):
            if k not in quick:
                item.add_marker(pytest.mark.slow)
    for item in items:
        definitions = item._fixtureinfo.name2fixturedefs.values()
        if any(definition[-1].scope == 'module' for definition in definitions):
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition('::')[0]))


@pytest.fixture(scope='session', autouse=True)
def domain(tmp_path_factory):
    """Give each test worker a ROS domain that no other program on this machine uses."""
    with domain_coordinator.domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')  # as far as dds.xml lets it
        patch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', str(ROOT / 'test' / 'dds.xml'))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros')))
        yield


@pytest.fixture(scope='session')
def wait():
    """Return a function that waits for a condition, with a timeout."""

    def wait(condition, what, seconds=DEADLINE, step=lambda: time.sleep(0.02)):
        end = time.monotonic() + seconds
        while not (result := condition()):
            assert time.monotonic() < end, f'{what}: not within {seconds:g} s'
            step()
        return result

    return wait


@pytest.fixture(scope='session')
def part():
    """Give the example part of a name."""
    return PartLibrary(ROOT / 'config' / 'parts').load


@pytest.fixture(scope='session')
def solid():
    """Make a part of a trimesh, in mm, through a file of a format."""

    def make(mesh, mesh_format='stl', **given):
        data = mesh.export(file_type=mesh_format)
        data = data.encode() if isinstance(data, str) else data
        return part_from_bytes(data, mesh_format.removesuffix('_ascii'), 'solid', **given)

    return make


@pytest.fixture(scope='session')
def surfaces():
    """Give the shipped sets of conditions."""
    return Surfaces.read(ROOT / 'config' / 'surfaces.yaml')


@pytest.fixture(scope='session')
def assert_same_poses():
    """Hold poses to others, bit for bit."""

    def assert_same_poses(a, b):
        for field in dataclasses.fields(RestingPoses):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))

    return assert_same_poses


@pytest.fixture(scope='session')
def make_cluster():
    """Begin a Dask cluster of processes on this machine; a context manager."""
    distributed = pytest.importorskip('distributed', reason='distributed is not installed')
    return lambda workers: distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=':0',
        silence_logs=logging.CRITICAL,
    )


@pytest.fixture(scope='module')
def cluster(make_cluster):
    """A Dask cluster of two workers."""
    with make_cluster(2) as cluster:
        yield cluster


@pytest.fixture(scope='session')
def filled():
    """Make a message in which every field, at any depth, has a value that is not the default."""
    return _filled


def _filled(message_class, rng):
    message = message_class()
    for name, kind in message_class.get_fields_and_field_types().items():
        setattr(message, name, _value(kind, rng))
    return message


def _value(kind, rng):
    if kind.startswith('sequence<'):
        element, _, most = kind[len('sequence<') : -1].partition(', ')
        return [_value(element, rng) for _ in range(min(3, int(most or 3)))]
    if kind.endswith(']'):
        element, count = kind[:-1].split('[')
        return [_value(element, rng) for _ in range(int(count))]
    if '/' in kind:
        package, name = kind.split('/')
        return _filled(getattr(importlib.import_module(f'{package}.msg'), name), rng)
    if 'int' in kind:
        bits = int(kind.split('int')[1])
        return rng.getrandbits(bits - 1) | (1 << bits - 1 if kind.startswith('u') else 1)
    return {
        'string': f'ä {rng.random()}',
        'boolean': True,
        'double': rng.uniform(-1, 1),
        'float': rng.randint(1, 999) / 64,  # exact in 32 bits
    }[kind]
