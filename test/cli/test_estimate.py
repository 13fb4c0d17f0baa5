"""`resting_aspects estimate`: its table, its document, and wrong input."""

import json

import pytest

from resting_aspects_ros.aspects.estimate import METHODS, RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects


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


def test_column_of_one_method_has_its_full_name(run):
    headings = run('estimate', 'l_bracket', '--method', 'rolling').stdout
    assert 'rolling' in headings
    assert 'rol-' not in headings
    assert 'rol-' in run('estimate', 'l_bracket').stdout


def test_table_of_a_cylinder_names_undefined_methods(run):
    ended = run('estimate', 'cylinder_d20_h20')
    assert ended.returncode == 0, ended.stderr
    assert all(len(line) <= 80 for line in ended.stdout.splitlines())
    (side,) = (line for line in ended.stdout.splitlines() if ' cylinder, ' in line)
    assert side.split()[-7:] == ['70.7', '70.7', '-', '-', '33.4', '70.7', '70.7']
    words = ' '.join(ended.stdout.split())
    for method in ('crsa', 'stability'):
        reason = 'aspect 1 rests on a curved side, not a polygon.'
        assert f'{method} is not defined for cylinder_d20_h20: {reason}' in words


def test_equivalent_aspects_are_summed_in_one_row(run, document):
    methods = document('hex_nut', '--method', 'csa,rolling')['methods'].values()
    flat, side = (
        [sum(a['probability'] for a in each['aspects'][k]) for each in methods]
        for k in (slice(0, 2), slice(2, 8))
    )
    for sums, ids in ((flat, '1 and 2 '), (side, '3 to 8 ')):
        lines = run('estimate', 'hex_nut', '--method', 'csa,rolling').stdout.splitlines()
        (row,) = (line for line in lines if line.strip().startswith(ids))
        assert row.split()[-2:] == [f'{100 * share:.1f}' for share in sums]
    assert [[c['probability'] for c in each['classes']] for each in methods] == [
        pytest.approx([a, b]) for a, b in zip(flat, side, strict=True)
    ]
    lines = run('estimate', 'hex_nut', '--each').stdout.splitlines()
    assert [line.split()[0] for line in lines if ' flat side ' in line] == list('12345678')


def test_legend_explains_every_method(run):
    lines = run('estimate', 'l_bracket').stdout.splitlines()
    for name, method in METHODS.items():
        assert any(line.split()[0] == name and method.label in line for line in lines)


def test_conditions_are_refused_because_no_method_uses_them(run):
    for words in (['--surface', 'steel'], ['--height', '1mm'], ['--friction', '0.4']):
        ended = run('estimate', 'l_bracket', *words)
        assert ended.returncode == 2
        assert words[0] in ended.stderr


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


@pytest.mark.slow
def test_against_counts_by_class(run, document, tmp_path):
    path = tmp_path / 'manual.csv'
    path.write_text('class,count\n1,72\n2,28\n')
    found = document('hex_nut', '--against', str(path))
    assert [(c['id'], c['count']) for c in found['against']['classes']] == [(1, 72), (2, 28)]
    flat = sum(a['probability'] for a in found['methods']['rolling']['aspects'][:2])
    said = found['against']['methods']['rolling']
    assert said['mean_deviation'] == pytest.approx(abs(flat - 0.72))
    lines = run('estimate', 'hex_nut', '--against', str(path)).stdout.splitlines()
    rows = [line.split()[2:4] for line in lines]
    assert ['2', '72.0'] in rows
    assert ['8', '28.0'] in rows
    path.write_text('class,count\n1,72\n2,28\n3,1\n')
    ended = run('estimate', 'hex_nut', '--against', str(path))
    assert ended.returncode == 2
    assert 'invalid classes [1, 2, 3] in --against' in ended.stderr
    assert ': expected those of hex_nut, [1, 2] (' in ended.stderr


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (
            ['l_bracket', '--method', 'guess'],
            "invalid --method 'guess': expected all, or some of solid_angle, csa",
        ),
        (['cylinder_d20_h20', '--method', 'crsa'], 'crsa is not defined for cylinder_d20_h20'),
        (['washer', '--method', 'crsa,stability'], '; stability is not defined for washer'),
        (['no_such_part'], "part 'no_such_part' is not known; known parts:"),
        (['l_bracket', '--against', 'no.csv'], "'no.csv'"),
    ],
)
def test_wrong_input_is_refused(run, words, said):
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
    assert 'invalid aspects [1, 2, 3] in --against' in ended.stderr
    assert ': expected those of l_bracket, [1, 2, 3, 4, 5] (' in ended.stderr
