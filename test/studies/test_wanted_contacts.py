"""Wanted contacts with floor and walls, and their counts at the points of a search."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.surroundings import contacts_in, scene_of, with_surroundings
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.contacts import EDGE, NONE
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_plans import plan_point
from resting_aspects_ros.studies.wanted_contacts import WantedContacts, finder_in, read_contacts

DROPS = 40


@pytest.fixture(scope='module')
def dropped():
    """Return a box, its aspects, its conditions in a chute, and drops there."""
    part = ra.load_part('box_10x20x30')
    landscape = Landscape(part)
    aspects = find_aspects(part, landscape)
    conditions = with_surroundings(shipped_surfaces().get(), 'l_chute')
    plan = plan_point(part, Setting(conditions), DROPS, 1, landscape, aspects)
    return part, aspects, conditions, landscape, drop_range(plan.job, 0, DROPS)


def test_counts_are_those_of_the_contact_table(dropped):
    """`drop --surroundings` counts placements by name: the wanted ones have the same sum."""
    part, aspects, conditions, landscape, poses = dropped
    table = contacts_in(scene_of(part, conditions), part, aspects)
    table.add(poses, np.zeros(DROPS, dtype=np.int64))
    rows = [(table.named(each), each.count) for each in table.placements]
    assert len({tuple(sorted(name.items(), key=str)) for name, _ in rows}) > 2
    for named, _ in rows:
        wish = read_contacts(named, list(table.planes), aspects)
        plan = plan_point(part, Setting(conditions), DROPS, 1, landscape, aspects, contacts=[wish])
        (counts,) = plan.count(poses)
        same = sum(count for other, count in rows if other == named)
        assert counts[0] == same
        assert counts.sum() == DROPS
    # Without the wall, all contacts with it count.
    first = rows[0][0]['belt']
    wish = read_contacts(f'belt={first}', list(table.planes), aspects)
    expected = sum(count for named, count in rows if named['belt'] == first)
    assert wish.found(table.finder, poses).sum() == expected


def test_alternatives_are_not_counted_twice(dropped):
    part, aspects, conditions, landscape, poses = dropped
    finder = finder_in(part, conditions, aspects)
    every = [WantedContacts((('belt', k),)) for k in range(1, len(aspects) + 1)]
    plan = plan_point(
        part, Setting(conditions), DROPS, 1, landscape, aspects, contacts=[*every, *every]
    )
    (counts,) = plan.count(poses)
    assert counts[0] == sum(each.found(finder, poses).sum() for each in every)


def test_texts_and_mappings_are_the_same(dropped):
    aspects, planes = dropped[1], ['belt', 'wall']
    one = read_contacts('belt=1, wall=edge', planes, aspects)
    assert one == read_contacts({'belt': 1, 'wall': 'edge'}, planes, aspects)
    assert one.codes == (('belt', 1), ('wall', EDGE))
    assert one.text == 'belt: aspect 1, wall: edge'
    free = read_contacts('belt=2,wall=none', planes, aspects)
    assert free == read_contacts({'belt': 2, 'wall': None}, planes, aspects)
    assert free.codes == (('belt', 2), ('wall', NONE))
    assert free.text == 'belt: aspect 2, wall: nothing'
    assert dict(free.named) == {'belt': 2, 'wall': None}
