"""The best conditions are those with the best value in the fresh drops."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.studies.objectives import Objective
from resting_aspects_ros.studies.optimum_comparison import certainty_of_best

FEW = {'points': 4, 'drops': 20, 'budget': 200}


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('seed', [1, 2, 3])
def test_best_has_the_best_value_of_the_compared_conditions(here, seed):
    # No conditions are better than others for a tetrahedron, so that the fresh drops decide.
    found = ra.optimise(
        'tetrahedron', {'height': '10mm:30mm'}, wanted=[1], height=0.02, seed=seed,
        workers=here(lookahead=1), **FEW,
    )  # fmt: skip
    others = [each for each in (found.second, found.start) if each is not None]
    assert found.best.estimate.value == max(each.estimate.value for each in [found.best, *others])
    assert not found.winner
    assert any(note.startswith('No winner') for note in found.notes)
    assert found.document['certainty'] == found.certainty < 0.95


def test_certainty_of_the_best_is_that_of_their_posteriors():
    share = Objective((1,), ((1,),))
    rng = np.random.default_rng(1)
    same = np.array([50, 50])
    # Of k equal conditions, each is the best with a probability of 1 / k.
    for others in ([same], [same, same]):
        found = certainty_of_best(share, same, others, rng)
        expected = 1 / (1 + len(others))
        assert abs(found - expected) < 5 * np.sqrt(expected * (1 - expected) / 20_000)
    assert certainty_of_best(share, np.array([90, 10]), [same], rng) > 0.999
    assert certainty_of_best(share, np.array([10, 90]), [same], rng) < 0.001
