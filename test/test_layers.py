"""Imports point one way, and a library is imported only where it belongs."""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

NAME = 'resting_aspects_ros'
PACKAGE = Path(__file__).resolve().parents[1] / NAME
# Which other rooms a room may import. `core` is its modules beside the rooms in it.
DOMAIN = {
    'core',
    'core.geometry',
    'core.aspects',
    'core.statistics',
    'core.estimators',
    'core.reorientation',
    'core.vision',
    'core.feeding',
}
COMPOSED = DOMAIN | {'simulation', 'logs', 'report', 'api'}
ON_ROS = COMPOSED | {'ros'}
ROOMS = {
    'core': {'core.geometry'},
    'core.geometry': {'core'},
    'core.aspects': {'core', 'core.geometry'},
    'core.statistics': {'core', 'core.geometry', 'core.aspects'},
    'core.estimators': {'core', 'core.geometry', 'core.aspects'},
    'core.reorientation': {'core', 'core.geometry', 'core.aspects', 'core.statistics'},
    'core.vision': {'core', 'core.geometry', 'core.aspects', 'core.statistics'},
    'core.feeding': {
        'core',
        'core.geometry',
        'core.aspects',
        'core.statistics',
        'core.reorientation',
    },
    'simulation': DOMAIN,
    'logs': DOMAIN,
    'report': DOMAIN,
    'api': COMPOSED,
    'studies': COMPOSED,
    'ros': COMPOSED,
    'client': ON_ROS,
    'run_logs': ON_ROS,
    'nodes.run_tracking': ON_ROS,
    'nodes.drop_simulator': ON_ROS,
    'nodes.aspect_classifier': ON_ROS | {'nodes.run_tracking'},
    'nodes.drop_recorder': ON_ROS | {'nodes.run_tracking', 'run_logs'},
    'nodes.log_replayer': ON_ROS,
    'nodes.feeder_controller': ON_ROS,
    # It has the same model of the tray, and some of the same parameters.
    'nodes.camera_simulator': ON_ROS | {'nodes.feeder_controller'},
    'nodes.vision_example': ON_ROS,
}
# Rooms that may import all others; what the package itself offers is in none.
TOP = {'cli', ''}
# Files that are in no room.
OUTSIDE = {'__init__.py', 'nodes/__init__.py'}
# A log needs the serialisation of messages: imported when one is read or written.
LATE = {('api', 'run_logs')}
CORE_KNOWS = {'numpy', 'scipy', 'shapely', 'trimesh'} | set(sys.stdlib_module_names)
# Libraries that one module of core alone imports.
CORE_ONLY_IN = {
    'yaml': 'core/yaml_file.py',
    'pydantic': 'core/schema.py',
    'manifold3d': 'core/geometry/bodies.py',
    'coacd': 'core/geometry/decomposition.py',
    'cascadio': 'core/geometry/step_file.py',
    'lxml': 'core/geometry/scene_file.py',
    'contourpy': 'core/vision/sampled_union.py',
}
# Clocks, global randomness and the machine are passed in (rule 6).
CORE_NEVER = {'random', 'time', 'datetime', 'os', 'subprocess', 'socket', 'threading'}
# Open CASCADE runs in a process of its own.
CORE_EXCEPTIONS = {('subprocess', 'core/geometry/step_file.py')}
ROS = ('ros/', 'client/', 'nodes/', 'run_logs/')
ONLY_IN = {
    'numba': (
        'simulation/kernel.py',
        'simulation/kernel_cuda.py',
        'simulation/compiled_kernel.py',
    ),
    'llvmlite': ('simulation/compiled_kernel.py',),
    'pybullet': ('simulation/bullet_',),
    'distributed': ('simulation/dask_workers.py',),
    'dask': (),
    'mcap': ('logs/',),
    'shapely': ('core/vision/', 'simulation/surroundings/', 'api/', 'report/'),
    'ezdxf': ('report/outline_drawing.py',),
    'PIL': ('report/outline_images.py',),
    'rclpy': ROS,
    'launch': (),
    'launch_ros': (),
}
MESSAGES = ('_msgs', '_srvs', '_interfaces')
GENERATORS = {'default_rng', 'Generator', 'SeedSequence', 'PCG64', 'Philox', 'BitGenerator'}


def modules():
    return sorted(PACKAGE.rglob('*.py'))


def where(path):
    return path.relative_to(PACKAGE).as_posix()


def room(names):
    """The room of a module, by the names of its place below the package."""
    for count in (2, 1):
        if (name := '.'.join(names[:count])) in ROOMS | dict.fromkeys(TOP):
            return name
    return ''


def imported(tree, path, *, types=True):
    """Full name of each module and member that a module imports, and whether that is at once.

    Without ``types``, imports for types alone are left out.
    """
    package = [NAME, *path.relative_to(PACKAGE).parts[:-1]]
    at_once = {id(node) for node in tree.body}
    for_types = {
        id(each)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING'
        for each in node.body
    }
    for node in ast.walk(tree):
        if id(node) in for_types and not types:
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, id(node) in at_once) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.'.join(package[: len(package) - node.level + 1]) if node.level else ''
            source = '.'.join(part for part in (base, node.module) if part)
            yield from ((f'{source}.{alias.name}', id(node) in at_once) for alias in node.names)


def breaches(path, text):
    """Yield a description of each forbidden import or call of a module."""
    tree = ast.parse(text)
    names = [*path.relative_to(PACKAGE).with_suffix('').parts]
    here = room(names)
    for name, at_once in imported(tree, path):
        first, *rest = name.split('.')
        if first == NAME:
            there = room(rest)
            late = not at_once and (here, there) in LATE
            if here not in TOP and there not in {here, '', *ROOMS[here]} and not late:
                yield f'{here} imports {name}'
        else:
            known = first in CORE_KNOWS or CORE_ONLY_IN.get(first) == where(path)
            never = first in CORE_NEVER and (first, where(path)) not in CORE_EXCEPTIONS
            if here in DOMAIN and (not known or never):
                yield f'core imports {name}'
            places = ONLY_IN.get(first, ROS if first.endswith(MESSAGES) else None)
            if places is not None and not where(path).startswith(places or 'nowhere'):
                yield f'{where(path)} imports {name}'
    if here in {*DOMAIN, 'simulation'}:
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


def test_modules_import_only_permitted_packages():
    found = {where(path): list(breaches(path, path.read_text('utf-8'))) for path in modules()}
    assert {path: breaches_found for path, breaches_found in found.items() if breaches_found} == {}


def test_every_module_is_in_a_room():
    found = {where(path): room(path.relative_to(PACKAGE).parts) for path in modules()}
    assert {path for path, name in found.items() if not name} == OUTSIDE
    assert {*found.values()} == {*ROOMS, *TOP}


def test_rooms_import_in_one_direction():
    # `core` and `core.geometry` are one room in two folders.
    order = {here: ROOMS[here] - {here, 'core', 'core.geometry'} for here in ROOMS}
    TopologicalSorter(order).prepare()  # raises CycleError


def circle(texts):
    """Return modules that import each other in a circle, from their texts by path; [] if none.

    Imports in functions count, and those for types alone do not.
    """
    full = {
        path: '.'.join([NAME, *path.relative_to(PACKAGE).with_suffix('').parts]) for path in texts
    }
    names = {path: name.removesuffix('.__init__') for path, name in full.items()}
    known = {*names.values()}
    graph = {}
    for path, text in texts.items():
        found = {name for name, _ in imported(ast.parse(text), path, types=False)}
        # A name that is no module is a member of the module or package before it.
        found = {name if name in known else name.rpartition('.')[0] for name in found}
        graph[names[path]] = found & known - {names[path]}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_modules_import_in_one_direction():
    assert circle({path: path.read_text('utf-8') for path in modules()}) == []


def test_circles_in_functions_are_detected():
    one, other = PACKAGE / 'core/a.py', PACKAGE / 'core/b.py'
    late = 'def late():\n    from resting_aspects_ros.core.b import B'
    names = circle({one: late, other: 'import resting_aspects_ros.core.a'})
    assert {*names} == {'resting_aspects_ros.core.a', 'resting_aspects_ros.core.b'}
    assert circle({one: late, other: 'if TYPE_CHECKING:\n    from .a import A'}) == []


def test_circle_through_a_package_is_detected():
    above, below = PACKAGE / 'client/__init__.py', PACKAGE / 'client/client.py'
    names = circle(
        {above: 'from .client import C', below: 'from resting_aspects_ros.client import C'}
    )
    assert {*names} == {'resting_aspects_ros.client', 'resting_aspects_ros.client.client'}


@pytest.mark.parametrize(
    ('file', 'line'),
    [
        ('core/part.py', 'from resting_aspects_ros.simulation import plan'),
        ('core/part.py', 'from ..simulation.plan import ENGINE'),
        ('core/part.py', 'from resting_aspects_ros.simulation.config_files import anything'),
        ('core/part.py', 'def late():\n    import time'),
        ('core/part.py', 'from datetime import datetime'),
        ('core/part.py', 'import os.path'),
        ('core/part.py', 'import yaml'),
        ('core/aspects/aspect.py', 'from resting_aspects_ros.core.statistics import intervals'),
        ('api/drop.py', 'from resting_aspects_ros.run_logs.logged_result import logged_result'),
        ('api/drop.py', 'def late():\n    from resting_aspects_ros.ros.spin import spin'),
        ('nodes/drop_recorder/node.py', 'import resting_aspects_ros.nodes.log_replayer.node'),
        ('core/part.py', 'import manifold3d'),
        ('core/part.py', 'import numpy as np\nnp.random.seed(0)'),
        ('simulation/plan.py', 'from resting_aspects_ros.logs.run_writer import RunLog'),
        ('simulation/plan.py', 'from resting_aspects_ros.report import table'),
        ('simulation/plan.py', 'import pybullet'),
        ('simulation/chunks.py', 'def late():\n    from distributed import Client'),
        ('simulation/plan.py', 'import numpy\nx = numpy.random.normal()'),
        ('logs/run_writer.py', 'import resting_aspects_ros.report.table'),
        ('logs/run_writer.py', 'from resting_aspects_ros.cli.main import main'),
        ('logs/run_writer.py', 'from rclpy.node import Node'),
        ('report/table.py', 'import mcap.writer'),
        ('report/table.py', 'from geometry_msgs.msg import Pose'),
        ('cli/verbs/drop.py', 'from resting_aspects_interfaces.msg import Aspect'),
        ('cli/verbs/replay.py', 'from std_srvs.srv import Trigger'),
        ('cli/main.py', 'import rclpy'),
        ('api/drop.py', 'from rclpy.node import Node'),
        ('report/table.py', 'from resting_aspects_ros.client import RestingAspectsClient'),
        ('ros/conversions.py', 'from mcap.writer import Writer'),
    ],
)
def test_forbidden_import_is_detected(file, line):
    assert len(list(breaches(PACKAGE / file, line))) >= 1


@pytest.mark.parametrize(
    ('file', 'line'),
    [
        ('core/part.py', 'from resting_aspects_ros.core.errors import PartError'),
        ('core/part.py', 'import numpy as np\nnp.random.default_rng(1)'),
        ('core/yaml_file.py', 'import yaml'),
        ('api/load_part.py', 'def late():\n    import resting_aspects_ros.run_logs.contents'),
        ('simulation/plan.py', 'from resting_aspects_ros import __version__'),
        ('simulation/bullet_engine.py', 'import pybullet'),
        ('simulation/dask_workers.py', 'from distributed import Client'),
        ('logs/run_writer.py', 'from mcap.writer import Writer'),
        ('ros/conversions.py', 'from resting_aspects_interfaces.msg import Aspect'),
        ('cli/main.py', 'from resting_aspects_ros.client.client import ask'),
        (
            'client/__init__.py',
            'from resting_aspects_ros.client.client import RestingAspectsClient',
        ),
    ],
)
def test_permitted_import_is_accepted(file, line):
    assert list(breaches(PACKAGE / file, line)) == []
