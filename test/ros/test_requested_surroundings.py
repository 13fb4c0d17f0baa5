"""Surroundings of goals and requests: files of a folder, values, and no paths."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import Surroundings

import resting_aspects_ros as ra
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.conversions import conditions_msg, surroundings_msg
from resting_aspects_ros.ros.requests import RequestedSurroundings
from resting_aspects_ros.simulation.surroundings import changed_surroundings


async def run(function, *arguments):
    """Run a function at once, in this process."""
    return function(*arguments)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'ramp.yaml').write_text('kind: slope\nangle: 20deg\n')
    (tmp_path / 'broken.yaml').write_text('kind: slope\nangle: 200deg\n')
    (tmp_path / 'plate.yaml').write_text('kind: mesh\nmesh: plate.obj\nunit: mm\n')
    (tmp_path / 'plate.obj').write_text('v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3\nf 1 3 4\n')
    return tmp_path


@pytest.fixture
def requested(folder):
    node = SimpleNamespace(get_name=lambda: 'drop_simulator')
    return RequestedSurroundings(node, str(folder), SimpleNamespace(run=run))


def ask(requested, surfaces, around):
    """The surroundings of a request: by their name, or with the values of a message."""
    if isinstance(around, str):
        request = SimpleNamespace(conditions=[], surface='steel', surroundings=around)
    else:
        message = conditions_msg(surfaces.get('steel'))
        message.surroundings = around
        request = SimpleNamespace(conditions=[message], surface='', surroundings='')
    found = asyncio.run(requested.conditions(surfaces, request, surfaces.get()))
    assert found.values() == surfaces.get('steel').values()
    return found.surroundings


def test_a_name_is_a_file_of_the_folder(requested, surfaces):
    for around in ('ramp', Surroundings(name='ramp')):
        found = ask(requested, surfaces, around)
        assert found == ra.surroundings('slope', angle='20deg')
        assert found.name == 'ramp'
    assert ask(requested, surfaces, '') is None
    # Values come before a name.
    given = Surroundings(kind='slope', name='ramp', names=['angle'], values=[0.25])
    assert ask(requested, surfaces, given) == ra.surroundings('slope', angle=0.25)


@pytest.mark.parametrize(
    ('around', 'expected'),
    [
        ('swamp', "invalid surroundings 'swamp': expected one of broken, plate, ramp"),
        ('../ramp', 'expected one of'),
        ('broken', 'invalid angle'),
        (Surroundings(name='ramp', orientation=[Quaternion()]), 'invalid kind of surroundings'),
    ],
)
def test_invalid_surroundings(requested, surfaces, around, expected):
    with pytest.raises(InvalidValueError) as caught:
        ask(requested, surfaces, around)
    assert expected in str(caught.value)


def test_a_message_never_reads_a_path(requested, surfaces, folder):
    mesh = str(folder / 'plate.obj')
    given = Surroundings(kind='mesh', mesh=mesh, mesh_sha256='0' * 64)
    with pytest.raises(InvalidValueError, match='surroundings_folder of drop_simulator'):
        ask(requested, surfaces, given)


def test_a_message_may_have_a_mesh_of_the_folder(requested, surfaces, folder):
    plate = ra.surroundings(folder / 'plate.yaml')
    given = surroundings_msg(plate)
    assert str(folder) not in repr(given)
    found = ask(requested, surfaces, given)
    assert (found, found.known) == (plate, True)
    raised = ask(requested, surfaces, surroundings_msg(changed_surroundings(plate, {'z': 0.1})))
    np.testing.assert_allclose(raised.shape.vertices[:, 2], plate.shape.vertices[:, 2] + 0.1)
