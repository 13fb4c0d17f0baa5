"""Forecasts of parts per minute, and remarks on classes that a camera confuses."""

import json

import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.api.forecast import cycle_times, footprints_of, forecast, forecast_from
from resting_aspects_ros.api.forecast_result import look_alike_texts
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.steady_state import CycleTimes

# A small tray, which is full soon.
TRAY = Tray((0.1, 0.1), 0.005)
TIMES = CycleTimes(1.2, 0.6, 0.6, 0.2)


@pytest.fixture(scope='module')
def tossed(crate, workers):
    return ra.reorient(crate, 'toss', 40, drops=100, seed=3, workers=workers)


def test_footprints_are_the_sides_of_the_part_or_a_disc(crate, solid):
    aspects = find_aspects(crate)
    found = footprints_of(crate, aspects)
    sides = [(each.length, each.width, each.radius) for each in found]
    expected = [(0.03, 0.02, 0), (0.03, 0.01, 0), (0.02, 0.01, 0)]
    assert sides == [pytest.approx(each) for each in expected]
    disc = solid(trimesh.creation.cylinder(10, 8))
    aspects = find_aspects(disc)
    flat = footprints_of(disc, aspects)[0]
    assert (flat.length, flat.width) == (0, 0)
    assert flat.radius == pytest.approx(0.01, rel=0.02)


@pytest.mark.slow
def test_known_reorientation_is_not_simulated_again(crate, tossed, workers):
    options = {'robot': 2.0, 'parts_on_tray': 3, 'tray': (0.1, 0.1)}
    known = forecast(tossed, pickable_classes=[1], **options)
    simulated = {'action': 'toss', 'per_aspect': 40, 'drops': 100, 'seed': 3, 'workers': workers}
    made = forecast(crate, pickable_classes=[1], **simulated, **options)
    assert known.parts_per_minute == made.parts_per_minute
    assert known.reorientation is tossed
    # The aspects of a class look the same.
    with pytest.warns(ra.RestingAspectsWarning, match='aspects 1 and 2 look the same'):
        one = forecast(tossed, [1], **options)
    assert one.parts_per_minute == known.parts_per_minute
    with pytest.raises(ra.InvalidValueError, match='with the result of reorient'):
        forecast(tossed, [1], seed=4)


@pytest.mark.slow
def test_document_has_the_numbers_of_the_result(tossed):
    result = forecast_from(tossed, [1, 2], TRAY, TIMES, minutes=30)
    document = json.loads(result.to_json([result]))
    found = result.named.forecast
    assert (document['parts_per_minute'], document['lower']) == (found.rate, found.lower)
    assert document['prediction_upper'] == found.prediction[1]
    assert document['best_number'] == document['parts_on_tray'] == result.best_number
    assert sum(document['time_shares'].values()) == pytest.approx(1)
    robot = document['sensitivity']['robot']
    assert robot['shorter'] > 0 > robot['longer']
    assert [row['aspects'] for row in document['mix']] == [[1, 2], [3, 4], [5, 6]]
    assert [row['on_tray'] for row in document['mix']] == found.state.mix.tolist()


@pytest.mark.slow
def test_action_that_never_reaches_a_pickable_aspect_is_said(crate, workers):
    still = ra.reorient(crate, ra.Kick(), 20, drops=60, seed=1, workers=workers)
    result = forecast_from(still, [1, 2], TRAY, TIMES)
    assert result.parts_per_minute == 0
    assert result.sentence.startswith('no part can be picked: in the long run all parts are in')
    document = json.loads(result.to_json())
    assert document['best_number'] is document['flips_per_part'] is None
    assert document['upper'] > 0


def test_times_of_the_action_are_used_by_default():
    given = {'robot': 1.0, 'image': 0.2, 'supply': 0.0, 'place': None}
    unknown = {'vibrate': None, 'settle': None}
    times = cycle_times(named_action('flip'), **given, **unknown, overlap=False)
    assert (times.vibrate, times.settle) == pytest.approx((0.6, 0.6))
    times = cycle_times(named_action('toss'), **given, **unknown, overlap=True)
    assert (times.vibrate, times.settle, times.place) == pytest.approx((1.0, 0.0, 0.5))


@pytest.mark.parametrize(
    'wrong',
    [
        {'pickable': [9]},
        {'pickable': [1], 'pickable_classes': [1]},
        {'pickable': [1], 'robot': 0},
        {'pickable': [1], 'place': 0.5},
        {'pickable': [1], 'tray': (0.02, 0.02)},
        {'pickable': [1], 'parts_on_tray': 500},
    ],
)
def test_wrong_values_are_refused(crate, workers, wrong):
    with pytest.raises(ra.InvalidValueError, match='expected'):
        forecast(crate, per_aspect=1, drops=5, workers=workers, **wrong)


@pytest.mark.slow
def test_pickable_classes_that_look_like_others_are_one_sentence(solid):
    # A cube with a blind hole in a side that is in no symmetric place: all sides look the same.
    place = trimesh.transformations.translation_matrix((3, 1, 8))
    hole = trimesh.creation.cylinder(2, 8, transform=place)
    part = solid(trimesh.creation.box((20, 20, 20)).difference(hole))
    aspects = find_aspects(part)
    (text,) = look_alike_texts(part, aspects, [1, 2])
    assert 'of classes 1 to 6, of which only 1 and 2 can be picked' in text
    assert look_alike_texts(part, aspects, [1, 2, 3, 4, 5, 6]) == []
