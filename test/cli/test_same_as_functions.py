"""Each command does what the public function does: the same documents and warnings."""

import json
import warnings

import pytest

import resting_aspects_ros as ra

# Of a run, not of its result.
OWN = ('run_id', 'started')


def without_time(document):
    """Return a document without what differs in each run, at any depth."""
    if isinstance(document, dict):
        return {k: without_time(v) for k, v in document.items() if k not in OWN}
    if isinstance(document, list):
        return [without_time(each) for each in document]
    return document


FORECAST = (
    'forecast l_bracket --pickable 1 --per-aspect 5 --drops 20 --robot 900ms --supply 50ms '
    '--overlap --clearance 2mm --parts-on-tray 3 --max-picks 2 --minutes 0.1 --tray 0.1mx100mm'
)
FORECAST_OF = {
    'part': 'l_bracket',
    'pickable': [1],
    'per_aspect': 5,
    'drops': 20,
    'tray': (0.1, 0.1),
    'robot': 0.9,
    'supply': 0.05,
    'overlap': True,
    'clearance': 0.002,
    'parts_on_tray': 3,
    'max_picks': 2,
    'minutes': 0.1,
}
WIPER = {'kind': 'wiper', 'height': '12.7mm'}
DOCUMENTS = {
    'drop in a groove': (
        'drop hex_nut --drops 9 --surroundings v_groove --set opening=0.3',
        lambda: ra.drop('hex_nut', 9, surroundings=ra.surroundings('v_groove', opening=0.3)),
    ),
    'reorient, precision that is not reached': (
        'reorient t_prism --per-aspect 10 --drops 50 --precision 0.02',
        lambda: ra.reorient('t_prism', 'tap', 10, drops=50, precision=0.02),
    ),
    'retention': ('retention l_bracket --per-height 5', lambda: ra.retention('l_bracket', 5)),
    'forecast': (FORECAST, lambda: ra.forecast(**FORECAST_OF)),
    'optimise': (
        'optimise l_bracket --vary height=20mm:200mm --wanted 1 --budget 2000',
        lambda: ra.optimise('l_bracket', {'height': '20mm:200mm'}, wanted=[1], budget=2000),
    ),
    'track, simulated parts after an action': (
        'track tetrahedron --trap wiper:height=12.7mm --simulate 1 --before tap --drops 50',
        lambda: ra.track(
            'tetrahedron',
            {'width': 0.047, 'roll': '5deg', 'traps': [WIPER]},
            drops=50,
            simulate=1,
            before=['tap'],
        ),
    ),
}


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(('words', 'function'), DOCUMENTS.values(), ids=DOCUMENTS)
def test_document_and_warnings_are_those_of_the_function(run, words, function):
    ended = run(*words.split(), '--json')
    assert ended.returncode == 0, ended.stderr
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter('always')
        result = function()
    found = without_time(json.loads(ended.stdout))
    assert found == without_time(json.loads(result.to_json()))
    lines = ended.stderr.splitlines()
    assert [line.removeprefix('warning: ') for line in lines if 'warning: ' in line] == [
        str(each.message) for each in issued if each.category is ra.RestingAspectsWarning
    ]
