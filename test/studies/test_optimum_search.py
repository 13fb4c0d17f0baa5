"""The search for an optimum: known functions, of which drops are drawn."""

import numpy as np
import pytest
from scipy.stats import binom

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.studies.objectives import Objective
from resting_aspects_ros.studies.optimum_comparison import advantage, posterior_values
from resting_aspects_ros.studies.optimum_facts import factor_facts
from resting_aspects_ros.studies.optimum_problem import Amounts
from resting_aspects_ros.studies.optimum_search import OptimumSearch

SHARE = Objective((1,), ((1,),))
AMOUNTS = Amounts(12, 400, 12_000)


def hill(points):
    """A share with its maximum, 0.7, at 0.3 of the first factor; the second has no effect."""
    return 0.3 + 0.4 * np.exp(-((points[:, 0] - 0.3) ** 2) / 0.1)


def slope(points):
    return 0.3 + 0.3 * points[:, 0]


class Known:
    """A problem whose shares are known."""

    def __init__(self, share, dimensions, seed=0, *, above=0.0, levels=0):
        self.share, self.dimensions, self.seed, self.tolerance = share, dimensions, seed, 0.01
        self.above, self.levels = above, levels

    def impossible(self, point):
        return '' if point[0] >= self.above else f'{point[0]} is too small'

    def snapped(self, points):
        return np.round(points * self.levels) / self.levels if self.levels else points

    def counts(self, points, drops, batch):
        rng = np.random.default_rng([self.seed, *batch.encode()])
        share = self.share(points)
        return rng.multinomial(drops, np.stack([share, 1 - share], axis=1))

    def scores(self, shares):
        return SHARE.scores(shares)


def searched(problem, amounts=AMOUNTS, seed=1):
    search = OptimumSearch(problem, amounts, seed)
    search.run()
    return search


@pytest.fixture(scope='module')
def found():
    search = searched(Known(hill, 2))
    best = search.best()
    return search, best, factor_facts(search, best)


def test_best_point_is_that_of_the_known_function(found):
    search, best, _ = found
    # A share of about 9000 drops has a standard error of 0.005; the loss is at most twice that.
    assert hill(best[None])[0] > 0.69
    assert AMOUNTS.points * AMOUNTS.drops < search.drops <= AMOUNTS.search


def test_rival_differs_by_a_fifth_of_a_range(found):
    search, best, _ = found
    rival = search.rival(best)
    assert np.abs(rival - best).max() >= 0.2
    # The second factor has no effect, so that a rival is as good.
    assert hill(rival[None])[0] > 0.66


def test_flat_range_is_that_of_the_known_function(found):
    _, best, facts = found
    u = np.linspace(0, 1, 101)
    line = np.column_stack([u, np.full(101, best[1])])
    good = u[hill(line) >= hill(best[None])[0] - 0.01]
    # The gain at the ends of the range is 1 point, and that of the surrogate is known to 1 point.
    assert facts[0].flat == pytest.approx((good.min(), good.max()), abs=0.08)
    assert facts[0].flat[0] <= best[0] <= facts[0].flat[1]
    assert facts[1].flat == (0.0, 1.0)


def test_factor_without_effect_is_recognised(found):
    _, best, facts = found
    assert facts[0].matters
    assert 0.3 < facts[0].effect < 0.5
    assert facts[0].effect_upper > 0.4
    assert not facts[0].at_bound
    assert not facts[1].matters
    assert facts[1].effect < facts[0].effect
    assert 0.15 < best[0] < 0.45


@pytest.mark.slow
def test_same_seed_gives_the_same_search():
    one, other = (searched(Known(hill, 1), Amounts(6, 100, 1500)) for _ in range(2))
    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.counts, other.counts)
    assert np.array_equal(one.best(), other.best())
    assert max(one.rounds) > 1


def test_optimum_at_a_bound_is_found_exactly():
    search = searched(Known(slope, 1), Amounts(8, 400, 9600))
    best = search.best()
    (facts,) = factor_facts(search, best)
    assert best[0] == 1.0
    assert facts.bound == 1
    assert facts.at_bound


def test_impossible_points_are_skipped_and_avoided():
    search = searched(Known(hill, 1, above=0.4), Amounts(8, 400, 9600))
    best = search.best()
    assert search.skipped
    assert 'too small' in search.skipped[0][1]
    assert all(point[0] >= 0.4 for point in search.points)
    # The best possible point is at the edge of what is possible: hill(0.4) = 0.662.
    assert hill(best[None])[0] > 0.64
    assert len(search.skipped) < 40


def test_nearly_no_possible_points_are_an_error():
    with pytest.raises(InvalidValueError, match=r'at least 2 possible points, .* is too small'):
        searched(Known(hill, 1, above=2.0))


def test_levels_are_kept():
    search = searched(Known(hill, 1, levels=4), Amounts(8, 400, 9600))
    assert {float(p[0]) for p in search.points} <= {0, 0.25, 0.5, 0.75, 1}
    assert search.best().tolist() == [0.25]
    assert search.rival(np.array([0.25])).tolist() == [0.5]


def test_search_that_is_stopped_keeps_what_is_known():
    search = OptimumSearch(Known(hill, 1), AMOUNTS, 1)
    search.run(lambda: search.drops >= AMOUNTS.points * AMOUNTS.drops)
    assert search.drops == AMOUNTS.points * AMOUNTS.drops
    assert 0.1 < search.best()[0] < 0.5


@pytest.mark.parametrize(
    ('amounts', 'message'),
    [((1, 100, 1000), 'at least 2 of each'), ((10, 100, 1200), 'at least 1300 drops')],
)
def test_too_few_drops_are_refused(amounts, message):
    with pytest.raises(InvalidValueError, match=message):
        Amounts(*amounts)


def test_a_quarter_of_the_budget_is_for_the_comparison():
    amounts = Amounts(48, 1000, 96_000)
    assert amounts.search == 72_000
    assert amounts.compared == 8000


@pytest.mark.slow
def test_stated_certainty_and_intervals_hold_over_repetitions():
    runs, start = 40, np.array([0.5, 0.5])
    covered, claims, optimism = np.zeros(3), [], []
    for seed in range(runs):
        problem = Known(hill, 2, seed)
        search = searched(problem, AMOUNTS, seed)
        best = search.best()
        points = np.array([best, search.rival(best), start])
        counts = problem.counts(points, AMOUNTS.compared, 'comparison')
        truth, rng = hill(points), np.random.default_rng(seed)
        value = posterior_values(SHARE, counts[0], rng, 0.9)
        gains = [advantage(SHARE, counts[0], counts[k], rng, 0.9) for k in (1, 2)]
        covered += [
            value.lower <= truth[0] <= value.upper,
            *(
                a.gain.lower <= truth[0] - t <= a.gain.upper
                for a, t in zip(gains, truth[1:], strict=True)
            ),
        ]
        claims += [(a.certainty, truth[0] > t) for a, t in zip(gains, truth[1:], strict=True)]
        optimism.append(value.value - truth[0])
    low, high = binom.ppf([0.001, 0.999], runs, 0.9)
    assert ((low <= covered) & (covered <= high)).all()
    sure = [true for certainty, true in claims if certainty >= 0.95]
    assert len(sure) >= runs / 2
    assert sum(sure) >= binom.ppf(0.001, len(sure), 0.95)
    # Fresh drops are not biased: there is no winner's curse.
    error = np.sqrt(0.25 / AMOUNTS.compared / runs)
    assert abs(np.mean(optimism)) < 4 * error
