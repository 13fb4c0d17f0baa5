"""What a calibration says and writes."""

import json

import numpy as np
import pytest

from resting_aspects_ros.simulation.conditions import Surfaces
from resting_aspects_ros.studies.calibration.calibrate import statements, summarise
from resting_aspects_ros.system import config_folder

from .conftest import fitted


@pytest.fixture(scope='module')
def result(agreeing):
    return summarise(agreeing, 1)


@pytest.mark.parametrize(
    ('counts', 'expected'),
    [
        ([(9, 10), (5, 10), (3, 10)], 'These counts do not determine the restitution: '),
        (  # At the corner of the ranges, with more of the square faces than there.
            [(4975, 5000), (4850, 5000), (4000, 5000)],
            'The interval of the restitution ends where its range does',
        ),
        (  # The shares of the only box are a function of one combination of the conditions.
            [(338, 400), (0, 1), (0, 1)],
            'More restitution with less friction fits as well',
        ),
    ],
)
def test_what_the_counts_do_not_tell_is_said(counts, expected):
    fit = fitted(counts, discrepancy=counts[0][1] == 10, per_point=4000)
    assert expected in ' '.join(statements(summarise(fit, 1)))


def test_counts_that_no_conditions_explain_are_said(result, contradicting):
    wrong = summarise(contradicting, 1)
    assert 'can explain these counts' in str(result)
    assert 'No restitution or friction within' in ' '.join(statements(wrong))
    assert (result.contradicted, wrong.contradicted) == (False, True)


def test_entry_is_a_surface_with_its_samples(result, tmp_path):
    path = tmp_path / 'surfaces.yaml'
    shipped = config_folder() / 'surfaces.yaml'
    path.write_text(f'{shipped.read_text()}\n{result.surface_entry()}')
    found, estimate = Surfaces.read(path).get('a_table'), result.estimates[0]
    assert found == result.conditions
    assert found.restitution == pytest.approx(estimate.best, rel=0.01)
    drawn = np.array([each['restitution'] for each in found.uncertainty])
    assert len(drawn) == 64
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
