"""`resting_aspects estimate`: its table, its document, and wrong input."""

import json

import pytest


@pytest.fixture
def document(run):
    def read(*words):
        ended = run('estimate', *words, '--json')
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return read


def counts(path, numbers):
    rows = [f'{k},{n}' for k, n in enumerate(numbers, start=1)]
    path.write_text('\n'.join(['aspect,count', *rows, '']), encoding='utf-8')
    return path


def test_against_drops(run, document, tmp_path):
    path = counts(tmp_path / 'manual.csv', [30, 30, 20, 15, 5])
    found = document('l_bracket', '--against', str(path))
    assert found['against']['drops'] == 100
    assert [a['probability'] for a in found['against']['aspects']] == [0.3, 0.3, 0.2, 0.15, 0.05]
    for name, method in found['methods'].items():
        off = [
            abs(a['probability'] - b['probability'])
            for a, b in zip(method['aspects'], found['against']['aspects'], strict=True)
        ]
        said = found['against']['methods'][name]
        assert said['mean_deviation'] == pytest.approx(sum(off) / 5)
        assert said['largest_deviation'] == pytest.approx(max(off))
        assert off[said['largest_aspect'] - 1] == max(off)
    ended = run('estimate', 'l_bracket', '--against', str(path))
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert all(len(line) <= 80 for line in lines)
    end = next(k for k, line in enumerate(lines) if line.split()[:2] == ['mean', 'dev.'])
    mean, largest, p_value = (line.split() for line in lines[end : end + 3])
    assert (mean[:2], largest[0]) == (['mean', 'dev.'], 'largest')
    assert p_value[:2] == ['p', 'value']
    solid_angle = found['against']['methods']['solid_angle']
    assert float(mean[2]) == pytest.approx(100 * solid_angle['mean_deviation'], abs=0.05)
    assert float(largest[1]) == pytest.approx(100 * solid_angle['largest_deviation'], abs=0.05)
