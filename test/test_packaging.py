"""package.xml, setup.py and requirements.in declare exactly what the code needs."""

import ast
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from catkin_pkg.package import parse_package
from catkin_pkg.packages import find_packages

import resting_aspects_ros

ROOT = Path(__file__).resolve().parent.parent
SHARED = ('config', 'launch', 'rviz')
SUITE = ROOT / 'package.xml'
INTERFACES = ROOT / 'resting_aspects_interfaces' / 'package.xml'

# import name: (name in requirements*.in, rosdep key or ROS package in package.xml)
MESSAGES = 'ros-jazzy-common-interfaces'
DEPENDENCIES = {
    'PIL': ('pillow', 'python3-pil'),
    'aiohttp': ('aiohttp', 'python3-aiohttp'),
    'action_msgs': ('ros-jazzy-rclpy', 'action_msgs'),
    'ament_index_python': ('ros-jazzy-rclpy', 'ament_index_python'),
    'builtin_interfaces': (MESSAGES, 'builtin_interfaces'),
    'cascadio': ('cascadio', None),  # rosdep has no key for it
    'catkin_pkg': ('catkin_pkg', 'python3-catkin-pkg'),
    'coacd': ('coacd', None),  # rosdep has no key for it
    'fast_simplification': ('fast-simplification', None),  # rosdep has no key for it
    'contourpy': ('contourpy', 'python3-matplotlib'),  # which depends on it
    'cv2': ('opencv-python-headless', 'python3-opencv'),
    'diagnostic_msgs': (MESSAGES, 'diagnostic_msgs'),
    'domain_coordinator': ('ros-domain-coordinator', 'domain_coordinator'),
    'geometry_msgs': (MESSAGES, 'geometry_msgs'),
    'ezdxf': ('ezdxf', 'python3-ezdxf'),
    'hypothesis': ('hypothesis', 'python3-hypothesis'),
    'jinja2': ('jinja2', 'python3-jinja2'),
    'launch': (None, 'launch'),  # with a ROS, where the launch file is used
    'launch_ros': (None, 'launch_ros'),
    'lxml': ('lxml', 'python3-lxml'),
    'lz4': ('mcap', 'mcap-ros2-support'),  # what mcap reads chunks with
    'manifold3d': ('manifold3d', None),  # rosdep has no key for it
    'matplotlib': ('matplotlib', 'python3-matplotlib'),
    'mcap': ('mcap', 'mcap-ros2-support'),
    'numpy': ('numpy', 'python3-numpy'),
    'openpyxl': ('openpyxl', 'python3-openpyxl'),
    'llvmlite': ('llvmlite', 'python3-llvmlite'),
    'numba': ('numba', 'python3-numba'),
    'pybullet': ('pybullet', 'python3-pybullet-pip'),
    'pydantic': ('pydantic', 'python3-pydantic'),
    'pytest': ('pytest', 'python3-pytest'),
    'rcl_interfaces': ('ros-jazzy-rclpy', 'rcl_interfaces'),
    'rclpy': ('ros-jazzy-rclpy', 'rclpy'),
    'resting_aspects_interfaces': (None, 'resting_aspects_interfaces'),
    'rich': ('rich', 'python3-rich'),
    'rosbags': ('rosbags', 'python3-rosbags-pip'),
    'scipy': ('scipy', 'python3-scipy'),
    'shapely': ('shapely', 'python3-shapely'),
    'simpy': ('simpy', None),  # rosdep has no key for it
    'rosgraph_msgs': ('ros-jazzy-rclpy', 'rosgraph_msgs'),
    'sensor_msgs': (MESSAGES, 'sensor_msgs'),
    'shape_msgs': (MESSAGES, 'shape_msgs'),
    'std_msgs': (MESSAGES, 'std_msgs'),
    'tf2_msgs': (None, 'tf2_msgs'),  # with a ROS, where tf2 is installed
    'std_srvs': (MESSAGES, 'std_srvs'),
    'trimesh': ('trimesh', 'python3-trimesh-pip'),
    'unique_identifier_msgs': ('ros-jazzy-rclpy', 'unique_identifier_msgs'),
    'visualization_msgs': (MESSAGES, 'visualization_msgs'),
    'yaml': ('pyyaml', 'python3-yaml'),
    'zstandard': ('mcap', 'mcap-ros2-support'),
}
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


@pytest.mark.parametrize('path', [SUITE, INTERFACES], ids=['suite', 'interfaces'])
def test_package_xml_is_valid_without_a_warning(path):
    warnings = []
    package = parse_package(path, warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert package.package_format == 3
    assert package.licenses == ['Apache-2.0']
    assert 'Apache License' in (ROOT / 'LICENSE').read_text()


def needed_to_launch():
    """Return what the launch file imports and the packages whose programs it starts."""
    _, imported = needed('launch')
    (file,) = (ROOT / 'launch').glob('*.py')
    started = set(re.findall(r"package='(\w+)'", file.read_text()))
    assert started == {'rviz2', 'tf2_ros'}
    return imported | started


@pytest.mark.slow
def test_imports_of_the_suite_are_declared():
    pinned, keys = needed('resting_aspects_ros')
    in_launch = needed_to_launch()
    assert {'numpy', 'ros-jazzy-rclpy'} <= pinned
    assert {'launch', 'launch_ros'} <= in_launch
    assert (keys | in_launch) - names(parse_package(SUITE).exec_depends) == set()
    assert pinned - requirements('requirements.in') == set()


def declared_by_setup():
    """Return the names that setup.py requires, and those of its extras."""
    script = (
        'import json, runpy, setuptools\n'
        "keys = ('install_requires', 'extras_require')\n"
        'setuptools.setup = lambda **given: print(json.dumps([given[key] for key in keys]))\n'
        'runpy.run_path("setup.py")'
    )
    printed = subprocess.run(
        [sys.executable, '-c', script], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    required, extras = json.loads(printed)
    name = re.compile('[A-Za-z0-9-]+')
    return (
        {name.match(each)[0] for each in required},
        {extra: {name.match(each)[0] for each in of} for extra, of in extras.items()},
    )


@pytest.mark.slow
def test_setup_declares_what_the_rooms_without_ros_import():
    required, extras = declared_by_setup()
    optional = set().union(*extras.values())
    pinned, _ = needed('resting_aspects_ros')
    assert pinned - required - optional == set()
    # trimesh reads 3MF files with networkx.
    assert required - pinned == {'networkx'}
    assert extras['dask'] == OPTIONAL
    assert requirements('requirements-dev.in') - requirements('requirements.in') >= OPTIONAL
    assert required | (optional - OPTIONAL - {'numba-cuda'}) <= requirements('requirements.in')


@pytest.mark.slow
def test_imports_of_the_tests_are_declared():
    pinned, keys = needed('test')
    package = parse_package(SUITE)
    assert keys - names(package.exec_depends + package.test_depends) == set()
    assert pinned - requirements('requirements.in', 'requirements-dev.in') == set()


@pytest.mark.slow
def test_every_name_in_package_xml_is_used():
    _, in_suite = needed('resting_aspects_ros')
    in_launch = needed_to_launch()
    _, in_tests = needed('test')
    package = parse_package(SUITE)
    # trimesh reads 3MF files with networkx.
    assert names(package.exec_depends) - in_suite - in_launch == {'python3-networkx'}
    assert names(package.build_depends) - in_suite == set()
    assert names(package.test_depends) - in_tests == NEVER_IMPORTED


def test_interface_package_declares_its_dependencies():
    folder = INTERFACES.parent
    files = [*folder.glob('msg/*'), *folder.glob('srv/*'), *folder.glob('action/*')]
    text = '\n'.join(path.read_text() for path in files)
    used = set(re.findall(r'^(\w+)/\w+', text, flags=re.MULTILINE))
    cmake = (folder / 'CMakeLists.txt').read_text()
    assert used <= names(parse_package(INTERFACES).build_depends)
    assert used == set(re.search(r'DEPENDENCIES([\w\s]+)', cmake)[1].split())
    assert {str(path.relative_to(folder)) for path in files} == set(
        re.findall(r'^ *((?:msg|srv|action)/\w+\.\w+)$', cmake, flags=re.MULTILINE)
    )


def test_rosdep_finds_both_packages():
    """It looks for no package within a package."""
    guide = (ROOT / 'docs' / 'how_to' / 'installed_ros.md').read_text(encoding='utf-8')
    line = re.search(r'rosdep install --from-paths (.+?) --', guide)
    found = [find_packages(ROOT / path) for path in line[1].split()]
    names = {package.name for packages in found for package in packages.values()}
    assert names == {'resting_aspects_ros', 'resting_aspects_interfaces'}


def test_versions_agree():
    setup = subprocess.run(
        [sys.executable, 'setup.py', '--version'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert {
        parse_package(SUITE).version,
        parse_package(INTERFACES).version,
        setup.stdout.split()[-1],
    } == {resting_aspects_ros.__version__}


def copied_to(source):
    """Return a copy of the suite, as a build leaves files behind."""
    source.mkdir()
    for name in ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'README.md'):
        shutil.copy(ROOT / name, source)
    for name in (*SHARED, 'resource', 'resting_aspects_ros'):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns('*.pyc'))
    return source


def test_script_beside_a_clone_named_like_the_package_imports_it(tmp_path):
    clone = copied_to(tmp_path / 'resting_aspects_ros')
    build = 'import setuptools.build_meta as b, sys; b.build_editable(sys.argv[1])'
    subprocess.run([sys.executable, '-c', build, tmp_path], cwd=clone, check=True)
    site = tmp_path / 'site'
    (wheel,) = tmp_path.glob('*.whl')
    with ZipFile(wheel) as packed:
        packed.extractall(site)
    script = tmp_path / 'script.py'
    script.write_text(
        'import site, sys\nsite.addsitedir(sys.argv[1])\n'
        'import resting_aspects_ros\nprint(resting_aspects_ros.__file__)\n'
    )
    # -S: without the site-packages of this virtual environment, where the suite is installed, too.
    found = subprocess.run(
        [sys.executable, '-S', script, site], env={}, capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == [str(clone / 'resting_aspects_ros' / '__init__.py')]


@pytest.mark.slow
def test_wheel_has_all_shared_files(tmp_path):
    files = {path for folder in SHARED for path in (ROOT / folder).rglob('*.*')} - {
        path for folder in SHARED for path in (ROOT / folder).rglob('*.pyc')
    }
    shared = {path.relative_to(ROOT).as_posix() for path in files if path.is_file()}
    assert {'config/surfaces.yaml', 'launch/resting_aspects.launch.py'} <= shared
    source = copied_to(tmp_path / 'source')
    options = ('--no-deps', '--no-build-isolation', '--no-index', '--quiet')
    subprocess.run(
        [sys.executable, '-m', 'pip', 'wheel', *options, '--wheel-dir', tmp_path, source],
        check=True,
    )
    (wheel,) = tmp_path.glob('*-py3-none-any.whl')
    share = '.data/data/share/resting_aspects_ros/'
    packed = {name.split(share)[1] for name in ZipFile(wheel).namelist() if share in name}
    assert packed == {*shared, 'package.xml'}


def test_every_requirement_is_pinned_in_the_lock_file():
    for name in ('requirements', 'requirements-dev'):
        lines = (ROOT / f'{name}.txt').read_text().lower().replace('_', '-').splitlines()
        pinned = {line.partition('==')[0] for line in lines if '==' in line}
        wanted = {
            requirement.lower().replace('_', '-') for requirement in requirements(f'{name}.in')
        }
        assert wanted - pinned == set(), f'make requirements, after a change of {name}.in'


def test_skipped_test_fails_in_ci_only(tmp_path):
    (tmp_path / 'test_skips.py').write_text(
        'import pytest\n\ndef test_skips():\n    pytest.skip("no ROS here")\n'
    )
    command = [sys.executable, '-m', 'pytest', '-p', 'conftest', '--rootdir=.', tmp_path]

    def run(**environment):
        return subprocess.run(
            command,
            env={'PYTHONPATH': str(ROOT), **environment},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    assert run().returncode == 0
    in_ci = run(CI='true')
    assert in_ci.returncode == 1
    assert 'no ROS here' in in_ci.stdout
