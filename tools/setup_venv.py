"""Makes .venv with all that the suite needs; does only what is not done yet.

Run by `make setup` through tools/setup, which chooses the Python. Standard library only.
`setup_venv.py dev` adds what tests and checks need.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
BUILD = ROOT / 'build'
INTERFACES = ROOT / 'resting_aspects_interfaces'
PYTHON = VENV / 'bin' / 'python'
STATE = VENV / 'setup.json'  # what is done; inside .venv, so that both go together
MANIFEST = VENV / 'interfaces_manifest.txt'

PYTHON_VERSION = f'{sys.version_info[0]}.{sys.version_info[1]}'
HEARTBEAT_S = 10.0
LOG_LINES_SHOWN = 20


class SetupError(Exception):
    """What is wrong and what can be done about it, in words for the person at the terminal."""


def main(with_dev):
    """Bring .venv up to date with the files that it is made from."""
    BUILD.mkdir(exist_ok=True)
    with one_at_a_time():
        state = usable_state()
        if state is None:
            check_machine()
            state = make_venv()
        done = state['done']
        for step, inputs, work in steps(with_dev):
            wanted = digest(inputs)
            if done.get(step) == wanted:
                continue
            done.pop(step, None)  # so that an interrupted step is not taken for done
            save(state)
            work()
            done[step] = wanted
            save(state)


def steps(with_dev):
    """Yield name, the files that decide whether it is done, and the work, in order."""
    this = Path(__file__)
    locked = [this, ROOT / 'requirements.txt']
    interfaces = sorted(p for p in INTERFACES.rglob('*') if p.is_file())
    package = [ROOT / name for name in ('setup.py', 'setup.cfg', 'package.xml')]
    yield 'requirements', locked, install_requirements
    yield 'interfaces', [*locked, *interfaces], build_interfaces
    yield 'package', [this, *package], install_package
    if with_dev:
        yield 'dev', [*locked, ROOT / 'requirements-dev.txt'], install_dev_requirements


def digest(files):
    """Hash names and contents: a fresh checkout or a touched file is no reason to build again."""
    sha = hashlib.sha256()
    for file in files:
        sha.update(f'{file.relative_to(ROOT)}\0'.encode())
        sha.update(hashlib.sha256(file.read_bytes()).digest())
    return sha.hexdigest()


@contextlib.contextmanager
def one_at_a_time():
    """Hold a lock, so that two set-ups in one folder follow each other."""
    with open(BUILD / 'setup.lock', 'w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say('waiting for another set-up in this folder')
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


# ---- the virtual environment


def usable_state():
    """Return what is recorded of .venv, or None if it has to be made (again)."""
    if not VENV.exists():
        return None
    try:
        state = json.loads(STATE.read_text())
    except (OSError, ValueError):
        reason = 'it is not finished'
    else:
        if state['venv'] != str(VENV):
            reason = f'it was made in {state["venv"]}'
        elif not PYTHON.exists():
            reason = f'its Python is gone ({state["python"]})'
        elif 'PYTHON' in os.environ and state['python'] != base_python():
            reason = f'it was made with {state["python"]}'
        elif 'requirements' not in state['done']:
            reason = 'an installation of requirements.txt did not end'
        else:
            return state
    say(f'.venv is made again: {reason}')
    return None


def check_machine():
    """Raise before anything is started if the machine lacks what the set-up cannot install."""
    missing = {}
    if not compiler():
        missing['g++'] = 'a C++ compiler ($CXX, c++, g++ or clang++)'
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        missing[f'python{PYTHON_VERSION}-dev'] = "Python's header Python.h"
    if subprocess.run([sys.executable, '-c', 'import venv, ensurepip'], capture_output=True).returncode:
        missing[f'python{PYTHON_VERSION}-venv'] = 'the modules venv and ensurepip'
    if missing:
        raise SetupError(
            f'{" and ".join(missing.values())} not found for {base_python()}:'
            f' sudo apt install {" ".join(missing)}'
        )


def compiler():
    """Return the path of a C++ compiler, or None."""
    named = os.environ.get('CXX', '').split()[:1]
    return next(filter(None, map(shutil.which, [*named, 'c++', 'g++', 'clang++'])), None)


def base_python():
    """Return the real path of the Python that runs this."""
    return os.path.realpath(sys.executable)


def make_venv():
    """Make an empty .venv and return its state."""
    with step(f'making .venv with Python {sys.version.split()[0]} ({sys.executable})', 'venv') as run:
        if VENV.exists():
            shutil.rmtree(VENV)
        run(sys.executable, '-m', 'venv', VENV)
    return {'venv': str(VENV), 'python': base_python(), 'done': {}}


def save(state):
    """Record the state; through a rename, so that it is whole or not there."""
    partial = STATE.with_suffix('.partial')
    partial.write_text(json.dumps(state, indent=1))
    partial.replace(STATE)


# ---- steps


def install_requirements():
    """Install what requirements.txt pins and mend the CMake files of the ROS wheels."""
    with step('installing requirements.txt: ROS 2 Jazzy, PyBullet, …', 'requirements') as run:
        if not has_pybullet_wheel():
            say(
                f'PyBullet has no wheel for Python {PYTHON_VERSION} and is compiled:'
                ' about 8 minutes more on two cores'
            )
        pip_install(run, '-r', ROOT / 'requirements.txt')
        for file in VENV.glob('share/*/cmake/*Export.cmake'):
            drop_missing_include_folders(file)


def install_dev_requirements():
    """Install what tests and checks need."""
    with step('installing requirements-dev.txt: pytest, ruff, mypy, colcon, …', 'dev') as run:
        pip_install(run, '-r', ROOT / 'requirements-dev.txt')


def install_package():
    """Install resting_aspects_ros so that its commands run the code of this folder."""
    with step('installing resting_aspects_ros, editable', 'package') as run:
        pip_install(run, '--no-build-isolation', '--editable', ROOT)


def pip_install(run, *arguments):
    """Install exactly what is given: the lock files are complete, so pip resolves nothing."""
    run(PYTHON, '-m', 'pip', 'install', '--no-deps', '--disable-pip-version-check', *arguments)


def has_pybullet_wheel():
    """Tell whether PyPI has PyBullet ready for this Python."""
    return sys.version_info[:2] in {(3, 10), (3, 11)}


def drop_missing_include_folders(file):
    """Remove folders of the machine that built the wheel from the targets that a file exports.

    CMake refuses targets with include folders that do not exist.
    """

    def existing(match):
        kept = [f for f in match[2].split(';') if f.startswith('$') or Path(f).exists()]
        return f'{match[1]}"{";".join(kept)}"'

    text = file.read_text()
    mended = re.sub(r'(INTERFACE_INCLUDE_DIRECTORIES )"([^"]*)"', existing, text)
    if mended != text:
        file.write_text(mended)


def build_interfaces():
    """Build resting_aspects_interfaces and install it into .venv, beside the wheels' own types."""
    build = BUILD / 'interfaces'
    shutil.rmtree(build, ignore_errors=True)  # stale generated files would be installed again
    with step('building resting_aspects_interfaces', 'interfaces') as run:
        cmake = VENV / 'bin' / 'cmake'
        run(
            cmake, '-S', INTERFACES, '-B', build, '-G', 'Ninja',
            f'-DCMAKE_INSTALL_PREFIX={VENV}', f'-DCMAKE_PREFIX_PATH={VENV}',
            f'-DPython3_EXECUTABLE={PYTHON}', '-DBUILD_TESTING=OFF',
        )  # fmt: skip
        run(cmake, '--build', build)
        uninstall_interfaces()
        run(cmake, '--install', build)
        shutil.copy(build / 'install_manifest.txt', MANIFEST)


def uninstall_interfaces():
    """Remove what an earlier build installed; a type that is gone must not be importable."""
    if MANIFEST.exists():
        for name in MANIFEST.read_text().splitlines():
            Path(name).unlink(missing_ok=True)


# ---- saying what is done


def say(text):
    """Print a line at once, also into a pipe."""
    print(f'set-up: {text}', flush=True)


@contextlib.contextmanager
def step(title, log_name):
    """Say what starts and how long it took; give a function that runs a command into a log."""
    say(title)
    start = time.monotonic()
    log = BUILD / f'setup-{log_name}.log'
    log.write_text('')

    def run(*command):
        run_quietly([str(part) for part in command], log, start)

    yield run
    say(f'  done in {time.monotonic() - start:.0f} s')


def run_quietly(command, log, start):
    """Run a command with its output in a log, a sign of life now and then, and its end if it fails."""
    environment = dict(os.environ, PATH=f'{VENV / "bin"}{os.pathsep}{os.environ["PATH"]}')
    with log.open('a') as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, cwd=ROOT, env=environment
        )
        while True:
            try:
                code = process.wait(HEARTBEAT_S)
                break
            except subprocess.TimeoutExpired:
                say(f'  at it for {time.monotonic() - start:.0f} s')
    if code:
        end = '\n'.join(log.read_text(errors='replace').splitlines()[-LOG_LINES_SHOWN:])
        raise SetupError(f'{" ".join(command)} failed ({code}); the end of {log}:\n{end}')


if __name__ == '__main__':
    try:
        main(with_dev='dev' in sys.argv[1:])
    except SetupError as error:
        sys.exit(f'set-up: {error}')
    except KeyboardInterrupt:
        sys.exit('set-up: interrupted; call it again to go on')
