"""The table says what the distribution is, in 80 columns."""

import dataclasses
import re

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
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

ROW = re.compile(
    r'^ *(?P<id>\d[\d ,.a-z]*?)?  +(?P<words>[a-z].*?)  +'
    r'(?P<down>[-+ ]\d\.\d\d [-+ ]\d\.\d\d [-+ ]\d\.\d\d)? *'
    r'(?P<probability>[\d.]+|-)(?: %)? +(?P<lower>[\d.]+) to (?P<upper>[\d.]+) % +(?P<count>\d+)'
    r'(?: +(?P<each>[\d.]+) %)? *$'
)


@pytest.fixture(scope='module')
def aspects(part):
    return find_aspects(part('l_bracket'))


@pytest.fixture
def rows(lines):
    """Return the rows of the table of a distribution."""

    def found(distribution, part=None, **options):
        shown = lines(distribution_table(distribution, 'a title', part, **options))
        matches = (ROW.match(line) for line in shown)
        return [row.groupdict(default='') for row in matches if row]

    return found


def half_digit(text):
    return 0.5 * 10.0 ** -len(text.partition('.')[2]) + 1e-9


def test_rows_match_the_distribution(aspects, rows):
    distribution = Distribution(aspects, np.array([2780, 2713, 2490, 1312, 0]), 7, 0, 1)
    found = rows(distribution, each=True)
    assert [row['id'] for row in found] == ['1', '2', '3', '4', '5', '', '']
    assert [row['count'] for row in found] == ['2780', '2713', '2490', '1312', '0', '7', '1']
    assert [row['words'] for row in found[5:]] == ['unclassified', 'failed']
    for row, aspect, interval in zip(found, aspects, distribution.intervals(), strict=False):
        for name in ('probability', 'lower', 'upper'):
            shown = row[name]
            assert float(shown) == pytest.approx(
                100 * getattr(interval, name), abs=half_digit(shown)
            )
        direction = [float(number) for number in row['down'].split()]
        assert direction == pytest.approx(aspect.down_in_part.tolist(), abs=0.005 + 1e-9)
    never = found[4]
    assert (never['probability'], never['lower']) == ('0', '0')
    z2, n = 3.8415, distribution.drops
    assert float(never['upper']) == pytest.approx(100 * z2 / (n + z2), abs=0.005)


def test_equivalent_aspects_are_summed_in_one_row(part, rows):
    nut = part('hex_nut')
    counts = np.array([300, 320, 60, 65, 70, 50, 55, 80])
    distribution = Distribution(find_aspects(nut), counts, 0, 0, 0)
    flat, side = rows(distribution, part=nut)
    assert (flat['id'], flat['words']) == ('1 and 2', 'flat side 17 x 19.6 mm')
    assert (side['id'], side['words']) == ('3 to 8', 'flat side 8.4 x 9.81 mm')
    assert [flat['count'], side['count']] == ['620', '380']
    for row, each in ((flat, 62 / 2), (side, 38 / 6)):
        assert float(row['each']) == pytest.approx(each, abs=half_digit(row['each']))


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


def test_direction_text_has_no_minus_zero():
    assert direction_text(np.array([-0.0, -0.004, 1.0])) == ' 0.00  0.00 +1.00'
    assert direction_text(np.array([0.5547, -0.83205, -0.005001])) == '+0.55 -0.83 -0.01'


def test_longest_length_has_four_digits():
    assert millimetre_texts(np.array([0.01, 0.0138675])) == ['10.00', '13.87']
    assert millimetre_texts(np.array([0.0008, 0.00799])) == ['0.800', '7.990']
    assert millimetre_texts(np.array([1.5, 0.25])) == ['1500', '250']


def test_summed_outcomes_have_the_interval_of_their_count(aspects):
    distribution = Distribution(aspects, np.array([10, 20, 30, 40, 0]), 5, 3, 2)
    same = dataclasses.replace(distribution, counts=np.array([30, 0, 30, 40, 0]))
    assert interval_of(distribution, 30) == same.intervals()[0]
