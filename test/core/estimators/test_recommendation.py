"""Which method is recommended, by part and conditions."""

import pytest

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.estimators.recommendation import recommend


@pytest.mark.parametrize(
    ('height', 'thrown', 'method'),
    [
        # The heights in docs/explanation/estimators.md, and the method that deviates least.
        (0.1, False, 'rolling'),
        (0.5, False, 'csa'),
        (3, False, 'csa'),
        (10, False, 'csa'),
        (30, False, 'crsa'),
        (100, False, 'crsa'),
        (3, True, 'crsa'),
    ],
)
def test_release_height_selects_method_for_flat_sides(part, height, thrown, method):
    found = recommend(find_aspects(part('l_bracket')), height, thrown=thrown)
    assert found.method == method
    assert f'({method}): for' in found.reason or 'is rolling: for' in found.reason


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('name', 'method'), [('washer', 'csa'), ('cylinder_d20_h20', '')])
def test_curved_side_matters_if_the_part_often_rolls_onto_it(part, name, method):
    for height in (3, 30):
        found = recommend(find_aspects(part(name)), height, thrown=False)
        assert found.method == method
        assert '%' in found.reason or method
