"""The best conditions of parts: mechanics, reproducibility, and what the result says."""

import dataclasses
import json
import math
from functools import partial

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import Plane
from resting_aspects_ros.studies.design import Setting

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
    assert document['wanted'] == [1, 2]
    assert document['start']['values'] == {'height': 0.06, 'friction': 0.25}
    assert document['best']['conditions']['height'] == document['best']['values']['height']
    assert document['notes'] == found.notes
    assert document['certainty'] == found.certainty
    # Conditions outside the ranges are compared, and are not the best.
    assert found.start.point is None
    assert found.candidates[-1] is found.start
    assert found.start.behind is not None
    assert found.best.behind is None
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
        ({'height': '1mm:2mm'}, {}, 'expected one of wanted aspects'),
        ({'action.speed': '0.1:1'}, {'wanted': [1]}, 'expected an action'),
        ({'height': (1, 2, 3)}, {'wanted': [1]}, 'invalid range'),
        ({'height': '1mm:2mm'}, {'wanted': [1], 'budget': 10}, 'invalid budget 10'),
        ({'height': '1mm:2mm'}, {'wanted': [1], 'confidence': 2}, 'invalid confidence'),
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
