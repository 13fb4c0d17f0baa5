"""Invalid requests are rejected with a message, and the nodes continue."""

import math

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.ros.conversions import conditions_msg


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


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize('name', ['no_such_part', 'x' * 300])
def test_unknown_part_name(refused, name):
    status = refused(part=name)
    assert status.code == Status.UNKNOWN_PART
    assert 'known parts: box_10x20x30, ' in status.message
    assert len(status.message) < 300


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        ({'drops': 2**64 - 1}, f'invalid drops {2**64 - 1}: expected'),
        ({'surface': 'ice'}, "invalid surface 'ice': expected"),
        ({'precision': math.nan}, 'invalid precision nan: expected'),
        ({'gravity': -0.5}, 'invalid gravity -0.5: expected'),
    ],
)
def test_values_out_of_bounds(refused, surfaces, fields, message):
    if 'gravity' in fields:
        conditions = conditions_msg(surfaces.get())
        conditions.gravity = fields['gravity']
        fields = {'conditions': [conditions]}
    status = refused(**fields)
    assert status.code == Status.INVALID
    assert status.message.startswith(message)


def test_invalid_run_id(suite):
    refused = suite.client.drop(drops=5, run_id='../../escape').result
    assert refused.status.code == Status.INVALID
    assert "invalid run_id '../../escape': expected" in refused.status.message
