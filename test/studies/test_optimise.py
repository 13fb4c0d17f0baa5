"""The best conditions: formulas, known functions with drawn drops, and mechanics."""

import dataclasses
import json
import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import Plane
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.optimise import best_points, final_drops, search
from resting_aspects_ros.studies.optimum import Objective, compared, estimated, make_objective

SHARE, SEVERAL = Objective((1,), ((1,),)), Objective((1, 3), ((1, 3),))
ENTROPY = Objective((), ((1,), (2, 3)))


def test_values_are_those_of_the_formulas():
    counts = np.array([5, 7, 11, 1, 0, 2, 0, 0])
    assert SEVERAL.columns(counts).tolist() == [16, 10]
    assert ENTROPY.columns(counts).tolist() == [5, 18, 3]
    shares = np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0], [0.2, 0.8, 0.0]])
    expected = [np.log(2), 0, -0.2 * np.log(0.2) - 0.8 * np.log(0.8)]
    assert ENTROPY.values(shares) == pytest.approx(expected)
    # Parts that are in no aspect do not lower the entropy.
    lost = np.linspace(0, 1, 11)
    values = ENTROPY.values(np.column_stack([0.1 * (1 - lost), 0.9 * (1 - lost), lost]))
    assert (np.diff(values) > 0).all()
    assert values[-1] == pytest.approx(np.log(2))


def test_posterior_corrects_the_bias_of_the_entropy():
    rng = np.random.default_rng(0)
    shares, drops = np.array([0.4, 0.3, 0.2, 0.1, 0.0]), 100
    objective = Objective((), ((1,), (2,), (3,), (4,)))
    truth = float(objective.values(shares))
    tables = rng.multinomial(drops, shares, 400)
    plain = objective.values(tables / drops)
    posterior = np.array([objective.posterior(row, rng, 100).mean() for row in tables])
    error = plain.std() / np.sqrt(len(tables))
    # Miller (1955): -sum p ln p of shares is too small by (k - 1) / 2 n.
    assert plain.mean() - truth == pytest.approx(-3 / (2 * drops), abs=3 * error)
    assert abs(posterior.mean() - truth) < 3 / (4 * drops) + 3 * error


@pytest.mark.parametrize('objective', [SEVERAL, ENTROPY])
def test_intervals_of_fresh_drops_cover_the_truth(objective):
    rng = np.random.default_rng(1)
    runs, drops = 150, 400
    one, other = (np.array([[0.55, 0.45], [0.5, 0.5]]) if objective is SEVERAL else
                  np.array([[0.2, 0.75, 0.05], [0.3, 0.68, 0.02]]))  # fmt: skip
    values = objective.values(np.array([one, other]))
    difference = values[0] - values[1]
    covered = np.zeros(2)
    for _ in range(runs):
        counts = rng.multinomial(drops, one), rng.multinomial(drops, other)
        draws = [objective.posterior(each, rng, 1000) for each in counts]
        value = estimated(draws[0], 0.9)
        ((found,), _) = compared(draws, 0.9)
        covered += [
            value.lower <= values[0] <= value.upper,
            found.gain.lower <= difference <= found.gain.upper,
        ]
    low, high = binom.ppf([0.001, 0.999], runs, 0.9)
    assert ((low <= covered) & (covered <= high)).all()


@pytest.mark.parametrize(
    ('part', 'wanted', 'message'),
    [
        ('box_10x20x30', {'wanted': [1], 'minimise_entropy': True}, 'expected one of wanted'),
        ('box_10x20x30', {'wanted': []}, 'expected at least one'),
        ('box_10x20x30', {'wanted_classes': [4]}, 'invalid wanted symmetry class 4: expected 1'),
        ('tetrahedron', {'minimise_entropy': True}, 'several symmetry classes'),
    ],
)
def test_invalid_objectives_are_named(part, wanted, message):
    with pytest.raises(ra.InvalidValueError, match=message):
        make_objective(ra.find_aspects(ra.load_part(part)), **wanted)


counts = st.lists(st.sampled_from([0, 0, 1, 5, 10_000]), min_size=3, max_size=3)


@given(counts, counts, st.sampled_from([SEVERAL, ENTROPY]), st.sampled_from([0.51, 0.8, 0.9999]))
def test_credible_intervals_of_an_objective_contain_the_mean(one, other, objective, confidence):
    rng = np.random.default_rng(1)
    draws = [objective.posterior(np.array(each), rng, 1000) for each in (one, other)]
    ((found,), certainty) = compared(draws, confidence)
    for each in (estimated(draws[0], confidence), found.gain):
        assert each.lower <= each.value <= each.upper
    assert 0 <= certainty <= 1


def peak(points):
    """A share with its maximum, 0.7, where all factors are 0.3."""
    return 0.3 + 0.4 * np.exp(-((points - 0.3) ** 2).sum(axis=1) / 0.1 / points.shape[1])


def hill(points):
    """The same of the first factor; others have no effect."""
    return peak(points[:, :1])


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


def searched(drop, factors, seed=1, levels=None, total=200_000):
    """Return the points of a search and the best ones."""
    ranges = [Factor(f'f{k}', 0.0, 1.0, levels) for k in range(factors)]
    points = search(drop, ranges, SHARE, total, seed)
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


def test_equally_good_conditions_have_a_winner_as_rarely_as_stated():
    """The threshold of OptimiseResult.winner, 1 - 0.05 / k, for three equal conditions."""
    runs, won = 150, 0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        counts = rng.multinomial(1000, [0.4, 0.6], 3)
        order = np.argsort(-counts[:, 0], kind='stable')
        draws = [SHARE.posterior(counts[k], rng, 2000) for k in order]
        won += compared(draws, 0.95)[1] >= 1 - 0.05 / 3
    assert won <= binom.ppf(0.999, runs, 0.05)


@pytest.mark.slow
def test_stated_certainty_and_intervals_hold_over_repetitions():
    """Fresh drops are not biased (winner's curse), and intervals contain the truth."""
    runs, drops, covered, sure, optimism, lucky = 25, 4000, 0, [], [], []
    for seed in range(runs):
        known, best = searched(problem(hill, seed), 2, seed, total=6 * drops)
        truth = hill(points := np.array([*best, [0.5, 0.5]]))
        fresh = problem(hill, seed)(points, drops, 'fresh')
        order, rng = np.argsort(-fresh[:, 0], kind='stable'), np.random.default_rng(seed)
        gains, certainty = compared([SHARE.posterior(fresh[k], rng, 2000) for k in order], 0.9)
        differences = truth[order[0]] - truth[order[1:]]
        for gain, difference in zip(gains, differences, strict=True):
            covered += gain.gain.lower <= difference <= gain.gain.upper
        if certainty >= 1 - 0.05 / 3:
            sure.append(truth[order[0]] == truth.max())
        counts = known[tuple(best[0].tolist())]
        optimism.append(fresh[0, 0] / drops - truth[0])
        lucky.append(counts[0] / counts.sum() - truth[0])
    assert covered >= binom.ppf(0.001, 2 * runs, 0.9)
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


RANGES = {'height': '10mm:30mm', 'friction': (0.1, 0.4)}
FEW = {'budget': 3840}


@pytest.fixture(scope='session')
def optimise(here):
    """The function, with workers in this process."""
    return partial(ra.optimise, workers=here(lookahead=1))


@pytest.fixture(scope='module')
def found(optimise):
    return optimise('tetrahedron', RANGES, wanted=[1, 2], **FEW)


def test_document_has_the_counts_of_all_drops(found, tmp_path):
    found.save_json(tmp_path / 'o.json')
    document = json.loads((tmp_path / 'o.json').read_text())
    points = sum(sum(p['counts']) for p in document['points'])
    compared = sum(document[name]['drops'] for name in ('best', 'second', 'start'))
    assert points + compared == document['drops'] <= 3840
    assert document['complete']
    assert document['start']['values'] == {'height': 0.06, 'friction': 0.25}
    assert document['best']['conditions']['height'] == document['best']['values']['height']
    # Conditions outside the ranges are compared, and are not the best.
    assert found.start.point is None
    assert found.candidates[-1] is found.start
    found.save_csv(tmp_path / 'p.csv')
    header, *rows = (tmp_path / 'p.csv').read_text().splitlines()
    assert (header, len(rows)) == ('height,friction,1+2,other', len(found.points))


@pytest.mark.slow
def test_search_that_is_stopped_shows_what_is_known(optimise):
    def stopped_after(number):
        asked = iter(range(number))
        given = {'wanted': [1], 'budget': 2000, 'stopped': lambda: next(asked, None) is None}
        return optimise('tetrahedron', {'height': '10mm:30mm'}, **given)

    found = stopped_after(150)
    assert not found.complete
    assert not found.winner
    assert 'probably too good' in found.notes[-1]
    assert found.document()['certainty'] is None
    with pytest.raises(ra.RestingAspectsError, match='too few points'):
        stopped_after(0)


@pytest.mark.slow
def test_result_does_not_depend_on_the_workers(found, here):
    again = ra.optimise('tetrahedron', RANGES, wanted=[1, 2], workers=here(lookahead=5), **FEW)
    assert again.to_json() == found.to_json()


@pytest.mark.parametrize(
    ('surroundings', 'action', 'engine'),
    [(ra.surroundings('wall'), 'tap', 'kernel'), (None, 'step_down', 'bullet')],
)
def test_document_names_the_engine_and_has_model_ranges_of_drops_on_a_plane(
    found, surroundings, action, engine
):
    setting = Setting(found.best.setting.conditions, surroundings, named_action(action))
    best = dataclasses.replace(found.best, setting=setting)
    result = dataclasses.replace(found, candidates=(best, *found.candidates[1:]))
    document = json.loads(result.to_json())
    assert document['engine'] == engine
    assert document['best']['model_lower'] is None
    best = json.loads(found.to_json())['best']
    value = best['value']
    assert best['model_lower'] < value['lower'] <= value['upper'] < best['model_upper']


@pytest.mark.slow
def test_impossible_start_is_not_compared(optimise):
    low = {'height': 0.01, 'height_of': 1}
    found = optimise('tetrahedron', {'height': (0.02, 0.04)}, wanted=[1], **low, **FEW)
    assert found.start is None
    assert found.complete
    assert any('Your conditions are impossible' in note for note in found.notes)
    # No conditions are better than others for a tetrahedron, so that the fresh drops decide.
    values = [each.estimate.value for each in found.candidates]
    assert values == sorted(values, reverse=True)
    assert any(note.startswith('No winner') for note in found.notes)


@pytest.mark.parametrize(
    ('vary', 'given', 'message'),
    [
        ({}, {'wanted': [1]}, 'expected at least one'),
        ({'action.speed': '0.1:1'}, {'wanted': [1]}, 'expected an action'),
        ({'height': (1, 2, 3)}, {'wanted': [1]}, 'invalid range'),
        ({'height': '1mm:2mm'}, {'wanted': [1], 'budget': 10}, 'invalid budget 10'),
        ({'height': '5mm:60'}, {'wanted': [1]}, 'invalid height 60 m'),
    ],
)
def test_invalid_input_is_named(vary, given, message, optimise):
    with pytest.raises(ra.InvalidValueError, match=message):
        optimise('tetrahedron', vary, **given)


@pytest.mark.slow
def test_parts_stay_on_a_slope_below_the_friction_angle(optimise):
    friction = 0.4
    found = optimise(
        'box_10x20x30', {'surroundings.angle': '5deg:40deg'}, wanted_classes=[1, 2, 3],
        surroundings='slope', friction=friction, height=0.005, **FEW,
    )  # fmt: skip
    assert found.best.values['surroundings.angle'] < math.atan(friction)
    assert found.best.estimate.value > 0.9
    # Above the friction angle no part stays.
    steep = [c for v, c in found.points if v['surroundings.angle'] > math.atan(friction)]
    assert steep
    assert sum(int(counts[0]) for counts in steep) == 0


@pytest.fixture(scope='module')
def released_upright():
    """A box that is released upright, in its highest aspect, above a level plane."""
    part = ra.load_part('box_10x20x30')
    highest = ra.find_aspects(part).aspects[-1]
    surroundings = Surroundings(Plane(), orientation=tuple(highest.orientation))
    return {'part': part, 'surroundings': surroundings, **FEW}


@pytest.mark.slow
def test_gentler_taps_keep_more_parts_in_their_aspect(optimise, released_upright):
    found = optimise(
        vary={'action.speed': '0.05:1'}, wanted_classes=[3], height=0.001, action='tap',
        **released_upright,
    )  # fmt: skip
    assert found.best.values['action.speed'] < 0.3
    assert 'after one tap on parts that were dropped' in found.aim


@pytest.mark.slow
def test_minimise_entropy_is_where_all_parts_stay_as_released(optimise, released_upright):
    vary = {'height': '1mm:100mm'}
    found = optimise(vary=vary, minimise_entropy=True, spin=2.0, **released_upright)
    assert found.best.values['height'] < 0.03
    assert found.best.estimate.value < found.start.estimate.value
    assert np.isfinite(found.best.estimate.upper)
