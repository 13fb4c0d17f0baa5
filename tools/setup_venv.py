"""Make .venv with all that the suite needs, doing only what is not done yet.

Run by `make setup` through tools/setup, which chooses the Python. Standard library only.
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
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
PYTHON = VENV / 'bin' / 'python'
STATE = VENV / 'setup.json'  # what is done; inside .venv, so that both go together
MANIFEST = VENV / 'interfaces_manifest.txt'
BUILD = ROOT / 'build'
INTERFACES = ROOT / 'resting_aspects_interfaces'
JAVASCRIPT = ROOT / 'test' / 'js'

PYTHON_VERSION = f'{sys.version_info[0]}.{sys.version_info[1]}'
HEARTBEAT_S = 30.0
LOG_LINES_SHOWN = 20

Run = Callable[..., None]


class SetupError(Exception):
    """What is wrong and what can be done about it, in words for the person at the terminal."""


class DoWithoutError(SetupError):
    """Something is not to be had, and all the rest works without it."""


def main(with_dev: bool) -> None:
    """Bring .venv up to date with the files that it is made from."""
    BUILD.mkdir(exist_ok=True)
    with one_at_a_time():
        state = usable_state()
        if state is None:
            check_machine()
            state = make_venv()
        done = state['done']
        for name, inputs, work in steps(with_dev):
            wanted = digest(inputs)
            if done.get(name) == wanted:
                continue
            done.pop(name, None)  # an interrupted step must not be taken for done
            save(state)
            try:
                work()
            except DoWithoutError as error:
                say(str(error))
                continue
            done[name] = wanted
            save(state)


def steps(with_dev: bool) -> Iterator[tuple[str, list[Path], Callable[[], None]]]:
    """Yield name, the files that decide whether it is done, and the work, in order."""
    this = Path(__file__).resolve()
    requirements = [this, ROOT / 'requirements.txt']
    interfaces = sorted(path for path in INTERFACES.rglob('*') if path.is_file())
    package = [ROOT / name for name in ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml')]
    yield 'requirements', requirements, install_requirements
    yield 'interfaces', [*requirements, *interfaces], build_interfaces
    yield 'package', [this, *package], install_package
    if with_dev:
        yield 'dev', [*requirements, ROOT / 'requirements-dev.txt'], install_dev_requirements
        packages = [this, JAVASCRIPT / 'package.json', JAVASCRIPT / 'package-lock.json']
        yield 'javascript', packages, install_javascript


def digest(files: Iterable[Path]) -> str:
    """Hash names and contents; unlike a time stamp, a checkout or a touch does not change it."""
    sha = hashlib.sha256()
    for file in files:
        sha.update(f'{file.relative_to(ROOT)}\0'.encode())
        sha.update(hashlib.sha256(file.read_bytes()).digest())
    return sha.hexdigest()


@contextlib.contextmanager
def one_at_a_time() -> Iterator[None]:
    """Hold a lock, so that two set-ups in one folder follow each other."""
    with (BUILD / 'setup.lock').open('w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say('waiting for another set-up in this folder')
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


# ---- the virtual environment


def usable_state() -> dict[str, Any] | None:
    """Return what is recorded of .venv, or None if it has to be made (again)."""
    if not VENV.exists():
        return None
    state, fault = {}, None
    try:
        state = json.loads(STATE.read_text())
    except (OSError, ValueError):
        fault = 'it is not finished'
    else:
        if state['venv'] != str(VENV):
            fault = f'it was made in {state["venv"]}'
        elif not PYTHON.exists():
            fault = f'its Python, {state["python"]}, is gone'
        elif os.environ.get('PYTHON') and state['python'] != base_python():
            fault = f'it was made with {state["python"]}'
        elif 'requirements' not in state['done']:
            fault = 'the installation of requirements.txt was interrupted'
    if fault:
        say(f'.venv is made again: {fault}')
    return None if fault else state


def check_machine() -> None:
    """Raise before anything is started if the machine lacks what pip cannot install."""
    missing = {}
    if not has_compiler():
        missing['g++'] = 'a C++ compiler ($CXX, c++, g++ or clang++)'
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        missing[f'python{PYTHON_VERSION}-dev'] = 'Python.h'
    if not has_venv():
        missing[f'python{PYTHON_VERSION}-venv'] = 'the modules venv and ensurepip'
    if missing:
        raise SetupError(
            f'{" and ".join(missing.values())} not found (for {base_python()}):'
            f' sudo apt install {" ".join(missing)}'
        )


def has_compiler() -> bool:
    """Tell whether CMake will find a C++ compiler."""
    named = os.environ.get('CXX', '').split()[:1]
    return any(shutil.which(name) for name in named or ['c++', 'g++', 'clang++'])


def has_venv() -> bool:
    """Tell whether a virtual environment with pip can be made; Debian takes both parts out."""
    command = [sys.executable, '-c', 'import ensurepip, venv']
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def base_python() -> str:
    """Return the path of the Python that runs this, not that of a virtual environment's link."""
    return os.path.realpath(sys.executable)


def make_venv() -> dict[str, Any]:
    """Make an empty .venv and return its state."""
    version = sys.version.split()[0]
    with step('venv', f'making .venv with Python {version} ({base_python()})') as run:
        run('rm', '-rf', VENV)
        run(base_python(), '-m', 'venv', VENV)
    return {'venv': str(VENV), 'python': base_python(), 'done': {}}


def save(state: dict[str, Any]) -> None:
    """Record the state; through a rename, so that it is whole or not there."""
    partial = STATE.with_suffix('.partial')
    partial.write_text(json.dumps(state, indent=1))
    partial.replace(STATE)


# ---- the steps


def install_requirements() -> None:
    """Install what requirements.txt pins and mend the CMake files of the ROS wheels."""
    with step('requirements', 'installing requirements.txt: ROS 2 Jazzy, PyBullet, …') as run:
        if PYTHON_VERSION == '3.12':
            say('  PyBullet has no wheel for Python 3.12 and is compiled: about 8 minutes more')
        pip_install(run, '-r', ROOT / 'requirements.txt')
        for file in VENV.glob('share/*/cmake/*Export.cmake'):
            drop_missing_include_folders(file)


def install_dev_requirements() -> None:
    """Install what tests and checks need."""
    with step('dev', 'installing requirements-dev.txt: pytest, ruff, mypy, colcon, …') as run:
        pip_install(run, '-r', ROOT / 'requirements-dev.txt')


def install_javascript() -> None:
    """Install what tests use in JavaScript, into a node_modules beside its package.json."""
    without = 'the tests of our logs and pages in JavaScript will be skipped'
    if missing := [name for name in ('node', 'npm') if not shutil.which(name)]:
        raise DoWithoutError(f'{" and ".join(missing)} not found: {without}')
    # No scripts of strangers, and no long wait where there is no network.
    options = ('--ignore-scripts', '--no-audit', '--no-fund', '--no-update-notifier')
    network = ('--fetch-retries=1', '--fetch-retry-mintimeout=1000', '--fetch-timeout=20000')
    try:
        with step(
            'javascript', 'installing packages that read logs and pages in JavaScript'
        ) as run:
            run('npm', 'ci', '--prefix', JAVASCRIPT, *options, *network)
    except SetupError:
        log = BUILD / 'setup-javascript.log'
        raise DoWithoutError(f'npm failed, see {log}: {without}') from None


def install_package() -> None:
    """Install resting_aspects_ros so that its commands run the code of this folder."""
    with step('package', 'installing resting_aspects_ros, editable') as run:
        pip_install(run, '--no-build-isolation', '--editable', ROOT)


def pip_install(run: Run, *arguments: str | Path) -> None:
    """Install exactly what is given: the lock files are complete, so pip resolves nothing."""
    run(PYTHON, '-m', 'pip', 'install', '--no-deps', '--disable-pip-version-check', *arguments)


def build_interfaces() -> None:
    """Build resting_aspects_interfaces and install it into .venv, beside the wheels' own types."""
    build = BUILD / 'interfaces'
    shutil.rmtree(build, ignore_errors=True)  # what was generated before would be installed too
    with step('interfaces', 'building resting_aspects_interfaces') as run:
        cmake = VENV / 'bin' / 'cmake'
        options = {
            'CMAKE_INSTALL_PREFIX': VENV,
            'CMAKE_PREFIX_PATH': VENV,
            'Python3_EXECUTABLE': PYTHON,
            'BUILD_TESTING': 'OFF',
        }
        defines = [f'-D{name}={value}' for name, value in options.items()]
        run(cmake, '-S', INTERFACES, '-B', build, '-G', 'Ninja', *defines)
        run(cmake, '--build', build)
        uninstall_interfaces()
        run(cmake, '--install', build)
        shutil.copy(build / 'install_manifest.txt', MANIFEST)


def uninstall_interfaces() -> None:
    """Remove what an earlier build installed; a type that is gone must not be importable."""
    if MANIFEST.exists():
        for name in MANIFEST.read_text().splitlines():
            Path(name).unlink(missing_ok=True)


def drop_missing_include_folders(file: Path) -> None:
    """Remove folders of the machine that built the wheel from the targets that a file exports.

    CMake refuses targets whose include folders do not exist.
    """

    def existing(match: re.Match[str]) -> str:
        kept = [f for f in match[2].split(';') if f.startswith('$') or Path(f).exists()]
        return f'{match[1]}"{";".join(kept)}"'

    text = file.read_text()
    file.write_text(re.sub(r'(INTERFACE_INCLUDE_DIRECTORIES )"([^"]*)"', existing, text))


# ---- saying what is done


def say(text: str) -> None:
    """Print a line at once, also into a pipe."""
    print(f'set-up: {text}', flush=True)


@contextlib.contextmanager
def step(name: str, title: str) -> Iterator[Run]:
    """Say what starts, and at the end how long it took; give a function that runs commands.

    What the commands print goes to a log file, and its end to the person if one fails.
    """
    say(title)
    start = time.monotonic()
    path = BUILD / f'setup-{name}.log'
    with path.open('w') as log:

        def run(*command: str | Path) -> None:
            code = wait(command, log, start)
            if code:
                end = path.read_text(errors='replace').splitlines()[-LOG_LINES_SHOWN:]
                what = ' '.join(map(str, command))
                raise SetupError('\n'.join([f'{what} failed ({code}); the end of {path}:', *end]))

        yield run
    say(f'  done in {time.monotonic() - start:.0f} s')


def wait(command: Iterable[str | Path], log: Any, start: float) -> int:
    """Run a command to its end, with a sign of life now and then, and return its exit code."""
    path = f'{VENV / "bin"}{os.pathsep}{os.environ["PATH"]}'
    with subprocess.Popen(
        list(map(str, command)),
        cwd=ROOT,
        env={**os.environ, 'PATH': path},
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
    ) as process:
        while True:
            next_sign = HEARTBEAT_S - (time.monotonic() - start) % HEARTBEAT_S
            try:
                return process.wait(next_sign)
            except subprocess.TimeoutExpired:
                say(f'  at it for {time.monotonic() - start:.0f} s')


if __name__ == '__main__':
    try:
        main(with_dev=sys.argv[1:] == ['dev'])
    except SetupError as error:
        sys.exit(f'set-up: {error}')
    except KeyboardInterrupt:
        sys.exit('set-up: interrupted; the next call goes on from here')
