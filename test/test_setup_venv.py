"""What set-up says before it starts on a machine that lacks something, and when it starts anew."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parent.parent / 'tools'


@pytest.fixture
def setup_venv(tmp_path):
    """Return a set-up of an empty folder, as a module."""
    (tmp_path / 'tools').mkdir()
    script = shutil.copy(TOOLS / 'setup_venv.py', tmp_path / 'tools')
    spec = importlib.util.spec_from_file_location('setup_venv', script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def path(tmp_path):
    """Return a folder that is all of PATH, with what a shell script needs."""
    folder = tmp_path / 'bin'
    folder.mkdir()
    (folder / 'dirname').symlink_to(shutil.which('dirname'))
    return folder


def put_program(folder, name, body):
    (folder / name).write_text(f'#!/bin/sh\n{body}\n')
    (folder / name).chmod(0o755)


def choose(path, **environment):
    return subprocess.run(
        [TOOLS / 'setup'],
        env={'PATH': str(path), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_python_that_does_not_run_is_passed_over(path):
    put_program(path, 'python3.11', 'echo no such version >&2; exit 127')
    put_program(path, 'python3.10', 'if [ "$1" = -c ]; then echo 3.10.12; else echo "$0 $*"; fi')
    chosen = choose(path).stdout
    assert chosen.startswith(f'{path}/python3.10 -I ')
    assert chosen.endswith('/setup_venv.py\n')


@pytest.mark.parametrize('version', ['3.9.19', '3.13.1'])
def test_python_that_is_too_old_or_too_new_is_named_in_one_sentence(path, version):
    put_program(path, 'python3', f'echo {version}')
    refused = choose(path)
    assert refused.returncode == 1
    assert refused.stdout == ''
    assert f'python3 is {version}; allowed are 3.10, 3.11 and 3.12:' in refused.stderr
    assert 'sudo apt install python3' in refused.stderr
    assert refused.stderr.count('\n') == 1


def test_no_python_at_all_is_said(path):
    assert 'none was found that runs' in choose(path).stderr


def test_python_that_was_asked_for_is_the_only_one_tried(path):
    put_program(path, 'python3.11', 'echo 3.11.7')
    refused = choose(path, PYTHON='/no/python')
    assert refused.returncode == 1
    assert '/no/python does not run' in refused.stderr


def test_missing_compiler_is_said_before_anything_starts(setup_venv, path, monkeypatch):
    monkeypatch.setenv('PATH', str(path))
    monkeypatch.delenv('CXX', raising=False)
    with pytest.raises(setup_venv.SetupError, match=r'C\+\+ compiler.*sudo apt install.*g\+\+'):
        setup_venv.main(with_dev=False)
    assert not setup_venv.VENV.exists()


def test_all_that_is_missing_is_said_at_once(setup_venv, tmp_path, monkeypatch):
    monkeypatch.setenv('CXX', 'no-such-compiler')
    monkeypatch.setattr(setup_venv.sysconfig, 'get_path', lambda name: str(tmp_path / name))
    monkeypatch.setattr(setup_venv, 'has_venv', lambda: False)
    with pytest.raises(setup_venv.SetupError) as refused:
        setup_venv.check_machine()
    text = str(refused.value)
    version = f'{sys.version_info[0]}.{sys.version_info[1]}'
    assert 'Python.h' in text
    assert text.endswith(f': sudo apt install g++ python{version}-dev python{version}-venv')
    assert '\n' not in text


def usable(setup_venv, **changes):
    """Write the record of a finished .venv, with changes, and ask whether it can be used."""
    setup_venv.PYTHON.parent.mkdir(parents=True)
    setup_venv.PYTHON.symlink_to(sys.executable)
    state = {
        'venv': str(setup_venv.VENV),
        'python': os.path.realpath(sys.executable),
        'done': {'requirements': ''},
    }
    setup_venv.STATE.write_text(json.dumps(state | changes))
    return setup_venv.usable_state() is not None


def test_finished_venv_is_used_again(setup_venv):
    assert usable(setup_venv)


def test_venv_of_another_folder_is_made_again(setup_venv, capsys):
    assert not usable(setup_venv, venv='/elsewhere/.venv')
    assert 'it was made in /elsewhere/.venv' in capsys.readouterr().out


def test_venv_whose_requirements_were_interrupted_is_made_again(setup_venv):
    assert not usable(setup_venv, done={})


def test_venv_of_another_python_is_made_again_only_if_one_was_asked_for(setup_venv, monkeypatch):
    monkeypatch.delenv('PYTHON', raising=False)
    assert usable(setup_venv, python='/usr/bin/python3.10')
    monkeypatch.setenv('PYTHON', sys.executable)
    assert setup_venv.usable_state() is None


def test_only_what_an_input_changed_is_done_again(setup_venv):
    inputs = setup_venv.ROOT / 'requirements.txt'
    inputs.write_text('numpy==2.2.6\n')
    before = setup_venv.digest([inputs])
    os.utime(inputs, (0, 0))
    assert setup_venv.digest([inputs]) == before
    inputs.write_text('numpy==2.2.5\n')
    assert setup_venv.digest([inputs]) != before


def test_without_node_set_up_goes_on_and_tries_again(setup_venv, path, monkeypatch, capsys):
    monkeypatch.setenv('PATH', str(path))
    monkeypatch.setattr(setup_venv, 'usable_state', lambda: {'done': {'before': ''}})
    monkeypatch.setattr(setup_venv, 'save', lambda state: saved.append(dict(state['done'])))
    worked, saved = [], []
    steps = [
        ('javascript', [], setup_venv.install_javascript),
        ('after', [], lambda: worked.append('after')),
    ]
    monkeypatch.setattr(setup_venv, 'steps', lambda with_dev: steps)
    setup_venv.main(with_dev=True)
    assert worked == ['after']
    assert set(saved[-1]) == {'before', 'after'}  # javascript is not done
    (line,) = capsys.readouterr().out.splitlines()
    assert line == (
        'set-up: node and npm not found: the tests of our logs and pages in JavaScript will be '
        'skipped'
    )


def test_npm_that_fails_is_told_in_one_line(setup_venv, path, monkeypatch):
    put_program(path, 'node', 'exit 0')
    put_program(path, 'npm', 'echo no network; exit 1')
    monkeypatch.setenv('PATH', str(path))
    setup_venv.BUILD.mkdir()
    with pytest.raises(setup_venv.DoWithoutError) as refused:
        setup_venv.install_javascript()
    log = setup_venv.BUILD / 'setup-javascript.log'
    assert str(refused.value) == (
        f'npm failed, see {log}: the tests of our logs and pages in JavaScript will be skipped'
    )
    assert log.read_text() == 'no network\n'


def test_npm_installs_what_is_pinned_and_runs_no_scripts(setup_venv, path, monkeypatch):
    put_program(path, 'node', 'exit 0')
    put_program(path, 'npm', 'echo "$@"')
    monkeypatch.setenv('PATH', str(path))
    setup_venv.BUILD.mkdir()
    setup_venv.install_javascript()
    words = (setup_venv.BUILD / 'setup-javascript.log').read_text().split()
    assert words[:3] == ['ci', '--prefix', str(setup_venv.JAVASCRIPT)]
    assert '--ignore-scripts' in words


def test_include_folders_that_do_not_exist_are_dropped_from_cmake_exports(setup_venv, tmp_path):
    file = tmp_path / 'msgExport.cmake'
    line = '  INTERFACE_INCLUDE_DIRECTORIES "{}"\n'
    kept = f'${{_IMPORT_PREFIX}}/include/msg;{tmp_path}'
    file.write_text(line.format(f'/opt/python/include;{kept}') + '  OTHER "/opt/python"\n')
    setup_venv.drop_missing_include_folders(file)
    assert file.read_text() == line.format(kept) + '  OTHER "/opt/python"\n'


def test_failing_command_shows_the_end_of_its_log(setup_venv):
    setup_venv.BUILD.mkdir()
    with (
        pytest.raises(setup_venv.SetupError, match=r'(?s)failed \(3\).*the reason'),
        setup_venv.step('broken', 'breaking') as run,
    ):
        run(sys.executable, '-c', 'print("the reason"); raise SystemExit(3)')
