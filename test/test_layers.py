"""Imports point one way: nodes and commands -> report, logs, drops -> core."""

import ast
import sys
from pathlib import Path

import pytest

NAME = 'resting_aspects_ros'
PACKAGE = Path(__file__).resolve().parents[1] / NAME
# Which other layers a layer may import. All that is not named here is above: the nodes, the
# command line and what they share.
LAYERS = {
    'core': set(),
    'drops': {'core'},
    'logs': {'core'},
    'report': {'core'},
}
CORE_KNOWS = {'numpy', 'scipy', 'trimesh'} | set(sys.stdlib_module_names)
# Libraries that one module of core alone imports.
CORE_ONLY_IN = {'yaml': 'core/yaml_file.py', 'manifold3d': 'core/bodies.py'}
# Clocks, global randomness and the machine are passed in (rule 6).
CORE_NEVER = {'random', 'time', 'datetime', 'os', 'subprocess', 'socket', 'threading'}
ONLY_IN = {
    'pybullet': ('drops/engine.py',),
    'distributed': ('drops/cluster.py',),
    'dask': (),
    'mcap': ('logs/',),
    'rclpy': ('nodes/',),
    'launch': (),
    'launch_ros': (),
}
MESSAGES = ('_msgs', '_srvs', '_interfaces')
GENERATORS = {'default_rng', 'Generator', 'SeedSequence', 'PCG64', 'BitGenerator'}


def modules():
    return sorted(PACKAGE.rglob('*.py'))


def where(path):
    return path.relative_to(PACKAGE).as_posix()


def layer(path):
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix('.py')


def imported(tree, path):
    """Full names of all modules and members that a module imports, wherever in it."""
    package = [NAME, *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.'.join(package[: len(package) - node.level + 1]) if node.level else ''
            source = '.'.join(part for part in (base, node.module) if part)
            yield from (f'{source}.{alias.name}' for alias in node.names)


def breaches(path, text):
    """What a module may not do, in words."""
    tree = ast.parse(text)
    here = layer(path)
    for name in imported(tree, path):
        first, *rest = name.split('.')
        if first == NAME:
            there = rest[0] if rest else ''
            is_module = (PACKAGE / there).is_dir() or (PACKAGE / f'{there}.py').exists()
            if here in LAYERS and there and is_module and there not in {here, *LAYERS[here]}:
                yield f'{here} imports {name}'
        else:
            known = first in CORE_KNOWS or CORE_ONLY_IN.get(first) == where(path)
            if here == 'core' and (not known or first in CORE_NEVER):
                yield f'core imports {name}'
            allowed = ONLY_IN.get(first, ('nodes/',) if first.endswith(MESSAGES) else None)
            if allowed is not None and not where(path).startswith(allowed or 'nowhere'):
                yield f'{where(path)} imports {name}'
    if here in ('core', 'drops'):
        yield from _global_randomness(tree)


def _global_randomness(tree):
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Attribute)
            and node.value.attr == 'random'
            and node.attr not in GENERATORS
        ):
            yield f'line {node.lineno} uses the global generator: random.{node.attr}'


@pytest.mark.parametrize('path', modules(), ids=where)
def test_a_module_imports_only_what_its_layer_may(path):
    assert list(breaches(path, path.read_text(encoding='utf-8'))) == []


def test_all_layers_were_read():
    assert {layer(path) for path in modules()} >= {*LAYERS, 'nodes', 'cli'}
    assert len(modules()) > 30


@pytest.mark.parametrize(
    ('file', 'line'),
    [
        ('core/part.py', 'from resting_aspects_ros.drops import engine'),
        ('core/part.py', 'from ..drops.engine import CHUNK'),
        ('core/part.py', 'from resting_aspects_ros.simulation.config_files import anything'),
        ('core/part.py', 'def late():\n    import time'),
        ('core/part.py', 'from datetime import datetime'),
        ('core/part.py', 'import os.path'),
        ('core/part.py', 'import yaml'),
        ('core/part.py', 'import manifold3d'),
        ('core/part.py', 'import numpy as np\nnp.random.seed(0)'),
        ('drops/run.py', 'from resting_aspects_ros.logs.run_writer import RunLog'),
        ('drops/run.py', 'from resting_aspects_ros import report'),
        ('drops/run.py', 'import pybullet'),
        ('drops/campaign.py', 'def late():\n    from distributed import Client'),
        ('drops/run.py', 'import numpy\nx = numpy.random.normal()'),
        ('logs/run_log.py', 'import resting_aspects_ros.report.table'),
        ('logs/run_log.py', 'from resting_aspects_ros.cli import main'),
        ('logs/run_log.py', 'from rclpy.node import Node'),
        ('report/table.py', 'import mcap.writer'),
        ('report/table.py', 'from geometry_msgs.msg import Pose'),
        ('commands/drop.py', 'from resting_aspects_interfaces.msg import Aspect'),
        ('commands/replay.py', 'from std_srvs.srv import Trigger'),
        ('cli.py', 'import rclpy'),
        ('client.py', 'from rclpy.node import Node'),
        ('report/table.py', 'from resting_aspects_ros.client import RestingAspectsClient'),
        ('nodes/convert.py', 'from mcap.writer import Writer'),
    ],
)
def test_a_breach_is_found(file, line):
    assert len(list(breaches(PACKAGE / file, line))) >= 1


@pytest.mark.parametrize(
    ('file', 'line'),
    [
        ('core/part.py', 'from resting_aspects_ros.core.errors import PartError'),
        ('core/part.py', 'import numpy as np\nnp.random.default_rng(1)'),
        ('core/yaml_file.py', 'import yaml'),
        ('drops/run.py', 'from resting_aspects_ros import __version__'),
        ('drops/engine.py', 'import pybullet'),
        ('drops/cluster.py', 'from distributed import Client'),
        ('logs/run_log.py', 'from mcap.writer import Writer'),
        ('nodes/convert.py', 'from resting_aspects_interfaces.msg import Aspect'),
        ('cli.py', 'from resting_aspects_ros.client.client import ask'),
        ('client.py', 'from resting_aspects_ros.client.client import RestingAspectsClient'),
    ],
)
def test_what_is_allowed_is_not_a_breach(file, line):
    assert list(breaches(PACKAGE / file, line)) == []
