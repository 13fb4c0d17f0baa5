"""Round trips between the types of the suite and ROS messages, through real CDR."""

import dataclasses
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import FeederAction, Outline, Surroundings
from resting_aspects_interfaces.srv import IdentifyPart
from scipy.stats import binomtest
from wire import over_the_wire

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_actions, without_drops
from resting_aspects_ros.api.identify import identify_part, known_part
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.aspects.support import CORNER, EDGE, NONE, SIDE
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.report.outlines import outlines_document
from resting_aspects_ros.ros import conversions
from resting_aspects_ros.ros.conversions import (
    candidate_msg,
    description_msg,
    outlines_msg,
    polygon_from,
    polygon_msgs,
    run_from,
    serialized_surroundings,
    surroundings_msg,
    surroundings_of,
    time_msg,
)
from resting_aspects_ros.ros.distribution_conversions import (
    action_from,
    action_msg,
    check_transitions,
    distribution_from,
    distribution_msg,
    estimate_msg,
    probability_of,
    serialized_transitions,
    transition_matrix_from,
    transitions_msg,
)
from resting_aspects_ros.simulation.actions import Kick, NamedAction
from resting_aspects_ros.simulation.conditions import MAX_SEED, DropConditions, HeightOf
from resting_aspects_ros.simulation.job import RunDescription, plan_run
from resting_aspects_ros.simulation.surroundings import make_surroundings, surroundings_names
from resting_aspects_ros.statistics.distribution import Distribution, Placement, Placements
from resting_aspects_ros.statistics.model_range import Draws, with_model_range
from resting_aspects_ros.statistics.poses import DecidedBy, RestStatus
from resting_aspects_ros.statistics.poses import RestingPoses as Poses
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix
from resting_aspects_ros.vision.identification import observed_polygon

# Each field has a distinct value, so that swapped fields are detected.
CONDITIONS = DropConditions(
    height=0.11,
    restitution=0.12,
    friction=0.13,
    rolling_friction=0.014,
    spinning_friction=0.15,
    gravity=0.16,
    speed_horizontal=0.17,
    speed_vertical=0.18,
    spin=0.19,
    height_of=HeightOf.CENTRE_OF_MASS,
    surface='felt',
    surroundings=ra.surroundings('l_chute', roll=0.7, belt={'speed': 0.2}),
)
RUN = RunDescription(
    *('4f1c', 'l_bracket', 'ab' * 32, CONDITIONS),
    *(MAX_SEED, 3, 2_000_000, 0.01),
    *('bullet', '3.2.7', '0.9.1', 1e-4, 1_795_233_147_000_000_023),
)
POSES = Poses(
    first_drop=2**40,
    position=np.arange(1.0, 16.0).reshape(5, 3) / 10,
    orientation=np.tile([0.1, -0.3, 0.5, 0.65**0.5], (5, 1)),
    status=np.array(list(RestStatus), dtype=np.uint8),
    decided_by=np.array([DecidedBy.ENERGY, *[DecidedBy.STILLNESS] * 4], dtype=np.uint8),
    time_to_rest=np.array([0.7, 1.9, math.nan, 0.3, 2.0]),
    energy_growth=np.array([0.0, 0.02, 0.4, 0.01, 0.03]),
)


@pytest.mark.parametrize('count', [0, 5, 2 * conversions.MAX_POSES + 1])
def test_run_and_poses_round_trip(assert_same_poses, count):
    given = {name: getattr(POSES, name) for name in conversions.POSE_COLUMNS}
    columns = {name: np.resize(each, (count, *each.shape[1:])) for name, each in given.items()}
    poses = dataclasses.replace(POSES, **columns)
    sent = conversions.poses_msgs(poses, RUN, time_msg(17), last=True)
    messages = [over_the_wire(each) for each in sent]
    assert len(messages) == max(1, -(-count // conversions.MAX_POSES))
    assert [each.last for each in messages] == [False] * (len(messages) - 1) + [True]
    assert_same_poses(Poses.join([conversions.poses_from(each) for each in messages]), poses)
    for each in messages:
        assert (each.header.stamp, each.header.frame_id) == (time_msg(17), 'tray')
        assert (each.run.started.sec, each.run.started.nanosec) == (1_795_233_147, 23)
        assert run_from(each.run) == RUN


@pytest.mark.parametrize(
    ('field', 'change', 'expected'),
    [
        ('position', lambda found: found.append(0), 'invalid number of values'),
        ('orientation', lambda found: found.__setitem__(3, 1.01), 'of drop 1099511627776'),
        ('position', lambda found: found.__setitem__(2, math.inf), 'invalid position'),
        ('status', lambda found: found.__setitem__(0, 77), 'invalid status 77 of drop 10995'),
    ],
)
def test_invalid_poses_are_rejected(field, change, expected):
    (message,) = conversions.poses_msgs(POSES, RUN, time_msg(0), last=True)
    message.status[0] = RestStatus.SETTLED
    change(getattr(message, field))
    with pytest.raises(InvalidValueError, match=re.escape(expected)):
        conversions.poses_from(message)


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('run_id', '../../tmp/evil'),
        ('part', '../../etc/x'),
        ('drops', 0),
        ('first_drop', MAX_SEED),
    ],
)
def test_invalid_run_description_is_rejected(field, value):
    message = conversions.run_msg(RUN)
    setattr(message, field, value)
    with pytest.raises(InvalidValueError, match=': expected '):
        run_from(message)


@pytest.mark.parametrize(
    ('field', 'value', 'expected'),
    [
        ('confidence', 7.0, 'invalid confidence 7.0: expected'),
        ('failed', 1, 'expected 1010 drops in aspects numbered from 1'),
        ('aspects', [], '0 drops in aspects []'),
    ],
)
def test_inconsistent_distribution_is_rejected(part, field, value, expected):
    aspects = find_aspects(part('tetrahedron'))
    counted = Distribution(aspects, np.array([1010, 0, 0, 0]), 0, 0, 0)
    message = distribution_msg(counted, RUN, time_msg(0), complete=True)
    setattr(message, field, value)
    with pytest.raises(InvalidValueError, match=re.escape(expected)):
        distribution_from(message)


def test_part_round_trip(part):
    original = part('l_bracket')
    message = over_the_wire(conversions.part_msg(original))
    again = conversions.part_from(message)
    assert again.part_sha256 == original.part_sha256 == message.part_sha256
    for name in ('centre_of_mass', 'inertia', 'hull_vertices'):
        np.testing.assert_array_equal(getattr(again, name), getattr(original, name))
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = original.inertia.tolist()
    sent = [getattr(message.inertia, name) for name in conversions.INERTIA]
    assert sent == [ixx, ixy, ixz, iyy, iyz, izz]


def test_distribution_round_trip(part):
    aspects = find_aspects(part('l_bracket'))
    counts = np.arange(10, 10 + len(aspects))
    without = Distribution(
        aspects, counts, unclassified=1, unsettled=2, failed=3, lost=4, sliding=5
    )
    draws = Draws(np.tile(np.arange(len(aspects) + 1), (8, 9)), ('friction',))
    original = with_model_range(without, draws)
    stamp = time_msg(17)
    message = over_the_wire(distribution_msg(original, RUN, stamp, complete=True))
    assert (message.header.stamp, message.header.frame_id) == (stamp, 'tray')
    assert (message.complete, message.drops) == (True, counts.sum() + 15)
    assert message.run == conversions.run_msg(RUN)
    again = distribution_from(message)
    assert again.model.uncertain == ('friction',)
    np.testing.assert_array_equal(again.model.by_aspect, original.model.by_aspect)
    np.testing.assert_array_equal(again.model.by_class, original.model.by_class)
    message = over_the_wire(distribution_msg(without, RUN, stamp, complete=True))
    assert distribution_from(message).model is None
    assert again.counts.tolist() == counts.tolist()
    assert (again.unclassified, again.unsettled, again.failed) == (1, 2, 3)
    assert (again.lost, again.sliding, again.contacts) == (4, 5, None)
    for one, other in zip(again.aspects, aspects, strict=True):
        for field in dataclasses.fields(other):
            expected = getattr(other, field.name)
            if field.name == 'support':  # a geometry_msgs/Polygon: float32
                expected = expected.astype(np.float32)
            np.testing.assert_array_equal(getattr(one, field.name), expected)


def test_probability_of_several_aspects(part):
    shape = part('l_bracket')
    aspects = find_aspects(shape)
    counted = Distribution(aspects, np.array([70, 60, 50, 40, 30]), 0, 0, 0)
    run = dataclasses.replace(RUN, precision=0.0)
    found = distribution_msg(counted, run, time_msg(1), complete=True)
    share = probability_of(found, [1, 4, 4])
    of_sum = binomtest(110, 250)
    wilson = of_sum.proportion_ci(method='wilson')
    expected = pytest.approx((of_sum.statistic, wilson.low, wilson.high), abs=1e-12)
    assert (share.probability, share.lower, share.upper) == expected
    prediction = estimate(RestingShape(shape, aspects), 'rolling')
    predicted = estimate_msg(prediction, shape, time_msg(1))
    share = probability_of(predicted, (4, 1))
    assert share.probability == pytest.approx(prediction.probabilities[[0, 3]].sum())
    with pytest.raises(InvalidValueError, match='invalid aspect 6: expected 1 to 5'):
        probability_of(predicted, [1, 6])


# -- surroundings and contacts with them ----------------------------------------------------------


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
    message = over_the_wire(distribution_msg(counted, run, time_msg(0), complete=True))
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


# -- actions and transitions ----------------------------------------------------------------------


ACTION = NamedAction('own_tap', Kick(speed=0.31, spin=11.0), 0.7)


@pytest.fixture(scope='module')
def result(part, surfaces):
    """Return a result with the given counts of the tetrahedron."""
    tetrahedron = part('tetrahedron')
    aspects = find_aspects(tetrahedron)
    _, run = plan_run(
        tetrahedron, surfaces.get(), seed=3, drops=400, run_id='4f1c', started=10**18
    )

    def result(counts, dropped=(5, 6, 7, 8), **changes):
        matrix = TransitionMatrix(aspects, np.array(counts), energy_growth=0.02, **changes)
        drop = Distribution(aspects, np.array(dropped), unclassified=1, unsettled=2, failed=3)
        return ReorientResult(matrix, ACTION, run, tetrahedron, drop, True)

    return result


@pytest.fixture(scope='module')
def message(result):
    """Return the message of distinct counts, as received."""
    made = result(np.arange(1, 33).reshape(4, 8), confidence=0.9, sliding=5)
    return over_the_wire(transitions_msg(made, time_msg(17), ended=False, frame='cell'))


def test_action_round_trip():
    shipped = shipped_actions()
    for action in (*map(shipped.get, shipped.names()), ACTION):
        message = over_the_wire(action_msg(action))
        assert message.name == action.name
        assert action_from(message).values == action.values
    rows = list(zip(message.names, message.values, message.units, strict=True))
    assert rows[0] == ('time', 0.7, 's')
    assert {('speed', 0.31, 'm/s'), ('spin', 11.0, 'rad/s')} <= set(rows)


def test_matrix_round_trip(message, result):
    made = result(np.arange(1, 33).reshape(4, 8), confidence=0.9)
    assert [getattr(message, name.upper()) for name in OUTCOMES] == list(range(message.OUTCOMES))
    assert list(message.long_run) == []
    assert (message.header.stamp, message.header.frame_id) == (time_msg(17), 'cell')
    assert (message.complete, message.ended) == (True, False)
    assert run_from(message.run) == made.run
    assert action_from(message.action) == ACTION
    assert list(message.actions) == made.matrix.actions.tolist()
    sent = [
        np.reshape(each, (4, 8)) for each in (message.probability, message.lower, message.upper)
    ]
    np.testing.assert_array_equal(sent, [made.matrix.probability, *made.matrix.bounds()])
    again = transition_matrix_from(message)
    np.testing.assert_array_equal(again.counts, made.matrix.counts)
    assert (again.interval, again.confidence) == ('wilson', 0.9)
    assert (again.energy_growth, again.sliding) == (0.02, 5)
    assert again.aspects.part_sha256 == made.part.part_sha256
    # The aspects have the counts of the drops.
    assert message.drops == made.drop.drops == 32
    assert [aspect.count for aspect in message.aspects] == [5, 6, 7, 8]


def test_long_run_describes_each_closed_class(result):
    """Aspects 1 and 2 alternate, 3 stays, and parts leave 4 for both; none is dropped into 3."""
    counts = np.zeros((4, 8), dtype=int)
    counts[0, 1] = counts[1, 0] = counts[2, 2] = 10
    counts[3, [0, 2]] = 5
    made = result(counts, dropped=(1, 0, 0, 1))
    bounded = (made.long_run, *made.long_run_bounds)
    message = over_the_wire(transitions_msg(made, time_msg(1), ended=True, long_run=bounded))
    np.testing.assert_allclose(message.long_run, [0.375, 0.375, 0.25, 0])
    assert list(message.closed_class) == [1, 1, 2, 0]
    np.testing.assert_allclose(message.closed_class_share, [0.5, 0.5, 1, 0])
    np.testing.assert_allclose(message.closed_class_weight, [0.75, 0.25])
    sent = (message.long_run_lower, message.long_run_upper)
    np.testing.assert_array_equal(sent, made.long_run_bounds)


@pytest.mark.parametrize(
    ('field', 'value', 'expected'),
    [
        ('counts', [1] * 31, 'invalid transition matrix of run '),
        ('aspects', [], 'expected a row for each aspect'),
        ('confidence', 7.0, 'invalid confidence 7.0: expected'),
        ('aspect_numbering', ASPECT_NUMBERING + 1, f'expected {ASPECT_NUMBERING}'),
        ('action', FeederAction(kind='no_kind'), 'invalid kind of action'),
        ('action', FeederAction(kind='kick', values=[1.0]), 'expected a different one for each'),
        ('action', FeederAction(kind='kick', values=[1.0], names=['mass']), 'invalid value'),
    ],
)
def test_inconsistent_matrix_is_rejected(message, field, value, expected):
    changed = over_the_wire(message)
    setattr(changed, field, value)
    assert serialized_transitions(serialize_message(message)) == message
    with pytest.raises(InvalidValueError, match=expected):
        serialized_transitions(serialize_message(changed))
    with pytest.raises(InvalidValueError, match='of part tetrahedron: expected l_bracket'):
        check_transitions(message, 'l_bracket')


# -- outlines and identified parts ----------------------------------------------------------------


# Rounding of a coordinate to 32 bits, for parts of some cm, m.
ROUNDING = 1e-8


def corners(polygon):
    return np.array([(p.x, p.y) for p in polygon.points])


@pytest.mark.slow
def test_message_contains_all_fields_of_the_document(part):
    result = ra.outlines(part('hex_nut'))
    first, *others = result.outlines
    # As of a part that rocks.
    outlines = (dataclasses.replace(first, family=(others[0].polygon, first.polygon)), *others)
    message = over_the_wire(outlines_msg(result.part, outlines, result.look_alikes))
    document = outlines_document(result.part, outlines, result.look_alikes)
    assert (message.part, message.part_sha256) == (document['part'], document['part_sha256'])
    assert len(message.outlines) == len(document['outlines'])
    for found, expected in zip(message.outlines, document['outlines'], strict=True):
        orientation = [getattr(found.orientation, axis) for axis in 'xyzw']
        assert orientation == expected.pop('orientation')
        assert [found.centroid.x, found.centroid.y] == expected.pop('centroid')
        assert list(found.aspects) == expected.pop('aspects')
        check_rings(found, expected)
        for k, other in enumerate(expected.pop('family')):
            of = zip(found.family_holes, found.family_hole_of, strict=True)
            holes = [hole for hole, outline in of if outline == k]
            check_rings(SimpleNamespace(outer=found.family[k], holes=holes), other)
        for k, other in enumerate(expected.pop('look_alike')):
            assert found.other_class[k] == other['symmetry_class']
            assert found.other_overlap[k] == other['overlap']
            assert found.other_verdict[k] == getattr(Outline, other['verdict'].upper())
            assert found.other_resolution[k] == other['resolution']
        expected.pop('mirrored')  # those with the verdict
        assert {name: getattr(found, name) for name in expected} == expected


def check_rings(message, fields):
    outer, holes = fields.pop('outer'), fields.pop('holes')
    assert corners(message.outer) == pytest.approx(np.array(outer), abs=ROUNDING)
    assert len(message.holes) == len(holes)
    for found, expected in zip(message.holes, holes, strict=True):
        assert corners(found) == pytest.approx(np.array(expected), abs=ROUNDING)


def test_polygon_with_a_hole_is_sent_unchanged():
    hole = [[0.01, 0.01], [0.01, 0.02], [0.02, 0.02]]
    given = {'outer': [[0, 0], [0.04, 0], [0.04, 0.03], [0, 0.03]], 'holes': [hole]}
    polygon = observed_polygon(given)
    request = over_the_wire(IdentifyPart.Request(**polygon_msgs(polygon)))
    again = observed_polygon(polygon_from(request.outer, request.holes))
    assert len(again.interiors) == 1
    assert again.symmetric_difference(polygon).area < ROUNDING * polygon.length


def test_candidates_contain_all_poses(part):
    known = known_part(part('box_10x20x30'))
    numbers = 'x y yaw overlap distance residual prior posterior symmetry_class'
    for candidate in identify_part(known.outlines[0].polygon, known).candidates:
        found = over_the_wire(candidate_msg(candidate))
        for name in ('part', *numbers.split()):
            assert getattr(found, name) == getattr(candidate, name)
        assert tuple(found.aspects) == candidate.aspects
        assert list(found.pose_aspects) == [each.aspect for each in candidate.poses]
        assert set(found.pose_aspects) == set(candidate.aspects)
        for sent, pose in zip(found.poses, candidate.poses, strict=True):
            assert [getattr(sent.position, axis) for axis in 'xyz'] == pose.position.tolist()
            assert [getattr(sent.orientation, a) for a in 'xyzw'] == pose.orientation.tolist()
