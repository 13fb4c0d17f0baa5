"""`resting_aspects estimate`: its table, its document, and wrong input."""

import dataclasses
import json
import re

import pytest
import trimesh

from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.recommended_method import recommended_method, release_numbers
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.estimators.estimate import METHODS, estimate
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.simulation.surroundings.library import named_surroundings


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
    release = release_numbers(shape, shipped_surfaces().get())
    for name, each in found['methods'].items():
        expected = estimate(shape, name, release).probabilities
        assert [a['id'] for a in each['aspects']] == [1, 2, 3, 4, 5, 6]
        assert [a['probability'] for a in each['aspects']] == expected.tolist()
        assert each['not_defined'] is None
        assert each['source'] == METHODS[name].source
        assert (each['weight'] is None) == (name != 'learned')


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
    assert side.split()[-8:-1] == ['70.7', '70.7', '-', '-', '33.4', '70.7', '70.7']
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


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize(
    ('words', 'method', 'reason'),
    [
        (['l_bracket'], 'learned', 'it knows the conditions'),
        (['l_bracket', '--surface', 'thrown'], 'learned', 'it knows the conditions'),
        (['cylinder_d20_h20'], 'learned', 'from 71 % of all directions the part rolls onto'),
        # The height of the surface is 60 mm.
        (['l_bracket', '--friction', '2'], 'csa', '0.2 to 20 part radii (here 2.1)'),
        (['l_bracket', '--height', '1mm'], 'rolling', 'below 0.2 part radii (here 0.035)'),
        (['l_bracket', '--height', '1.2'], 'crsa', 'above 20 part radii (here 42)'),
        (['l_bracket', '--spin', '200'], 'crsa', 'for thrown parts'),
        (['washer', '--height', '1'], 'csa', 'rarely rest on their curved side'),
        (['cylinder_d20_h20', '--restitution', '1'], None, 'all methods deviate from drops by 5'),
        (['sphere.stl'], None, 'has one aspect'),
    ],
)
def test_one_method_is_recommended_for_the_conditions(
    run, document, tmp_path, words, method, reason
):
    trimesh.creation.icosphere(2, 10).export(tmp_path / 'sphere.stl')
    found = document(*words)
    assert found['recommended'] == method
    assert reason in found['reason']
    printed = run('estimate', *words).stdout
    assert ' '.join(printed.split()).endswith(found['reason'])
    marked = [line.split()[0] for line in printed.splitlines() if re.match(r'[a-z_]+\* ', line)]
    assert marked == ([] if method is None else [f'{method}*'])


def test_no_method_is_recommended_for_drops_in_surroundings(run, part, surfaces):
    printed = run('estimate', 'tetrahedron').stdout
    assert 'All methods assume an infinite level plane.' in printed
    slope = dataclasses.replace(surfaces.get(), surroundings=named_surroundings('slope').key)
    found = recommended_method(RestingShape(part('tetrahedron')), slope)
    assert found.method == ''
    assert found.reason.endswith('the drops were made on a slope (angle 10 deg).')


def test_recommendation_uses_conditions_of_drops_by_default(run, document, tmp_path):
    ended = run('drop', 'l_bracket', '--drops', 50, '--height', 1.2, '--json')
    (tmp_path / 'd.json').write_text(ended.stdout, encoding='utf-8')
    assert document('l_bracket', '--against', 'd.json')['recommended'] == 'crsa'
    again = document('l_bracket', '--against', 'd.json', '--surface', 'steel')
    assert again['recommended'] == 'learned'


def test_legend_explains_every_method(run):
    lines = run('estimate', 'l_bracket').stdout.splitlines()
    for name, method in METHODS.items():
        assert any(line.split()[0].rstrip('*') == name and method.label in line for line in lines)


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
