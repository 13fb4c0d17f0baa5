"""Reading of JSON documents: an error names the wrong field in one line."""

import copy
import json

import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.api.result_json import document_result
from resting_aspects_ros.errors import InvalidValueError


@pytest.fixture(scope='module')
def original():
    """Return a document of `drop`."""
    return json.loads(ra.drop('box_10x20x30', 25, seed=3).to_json())


@pytest.fixture
def refusal(tmp_path):
    """Return the error for a content; the file is called f.json in it."""

    def words(text):
        path = tmp_path / 'f.json'
        path.write_text(text, encoding='utf-8')
        with pytest.raises(InvalidValueError) as caught:
            read_counts(path)
        message = str(caught.value)
        assert len(message) < 400 + len(str(path))
        assert '\n' not in message
        return message.replace(repr(str(path)), 'f.json')

    return words


def changed(document, path, *value):
    """Return a copy of a document with another value at a place, or without it."""
    document = copy.deepcopy(document)
    *outer, last = path
    inside = document
    for key in outer:
        inside = inside[key]
    if value:
        (inside[last],) = value
    else:
        del inside[last]
    return document


@pytest.mark.parametrize(
    ('place', 'name'),
    [
        (('drops',), 'drops'),
        (('part',), 'part'),
        (('conditions', 'friction'), 'conditions.friction'),
        (('aspects', 0, 'count'), 'aspects[0].count'),
    ],
)
def test_error_names_the_field_that_is_wrong_or_missing(original, refusal, place, name):
    wrong, shown = (5, '5') if name == 'part' else ('x' * 1000, "'xxx")
    said = refusal(json.dumps(changed(original, place, wrong)))
    assert said.startswith(f'invalid {name} {shown}')
    assert ' in f.json: expected ' in said
    assert refusal(json.dumps(changed(original, place))) == f'f.json has no {name}'


@pytest.mark.parametrize(
    ('place', 'value', 'said'),
    [
        (('drops',), 26, 'invalid drops 26 in f.json: expected 25, the sum of all counts'),
        (('schema_version',), 1, 'invalid schema_version 1 in f.json: expected 2'),
        (('part',), '<b>', "invalid part '<b>' in f.json: expected a name of lower case letters"),
        (('conditions', 'height'), -1.0, 'invalid conditions in f.json: invalid height -1.0'),
        (('aspects', 0, 'id'), 2, 'in f.json: expected each aspect once'),
    ],
)
def test_invalid_document_is_refused(original, refusal, place, value, said):
    assert said in refusal(json.dumps(changed(original, place, value)))


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('{"a":' * 100_000, 'f.json is not JSON: '),
        ('{"drops": NaN}', 'f.json is not JSON: NaN is not a finite number'),
        (f'{{"schema_version": {10**400}}}', 'invalid schema_version 1000000'),
        ('{"method": "rolling"}', "f.json is of method 'rolling': expected"),
    ],
)
def test_other_json_documents_are_refused(refusal, text, said):
    assert said in refusal(text)


def test_result_with_lost_parts_is_read_back(tmp_path):
    result = ra.drop('box_10x20x30', 20, surroundings='bowl_track', workers=1)
    lost = result.distribution.lost
    assert lost > 0
    path = tmp_path / 'track.json'
    result.save_json(path)
    assert document_result(path, None, None, None, None).distribution.lost == lost
    assert read_counts(path).tally.unsettled == lost + result.distribution.unsettled


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({('history',): [{'drops': 1, 'counts': [1]}]}, 'history'),
        ({('aspects', 0, 'id'): 77}, 'invalid ids'),
        ({('aspects', 0, 'model_lower'): None}, 'invalid model range'),
        ({('classes',): []}, 'invalid model range'),
    ],
)
def test_report_refuses_what_it_cannot_show(original, tmp_path, changes, said):
    document = original
    for place, value in changes.items():
        document = changed(document, place, value)
    path = tmp_path / 'f.json'
    path.write_text(json.dumps(document), encoding='utf-8')
    with pytest.raises(InvalidValueError, match=said):
        document_result(path, None, None, None, None)
