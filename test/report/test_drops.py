"""The table and the document of a distribution say what the distribution is."""

import dataclasses
import json

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.report.drops import distribution_table
from resting_aspects_ros.report.format import (
    direction_text,
    interval_of,
    interval_text,
    millimetre_texts,
    probability_text,
)
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.model_range import with_model_range


@pytest.fixture(scope='module')
def distribution(part):
    aspects = find_aspects(part('l_bracket'))
    return Distribution(aspects, np.array([2780, 2713, 2490, 1312, 0]), 7, 0, 1)


def test_rows_match_the_distribution(distribution):
    rows = distribution_table(distribution, 'a title', each=True).rows
    assert [row[0] for row in rows] == ['1', '2', '3', '4', '5', '', '', '']
    assert [row[-1] for row in rows] == ['2780', '2713', '2490', '1312', '0', '7', '1', '9303']
    assert [row[1] for row in rows[5:]] == ['unclassified', 'failed', 'drops in total']
    for row, aspect in zip(rows, distribution.aspects, strict=False):
        direction = [float(number) for number in row[2].split()]
        assert direction == pytest.approx(aspect.down_in_part.tolist(), abs=0.005 + 1e-9)
    intervals = [(probability_text(i), interval_text(i)) for i in distribution.intervals()]
    assert [tuple(row[3:5]) for row in rows[:5]] == intervals
    # Wilson's bound of what was never seen.
    z2, n = 3.8415, distribution.drops
    assert rows[4][3] == '0 %'
    assert rows[4][4].values == (0, pytest.approx(100 * z2 / (n + z2), rel=1e-4))


def test_equivalent_aspects_are_summed_in_one_row(part):
    nut = part('hex_nut')
    counts = np.array([300, 320, 60, 65, 70, 50, 55, 80])
    distribution = Distribution(find_aspects(nut), counts, 0, 0, 0)
    flat, side, _ = distribution_table(distribution, 'a title', nut).rows
    assert flat[:2] == ['1 and 2', 'flat side 17 x 19.6 mm']
    assert side[:2] == ['3 to 8', 'flat side 8.4 x 9.81 mm']
    assert [flat[-2], side[-2]] == ['620', '380']
    assert [flat[-1].values, side[-1].values] == [(31,), (pytest.approx(38 / 6),)]


@pytest.mark.parametrize('name', ['t_prism', 'hex_nut'])
def test_table_with_model_ranges_shows_them_in_80_columns(part, lines, name):
    shape = part(name)
    aspects = find_aspects(shape)
    counts = np.full(len(aspects), 150)
    counts[-1] = 1
    found = with_model_range(dataclasses.replace(no_drops(aspects), counts=counts, failed=3))
    for each, rows in ((False, found.by_class()), (True, found)):
        text = '\n'.join(lines(distribution_table(found, 'title', shape, each=each)))
        for model in rows.model_intervals():
            assert interval_text(model) in text


@pytest.mark.parametrize(
    ('lower', 'probability', 'upper', 'words'),
    [
        (0.251, 0.278, 0.301, ('27.8 %', '25.1 to 30.1 %')),
        (0.27751, 0.278, 0.27849, ('27.800 %', '27.751 to 27.849 %')),
        (0.0, 0.0, 0.0038, ('0 %', '0 to 0.38 %')),
    ],
)
def test_digits_follow_the_width_of_the_interval(lower, probability, upper, words):
    interval = Interval(probability, lower, upper)
    assert (probability_text(interval), interval_text(interval)) == words


def test_texts_of_directions_and_lengths():
    assert direction_text(np.array([-0.0, -0.004, 1.0])) == ' 0.00  0.00 +1.00'
    # The longest length has four digits.
    assert millimetre_texts(np.array([0.01, 0.0138675])) == ['10.00', '13.87']
    assert millimetre_texts(np.array([1.5, 0.25])) == ['1500', '250']


def test_summed_outcomes_have_the_interval_of_their_count(distribution):
    counts = np.array([5493, 0, 2490, 1312, 0])
    same = dataclasses.replace(distribution, counts=counts)
    assert interval_of(distribution, 2780 + 2713) == same.intervals()[0]


def test_document_is_exact(distribution):
    distribution = dataclasses.replace(distribution, unsettled=2)
    run = {'volume': float('nan'), 'inertia': np.array([[0.1 + 0.2, np.inf]]), 'drops': 10**6}
    document = distribution_document(distribution, run)
    text = to_json(document)
    assert json.loads(text) == document
    assert (document['volume'], document['inertia']) == (None, [[0.1 + 0.2, None]])
    assert '-0.0,' not in text.replace('\n', ',')
    assert document['drops'] == 9305  # those counted, not those asked for
    assert (document['unclassified'], document['unsettled'], document['failed']) == (7, 2, 1)
    for written, aspect, count, interval in zip(
        document['aspects'],
        distribution.aspects,
        distribution.counts.tolist(),
        distribution.intervals(),
        strict=True,
    ):
        assert (written['id'], written['count']) == (aspect.id, count)
        for name in ('down_in_part', 'orientation', 'support'):
            assert written[name] == getattr(aspect, name).tolist()
        assert written['com_height'] == aspect.com_height
        assert written['probability'] == interval.probability == count / 9305
        assert (written['lower'], written['upper']) == (interval.lower, interval.upper)
