"""What a calibration says and writes."""

import json

import numpy as np
import pytest

from resting_aspects_ros.simulation.conditions import Surfaces, surfaces_file
from resting_aspects_ros.studies.calibration.calibrate import summarise
from resting_aspects_ros.studies.calibration.result import statements

TRUTH = (0.4, 0.6)


@pytest.fixture(scope='module')
def result(agreeing):
    return summarise(agreeing, 1)


@pytest.mark.slow
def test_what_the_counts_do_not_determine_is_said(invented):
    few = summarise(invented.fit([(9, 10), (5, 10), (3, 10)]), 1)
    said = ' '.join(statements(few))
    assert 'These counts do not determine the restitution: ' in said
    assert 'These counts do not determine the friction: ' in said
    many = invented.counted(TRUTH, 5000, np.random.default_rng(3))
    said = ' '.join(statements(summarise(invented.fit(many, discrepancy=False), 1)))
    assert 'The restitution is ' in said
    assert 'not determine' not in said


def test_an_interval_that_its_range_cuts_off_is_said(invented):
    # The corner of the ranges, and more of the square faces than there.
    counts = [(4975, 5000), (4850, 5000), (4000, 5000)]
    said = ' '.join(statements(summarise(invented.fit(counts, discrepancy=False), 1)))
    assert 'The interval of the restitution ends where its range does' in said


def test_conditions_that_trade_off_are_said(invented):
    """The shares of the flat box are a function of one combination of the conditions."""
    fit = invented.fit([(338, 400), (0, 1), (0, 1)], discrepancy=False, per_point=4000)
    assert 'More restitution with less friction fits as well' in ' '.join(
        statements(summarise(fit, 1))
    )


def test_counts_that_no_conditions_explain_are_said(result, contradicting):
    wrong = summarise(contradicting, 1)
    assert 'can explain these counts' in str(result)
    assert 'No restitution or friction within' in ' '.join(statements(wrong))
    assert (result.contradicted, wrong.contradicted) == (False, True)


def test_entry_is_a_surface_with_its_samples(result, tmp_path):
    path = tmp_path / 'surfaces.yaml'
    shipped = surfaces_file().read_text(encoding='utf-8')
    path.write_text(f'{shipped}\n{result.surface_entry()}', encoding='utf-8')
    found = Surfaces.read(path)
    assert found.get('a_table') == result.conditions
    assert found.get('a_table').restitution == pytest.approx(result.estimates[0].best, rel=0.01)
    drawn = np.array([each['restitution'] for each in found.get('a_table').uncertainty])
    assert len(drawn) == 64
    estimate = result.estimates[0]
    assert drawn.mean() == pytest.approx(estimate.mean, abs=4 * estimate.deviation / np.sqrt(64))


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
