"""What a calibration says and writes."""

import dataclasses
import json

import numpy as np
import pytest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.simulation.surfaces import Surfaces
from resting_aspects_ros.studies.calibration.calibrate import summarise
from resting_aspects_ros.studies.calibration.comparison import compare_surfaces
from resting_aspects_ros.studies.calibration.summary import shortest_interval
from resting_aspects_ros.studies.calibration.texts import comparison_text, statements

SURFACES = 'config/surfaces.yaml'


@pytest.fixture(scope='module')
def result(agreeing):
    return summarise(agreeing, 1)


@pytest.fixture(scope='module')
def wrong(contradicting):
    return summarise(contradicting, 1)


def test_estimates_contain_the_truth(result):
    for each, unit in zip(result.estimates, (0.4, 0.6), strict=True):
        truth = float(each.factor.values(np.array([unit]))[0])
        assert each.low <= truth <= each.high
        assert each.low <= each.best <= each.high


def test_shortest_interval_of_a_normal_density():
    x = np.linspace(-5, 5, 2001)
    low, high = shortest_interval(x, np.exp(-(x**2) / 2))
    assert (low, high) == pytest.approx((-1.645, 1.645), abs=0.03)


def test_what_the_counts_do_not_determine_is_said(result, invented):
    few = summarise(invented.fit([(9, 10), (5, 10), (3, 10)]), 1)
    said = ' '.join(statements(few))
    assert 'These counts do not determine the restitution: ' in said
    assert 'These counts do not determine the friction: ' in said
    many = invented.counted((0.4, 0.6), 100_000, np.random.default_rng(3))
    said = ' '.join(statements(summarise(invented.fit(many, discrepancy=False), 1)))
    assert 'The restitution is ' in said
    assert 'not determine' not in said


def test_an_interval_that_its_range_cuts_off_is_said(invented):
    # The corner of the ranges, and more of the square faces than there.
    counts = [(99_500, 100_000), (97_000, 100_000), (80_000, 100_000)]
    said = ' '.join(statements(summarise(invented.fit(counts, discrepancy=False), 1)))
    assert 'The interval of the restitution ends where its range does' in said


def test_counts_that_no_conditions_explain_are_said(result, wrong):
    assert 'can explain these counts' in str(result)
    assert not result.contradicted
    assert 'No restitution or friction within the ranges explain these counts' in ' '.join(
        statements(wrong)
    )
    assert wrong.contradicted
    assert not wrong.usable
    assert 'check the counts' in ' '.join(statements(wrong))


def test_entry_is_a_surface(result, tmp_path):
    path = tmp_path / 'surfaces.yaml'
    shipped = open(SURFACES, encoding='utf-8').read()  # noqa: SIM115, PTH123
    path.write_text(f'{shipped}\n{result.surface_entry()}', encoding='utf-8')
    found = Surfaces.read(path).get('a_table')
    assert found == result.conditions
    assert found.restitution == pytest.approx(result.estimates[0].best, rel=0.01)


def test_source_names_the_counts_and_what_is_unknown(result):
    entry = ' '.join(result.surface_entry().split())
    assert (
        'Calibrated to 900 counted drops of box 10, box 15, box 20. Invented for a test.' in entry
    )
    assert '90 %' in entry


def test_document_is_json_with_the_conditions_and_draws(result):
    document = json.loads(result.to_json())
    assert document['conditions']['height'] == 0.1
    assert [each['name'] for each in document['estimates']] == ['restitution', 'friction']
    assert len(document['draws']) == 200
    drawn = np.array([each['restitution'] for each in document['draws']])
    estimate = result.estimates[0]
    assert drawn.mean() == pytest.approx(estimate.mean, abs=4 * estimate.deviation / np.sqrt(200))
    assert document['parts'][0]['counts'] == result.fit.given.parts[0].counts.tolist()


def test_picture_is_written(result, tmp_path):
    from PIL import Image

    result.save_picture(tmp_path / 'picture.png')
    pixels = np.asarray(Image.open(tmp_path / 'picture.png').convert('RGB'))
    # The inner region is drawn in its colour.
    assert (np.abs(pixels.astype(int) - (0x5B, 0x93, 0xD0)).sum(axis=2) < 10).sum() > 1000


@pytest.mark.slow
def test_equal_surfaces_are_one_and_others_are_two(invented):
    rng = np.random.default_rng(3)
    one, same = (
        summarise(invented.fit(invented.counted((0.4, 0.6), 1000, rng), surface=name), 1)
        for name in ('one', 'same')
    )
    other = summarise(invented.fit(invented.counted((0.8, 0.9), 1000, rng), surface='other'), 1)
    equal, different = (one.compare(each) for each in (same, other))
    assert equal.log_ratio < 0 < different.log_ratio
    assert equal.overlap > 0.3
    assert different.overlap < 0.05
    assert equal.same_parts_p > 0.01 > different.same_parts_p
    assert 'more probable with two surfaces than with one' in comparison_text(different)
    assert 'more probable with one surface than with two' in comparison_text(equal)
    assert 'do not differ significantly' in comparison_text(equal)


def test_surfaces_with_other_ranges_are_not_compared(result, invented):
    given = dataclasses.replace(result.fit.given, factors=result.fit.given.factors[:1])
    other = dataclasses.replace(result, fit=dataclasses.replace(result.fit, given=given))
    with pytest.raises(InvalidValueError, match='expected the same ranges'):
        result.compare(other)


def test_surfaces_with_other_parts_are_compared_by_their_conditions(result):
    given = result.fit.given
    fewer = dataclasses.replace(given, parts=given.parts[:1])
    posterior = dataclasses.replace(
        result.fit.posterior, log_likelihood=result.fit.posterior.log_likelihood[1:2]
    )
    parts = dataclasses.replace(given, parts=given.parts[1:2])
    one = dataclasses.replace(
        result.fit,
        given=fewer,
        posterior=dataclasses.replace(
            posterior, log_likelihood=result.fit.posterior.log_likelihood[:1]
        ),
    )
    other = dataclasses.replace(result.fit, given=parts, posterior=posterior)
    found = compare_surfaces(one, other)
    assert not found.same_parts
    assert found.same_parts_p is None
    assert found.log_ratio < 0  # both are of the same surface
    assert 'G test' not in comparison_text(found)
