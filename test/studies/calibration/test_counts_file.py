"""Counts files: groups of aspects, what is fitted, and what is refused."""

from pathlib import Path

import pytest
import yaml
from doc_pages import code

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.errors import RestingAspectsWarning as Warned
from resting_aspects_ros.studies.calibration.counts_file import (
    CountedEntry,
    make_solid,
    make_surface_counts,
    read_groups,
)

ROOT = Path(__file__).parents[3]
BOX = {'box': [20, 20, 15], 'counts': {'z': 60, 'rest': 40}}


@pytest.fixture(scope='module')
def box():
    return find_aspects(make_solid(CountedEntry(box=(20, 30, 10), counts={}), Path()))


def groups(given, aspects, drops=None, kind='box'):
    return read_groups(given, drops, kind, aspects)


@pytest.mark.parametrize(
    ('given', 'drops', 'ids', 'counts'),
    [
        # Ids ascend with the height of the centre: 10, 20 and 30 mm.
        ({'x': 5, 'y': 1, 'z': 94}, None, ((3, 4), (5, 6), (1, 2)), [5, 1, 94]),
        ({1: 3, 'class_2': 2, 3: 0}, 5, ((1, 2), (3, 4), (5, 6)), [3, 2, 0]),
        ({'1+3': 3, 2: 2}, None, ((1, 2, 5, 6), (3, 4)), [3, 2]),
        ({'aspect_1': 3, 'aspect_2': 4, 'rest': 1}, None, ((1,), (2,), (3, 4, 5, 6)), [3, 4, 1]),
        ({'z': 3, 'rest': 7, 'unclassified': 2}, 12, ((1, 2), (3, 4, 5, 6)), [3, 7]),
    ],
)
def test_counts_by_axis_class_aspect_and_rest(given, drops, ids, counts, box):
    found = groups(given, box, drops)
    assert (found[0], found[2].tolist()) == (ids, counts)


@pytest.mark.slow
def test_sides_of_a_cylinder():
    aspects = find_aspects(make_solid(CountedEntry(cylinder=(10, 10), counts={}), Path()))
    ids, _, counts = groups({'end': 38, 'side': 62}, aspects, kind='cylinder')
    ends = {a.id for a in aspects if abs(a.down_in_part[2]) > 0.9}
    assert set(ids[0]) == ends
    assert set(ids[1]) == {a.id for a in aspects} - ends
    assert counts.tolist() == [38, 62]


@pytest.mark.parametrize(
    ('given', 'drops', 'message'),
    [
        ({'top': 3, 'rest': 7}, None, "invalid name 'top' of a count: expected a class"),
        ({'aspect_7': 3, 'rest': 7}, None, 'the part has aspects 1 to 6'),
        ({'z': 3, 'rest': 7}, 12, 'invalid drops 12: expected the sum of the counts, 10'),
        ({'z': 3, 'x': 2}, None, r'aspects \[5, 6\] are missing'),
        ({'z': 3, 1: 2, 'rest': 1}, None, 'counts aspect 1 again'),
        ({'1+2+3': 5}, None, 'all aspects are in one group'),
    ],
)
def test_wrong_counts_are_refused(given, drops, message, box):
    with pytest.raises(InvalidValueError, match=message.replace('+', r'\+')):
        groups(given, box, drops)


def test_counts_in_a_single_group_are_warned_of():
    part = {'name': 'block', 'box': [20, 30, 10], 'counts': {'z': 50, 'rest': 0}}
    with pytest.warns(Warned, match="block: all 50 drops are in 'z': they tell little"):
        make_surface_counts({'parts': [part]}, Path())


@pytest.mark.slow
def test_what_is_not_known_is_fitted():
    def fitted(conditions, parts=(BOX,)):
        found = make_surface_counts({'conditions': conditions, 'parts': [*parts]}, Path())
        return found, {factor.name: (factor.low, factor.high) for factor in found.factors}

    default = {'height': (0.02, 0.3), 'restitution': (0.05, 0.95), 'friction': (0.03, 1.0)}
    assert fitted(None)[1] == default
    given = {'height': '100 mm', 'restitution': 0.4, 'friction': '0.1:0.5', 'spin': '0:20'}
    found, ranges = fitted(given)
    assert ranges == {'friction': (0.1, 0.5), 'spin': (0.0, 20.0)}
    assert (found.base.height, found.base.restitution) == (0.1, 0.4)
    own = [{**BOX, 'name': str(h), 'conditions': {'height': h}} for h in (1, 2)]
    found, ranges = fitted({'height': 1}, own)
    assert list(ranges) == ['restitution', 'friction']
    assert [part.values['height'] for part in found.parts] == [1.0, 2.0]


@pytest.mark.slow
def test_example_has_the_published_shares():
    document = yaml.safe_load((ROOT / 'config' / 'counts' / 'steel_cuboids.yaml').read_text())
    published = {
        0.47: (0.916, 332), 0.75: (0.548, 799), 0.93: (0.399, 516), 1.16: (0.148, 1011),
        1.44: (0.052, 654), 1.60: (0.017, 702), 1.87: (0.009, 680), 2.65: (0.006, 503),
    }  # fmt: skip
    for part, (thickness, (share, rolls)) in zip(
        document['parts'], published.items(), strict=True
    ):
        assert part['box'] == pytest.approx([20, 20, 20 * thickness])
        assert sum(part['counts'].values()) == rolls
        assert part['counts']['z'] / rolls == pytest.approx(share, abs=0.0005)
    found = make_surface_counts({**document, 'parts': document['parts'][:1]}, ROOT)
    assert found.parts[0].shares[0] == pytest.approx(0.916, abs=0.0005)


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'colour': 'red'}, "invalid key 'colour'"),
        ({'parts': [BOX, BOX]}, 'is there twice'),
        ({'parts': [{**BOX, 'counts': {'z': -2}}]}, 'invalid counts.z -2'),
        ({'parts': [{**BOX, 'cylinder': [1, 2]}]}, 'expected exactly one of'),
        ({'parts': [{'box': [1, 2, -3], 'counts': {'z': 1}}]}, 'expected three lengths'),
        ({'parts': [{'hull': [[0, 0, 0]] * 5, 'counts': {}}]}, 'expected points that span'),
        (
            {'parts': [{**BOX, 'conditions': {'friction': 0.2}}, {**BOX, 'name': 'other'}]},
            'invalid friction: it is fitted',
        ),
        ({'conditions': {'height': 'high'}}, "invalid height 'high'"),
        (
            {'conditions': {'height': 1, 'restitution': 0.5, 'friction': 0.5}},
            'all values are known',
        ),
    ],
)
def test_wrong_files_are_refused(changes, message):
    with pytest.raises(RestingAspectsError, match=message) as error:
        make_surface_counts({'parts': [BOX], **changes}, Path(), 'here')
    assert str(error.value).startswith('here')


@pytest.mark.slow
def test_example_of_the_page_is_a_counts_file():
    (text,) = code('docs/how_to/calibrate.md', 'yaml')
    found = make_surface_counts(yaml.safe_load(text), ROOT)
    assert [part.drops for part in found.parts] == [200, 100]
    assert [factor.name for factor in found.factors] == ['restitution', 'friction']
