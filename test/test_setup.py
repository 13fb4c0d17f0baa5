"""Set-up: selection of the Python, and the steps that are repeated after a change."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BASE_PYTHON = os.path.realpath(sys.executable)
THIS_PYTHON = f'exec "{sys.executable}" "$@"'
REFUSED_BY_PYENV = 'echo "pyenv: python3.10: command not found" >&2; exit 127'


def put_program(path, body):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'#!/bin/sh\n{body}\n')
    path.chmod(0o755)


@pytest.fixture
def path(tmp_path):
    """Give a folder that is all of PATH, with what a shell script needs."""
    folder = tmp_path / 'pyenv' / 'shims'
    folder.mkdir(parents=True)
    for name in ('dirname', 'head'):
        (folder / name).symlink_to(shutil.which(name))
    return folder


@pytest.fixture
def find(path):
    """Run tools/find_python."""

    def find(**environment):
        return subprocess.run(
            [ROOT / 'tools' / 'find_python'],
            env={'PATH': str(path), **environment},
            capture_output=True,
            text=True,
            check=False,
        )

    return find


@pytest.mark.parametrize('chosen', [{}, {'PYTHON': 'python3.10'}])
def test_rejected_pyenv_shim_uses_an_installed_version(find, path, chosen):
    put_program(path / 'python3.10', REFUSED_BY_PYENV)
    put_program(path.parent / 'versions' / '3.10.13' / 'bin' / 'python3.10', THIS_PYTHON)
    found = find(**chosen)
    assert found.stdout == f'{BASE_PYTHON}\n', found.stderr


def test_pyenv_message_is_shown_if_no_version_fits(find, path):
    put_program(path / 'python3.10', REFUSED_BY_PYENV)
    refused = find(PYTHON='python3.10')
    assert refused.returncode == 1
    assert refused.stdout == ''
    assert f'{path}/python3.10: pyenv: python3.10: command not found\n' in refused.stderr
    assert 'sudo apt install' in refused.stderr


def test_python_that_does_not_run_is_skipped(find, path):
    put_program(path / 'python3.11', 'exit 127')
    put_program(path / 'python3.12', THIS_PYTHON)
    assert find().stdout == f'{BASE_PYTHON}\n'


def test_the_named_python_is_the_only_one_tried(find, path):
    put_program(path / 'python3.11', THIS_PYTHON)
    refused = find(PYTHON='/no/python')
    assert refused.returncode == 1
    assert '/no/python' in refused.stderr


@pytest.mark.parametrize('version', [(3, 9, 19), (3, 13, 1)])
def test_unsupported_python_is_named_with_its_version(find, path, version):
    script = f'import sys; sys.version_info = {version}; exec(sys.argv[3])'
    put_program(path / 'python3', f'exec "{sys.executable}" -c "{script}" "$@"')
    refused = find()
    assert refused.returncode == 1
    assert f'{path}/python3: is Python 3.{version[1]}\n' in refused.stderr


# A Python and a uv that only note how they are called, and make environments of themselves.
RECORDER = """
case $* in
    -I*) echo "$0" ;;
    '-m venv '*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && cp "$0" "$3/bin/uv" &&
        cp "$0" "$3/bin/resting_aspects" ;;
    *) echo "$0 $*" >> calls; [ ! -e broken ] ;;
esac
"""
STEPS = {
    'environment': '-m pip install',
    'requirements': '--requirement requirements.txt',
    'package': '--editable .',
    'dev': '--requirement requirements-dev.txt',
    'interfaces': 'tools/build_interfaces .venv',
    'kernel': 'resting_aspects drop',
}


KERNEL = 'resting_aspects_ros/simulation/kernel.py'
KERNEL_DATA = 'resting_aspects_ros/simulation/kernel_data.py'


class Folder:
    """A folder with the Makefile of this project and the files that its steps depend on."""

    def __init__(self, path):
        self.path = path
        # Nothing of the make that runs the tests, whose variables would replace those given here.
        self.environment = {'PATH': os.environ['PATH'], 'PYTHON': './python'}
        (path / 'tools').mkdir(parents=True)
        for name in ('Makefile', 'tools/make_venv', 'tools/find_python'):
            shutil.copy(ROOT / name, path / name)
        for name in (
            'requirements.txt', 'requirements-dev.txt', 'setup.py', 'setup.cfg', 'package.xml',
            'pyproject.toml', 'test/js/package.json',
            'test/js/package-lock.json', 'resting_aspects_interfaces/msg/Status.msg',
            'test/js/node_modules/.package-lock.json', KERNEL, KERNEL_DATA,
        ):  # fmt: skip
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).touch()
        put_program(path / 'python', RECORDER)
        put_program(path / 'tools' / 'build_interfaces', RECORDER)

    def make(self, target='dev', **variables):
        """The exit code and the steps that were done, in order."""
        (self.path / 'calls').write_text('')
        given = [f'{name}={value}' for name, value in variables.items()]
        ended = subprocess.run(
            ['make', target, *given],
            cwd=self.path,
            env=self.environment | variables,
            capture_output=True,
            text=True,
            check=False,
        )
        self.printed = ended.stdout
        calls = (self.path / 'calls').read_text().splitlines()
        named = [[name for name, words in STEPS.items() if words in call] for call in calls]
        return ended.returncode, [name for (name,) in named]

    def change(self, file):
        """Write a file, 100 s after all others."""
        for path in self.path.rglob('*'):
            then = path.stat().st_mtime - 100
            os.utime(path, (then, then))
        (self.path / file).touch()


@pytest.fixture
def folder(tmp_path):
    """Give a folder that is set up."""
    folder = Folder(tmp_path / 'a folder')
    code, steps = folder.make()
    assert code == 0, folder.printed
    assert steps == ['environment', 'requirements', 'interfaces', 'package', 'kernel', 'dev']
    return folder


def test_finished_setup_does_nothing_silently(folder):
    assert folder.make() == (0, [])
    assert folder.make('setup') == (0, [])
    assert folder.printed == ''


@pytest.mark.parametrize(
    ('file', 'steps'),
    [
        ('requirements.txt', ['requirements', 'interfaces', 'kernel']),
        ('requirements-dev.txt', ['dev']),
        ('setup.py', ['package', 'kernel']),
        ('package.xml', ['package', 'kernel']),
        (KERNEL, ['kernel']),
        (KERNEL_DATA, ['kernel']),
        ('resting_aspects_interfaces/msg/Status.msg', ['interfaces']),
        ('resting_aspects_interfaces/msg/New.msg', ['interfaces']),
    ],
)
def test_changed_file_repeats_dependent_steps(folder, file, steps):
    folder.change(file)
    assert folder.make() == (0, steps)


def test_a_removed_message_repeats_the_build(folder):
    (folder.path / 'resting_aspects_interfaces' / 'msg' / 'Status.msg').unlink()
    assert folder.make() == (0, ['interfaces'])


@pytest.mark.parametrize('file', ['requirements.txt', 'requirements-dev.txt'])
def test_interrupted_installation_repeats_all_steps(folder, file):
    (folder.path / 'broken').touch()
    folder.change(file)
    assert folder.make()[0] != 0
    (folder.path / 'broken').unlink()
    code, steps = folder.make()
    assert code == 0
    assert steps == ['environment', 'requirements', 'interfaces', 'package', 'kernel', 'dev']
    assert folder.make() == (0, [])


def test_an_interrupted_build_is_repeated(folder):
    (folder.path / '.venv' / '.interfaces').unlink()
    (folder.path / 'broken').touch()
    assert folder.make()[0] != 0
    (folder.path / 'broken').unlink()
    assert folder.make() == (0, ['interfaces'])


def test_a_moved_folder_is_set_up_again(folder):
    folder.path = folder.path.rename(folder.path.parent / 'elsewhere')
    code, steps = folder.make()
    assert code == 0
    assert steps[0] == 'environment'
    assert 'set-up: .venv is made again' in folder.printed


def test_requested_python_is_used(folder):
    put_program(folder.path / 'other', RECORDER)
    assert folder.make(PYTHON='') == (0, [])
    assert folder.make(PYTHON='./other')[1][0] == 'environment'
    assert folder.make(PYTHON='./other') == (0, [])


def test_help_lists_every_target():
    text = (ROOT / 'Makefile').read_text()
    declared = text.partition('.PHONY:')[2].partition('\n\n')[0].replace('\\', '').split()
    printed = subprocess.run(
        ['make', '--no-print-directory', 'help'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    listed = [line.split()[1] for line in printed.splitlines()]
    assert sorted(listed) == sorted(set(declared) - {'always'})
    assert {'test-all', 'test-pythons', 'test-under-load'} <= set(listed)


@pytest.mark.parametrize('end', ['success', 'failure', 'Ctrl-C'])
def test_busy_processes_end_with_the_tests(folder, end):
    def busy():
        """How many shells there are in the folder that look for their parent all the time."""
        count = 0
        for process in Path('/proc').glob('[0-9]*'):
            with contextlib.suppress(OSError):
                here = (process / 'cwd').readlink() == folder.path
                count += here and b'kill -0' in (process / 'cmdline').read_bytes()
        return count

    def wait_for(condition):
        while not condition():
            time.sleep(0.02)

    put_program(folder.path / '.venv' / 'bin' / 'python', 'echo run >> runs; read end; exit $end')
    make = subprocess.Popen(
        ['make', 'test-under-load'],
        cwd=folder.path,
        env=folder.environment,
        stdin=subprocess.PIPE,
        start_new_session=True,
    )
    runs = folder.path / 'runs'
    wait_for(lambda: make.poll() is not None or (runs.exists() and runs.read_text()))
    assert busy() == 6 + 1  # and their parent
    if end == 'Ctrl-C':
        os.killpg(make.pid, signal.SIGINT)
    make.communicate({'success': b'0\n0\n', 'failure': b'1\n', 'Ctrl-C': b''}[end])
    assert (make.returncode == 0) == (end == 'success')
    assert len(runs.read_text().split()) == (2 if end == 'success' else 1)
    wait_for(lambda: busy() == 0)


@pytest.fixture
def build(tmp_path):
    """Run tools/build_interfaces with a CMake that installs what is named in `types`."""
    put_program(
        tmp_path / '.venv' / 'bin' / 'cmake',
        """case $1 in
    -S) mkdir -p "$4" ;;
    --install) for name in $(cat types); do echo > ".venv/$name"; echo "$PWD/.venv/$name"; done \
        > "$2/install_manifest.txt" ;;
    esac
    if [ -e broken ]; then echo the reason; exit 3; fi""",
    )
    share = tmp_path / '.venv' / 'share' / 'std_msgs' / 'cmake'
    share.mkdir(parents=True)
    (share / 'std_msgsExport.cmake').touch()

    def build():
        return subprocess.run(
            [ROOT / 'tools' / 'build_interfaces', '.venv'],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    return build


def test_removed_type_is_uninstalled(build, tmp_path):
    (tmp_path / 'types').write_text('kept.py gone.py')
    assert build().returncode == 0
    assert (tmp_path / '.venv' / 'gone.py').exists()
    (tmp_path / 'types').write_text('kept.py')
    assert build().returncode == 0
    assert (tmp_path / '.venv' / 'kept.py').exists()
    assert not (tmp_path / '.venv' / 'gone.py').exists()


def test_a_failed_build_shows_the_end_of_its_log(build, tmp_path):
    (tmp_path / 'broken').touch()
    failed = build()
    assert failed.returncode == 1
    assert 'cmake failed' in failed.stderr
    assert 'the reason' in failed.stderr


@pytest.mark.parametrize('folders', ['/opt/a;{}', '{};/opt/a', '/opt/a;/opt/b;{};/opt/c', '{}'])
def test_foreign_include_folders_are_removed(build, tmp_path, folders):
    """The file is linked to the cache of uv, which must not change."""
    (file,) = tmp_path.glob('.venv/share/*/cmake/*Export.cmake')
    cached = tmp_path / 'cached.cmake'
    kept = '${_IMPORT_PREFIX}/include/msg'
    lines = '  INTERFACE_INCLUDE_DIRECTORIES "{}"\n  OTHER "/opt/a;/opt/b"\n'
    cached.write_text(lines.format(folders.format(kept)))
    file.unlink()
    file.hardlink_to(cached)
    (tmp_path / 'types').write_text('kept.py')
    assert build().returncode == 0
    assert file.read_text() == lines.format(kept)
    assert cached.read_text() == lines.format(folders.format(kept))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_clean_copy_in_a_folder_with_a_space_works(tmp_path):
    source = tmp_path / 'a copy'
    tracked = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, tracked.stdout.split('\0')):
        if (ROOT / name).exists():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    subprocess.run(['make', f'PYTHON={BASE_PYTHON}', 'setup'], cwd=source, check=True)
    command = ['.venv/bin/resting_aspects', 'aspects', 'l_bracket']
    printed = subprocess.run(command, cwd=source, capture_output=True, text=True, check=True)
    assert 'l_bracket' in printed.stdout
    types = 'from resting_aspects_interfaces.msg import RestingPoses; print(RestingPoses())'
    subprocess.run([source / '.venv/bin/python', '-c', types], cwd=source, check=True)
