"""`nodes` and `request`: the suite in one process, a client in another."""

import ast
import contextlib
import io
import json
import os
import re
import signal

import numpy as np
import pytest
from doc_pages import code


@pytest.mark.slow
def test_request_returns_every_form_of_result(begin, run, read_until, wait, tmp_path):
    nodes = begin('nodes', '--ros-args', '-p', 'log_folder:=logs', '-p', 'surface:=steel')
    read_until(nodes.stderr, lambda line: 'aspect_classifier]: ready' in line)

    # Without a surface, that of the simulator.
    asked = ('request', 'tetrahedron', '--drops', 20, '--seed', 3)
    ended = run(*asked, '--json')
    assert ended.returncode == 0, ended.stderr
    dropped = json.loads(run('drop', *asked[1:], '--surface', 'steel', '--json').stdout)
    document = json.loads(ended.stdout)
    # The drops and the fields are the same as those of `drop`.
    assert document.keys() == dropped.keys()
    for of in (document, dropped):
        del of['run_id'], of['started']
    for asked_for, made_here in zip(document['aspects'], dropped['aspects'], strict=True):
        # The message has a polygon of float32.
        assert np.allclose(asked_for.pop('support'), made_here.pop('support'), atol=1e-8)
    assert document.pop('history') is None  # not part of the service
    del dropped['history']
    assert document == dropped

    known = run(*asked, '--only-known')
    assert known.stdout.splitlines()[1].strip() == '20 drops on steel, seed 3'
    assert known.stderr == ''

    ended = run('request', 'tetrahedron', '--drops', 3, '--friction', '0.4', '--json')
    steel = document['conditions']
    assert json.loads(ended.stdout)['conditions'] == steel | {'surface': '', 'friction': 0.4}

    unknown = run('request', 'nothing')
    assert (unknown.returncode, unknown.stdout) == (2, '')
    (line,) = unknown.stderr.splitlines()
    assert line.startswith("error: part 'nothing' is not known; known parts: angle_45x30x8")

    # The Python of the README, in this process.
    (client,) = [text for text in code('README.md', 'python') if 'Client' in text]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(client.replace('drops=1000', 'drops=50'), {})
    assert [row[0] for row in ast.literal_eval(out.getvalue())] == [1, 2, 3, 4, 5]

    asking = begin('request', 'tetrahedron', '--drops', 4000, '--seed', 4)
    read_until(asking.stderr, lambda line: re.match(r'tetrahedron: [1-9]\d* of 4000', line))
    os.killpg(asking.pid, signal.SIGINT)
    *_, last = asking.communicate(timeout=600)[1].splitlines()
    assert asking.returncode == 130
    assert last == 'interrupted'
    # The completed drops are logged, and the log is closed.
    wait(lambda: len(list(tmp_path.glob('logs/*/metadata.yaml'))) == 4, 'the logs')

    nodes.send_signal(signal.SIGINT)
    _, errors = nodes.communicate(timeout=600)
    assert nodes.returncode == 0
    assert 'Traceback' not in errors
