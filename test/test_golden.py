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


def first_poses(poses):
    chosen = slice(FIRST_POSES)
    return [
        [*position, *orientation]
        for position, orientation in zip(
            poses.position[chosen].tolist(), poses.orientation[chosen].tolist(), strict=True
        )
    ]


def dropped(*words, **options):
    result = ra.drop(*words, **options)
    values = {'poses': first_poses(result.poses)}
    return distribution(result.distribution), values, result


def drop_on_the_plane():
    return dropped('l_bracket', 200, seed=3, check_convergence=True)


def drop_in_a_slope():
    slope = ra.surroundings('slope', angle='12deg')
    return dropped('hex_nut', 200, seed=3, surroundings=slope)


def drop_in_a_chute():
    counts, values, result = dropped('l_bracket', 100, seed=3, surroundings='l_chute')
    counts['placements'] = [each.count for each in result.contacts.placements]
    return counts, values, result


def drop_from_given_states():
    states = ra.GivenStates(
        position=[[0, 0, 0.06], [0, 0, 0.08]],
        orientation=[[0, 0, 0, 1], [0.5, 0.5, 0.1, 0.7]],
        spin=[[1, 2, 3], [0, 0, 0]],
    )
    noise = ra.Noise(orientation=0.2)
    counts, values, result = dropped(
        't_prism', initial_states=states, replicates=50, noise=noise, seed=3
    )
    return {**counts, 'by_state': result.by_state.counts.tolist()}, values, result


def drop_until_precise():
    return dropped('tetrahedron', precision=0.1, seed=3)


def drop_with_bullet():
    return dropped('l_bracket', 50, seed=3, engine='bullet', workers=1)


def reoriented(*words, **options):
    result = ra.reorient(*words, drops=100, seed=3, **options)
    counts = {
        'matrix': result.matrix.counts.tolist(),
        'sliding': result.matrix.sliding,
        'drop': distribution(result.drop),
    }
    shares = None if result.long_run is None else result.long_run.shares.tolist()
    return counts, {'long_run': shares}, result


def reorient_tap():
    return reoriented('l_bracket', 'tap', 30, check_convergence=True)


def reorient_toss():
    return reoriented('hex_nut', 'toss', 30)


def reorient_bowl():
    return reoriented('l_bracket', 'bowl', 10)


def reorient_in_a_groove():
    return reoriented('l_bracket', 'tap', 20, surroundings='v_groove')


def retention():
    result = ra.retention('l_bracket', 10, seed=3)
    values = {'lift': [curve.lift.tolist() for curve in result.curves]}
    return {'left': [curve.left.tolist() for curve in result.curves]}, values, result


def forecast():
    result = ra.forecast('hex_nut', pickable_classes=[1], per_aspect=30, drops=100, seed=3)
    counts = {
        'matrix': result.reorientation.matrix.counts.tolist(),
        'drop': distribution(result.reorientation.drop),
    }
    return counts, {'parts_per_minute': result.parts_per_minute}, result


def study():
    result = ra.study('cylinder_d20_h20', {'restitution': '0.2:0.6:4'}, drops=50, seed=3)
    return {'classes': [case.classes.tolist() for case in result.cases]}, {}, result


def study_of_an_action():
    vary = {'action.speed': '0.1:0.5:3'}
    result = ra.study('cylinder_d20_h20', vary, action='tap', points=2, drops=20, seed=3)
    return {'classes': [case.classes.tolist() for case in result.cases]}, {}, result


def optimise():
    result = ra.optimise('l_bracket', {'height': '20mm:200mm'}, wanted=[1], budget=4000, seed=3)
    counts = {'drops': result.drops, 'points': [row.tolist() for _, row in result.points]}
    return counts, {'certainty': result.certainty}, result


def batch():
    result = ra.drop_batch(['tetrahedron', 't_prism'], 50, seed=3)
    counts = {each.source: distribution(each.result.distribution) for each in result.entries}
    return counts, {}, result


def classify():
    poses = ra.drop('l_bracket', 150, seed=4).poses
    result = ra.classify(poses, 'l_bracket')
    found = result.by_part.distribution
    return {'clusters': result.clusters.counts.tolist(), **distribution(found)}, {}, result


def identify():
    seen = ra.outlines('l_bracket').outlines[0].polygon
    found = ra.identify_part(seen, 'l_bracket')
    counts = {
        'answer': found.answer,
        'classes': [each.symmetry_class for each in found.candidates],
    }
    values = {
        'posterior': [each.posterior for each in found.candidates],
        'place': [[each.x, each.y] for each in found.candidates],
    }
    return counts, values, found


def estimate():
    result = ra.estimate('l_bracket')
    found = {name: each.probabilities.tolist() for name, each in result.estimates.items()}
    return {'methods': sorted(found)}, found, result


def track():
    traps = [{'kind': 'wiper', 'height': '22.25mm'}, {'kind': 'balcony', 'width': '12mm'}]
    on = {'width': '55mm', 'roll': '5deg', 'speed': '300mm/s', 'traps': traps}
    result = ra.track('u_bracket', on, 1, drops=200, simulate=2, seed=3)
    counts = {
        'outcomes': [[each.outcome for each in of_trap] for of_trap in result.passage.outcomes],
        'runs': result.runs.counts.tolist(),
    }
    values = {
        'rate': result.passage.rate,
        'shares': [row.probability for row in result.rows],
        'critical': [[each.critical for each in of] for of in result.passage.outcomes],
    }
    return counts, values, result


def design_track():
    result = ra.design_track('u_bracket', 1, drops=200, seed=3)
    counts = {'kinds': [[trap.kind for trap in each.traps] for each in _passages(result)]}
    return counts, {'margins': [each.margin for each in result.designs]}, result


def _passages(result):
    return [each.passage.track for each in result.designs]


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
    study_of_an_action,
    optimise,
    batch,
    classify,
    identify,
    estimate,
    pytest.param(track, marks=pytest.mark.slow),
    pytest.param(design_track, marks=pytest.mark.slow),
)


def plain(values):
    return json.loads(json.dumps(values))


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.__name__)
def test_golden_result(case):
    counts, values, _ = case()
    path = GOLDEN / f'{case.__name__}.json'
    if 'UPDATE_GOLDEN' in os.environ:
        rounded = {name: np.round(found, 6).tolist() for name, found in values.items()}
        path.write_text(json.dumps({'counts': counts, 'values': rounded}) + '\n', encoding='utf-8')
    golden = json.loads(path.read_text(encoding='utf-8'))
    assert plain(counts) == golden['counts']
    assert values.keys() == golden['values'].keys()
    for name, found in values.items():
        np.testing.assert_allclose(found, golden['values'][name], rtol=0, atol=TOLERANCE)
