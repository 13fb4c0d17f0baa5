"""Surroundings and contacts with them as ROS messages, through real CDR."""

import dataclasses

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import Surroundings
from wire import over_the_wire

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import without_drops
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import CORNER, EDGE, NONE, SIDE
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros import conversions
from resting_aspects_ros.ros.conversions import (
    description_msg,
    serialized_surroundings,
    surroundings_msg,
    surroundings_of,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_from, distribution_msg
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import make_surroundings, surroundings_names
from resting_aspects_ros.statistics.distribution import Distribution, Placement, Placements

RADIUS = 0.02


def run_in(found, surfaces):
    conditions = dataclasses.replace(surfaces.get(), surroundings=found)
    return RunDescription(
        'id1', 'l_bracket', 'ab' * 32, conditions, 1, 0, 10, 0.0, 'bullet', '3', '1', 1e-4, 7
    )


def described(found, surfaces, *frame):
    run = run_in(found, surfaces)
    return description_msg(run, found.scene(run.conditions, RADIUS), *frame)


@pytest.fixture
def ramp(tmp_path):
    """Surroundings of a mesh: a square in the plane z = x / 2, in mm."""
    corners = [(-100, -100, -50), (100, -100, 50), (100, 100, 50), (-100, 100, -50)]
    lines = [f'v {x} {y} {z}' for x, y, z in corners] + ['f 1 2 3', 'f 1 3 4']
    (tmp_path / 'ramp.obj').write_text('\n'.join(lines))
    (tmp_path / 'ramp.yaml').write_text('kind: mesh\nmesh: ramp.obj\nunit: mm\nz: 10 mm\n')
    return ra.surroundings(tmp_path / 'ramp.yaml')


def test_planes_are_sent_in_the_tray_frame(surfaces):
    found = ra.surroundings('l_chute', roll='30deg', belt={'speed': 0.2})
    message = over_the_wire(described(found, surfaces, 'cell'))
    assert message.header.frame_id == 'cell'
    belt, wall = message.bodies
    assert (belt.name, wall.name) == ('belt', 'wall')
    assert (belt.friction, wall.friction) == (0.4, 0.2)
    # The chute is rolled about x by 30 degrees: belt and wall stay perpendicular.
    one, other = np.array(belt.plane[0].coef), np.array(wall.plane[0].coef)
    assert one[2] == pytest.approx(np.cos(np.radians(30)))
    assert abs(one[1]) == pytest.approx(np.sin(np.radians(30)))
    assert one[:3] @ other[:3] == pytest.approx(0, abs=1e-12)
    velocity = np.array([belt.velocity.x, belt.velocity.y, belt.velocity.z])
    assert np.linalg.norm(velocity) == pytest.approx(0.2)
    assert velocity @ one[:3] == pytest.approx(0, abs=1e-12)
    assert serialized_surroundings(serialize_message(message)).key == found.key


def test_a_block_is_sent_as_a_closed_mesh_that_points_outward(surfaces):
    found = ra.surroundings('bowl_track')
    run = run_in(found, surfaces)
    scene = found.scene(run.conditions, RADIUS)
    message = over_the_wire(description_msg(run, scene))
    block, body = next((b, m) for b, m in zip(scene.bodies, message.bodies, strict=True) if m.mesh)
    points = np.array([[p.x, p.y, p.z] for p in body.mesh[0].vertices])
    a, b, c = (points[[t.vertex_indices[k] for t in body.mesh[0].triangles]] for k in range(3))
    volume = float(np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6)
    assert volume == pytest.approx(float(np.prod(block.high - block.low)))


def test_a_mesh_travels_in_the_message(ramp, surfaces):
    message = over_the_wire(described(ramp, surfaces))
    points = np.array([[p.x, p.y, p.z] for p in message.bodies[0].mesh[0].vertices])
    np.testing.assert_allclose(points[:, 2], points[:, 0] / 2 + 0.01, atol=1e-12)
    again = serialized_surroundings(serialize_message(message))
    assert again.key == ramp.key
    np.testing.assert_array_equal(again.shape.vertices, ramp.shape.vertices)
    message.mesh = bytes(message.mesh).replace(b'-100', b'-200')
    with pytest.raises(InvalidValueError, match='expected the hash'):
        serialized_surroundings(serialize_message(message))


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ({'kind': 'chute', 'names': ['roll'], 'values': [9.0]}, 'invalid roll'),
        ({'kind': 'chute', 'names': ['belt.sped'], 'values': [0.1]}, "'sped'"),
        ({'kind': 'chute', 'names': ['roll'] * 2, 'values': [0.1, 0.2]}, 'expected 2 different'),
        ({'kind': 'chute', 'orientation': [Quaternion(w=2.0)]}, 'expected a unit quaternion'),
        ({'kind': 'mesh', 'mesh': '/etc/passwd'}, 'invalid mesh_sha256'),
    ],
)
def test_bad_surroundings_are_rejected(surfaces, fields, expected):
    message = conversions.conditions_msg(surfaces.get())
    message.surroundings = Surroundings(**fields)
    with pytest.raises(InvalidValueError, match=expected):
        conversions.conditions_from(over_the_wire(message))


def test_all_surroundings_survive_a_message():
    for name in surroundings_names():
        found = ra.surroundings(name)
        again = surroundings_of(over_the_wire(surroundings_msg(found)))
        assert again == (None if found.level else found)
    values = {'bodies': {'wall': {'friction': 0.3}}, 'release': {'y_min': -0.01, 'y_max': 0.02}}
    for given in np.random.default_rng(1).standard_normal((100, 4)):
        turned = given / np.linalg.norm(given)
        found = make_surroundings({'kind': 'wall', **values, 'orientation': turned}, 'mine')
        again = surroundings_of(over_the_wire(surroundings_msg(found)))
        assert (again, again.name) == (found, 'mine')


def test_values_that_are_left_out_have_their_defaults(surfaces):
    message = conversions.conditions_msg(surfaces.get())
    message.surroundings = Surroundings(kind='slope', names=['angle'], values=[0.3])
    found = conversions.conditions_from(message)
    assert found.surroundings == ra.surroundings('slope', angle=0.3)
    message.surroundings.values = [0.0]
    assert conversions.conditions_from(message) == surfaces.get()


def test_contacts_round_trip(part, surfaces):
    aspects = find_aspects(part('l_bracket'))
    placements = [
        Placement((1, 2), np.array([0, 0, 0.6, 0.8]), 5, 1),
        Placement((2, NONE), np.array([0.6, 0, 0, 0.8]), 4, 2),
        Placement((SIDE, EDGE), np.array([0, 0.6, 0, 0.8]), 2, 3),
        Placement((CORNER, 1), np.array([0, 0, 0, 1.0]), 1, 4),
    ]
    contacts = Placements(('belt', 'wall'), placements, drops=20, uncounted=1)
    counted = Distribution(aspects, np.array([9, 4, 0, 0, 3]), 2, 1, 1, contacts=contacts)
    run = run_in(ra.surroundings('l_chute'), surfaces)
    message = over_the_wire(distribution_msg(counted, run, conversions.time_msg(0), complete=True))
    sent = [list(each.contacts) for each in message.contacts]
    assert sent == [[1, 2], [2, 0], [-1, -2], [-3, 1]]
    assert message.contacts[0].probability == 5 / 20
    assert message.contacts[0].lower < 5 / 20 < message.contacts[0].upper
    again = distribution_from(message).contacts
    assert (again.planes, again.drops, again.uncounted) == (('belt', 'wall'), 20, 1)
    for one, other in zip(again.placements, placements, strict=True):
        for field in dataclasses.fields(other):
            one_value, other_value = getattr(one, field.name), getattr(other, field.name)
            np.testing.assert_array_equal(one_value, other_value)
    message.contacts[0].contacts = [99, 0]
    with pytest.raises(InvalidValueError, match='expected a code from -3 to'):
        distribution_from(message)


def test_drops_on_an_unknown_mesh_are_counted_as_on_a_plane(ramp, part, surfaces):
    given = find_aspects(part('l_bracket'))
    sent = run_in(ramp, surfaces).conditions
    conditions = conversions.conditions_from(conversions.conditions_msg(sent))
    assert conditions == sent
    assert not conditions.surroundings.known  # without the mesh
    assert without_drops(part('l_bracket'), conditions, given) == (given, None)
