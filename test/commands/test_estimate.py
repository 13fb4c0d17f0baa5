"""`resting_aspects estimate`: its table, its document, and what it refuses."""

import json

import pytest

from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.estimators.estimate import METHODS, estimate
from resting_aspects_ros.core.estimators.resting_shape import RestingShape


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


def test_the_document_has_all_methods(document, part):
    found = document('u_bracket')
    assert found['part'] == 'u_bracket'
    assert list(found['methods']) == list(METHODS)
    shape = RestingShape(part('u_bracket'), find_aspects(part('u_bracket')))
    for name, each in found['methods'].items():
        expected = estimate(shape, name).probabilities
        assert [a['id'] for a in each['aspects']] == [1, 2, 3, 4, 5, 6]
        assert [a['probability'] for a in each['aspects']] == expected.tolist()
        assert each['not_defined'] is None
        assert each['source'] == METHODS[name].source


def test_some_methods(document):
    assert list(document('l_bracket', '--method', 'rolling, csa')['methods']) == ['csa', 'rolling']


def test_the_column_of_one_method_has_its_name(run):
    headings = run('estimate', 'l_bracket', '--method', 'rolling').stdout
    assert 'rolling' in headings
    assert 'roll-' not in headings
    assert 'roll-' in run('estimate', 'l_bracket').stdout


def test_the_table_of_a_cylinder_says_what_is_not_defined(run):
    ended = run('estimate', 'cylinder_d20_h20')
    assert ended.returncode == 0, ended.stderr
    assert all(len(line) <= 80 for line in ended.stdout.splitlines())
    (side,) = (line for line in ended.stdout.splitlines() if ' axis ' in line)
    assert side.split()[-7:] == ['70.7', '70.7', '-', '-', '33.4', '70.7', '70.7']
    words = ' '.join(ended.stdout.split())
    for method in ('crsa', 'stability'):
        reason = 'aspect 1 rests on a curved side, not a polygon.'
        assert f'{method} is not defined for cylinder_d20_h20: {reason}' in words


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
    mean, largest, p_value = (line.split() for line in lines[-3:])
    assert (mean[:2], largest[0]) == (['mean', 'dev.'], 'largest')
    assert p_value[:2] == ['p', 'value']
    solid_angle = found['against']['methods']['solid_angle']
    assert float(mean[2]) == pytest.approx(100 * solid_angle['mean_deviation'], abs=0.05)
    assert float(largest[1]) == pytest.approx(100 * solid_angle['largest_deviation'], abs=0.05)


def test_against_a_count_of_what_looks_alike(run, document, tmp_path):
    path = tmp_path / 'manual.csv'
    path.write_text('class,count\n1,72\n2,28\n')
    found = document('hex_nut', '--against', str(path))
    assert [(c['id'], c['count']) for c in found['against']['classes']] == [(1, 72), (2, 28)]
    flat = sum(a['probability'] for a in found['methods']['rolling']['aspects'][:2])
    said = found['against']['methods']['rolling']
    assert said['mean_deviation'] == pytest.approx(abs(flat - 0.72))
    lines = run('estimate', 'hex_nut', '--against', str(path)).stdout.splitlines()
    rows = [line.split()[:2] for line in lines]
    assert ['1', '72.0'] in rows
    assert ['2', '28.0'] in rows
    path.write_text('class,count\n1,72\n2,28\n3,1\n')
    ended = run('estimate', 'hex_nut', '--against', str(path))
    assert ended.returncode == 2
    assert 'with the classes [1, 2, 3], allowed are those of hex_nut: [1, 2] ' in ended.stderr


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (
            ['l_bracket', '--method', 'guess'],
            "--method is 'guess', allowed is all, or some of solid_angle, csa",
        ),
        (['cylinder_d20_h20', '--method', 'crsa'], 'crsa is not defined for cylinder_d20_h20'),
        (['washer', '--method', 'crsa,stability'], '; stability is not defined for washer'),
        (['no_such_part'], "part 'no_such_part' is not known, known are"),
        (['l_bracket', '--against', 'no.csv'], "'no.csv'"),
    ],
)
def test_what_is_refused(run, words, said):
    ended = run('estimate', *words)
    assert ended.returncode == 2
    assert ended.stdout == ''
    assert ended.stderr.startswith('error: ')
    assert said in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def test_drops_of_another_part_are_refused(run, tmp_path):
    path = counts(tmp_path / 'manual.csv', [1, 2, 3])
    ended = run('estimate', 'l_bracket', '--against', str(path))
    assert ended.returncode == 2
    assert 'aspects [1, 2, 3], allowed are those of l_bracket: [1, 2, 3, 4, 5]' in ended.stderr
