"""Each command does what the public function does: same documents, warnings and refusals."""

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


def called(function):
    """Return the result of a function, or its error, and the warnings."""
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter('always')
        try:
            found = function()
        except ra.RestingAspectsError as error:
            found = error
    texts = [str(each.message) for each in issued if each.category is ra.RestingAspectsWarning]
    return found, texts


def warned(ended):
    lines = ended.stderr.splitlines()
    return [line.removeprefix('warning: ') for line in lines if line.startswith('warning: ')]


def nut_track(**values):
    traps = [{'kind': 'wiper', 'height': '12.7mm'}]
    return {'width': '40mm', 'roll': '5deg', **values, 'traps': traps}


DOCUMENTS = {
    'drop, precision that is not reached': (
        'drop l_bracket --drops 100 --precision 0.02',
        lambda: ra.drop('l_bracket', 100, precision=0.02),
    ),
    'drop, parts wedge': (
        'drop hex_nut --drops 20 --surroundings v_groove --set opening=20deg --friction 0.6',
        lambda: ra.drop(
            'hex_nut', 20, surroundings=ra.surroundings('v_groove', opening='20deg'), friction=0.6
        ),
    ),
    'drop, convergence': (
        'drop l_bracket --drops 50 --check-convergence',
        lambda: ra.drop('l_bracket', 50, check_convergence=True),
    ),
    'reorient, precision that is not reached': (
        'reorient t_prism --per-aspect 10 --drops 50 --precision 0.02',
        lambda: ra.reorient('t_prism', 'tap', 10, drops=50, precision=0.02),
    ),
    'reorient in surroundings': (
        'reorient l_bracket --per-aspect 5 --drops 50 --surroundings l_chute',
        lambda: ra.reorient('l_bracket', 'tap', 5, drops=50, surroundings='l_chute'),
    ),
    'retention': ('retention l_bracket --per-height 5', lambda: ra.retention('l_bracket', 5)),
    'forecast, aspects that look the same': (
        'forecast hex_nut --pickable 1 --per-aspect 10 --drops 50 --tray 100x100mm',
        lambda: ra.forecast('hex_nut', [1], per_aspect=10, drops=50, tray=(0.1, 0.1)),
    ),
    'optimise': (
        'optimise l_bracket --vary height=20mm:200mm --wanted 1 --budget 2000',
        lambda: ra.optimise('l_bracket', {'height': '20mm:200mm'}, wanted=[1], budget=2000),
    ),
    'track, simulated parts after an action': (
        'track hex_nut --trap wiper:height=12.7mm --speed 1 --simulate 1 --before tap --drops 50',
        lambda: ra.track(
            'hex_nut', nut_track(speed=1, width=0.031), drops=50, simulate=1, before=['tap']
        ),
    ),
    'track, unit in doubt': (
        'track hex_nut --width 1 --drops 50 --seed 3',
        lambda: ra.track('hex_nut', {'width': 1.0, 'roll': '5deg'}, drops=50, seed=3),
    ),
    'track, design': (
        'track u_bracket --design --want 1 --drops 100',
        lambda: ra.design_track('u_bracket', 1, drops=100),
    ),
    'estimate': ('estimate l_bracket', lambda: ra.estimate('l_bracket')),
    'outlines': ('outlines l_bracket', lambda: ra.outlines('l_bracket')),
}


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(('words', 'function'), DOCUMENTS.values(), ids=DOCUMENTS)
def test_document_and_warnings_are_those_of_the_function(run, words, function):
    ended = run(*words.split(), '--json')
    assert ended.returncode == 0, ended.stderr
    result, texts = called(function)
    found = without_time(json.loads(ended.stdout))
    assert found == without_time(json.loads(result.to_json()))
    assert warned(ended) == texts


SEARCH = 'optimise l_bracket --vary friction=0.1:0.5 --wanted 1 --budget 2000'
REFUSED = {
    'no drops': ('drop l_bracket --drops 0', lambda: ra.drop('l_bracket', 0)),
    'height in a wrong unit': (
        'drop l_bracket --height 60',
        lambda: ra.drop('l_bracket', height=60.0),
    ),
    'precision': ('drop l_bracket --precision 0.9', lambda: ra.drop('l_bracket', precision=0.9)),
    'step in a groove': (
        'reorient l_bracket --action step_down --surroundings v_groove',
        lambda: ra.reorient('l_bracket', 'step_down', surroundings='v_groove'),
    ),
    'the same in a search': (
        f'{SEARCH} --action step_down --surroundings v_groove',
        lambda: ra.optimise(
            'l_bracket',
            {'friction': '0.1:0.5'},
            wanted=[1],
            action='step_down',
            surroundings='v_groove',
            budget=2000,
        ),
    ),
    'an aspect that is not known': (
        'forecast l_bracket --pickable 99',
        lambda: ra.forecast('l_bracket', [99]),
    ),
    'a row that is not known': (
        'track hex_nut --want 9 --drops 20',
        lambda: ra.track('hex_nut', {'width': '50mm'}, 9, drops=20),
    ),
    'a half class with a controller': (
        'forecast hex_nut --pickable 1 --controller',
        lambda: ra.forecast('hex_nut', [1], controller=True),
    ),
}


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(('words', 'function'), REFUSED.values(), ids=REFUSED)
def test_command_refuses_what_the_function_refuses(run, words, function):
    ended = run(*words.split())
    assert ended.returncode == 2
    error, texts = called(function)
    assert isinstance(error, ra.InvalidValueError)
    assert ended.stderr.splitlines()[-1] == f'error: {error}'
    assert ended.stdout == ''
    assert warned(ended) == texts
