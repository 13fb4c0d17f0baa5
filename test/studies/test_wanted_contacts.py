"""Wanted contacts with floor and walls, and their counts at the points of a search."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import (
    contacts_in,
    scene_of,
    shipped_surfaces,
    with_surroundings,
)
from resting_aspects_ros.aspects.support import EDGE, NONE
from resting_aspects_ros.studies.objective import WantedContacts, finder_in, read_contacts

DROPS = 40


@pytest.fixture(scope='module')
def dropped(here):
    """Return a box, its aspects, its conditions in a chute, and drops there."""
    part = ra.load_part('box_10x20x30')
    conditions = with_surroundings(shipped_surfaces().get(), 'l_chute')
    poses = ra.drop(part, DROPS, surface=conditions, workers=here()).poses
    return part, ra.find_aspects(part), conditions, poses


def test_counts_are_those_of_the_contact_table(dropped):
    """`drop --surroundings` counts placements by name: the wanted ones have the same sum."""
    part, aspects, conditions, poses = dropped
    table = contacts_in(scene_of(part, conditions), part, aspects)
    table.add(poses, np.zeros(DROPS, dtype=np.int64))
    rows = [(table.named(each), each.count) for each in table.placements]
    assert len({tuple(sorted(name.items(), key=str)) for name, _ in rows}) > 2
    finder = finder_in(part, conditions, aspects)
    for named, _ in rows:
        wish = read_contacts(named, list(table.planes), aspects)
        same = sum(count for other, count in rows if other == named)
        assert wish.found(finder, poses).sum() == same
    # Without the wall, all contacts with it count.
    first = rows[0][0]['belt']
    wish = read_contacts(f'belt={first}', list(table.planes), aspects)
    expected = sum(count for named, count in rows if named['belt'] == first)
    assert wish.found(finder, poses).sum() == expected


def test_alternatives_are_not_counted_twice(dropped, here):
    part, aspects, conditions, _ = dropped
    every = [f'belt={k}' for k in range(1, len(aspects) + 1)]
    one, twice = (
        ra.optimise(
            part, {'height': '10mm:30mm'}, wanted_contacts=wanted, surroundings='l_chute',
            budget=2000, workers=here(),
        )
        for wanted in (every, [*every, *every])
    )  # fmt: skip
    assert [c.tolist() for _, c in one.points] == [c.tolist() for _, c in twice.points]
    assert 0 < one.best.counts[0] <= one.best.drops
    finder = finder_in(part, conditions, aspects)
    assert isinstance(WantedContacts((('belt', 1),)).found(finder, dropped[3]), np.ndarray)


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
