"""The Python interface, as a script or a notebook uses it."""

import doctest
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.nodes.aspect_classifier.known import load_log

PACKAGE = Path(ra.__file__).parent
# Every module of the interface with an example; those of the client need nodes.
WITH_EXAMPLES = [
    f'.api.{path.stem}'
    for path in sorted((PACKAGE / 'api').glob('*.py'))
    if '>>>' in path.read_text(encoding='utf-8')
]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('module', ['', *WITH_EXAMPLES])
def test_examples_in_docstrings_hold(module):
    tested = import_module(f'resting_aspects_ros{module}')
    failed, attempted = doctest.testmod(tested, optionflags=doctest.ELLIPSIS)
    assert failed == 0
    assert attempted > 0


def test_every_public_name_exists():
    for name in ra.__all__:
        assert getattr(ra, name).__doc__
    assert set(ra.__all__) <= set(dir(ra))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        ra.nothing  # noqa: B018


def test_no_ros_and_no_matplotlib_is_imported():
    code = (
        'import sys, resting_aspects_ros as ra\n'
        "light = 'numpy' in sys.modules\n"
        "options = {'drops': 30, 'model_range': False, 'workers': 1}\n"
        "a, b = (ra.drop('tetrahedron', seed=k, **options) for k in (1, 2))\n"
        "ra.compare(a, b), ra.estimate('tetrahedron'), ra.classify(a.poses, 'tetrahedron')\n"
        "print(light, 'rclpy' in sys.modules, 'matplotlib' in sys.modules)\n"
    )
    # No `if __name__ == '__main__'` is needed.
    ended = subprocess.run(
        [sys.executable, '-'], input=code, capture_output=True, text=True, check=True
    )
    assert ended.stdout.split() == ['False', 'False', 'False']


@pytest.mark.slow
def test_requested_engine_makes_drops_actions_and_disturbances(workers):
    options = {'workers': workers, 'engine': 'bullet'}
    runs = (
        ra.drop('tetrahedron', drops=2, model_range=False, **options).run,
        ra.reorient('tetrahedron', 'tap', 1, drops=2, **options).run,
        ra.retention('tetrahedron', 1, **options).run,
    )
    assert [run.engine for run in runs] == ['bullet'] * 3


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ({'surface': 'ice'}, "surface 'ice'"),
        ({'workers': 0}, 'workers'),
        ({'engine': 'bulet'}, "engine 'bulet'"),
        ({'engine': 'kernel', 'surroundings': 'pocket'}, 'engine kernel'),
    ],
)
def test_a_wrong_value_is_named(arguments, words):
    with pytest.raises(ra.InvalidValueError, match=words):
        ra.drop('tetrahedron', **{'drops': 5, **arguments})


def test_a_wrong_argument_of_load_part_is_named():
    with pytest.raises(ra.InvalidValueError, match="invalid unit 'mm': expected only with a mesh"):
        ra.load_part('l_bracket', unit='mm')
    with pytest.raises(ra.InvalidValueError, match="invalid folder of parts 'none'"):
        ra.load_part('l_bracket', folder='none')


@pytest.mark.slow
def test_a_log_has_the_poses_and_the_distribution(workers, tmp_path):
    result = ra.drop('tetrahedron', drops=60, seed=4, workers=workers, log=tmp_path / 'logs')
    assert result.log.parent == tmp_path / 'logs'
    read = ra.read_log(result.log)
    assert (read.run, read.part.part_sha256) == (result.run, result.part.part_sha256)
    assert np.array_equal(read.poses.position, result.poses.position)
    assert np.array_equal(read.poses.orientation, result.poses.orientation)
    # What a classifier takes from the log when it starts.
    run, distribution = load_log(result.log)
    assert run == result.run
    assert distribution.counts.tolist() == result.distribution.counts.tolist()


@pytest.mark.slow
def test_the_log_of_interrupted_drops_is_closed(workers, tmp_path):
    counted = []

    def interrupt(poses, ids):
        counted.append(len(poses))
        if len(counted) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ra.drop('tetrahedron', 2000, workers=workers, log=tmp_path, consumers=[interrupt])
    (log,) = tmp_path.iterdir()
    assert (log / 'metadata.yaml').is_file()
    assert ra.read_log(log).distribution.drops == sum(counted)
    (tmp_path / 'file').touch()
    with pytest.raises(ra.LogError, match='cannot be written'):
        ra.drop('tetrahedron', drops=5, workers=workers, log=tmp_path / 'file')


@pytest.mark.slow
@pytest.mark.parametrize('engine', ['kernel', 'bullet'])
def test_ctrl_c_ends_the_drops_and_their_workers(engine):
    code = (
        'import threading, resting_aspects_ros as ra\n'
        'from pathlib import Path\n'
        "options = {'workers': 2, 'keep_poses': False, 'progress': True}\n"
        'try:\n'
        f"    ra.drop('l_bracket', drops=2_000_000, engine='{engine}', **options)\n"
        'except KeyboardInterrupt:\n'
        "    children = Path('/proc/thread-self/children').read_text().split()\n"
        "    print('interrupted', children, threading.active_count())\n"
    )
    script = subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert any('of 2000000 drops' in line for line in script.stderr)
    script.send_signal(signal.SIGINT)
    assert script.communicate(timeout=600)[0] == 'interrupted [] 1\n'


def test_what_is_odd_about_a_part_is_a_warning(workers, tmp_path):
    trimesh.creation.box((0.01, 0.02, 0.03)).export(tmp_path / 'box.stl')
    with pytest.warns(ra.RestingAspectsWarning, match='in metres it would be 10 x 20 x 30 mm'):
        ra.drop(tmp_path / 'box.stl', 2, model_range=False, workers=workers, height=0.001)
