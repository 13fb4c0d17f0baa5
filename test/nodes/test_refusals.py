"""Invalid requests are rejected with a message, and the nodes continue."""

import math

import pytest
from resting_aspects_interfaces.msg import DropConditions, Status


@pytest.fixture(params=['get_distribution', 'drop_part'])
def refused(request, suite):
    """Send an invalid request in either way; return its status."""

    def refused(**fields):
        if request.param == 'drop_part':
            drop = suite.client.drop(**fields)
            assert (drop.outcome, drop.result.drops) == ('aborted', 0)
            return drop.result.status
        answer = suite.client.ask(**fields)
        assert answer.distribution.drops == 0
        return answer.status

    yield refused
    assert suite.client.ask('tetrahedron', 5).status.code == Status.OK


def test_unknown_part_name(refused):
    status = refused(part='x' * 300)
    assert status.code == Status.UNKNOWN_PART
    assert 'known parts: box_10x20x30, ' in status.message
    assert len(status.message) < 300


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        ({'drops': 2**64 - 1}, f'invalid drops {2**64 - 1}: expected'),
        ({'surface': 'ice'}, "invalid surface 'ice': expected"),
        ({'precision': math.nan}, 'invalid precision nan: expected'),
        ({'conditions': [DropConditions(gravity=-0.5)]}, 'invalid '),
    ],
)
def test_values_out_of_bounds(refused, fields, message):
    status = refused(**fields)
    assert status.code == Status.INVALID
    assert status.message.startswith(message)


def test_invalid_run_id(suite):
    refused = suite.client.drop(drops=5, run_id='../../escape').result
    assert refused.status.code == Status.INVALID
    assert "invalid run_id '../../escape': expected" in refused.status.message
