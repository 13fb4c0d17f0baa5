"""package.xml, setup.py and requirements.in declare exactly what the code needs."""

import ast
import json
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from zipfile import ZipFile

import pytest
from catkin_pkg.package import parse_package

import resting_aspects_ros

ROOT = Path(__file__).resolve().parent.parent
SHARED = ('config', 'launch', 'rviz')
SUITE = ROOT / 'package.xml'
INTERFACES = ROOT / 'resting_aspects_interfaces' / 'package.xml'

# import name: (name in requirements*.in, rosdep key or ROS package in package.xml)
DEPENDENCIES = {
    **{
        name: (name, f'python3-{name}')
        for name in (
            'aiohttp', 'ezdxf', 'hypothesis', 'jinja2', 'llvmlite', 'lxml', 'matplotlib', 'numba',
            'numpy', 'openpyxl', 'pydantic', 'pytest', 'rich', 'scipy', 'shapely',
        )
    },
    **{name: (name, f'python3-{name}-pip') for name in ('pybullet', 'rosbags', 'trimesh')},
    **{name: (name, None) for name in ('cascadio', 'coacd', 'manifold3d', 'simpy')},
    'fast_simplification': ('fast-simplification', None),  # rosdep has no key for these five
    'PIL': ('pillow', 'python3-pil'),
    'catkin_pkg': ('catkin_pkg', 'python3-catkin-pkg'),
    'contourpy': ('contourpy', 'python3-matplotlib'),  # which depends on it
    'cv2': ('opencv-python-headless', 'python3-opencv'),
    'domain_coordinator': ('ros-domain-coordinator', 'domain_coordinator'),
    'pybullet_utils': ('pybullet', 'python3-pybullet-pip'),
    'yaml': ('pyyaml', 'python3-yaml'),
    # mcap reads chunks with the others.
    **dict.fromkeys(('lz4', 'mcap', 'zstandard'), ('mcap', 'mcap-ros2-support')),
    **{
        name: ('ros-jazzy-rclpy', name)
        for name in (
            'action_msgs', 'ament_index_python', 'rcl_interfaces', 'rclpy', 'rosgraph_msgs',
            'unique_identifier_msgs',
        )
    },
    **{
        name: ('ros-jazzy-common-interfaces', name)
        for name in (
            'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'sensor_msgs', 'shape_msgs',
            'std_msgs', 'std_srvs', 'visualization_msgs',
        )
    },
    # Built here, or in an installed ROS.
    **{
        name: (None, name)
        for name in ('launch', 'launch_ros', 'resting_aspects_interfaces', 'tf2_msgs')
    },
}  # fmt: skip
# What the suite can do without, and neither requirements.in nor package.xml has.
OPTIONAL = {'distributed'}
# Used without an import: the time limit of tests in pyproject.toml.
NEVER_IMPORTED = {'python3-pytest-timeout'}


def third_party_imports(folder):
    """Return the top names that the files below a folder import, without Python's and our own."""
    names = set()
    for path in (ROOT / folder).rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.split('.')[0])
    own = {
        'resting_aspects_ros',
        'test',
        *(path.parent.name for path in (ROOT / 'tools').glob('*/__init__.py')),
        *(path.stem for path in (ROOT / 'test').glob('*.py')),
    }
    return names - sys.stdlib_module_names - own


@cache
def needed(folder):
    """Return what the imports of a folder need: names in requirements*.in, and in package.xml."""
    imported = third_party_imports(folder) - OPTIONAL
    assert imported <= DEPENDENCIES.keys(), 'add these to DEPENDENCIES here'
    pairs = [DEPENDENCIES[name] for name in imported]
    return {name for name, _ in pairs} - {None}, {key for _, key in pairs} - {None}


def requirements(*files):
    """Return the package names in requirements*.in files."""
    lines = '\n'.join((ROOT / file).read_text() for file in files).splitlines()
    found = (re.match(r'[A-Za-z][\w.-]*', line) for line in lines)
    return {match[0] for match in found if match}


def names(dependencies):
    return {dependency.name for dependency in dependencies}


def from_setup(*keys):
    """Return some of the values that setup.py gives to setuptools."""
    script = (
        'import json, runpy, setuptools, sys\n'
        'setuptools.setup = lambda **given: print(json.dumps([given[k] for k in sys.argv[1:]]))\n'
        'runpy.run_path("setup.py")'
    )
    command = [sys.executable, '-c', script, *keys]
    return json.loads(subprocess.check_output(command, cwd=ROOT, text=True))


@pytest.mark.slow
def test_package_xml_and_requirements_declare_what_is_imported():
    pinned, keys = needed('resting_aspects_ros')
    _, in_launch = needed('launch')
    (file,) = (ROOT / 'launch').glob('*.py')
    started = set(re.findall(r"package='(\w+)'", file.read_text()))
    assert started == {'rviz2', 'tf2_ros'}
    pinned_of_tests, keys_of_tests = needed('test')
    package = parse_package(SUITE)
    # trimesh reads 3MF files with lxml and networkx.
    scenes = {'python3-lxml', 'python3-networkx'}
    assert names(package.exec_depends) == keys | in_launch | started | scenes
    assert names(package.test_depends) - keys_of_tests == NEVER_IMPORTED
    assert keys_of_tests <= names(package.exec_depends + package.test_depends)
    assert pinned <= requirements('requirements.in')
    assert pinned_of_tests <= requirements('requirements.in', 'requirements-dev.in')


@pytest.mark.slow
def test_setup_declares_what_the_rooms_without_ros_import():
    name = re.compile('[A-Za-z0-9-]+')
    installed, extras = from_setup('install_requires', 'extras_require')
    required = {name.match(each)[0] for each in installed}
    optional = {name.match(each)[0] for of in extras.values() for each in of}
    pinned, _ = needed('resting_aspects_ros')
    assert pinned - required - optional == set()
    # trimesh reads 3MF files with lxml and networkx.
    assert required - pinned == {'lxml', 'networkx'}
    assert {name.match(each)[0] for each in extras['dask']} == OPTIONAL
    assert requirements('requirements-dev.in') - requirements('requirements.in') >= OPTIONAL
    assert required | (optional - OPTIONAL - {'numba-cuda'}) <= requirements('requirements.in')


def test_interface_package_declares_its_dependencies():
    folder = INTERFACES.parent
    files = [*folder.glob('msg/*'), *folder.glob('srv/*'), *folder.glob('action/*')]
    text = '\n'.join(path.read_text() for path in files)
    used = set(re.findall(r'^(\w+)/\w+', text, flags=re.MULTILINE))
    cmake = (folder / 'CMakeLists.txt').read_text()
    assert used <= names(parse_package(INTERFACES).build_depends)
    assert used == set(re.search(r'DEPENDENCIES([\w\s]+)', cmake)[1].split())


def test_packages_are_valid_and_of_one_version():
    warnings = []
    packages = [parse_package(each, warnings=warnings) for each in (SUITE, INTERFACES)]
    for package in packages:
        package.validate(warnings=warnings)
    assert warnings == []
    versions = {*(each.version for each in packages), *from_setup('version')}
    assert versions == {resting_aspects_ros.__version__}


def built(kind, source, folder):
    """Copy the suite to a folder, as a build leaves files behind, and build a wheel of it."""
    source.mkdir()
    for name in ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'README.md'):
        shutil.copy(ROOT / name, source)
    for name in (*SHARED, 'resource', 'resting_aspects_ros'):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns('*.pyc'))
    build = f'import setuptools.build_meta as b, sys; b.{kind}(sys.argv[1])'
    subprocess.run([sys.executable, '-c', build, folder], cwd=source, check=True)
    (wheel,) = folder.glob('*.whl')
    return ZipFile(wheel)


def test_script_beside_a_clone_named_like_the_package_imports_it(tmp_path):
    clone, site = tmp_path / 'resting_aspects_ros', tmp_path / 'site'
    with built('build_editable', clone, tmp_path) as packed:
        packed.extractall(site)
    script = tmp_path / 'script.py'
    script.write_text(
        'import site, sys\nsite.addsitedir(sys.argv[1])\n'
        'import resting_aspects_ros\nprint(resting_aspects_ros.__file__)\n'
    )
    # -S: without the site-packages of this virtual environment, where the suite is installed, too.
    found = subprocess.check_output([sys.executable, '-S', script, site], env={}, text=True)
    assert found.split() == [str(clone / 'resting_aspects_ros' / '__init__.py')]


@pytest.mark.slow
def test_wheel_has_all_shared_files(tmp_path):
    files = {
        path.relative_to(ROOT).as_posix()
        for folder in SHARED
        for path in (ROOT / folder).rglob('*.*')
        if path.is_file() and path.suffix != '.pyc'
    }
    share = '.data/data/share/resting_aspects_ros/'
    with built('build_wheel', tmp_path / 'source', tmp_path) as packed:
        shared = {name.split(share)[1] for name in packed.namelist() if share in name}
    assert shared == {*files, 'package.xml'}
