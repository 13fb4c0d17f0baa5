"""Golden results of the entry points of the Python interface.

Each file of test/golden has the counts of an entry point, which are compared exactly, and other
numbers, such as the first three poses, which are compared to 1e-6. After a change that is meant to
change them, ``UPDATE_GOLDEN=1 python -m pytest test/test_golden.py`` writes the files again; the
commit says why.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.statistics.distribution import OUTSIDE

GOLDEN = Path(__file__).with_name('golden')
TOLERANCE = 1e-6
FIRST_POSES = 3


def distribution(found):
    return {'aspects': found.counts.tolist()} | {name: getattr(found, name) for name in OUTSIDE}


def dropped(*words, **options):
    result = ra.drop(*words, seed=3, **options)
    poses = np.hstack([result.poses.position, result.poses.orientation])
    return distribution(result.distribution), {'poses': poses[:FIRST_POSES].tolist()}, result


def drop_on_the_plane():
    return dropped('l_bracket', 200, check_convergence=True)[:2]


def drop_in_a_slope():
    slope = ra.surroundings('slope', angle='12deg')
    return dropped('tetrahedron', 200, surroundings=slope)[:2]


def drop_in_a_chute():
    counts, values, result = dropped('l_bracket', 100, surroundings='l_chute')
    counts['placements'] = [each.count for each in result.contacts.placements]
    return counts, values


def drop_from_given_states():
    states = ra.GivenStates(
        position=[[0, 0, 0.06], [0, 0, 0.08]],
        orientation=[[0, 0, 0, 1], [0.5, 0.5, 0.1, 0.7]],
        spin=[[1, 2, 3], [0, 0, 0]],
    )
    noise = ra.Noise(orientation=0.2)
    counts, values, result = dropped('t_prism', initial_states=states, replicates=50, noise=noise)
    return {**counts, 'by_state': result.by_state.counts.tolist()}, values


def drop_until_precise():
    return dropped('tetrahedron', precision=0.1)[:2]


def drop_with_bullet():
    return dropped('tetrahedron', 30, engine='bullet', workers=1)[:2]


def reoriented(part, action, per_aspect, **options):
    result = ra.reorient(part, action, per_aspect, drops=50, seed=3, **options)
    counts = {
        'matrix': result.matrix.counts.tolist(),
        'sliding': result.matrix.sliding,
        'drop': distribution(result.drop),
    }
    shares = None if result.long_run is None else result.long_run.shares.tolist()
    return counts, {'long_run': shares}


def reorient_tap():
    return reoriented('l_bracket', 'tap', 30, check_convergence=True)


def reorient_toss():
    return reoriented('tetrahedron', 'toss', 30)


def reorient_bowl():
    return reoriented('l_bracket', 'bowl', 10)


def reorient_in_a_groove():
    return reoriented('l_bracket', 'tap', 20, surroundings='v_groove')


def retention():
    curves = ra.retention('l_bracket', 10, seed=3).curves
    values = {'lift': [curve.lift.tolist() for curve in curves]}
    return {'left': [curve.left.tolist() for curve in curves]}, values


def forecast():
    result = ra.forecast('l_bracket', pickable_classes=[1], per_aspect=20, drops=50, seed=3)
    counts = {
        'matrix': result.reorientation.matrix.counts.tolist(),
        'drop': distribution(result.reorientation.drop),
    }
    return counts, {'parts_per_minute': result.parts_per_minute}


def study():
    result = ra.study('t_prism', {'restitution': '0.2:0.6:3'}, drops=50, seed=3)
    return {'classes': [case.classes.tolist() for case in result.cases]}, {}


def optimise():
    result = ra.optimise('l_bracket', {'height': '20mm:200mm'}, wanted=[1], budget=2000, seed=3)
    counts = {'drops': result.drops, 'points': [row.tolist() for _, row in result.points]}
    return counts, {'certainty': result.certainty}


def batch():
    result = ra.drop_batch(['tetrahedron', 't_prism'], 50, seed=3)
    return {each.source: distribution(each.result.distribution) for each in result.entries}, {}


def classify():
    result = ra.classify(ra.drop('l_bracket', 100, seed=4).poses, 'l_bracket')
    found = result.by_part.distribution
    return {'clusters': result.clusters.counts.tolist(), **distribution(found)}, {}


def identify():
    seen = ra.outlines('l_bracket').outlines[0].polygon
    found = ra.identify_part(seen, 'l_bracket')
    classes = [each.symmetry_class for each in found.candidates]
    values = {
        'posterior': [each.posterior for each in found.candidates],
        'place': [[each.x, each.y] for each in found.candidates],
    }
    return {'answer': found.answer, 'classes': classes}, values


def estimate():
    found = ra.estimate('l_bracket').estimates
    values = {name: each.probabilities.tolist() for name, each in found.items()}
    return {'methods': sorted(found)}, values


def track():
    traps = [{'kind': 'wiper', 'height': '22.25mm'}, {'kind': 'balcony', 'width': '12mm'}]
    on = {'width': '55mm', 'roll': '5deg', 'speed': '300mm/s', 'traps': traps}
    result = ra.track('u_bracket', on, 1, drops=100, simulate=1, workers=1, seed=3)
    outcomes = result.passage.outcomes
    counts = {
        'outcomes': [[each.outcome for each in of_trap] for of_trap in outcomes],
        'runs': result.runs.counts.tolist(),
    }
    values = {
        'rate': result.passage.rate,
        'shares': [row.probability for row in result.rows],
        'critical': [[each.critical for each in of_trap] for of_trap in outcomes],
    }
    return counts, values


def design_track():
    designs = ra.design_track('u_bracket', 1, drops=100, seed=3).design.designs
    kinds = [[trap.kind for trap in each.passage.track.traps] for each in designs]
    return {'kinds': kinds}, {'margins': [each.margin for each in designs]}


CASES = (
    drop_on_the_plane,
    drop_in_a_slope,
    drop_in_a_chute,
    drop_from_given_states,
    drop_until_precise,
    drop_with_bullet,
    reorient_tap,
    reorient_toss,
    reorient_bowl,
    reorient_in_a_groove,
    retention,
    forecast,
    study,
    optimise,
    batch,
    classify,
    identify,
    estimate,
    pytest.param(track, marks=pytest.mark.slow),
    pytest.param(design_track, marks=pytest.mark.slow),
)


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.__name__)
def test_golden_result(case):
    counts, values = case()
    path = GOLDEN / f'{case.__name__}.json'
    if 'UPDATE_GOLDEN' in os.environ:
        rounded = {name: np.round(found, 6).tolist() for name, found in values.items()}
        path.write_text(json.dumps({'counts': counts, 'values': rounded}) + '\n', encoding='utf-8')
    golden = json.loads(path.read_text(encoding='utf-8'))
    assert json.loads(json.dumps(counts)) == golden['counts']
    assert values.keys() == golden['values'].keys()
    for name, found in values.items():
        np.testing.assert_allclose(found, golden['values'][name], rtol=0, atol=TOLERANCE)
