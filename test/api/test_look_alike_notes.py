"""Remarks on classes that a robot or a camera confuses."""

import pytest
import trimesh

from resting_aspects_ros.api.forecast_result import (
    counted_apart_texts,
    divided_class_texts,
    look_alike_texts,
)
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.aspects.find import find_aspects


@pytest.fixture(scope='module')
def u_bracket():
    """A part whose classes 1 (aspect 1) and 4 (aspect 6) have the same outline."""
    part = load_part('u_bracket')
    return part, find_aspects(part)


@pytest.mark.parametrize(
    ('pickable', 'expected'),
    [
        ([1, 6], []),
        ([2, 3, 4, 5], []),
        ([1], ['class 1, which is pickable, and class 4, which is not: the forecast assumes']),
        ([6, 4, 5], ['class 4, which is pickable, and class 1, which is not']),
    ],
)
def test_pickable_class_that_looks_like_another_is_named(u_bracket, pickable, expected):
    texts = look_alike_texts(*u_bracket, pickable)
    assert len(texts) == len(expected)
    assert all(words in text for words, text in zip(expected, texts, strict=True))


def test_mirrored_classes_are_named():
    part = load_part('l_bracket')
    (text,) = look_alike_texts(part, find_aspects(part), [2])
    assert text.startswith('The outlines of class 2, which is pickable, and class 1')
    assert text.endswith('vision must not match mirrored outlines.')


def test_many_classes_with_one_outline_are_one_sentence(solid):
    # A cube with a blind hole in a side that is in no symmetric place: all sides look the same.
    place = trimesh.transformations.translation_matrix((3, 1, 8))
    hole = trimesh.creation.cylinder(2, 8, transform=place)
    part = solid(trimesh.creation.box((20, 20, 20)).difference(hole))
    aspects = find_aspects(part)
    (text,) = look_alike_texts(part, aspects, [1, 2])
    assert 'classes 1 and 2, which are pickable, and classes 3 to 6, which are not' in text
    (text,) = counted_apart_texts(part, aspects, [[1, 2], [3]])
    assert text.endswith('can be counted together as 1+2+3+4+5+6.')


def test_part_of_a_class_is_named(u_bracket):
    aspects = u_bracket[1]
    assert divided_class_texts(aspects, [1, 2, 3]) == []
    (text,) = divided_class_texts(aspects, [1, 2])
    assert text == (
        'the aspects 2 and 3 of class 2 look the same: a robot that picks aspect 2 also picks '
        'aspect 3, which is not requested as pickable'
    )


def test_classes_with_one_outline_can_be_counted_together(u_bracket):
    (text,) = counted_apart_texts(*u_bracket, [[1], [2], [3], [4]])
    assert text.endswith('can be counted together as 1+4.')
    assert counted_apart_texts(*u_bracket, [[1, 4], [2], [3]]) == []
