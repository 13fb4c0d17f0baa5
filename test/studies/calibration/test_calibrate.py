"""The drops of a calibration, what is refused, and what the result says and writes."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.simulation.conditions import Surfaces
from resting_aspects_ros.studies.calibration.calibrate import (
    Simulation,
    given_counts,
    statements,
    summarise,
)
from resting_aspects_ros.system import config_folder

from .conftest import HEIGHTS, fitted, surface_counts


@pytest.mark.slow
def test_drops_are_counted_by_group_and_follow_from_the_seed(here):
    given = surface_counts([(30, 100)] * 2, heights=HEIGHTS[:2])
    points = np.array([[0.2, 0.5], [0.7, 0.5]])
    one, other = (Simulation(given, (20, 30), seed, here())(points) for seed in (1, 2))
    assert [each.sum(axis=1).tolist() for each in one] == [[20, 20], [30, 30]]
    assert any((a != b).any() for a, b in zip(one, other, strict=True))
    # A point does not depend on the others.
    (alone, _) = Simulation(given, (20, 30), 1, here())(points[1:])
    assert (alone[0] == one[0][1]).all()


@pytest.mark.slow
def test_point_at_which_a_part_cannot_be_dropped_is_refused(here):
    document = {
        'conditions': {'height': '5mm:300mm', 'height_of': 'CENTRE_OF_MASS', 'friction': 0.3},
        'parts': [{'box': [20, 20, 12], 'counts': {'z': 70, 'rest': 30}}],
    }
    with pytest.raises(ra.InvalidValueError, match='expected ranges in which all parts'):
        ra.calibrate(document, points=8, drops=1, workers=here())
    with pytest.raises(ra.InvalidValueError, match='invalid points 7'):
        ra.calibrate(document, points=7)


@pytest.mark.slow
def test_counts_of_the_simulation_are_explained_by_its_conditions(here):
    """Parts are dropped under known conditions, and the conditions are found again."""
    truth = {'restitution': 0.3, 'friction': 0.2}
    document = {'conditions': {'height': '60 mm'}}
    document['parts'] = [
        {'name': f'box {h}', 'box': [20, 20, h], 'counts': {'z': 1, 'rest': 1}}
        for h in (8, 14, 20)
    ]
    given = given_counts(document)
    point = np.array([[float(f.shares(truth[f.name])) for f in given.factors]])
    tables = Simulation(given, [150] * 3, 99, here())(point)
    for part, table in zip(document['parts'], tables, strict=True):
        part['counts'] = dict(zip(('z', 'rest'), table[0].tolist(), strict=True))
    found = ra.calibrate(document, discrepancy=False, points=24, drops=40, workers=here())
    assert not found.contradicted
    for each in found.estimates:
        # An interval of 90 % that misses the truth by more than its length is improbable.
        length = each.high - each.low
        assert each.low - length < truth[each.factor.name] < each.high + length


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
