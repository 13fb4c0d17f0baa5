"""An analysis that fails after the drops is named in a sentence, and costs only itself."""

import importlib

import pytest

STUDY = ('study', 'cylinder_d20_h20', '--vary', 'restitution=0.2:0.6')
FEW = ('--drops', 20, '--workers', 1, '--out', 'out')
REORIENT = ('reorient', 'tetrahedron', '--action', 'tap', '--per-aspect', 5, '--report')
ROADMAP_AND_PAGE = ['roadmap.json', 'reorientation.html']
DROP = ('drop', 'tetrahedron', '--report')
COMMANDS = {
    # The function that fails: the command, what is named, and what is still written.
    'studies.effects:indices_of': (STUDY, 'depend on', ['results.csv', 'page.html']),
    'report.drop_page:convergence_figure': (DROP, 'figure', ['report.html', 'pie.png']),
    'api.pages:drop_page': (DROP, 'report', ['distribution.json', 'poses.csv']),
    'api.reorient:long_run': (REORIENT, 'long-run', ['transitions.json', *ROADMAP_AND_PAGE]),
}


def broken(*_, **__):
    return 1 / 0


@pytest.mark.slow
@pytest.mark.parametrize('place', COMMANDS)
def test_failure_is_named_and_everything_else_is_written(place, run, tmp_path, monkeypatch):
    words, named, files = COMMANDS[place]
    module, function = place.split(':')
    monkeypatch.setattr(importlib.import_module(f'resting_aspects_ros.{module}'), function, broken)
    ended = run(*words, *FEW)
    assert ended.returncode == 0, ended.stderr
    assert 'Traceback' not in ended.stderr
    warning = next(line for line in ended.stderr.splitlines() if 'ZeroDivisionError' in line)
    assert named in warning
    assert set(files) <= {
        str(path.relative_to(tmp_path / 'out')) for path in (tmp_path / 'out').rglob('*')
    }
