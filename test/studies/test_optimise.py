"""The best conditions of parts: mechanics, reproducibility, and what the result says."""

import dataclasses
import json
import math

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import Plane
from resting_aspects_ros.studies.design import Setting

RANGES = {'height': '10mm:30mm', 'friction': (0.1, 0.4)}
FEW = {'budget': 3840}
HEIGHT, LEAST = {'height': '10mm:30mm'}, {'budget': 2000}


@pytest.fixture(scope='module')
def found(here):
    return ra.optimise('tetrahedron', RANGES, wanted=[1, 2], workers=here(lookahead=1), **FEW)


def test_document_has_the_counts_of_all_drops(found, tmp_path):
    found.save_json(tmp_path / 'o.json')
    document = json.loads((tmp_path / 'o.json').read_text())
    points = sum(sum(p['counts']) for p in document['points'])
    compared = sum(document[name]['drops'] for name in ('best', 'second', 'start'))
    # The best conditions are in the curves of both factors, whose other points are fresh ones.
    curves = sum(len(f['curve']['at']) - 1 for f in document['factors'])
    each = 3840 // 4 // (9 * 2)
    assert points + compared + curves * each == document['drops'] <= 3840
    assert document['complete']
    assert document['wanted'] == [1, 2]
    assert document['start']['values'] == {'height': 0.06, 'friction': 0.25}
    assert document['best']['conditions']['height'] == document['best']['values']['height']
    assert document['notes'] == found.notes
    assert document['certainty'] == found.certainty
    # Conditions outside the ranges are compared, and are not the best.
    assert found.start.point is None
    assert found.candidates[-1] is found.start
    assert found.over(found.start) is found.gains[-1]
    found.save_csv(tmp_path / 'p.csv')
    header, *rows = (tmp_path / 'p.csv').read_text().splitlines()
    assert (header, len(rows)) == ('height,friction,1+2,other', len(found.points))


@pytest.mark.slow
def test_best_has_the_best_value_of_the_compared_conditions(here):
    # No conditions are better than others for a tetrahedron, so that the fresh drops decide.
    found = ra.optimise('tetrahedron', HEIGHT, wanted=[1], height=0.02, workers=here(), **LEAST)
    values = [each.estimate.value for each in found.candidates]
    assert values == sorted(values, reverse=True)
    assert found.start in found.candidates
    assert not found.winner
    assert any(note.startswith('No winner') for note in found.notes)


@pytest.mark.slow
def test_search_that_is_stopped_shows_what_is_known(here):
    def stopped_after(number):
        asked = iter(range(number))
        return ra.optimise(
            'tetrahedron',
            HEIGHT,
            wanted=[1],
            workers=here(lookahead=1),
            stopped=lambda: next(asked, None) is None,
            **LEAST,
        )

    found = stopped_after(150)
    assert not found.complete
    assert np.isnan(found.certainty)
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
    [('wall', 'tap', 'kernel'), ('pocket', None, 'bullet'), (None, 'step_down', 'bullet')],
)
def test_document_names_the_engine_and_has_model_ranges_of_drops_on_a_plane(
    found, surroundings, action, engine
):
    setting = Setting(
        found.best.setting.conditions,
        None if surroundings is None else ra.surroundings(surroundings),
        None if action is None else named_action(action),
    )
    best = dataclasses.replace(found.best, setting=setting)
    result = dataclasses.replace(found, candidates=(best, *found.candidates[1:]))
    document = json.loads(result.to_json())
    assert document['engine'] == engine
    assert document['best']['model_lower'] is None
    best = json.loads(found.to_json())['best']
    value = best['value']
    assert best['model_lower'] < value['lower'] <= value['upper'] < best['model_upper']


@pytest.mark.slow
def test_impossible_start_is_not_compared(here):
    found = ra.optimise(
        'tetrahedron', {'height': (0.02, 0.04)}, wanted=[1], height=0.01,
        height_of=1, workers=here(lookahead=1), **FEW,
    )  # fmt: skip
    assert found.start is None
    assert found.complete
    assert any('Your conditions are impossible' in note for note in found.notes)


@pytest.mark.parametrize(
    ('vary', 'given', 'message'),
    [
        ({}, {'wanted': [1]}, 'expected at least one'),
        ({'height': '1mm:2mm'}, {}, 'expected one of wanted aspects'),
        ({'action.speed': '0.1:1'}, {'wanted': [1]}, 'expected an action'),
        ({'height': (1, 2, 3)}, {'wanted': [1]}, 'invalid range'),
        ({'height': '1mm:2mm'}, {'wanted': [1], 'budget': 10}, 'invalid budget 10'),
        ({'height': '1mm:2mm'}, {'wanted': [1], 'confidence': 2}, 'invalid confidence'),
        ({'height': '5mm:60'}, {'wanted': [1]}, 'invalid height 60 m'),
    ],
)
def test_invalid_input_is_named(vary, given, message, here):
    with pytest.raises(ra.InvalidValueError, match=message):
        ra.optimise('tetrahedron', vary, workers=here(lookahead=1), **given)


@pytest.mark.slow
def test_parts_stay_on_a_slope_below_the_friction_angle(here):
    friction = 0.4
    found = ra.optimise(
        'box_10x20x30', {'surroundings.angle': '5deg:40deg'}, wanted_classes=[1, 2, 3],
        surroundings='slope', friction=friction, height=0.005, workers=here(lookahead=1),
        budget=4000,
    )  # fmt: skip
    assert found.best.values['surroundings.angle'] < math.atan(friction)
    assert found.best.estimate.value > 0.9
    # Above the friction angle no part stays.
    steep = [c for v, c in found.points if v['surroundings.angle'] > math.atan(friction)]
    assert steep
    assert sum(int(counts[0]) for counts in steep) == 0
    assert found.curves[0].matters
    assert 5 + 35 * found.curves[0].flat[1] < math.degrees(math.atan(friction)) + 1


def upright(part):
    """Return a level plane above which parts are released upright, in their highest aspect."""
    highest = ra.find_aspects(part).aspects[-1]
    return Surroundings(Plane(), orientation=tuple(highest.orientation))


@pytest.mark.slow
def test_gentler_taps_keep_more_parts_in_their_aspect(here):
    part = ra.load_part('box_10x20x30')
    found = ra.optimise(
        part, {'action.speed': '0.05:1'}, wanted_classes=[3], surroundings=upright(part),
        height=0.001, action='tap', workers=here(lookahead=1), budget=4000,
    )  # fmt: skip
    assert found.best.values['action.speed'] < 0.3
    assert found.curves[0].matters
    assert 'after one tap on parts that were dropped' in found.aim


@pytest.mark.slow
def test_minimise_entropy_is_where_all_parts_stay_as_released(here):
    part = ra.load_part('box_10x20x30')
    found = ra.optimise(
        part, {'height': '1mm:100mm'}, minimise_entropy=True, surroundings=upright(part), spin=2.0,
        workers=here(lookahead=1), budget=4000,
    )  # fmt: skip
    assert found.best.values['height'] < 0.03
    assert found.best.estimate.value < found.start.estimate.value
    assert np.isfinite(found.best.estimate.upper)
