"""The document is JSON, complete, and not rounded."""

import json

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.statistics.distribution import Distribution


@pytest.fixture(scope='module')
def distribution(part):
    aspects = find_aspects(part('l_bracket'))
    return Distribution(aspects, np.array([278, 271, 249, 131, 0]), 1, 2, 3)


def test_numbers_match_the_distribution(distribution):
    run = {'volume': float('nan'), 'inertia': np.array([[0.1 + 0.2, np.inf]]), 'drops': 10**6}
    document = distribution_document(distribution, run)
    text = to_json(document)
    assert json.loads(text) == document
    assert (document['volume'], document['inertia']) == (None, [[0.1 + 0.2, None]])
    assert '-0.0,' not in text.replace('\n', ',')
    assert document['drops'] == 935  # those counted, not those asked for
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
