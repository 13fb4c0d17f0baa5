"""Invalid requests are rejected with a message, and the nodes continue."""

import math
import shutil

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.simulation.conditions import parts_folder

NAMES = ('OK', 'INVALID', 'UNKNOWN_PART', 'NOT_AVAILABLE', 'BUSY', 'CANCELED', 'FAILED')
KINDS = {getattr(Status, name): name for name in NAMES}


@pytest.fixture(scope='module')
def suite(fresh_suite, tmp_path_factory):
    """Start a suite with a good and a broken part."""
    folder = tmp_path_factory.mktemp('parts')
    shutil.copy(parts_folder() / 'tetrahedron.stl', folder)
    whole = (folder / 'tetrahedron.stl').read_bytes()
    (folder / 'cut_short.stl').write_bytes(whole[:-20])
    quiet = {'nodes.aspect_classifier.known.QUIET_PERIOD': 1.0}
    return fresh_suite({'aspect_classifier': quiet}, parts_folder=folder)


@pytest.fixture(params=['get_distribution', 'drop_part'])
def refused(request, suite):
    """Send an invalid request in either way; return the status name and the message."""

    def refused(**fields):
        if request.param == 'drop_part':
            drop = suite.client.drop(**fields)
            assert drop.outcome == 'aborted'
            assert drop.result.drops == 0
            status = drop.result.status
        else:
            if 'seed' in fields:
                fields['seed'] = [fields['seed']]
            answer = suite.client.ask(**fields)
            status = answer.status
            assert answer.distribution.drops == 0
        return KINDS[status.code], status.message

    yield refused
    assert suite.client.ask('tetrahedron', 5).status.code == Status.OK


@pytest.mark.parametrize(
    'name',
    ['no_such_part', '../x', '', 'x' * 300, 'tetrahedron\n'],
)
def test_unknown_part_name(refused, name):
    kind, message = refused(part=name)
    assert kind == 'UNKNOWN_PART'
    assert ' is not known; known parts: cut_short, tetrahedron' in message
    assert len(message) < 300


@pytest.mark.parametrize('drops', [0, 2**64 - 1])
def test_drops_out_of_bounds(refused, drops):
    message = f'invalid drops {drops}: expected an integer from 1 to 2000000'
    assert refused(drops=drops) == ('INVALID', message)


@pytest.mark.parametrize('value', [math.nan, -0.5])
@pytest.mark.parametrize('name', ['friction', 'gravity'])
def test_conditions_out_of_bounds(refused, surfaces, name, value):
    conditions = conditions_msg(surfaces.get())
    setattr(conditions, name, value)
    kind, message = refused(conditions=[conditions])
    assert kind == 'INVALID'
    assert message.startswith(f'invalid {name} {value!r}: expected ')


def test_unknown_surface(refused):
    assert refused(surface='ice') == (
        'INVALID',
        "invalid surface 'ice': expected one of rubber_mat, steel, thrown",
    )


@pytest.mark.parametrize('precision', [0.9, math.nan])
def test_precision_out_of_bounds(refused, precision):
    kind, message = refused(precision=precision)
    assert (kind, message) == (
        'INVALID',
        f'invalid precision {precision!r}: expected 0.001 to 0.25',
    )


@pytest.mark.parametrize('run_id', ['../../escape', 'x' * 65])
def test_invalid_run_id(suite, run_id):
    refused = suite.client.drop(drops=5, run_id=run_id).result
    assert refused.status.code == Status.INVALID
    assert f'invalid run_id {run_id!r}: expected up to 64 letters' in refused.status.message
