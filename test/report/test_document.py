"""The document is JSON, complete, and not rounded."""

import json
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.statistics.distribution import Distribution


class Side(IntEnum):
    LEFT = 0


@dataclass(frozen=True)
class Conditions:
    height: float
    side: Side


@pytest.fixture(scope='module')
def distribution(part):
    aspects = find_aspects(part('l_bracket'))
    return Distribution(aspects, np.array([278, 271, 249, 131, 0]), 1, 2, 3)


def test_numbers_match_the_distribution(distribution):
    document = distribution_document(distribution, {'time_step': 1 / 3})
    text = to_json(document)
    assert json.loads(text) == document
    assert '-0.0,' not in text.replace('\n', ',')
    assert document['drops'] == 935
    assert (document['unclassified'], document['unsettled'], document['failed']) == (1, 2, 3)
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
        assert written['probability'] == interval.probability == count / 935
        assert (written['lower'], written['upper']) == (interval.lower, interval.upper)


def test_run_values_become_plain_types(distribution):
    given = {
        'conditions': Conditions(0.06, Side.LEFT),
        'volume': float('nan'),
        'inertia': np.array([[1.0, np.inf]]),
        'seed': np.uint64(2**64 - 1),
        'drops': 10**6,
    }
    written = json.loads(to_json(distribution_document(distribution, given)))
    assert written['conditions'] == {'height': 0.06, 'side': 'LEFT'}
    assert (written['volume'], written['inertia']) == (None, [[1.0, None]])
    assert written['seed'] == 2**64 - 1
    assert written['drops'] == distribution.drops  # those counted, not those asked for
