"""The table of contacts: which rows it has, and how rows with the same contacts differ."""

import numpy as np

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import CODE_TEXT
from resting_aspects_ros.report.drops import contact_table
from resting_aspects_ros.statistics.distribution import Distribution, Placement, Placements

EDGE = next(code for code, text in CODE_TEXT.items() if text == 'edge')


def test_rows_with_the_same_contacts_have_letters(part):
    aspects = find_aspects(part('tetrahedron'))
    upright = np.array([0.0, 0, 0, 1])
    given = [((1, EDGE), 30), ((1, EDGE), 20), ((2, EDGE), 10), ((EDGE, 3), 9), ((EDGE, 3), 8)]
    placements = [Placement(contacts, upright, count) for contacts, count in given]
    found = Placements(('belt', 'wall'), placements, 100)
    table = contact_table(found, Distribution(aspects, np.full(4, 25), 0, 0, 0))
    belt, wall, *_ = map(list, zip(*table.rows, strict=True))
    assert belt == ['1', '1', '2', 'edge a', 'edge b']
    assert wall == ['edge a', 'edge b', 'edge', '3', '3']


def test_only_the_most_frequent_rows_are_shown(part):
    aspects = find_aspects(part('tetrahedron'))
    placements = [Placement((EDGE, 0), np.array([0.0, 0, 0, 1]), 1) for _ in range(20)]
    found = Placements(('belt', 'wall'), placements * 2, 40)
    table = contact_table(found, Distribution(aspects, np.full(4, 10), 0, 0, 0))
    cells = [row[0] for row in table.rows]
    assert cells[:2] == ['edge a', 'edge b']
    assert cells[-2:] == ['edge t', '20 more']
