"""Which method is recommended, by part and conditions."""

import dataclasses

import pytest

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.estimators.recommendation import recommend
from resting_aspects_ros.core.estimators.release import TYPICAL

# More friction than in the drops to which learned is fitted.
ROUGH = dataclasses.replace(TYPICAL, friction=5.0)


@pytest.mark.parametrize('height', [0.1, 3, 25])
@pytest.mark.parametrize('thrown', [False, True])
def test_learned_is_recommended_for_the_conditions_of_its_fit(part, height, thrown):
    release = dataclasses.replace(TYPICAL, height=height)
    found = recommend(find_aspects(part('l_bracket')), release, thrown=thrown)
    assert found.method == 'learned'


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
def test_release_height_selects_method_beyond_the_fit(part, height, thrown, method):
    release = dataclasses.replace(ROUGH, height=height)
    found = recommend(find_aspects(part('l_bracket')), release, thrown=thrown)
    assert found.method == method
    assert f'({method}): for' in found.reason or 'is rolling: for' in found.reason
    beyond = 'height' if height > 30 else 'friction'
    assert found.reason.startswith(f'The {beyond} is beyond the conditions')


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('name', 'method'), [('washer', 'csa'), ('cylinder_d20_h20', '')])
def test_curved_side_matters_if_the_part_often_rolls_onto_it(part, name, method):
    aspects = find_aspects(part(name))
    for height in (3, 30):
        found = recommend(aspects, dataclasses.replace(ROUGH, height=height), thrown=False)
        assert found.method == method
        assert '%' in found.reason or method
    fitted = recommend(aspects, TYPICAL, thrown=False)
    assert fitted.method == 'learned'
    assert ('simulate drops' in fitted.reason) == (method == '')
