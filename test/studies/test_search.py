"""The search for an optimum: known functions, of which drops are drawn."""

import numpy as np
import pytest
from scipy.stats import binom

from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.optimise import best_points, final_drops, search
from resting_aspects_ros.studies.optimum import Objective, compared, estimated

SHARE = Objective((1,), ((1,),))


def hill(points):
    """A share with its maximum, 0.7, at 0.3 of the first factor; others have no effect."""
    return 0.3 + 0.4 * np.exp(-((points[:, 0] - 0.3) ** 2) / 0.1)


def peak(points):
    """A share with its maximum, 0.7, where all factors are 0.3."""
    return 0.3 + 0.4 * np.exp(-((points - 0.3) ** 2).sum(axis=1) / 0.1 / points.shape[1])


def slope(points):
    return 0.3 + 0.3 * points.mean(axis=1)


def problem(share, seed=0, above=0.0):
    """Return the drops of a problem whose shares are known; below ``above`` it is impossible."""

    def drop(points, drops, batch):
        rng = np.random.default_rng([seed, *batch.encode()])
        shares = share(points)
        found = rng.multinomial(drops, np.stack([shares, 1 - shares], axis=1))
        return found * (points[:, :1] >= above)

    return drop


def searched(drop, factors, total=200_000, seed=1, levels=0, **given):
    """Return the points of a search and the best ones."""
    ranges = [Factor(f'f{k}', 0.0, 1.0, levels) for k in range(factors)]
    points = search(drop, ranges, SHARE, total, seed, **given)
    return points, best_points(points, SHARE, total, seed)


@pytest.mark.parametrize('factors', [1, 4])
@pytest.mark.parametrize(('share', 'most', 'loss'), [(peak, 0.7, 0.02), (slope, 0.6, 0.03)])
def test_best_point_is_that_of_the_known_function(share, most, loss, factors):
    found = [searched(problem(share, k), factors, seed=k)[1][0] for k in range(4)]
    lost = [most - share(best[None])[0] for best in found]
    assert max(lost) < loss
    assert np.mean(lost) < loss / 2


def test_second_point_differs_by_a_fifth_of_a_range():
    points, (best, second) = searched(problem(hill), 2)
    assert np.abs(second - best).max() >= 0.2
    # The second factor has no effect, so that another value of it is as good.
    assert hill(second[None])[0] > 0.66
    # The search uses half of the budget.
    assert 90_000 < sum(counts.sum() for counts in points.values()) <= 100_000


def test_impossible_points_are_avoided():
    points, (best, *_) = searched(problem(hill, above=0.4), 1)
    assert min(points)[0] >= 0.4
    # The best possible point is at the edge of what is possible: hill(0.4) = 0.662.
    assert hill(best[None])[0] > 0.64


def test_levels_are_kept():
    points, best = searched(problem(hill), 1, levels=5)
    assert sorted(points) == [(0,), (0.25,), (0.5,), (0.75,), (1,)]
    assert [float(p[0]) for p in best] == [0.25, 0.5]
    # A bound without levels is a point as well.
    points, _ = searched(problem(slope), 1)
    assert points[1.0,].sum() >= final_drops(200_000)


def test_given_point_takes_part():
    given = np.array([[0.3, 0.123]])
    points, _ = searched(problem(hill), 2, 4000, given=given, stopped=lambda: True)
    assert points[0.3, 0.123].sum() > 0


def comparison(share, seed, points, drops, confidence=0.95):
    """Return the order of points by fresh drops, the gains of the first and its certainty."""
    rng = np.random.default_rng(seed)
    p = share(points)
    counts = rng.multinomial(drops, np.stack([p, 1 - p], axis=1))
    order = np.argsort(-counts[:, 0], kind='stable')
    draws = [SHARE.posterior(counts[k], rng, 2000) for k in order]
    return order, *compared(draws, confidence), [estimated(d, confidence) for d in draws]


def test_equally_good_conditions_have_a_winner_as_rarely_as_stated():
    """The threshold of OptimiseResult.winner, 1 - 0.05 / k, for three equal conditions."""
    runs, points = 150, np.full((3, 1), 0.5)
    won = sum(
        comparison(lambda u: np.full(len(u), 0.4), seed, points, 1000)[2] >= 1 - 0.05 / 3
        for seed in range(runs)
    )
    assert won <= binom.ppf(0.999, runs, 0.05)


@pytest.mark.slow
def test_stated_certainty_and_intervals_hold_over_repetitions():
    """Fresh drops are not biased (winner's curse), and intervals contain the truth."""
    runs, start = 25, np.array([0.5, 0.5])
    covered, claims, optimism, lucky = 0, [], [], []
    for seed in range(runs):
        known, best = searched(problem(hill, seed), 2, 24_000, seed)
        points = np.array([*best, start])
        truth = hill(points)
        drops = 24_000 // 6
        order, gains, certainty, values = comparison(hill, seed, points, drops, 0.9)
        covered += sum(
            gain.gain.lower <= truth[order[0]] - truth[other] <= gain.gain.upper
            for gain, other in zip(gains, order[1:], strict=True)
        )
        claims.append((certainty, truth[order[0]] == truth.max()))
        first = list(order).index(0)
        optimism.append(values[first].value - truth[0])
        counts = known[tuple(best[0].tolist())]
        lucky.append(counts[0] / counts.sum() - truth[0])
    assert covered >= binom.ppf(0.001, 2 * runs, 0.9)
    sure = [true for certainty, true in claims if certainty >= 1 - 0.05 / 3]
    assert sum(sure) >= binom.ppf(0.001, len(sure), 0.95)
    assert abs(np.mean(optimism)) < 4 * np.sqrt(0.25 / drops / runs)
    assert np.mean(lucky) > np.mean(optimism)


def test_certainty_of_the_best_is_that_of_their_posteriors():
    rng = np.random.default_rng(1)

    def draws(wanted):
        return SHARE.posterior(np.array([wanted, 100 - wanted]), rng, 20_000)

    # Of k equal conditions, each is the best with a probability of 1 / k.
    for k in (2, 3):
        gains, found = compared([draws(50) for _ in range(k)], 0.95)
        assert abs(found - 1 / k) < 5 * np.sqrt(0.25 / 20_000)
        assert [abs(each.certainty - 0.5) < 0.02 for each in gains] == [True] * (k - 1)
    assert compared([draws(90), draws(50)], 0.95)[1] > 0.999
    assert compared([draws(10), draws(50)], 0.95)[1] < 0.001
