"""The drops of a calibration, and what is refused."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.studies.calibration.calibrate import Simulation, given_counts

from .conftest import HEIGHTS, surface_counts

COUNTS = {
    'conditions': {'height': '60 mm'},
    'parts': [{'box': [20, 20, 12], 'counts': {'z': 70, 'rest': 30}}],
}


@pytest.mark.slow
def test_drops_are_counted_by_group_and_follow_from_the_seed(here):
    given = surface_counts([(30, 100)] * 2, heights=HEIGHTS[:2])
    points = np.array([[0.2, 0.5], [0.7, 0.5]])
    made = []
    one, same, other = (
        Simulation(given, (20, 30), seed, here(), made.append)(points) for seed in (1, 1, 2)
    )
    assert [each.sum(axis=1).tolist() for each in one] == [[20, 20], [30, 30]]
    assert max(made) == 100
    assert all((a == b).all() for a, b in zip(one, same, strict=True))
    assert any((a != b).any() for a, b in zip(one, other, strict=True))
    # A point does not depend on the others.
    (alone, _) = Simulation(given, (20, 30), 1, here())(points[1:])
    assert (alone[0] == one[0][1]).all()


@pytest.mark.slow
def test_point_at_which_a_part_cannot_be_dropped_is_refused(here):
    conditions = {'height': '5mm:300mm', 'height_of': 'CENTRE_OF_MASS', 'friction': 0.3}
    with pytest.raises(ra.InvalidValueError, match='expected ranges in which all parts'):
        ra.calibrate({**COUNTS, 'conditions': conditions}, points=8, drops=1, workers=here())


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'points': 7}, 'invalid points 7'),
        ({'drops': 2.5}, 'invalid drops 2.5'),
        ({'seed': -1}, 'seed'),
    ],
)
def test_wrong_numbers_are_refused(options, message):
    with pytest.raises(ra.InvalidValueError, match=message):
        ra.calibrate(COUNTS, **options)


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
