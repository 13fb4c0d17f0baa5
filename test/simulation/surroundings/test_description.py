"""The description of surroundings: values, texts, keys and the scene that follows from them."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.conditions import quantities_of
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.surroundings import (
    Surroundings,
    make_surroundings,
    named_surroundings,
    surroundings_folder,
    surroundings_from,
    surroundings_names,
)
from resting_aspects_ros.simulation.surroundings_kinds import KINDS, Chute, Slope, tray_from_scene

# Dimensions that have no default.
NEEDED = {
    'slope': {'angle': 0.2},
    'v_groove': {'opening': 1.5},
    'tray': {'length': 0.4, 'width': 0.3},
    'bowl_track': {'width': 0.04},
}
FLAT = [kind for kind in KINDS if kind != 'mesh']


def described(kind, **values):
    return make_surroundings({'kind': kind, **NEEDED.get(kind, {}), **values})


@pytest.mark.parametrize('kind', FLAT)
def test_keys_are_read_back_and_dimensions_are_checked(kind):
    body = KINDS[kind].body_names[0]
    given = described(kind, bodies={body: {'friction': 0.3}}, release={'x_min': 0.01})
    assert surroundings_from(given.key).document == given.document
    assert surroundings_from(given.key) == given
    for name, quantity in quantities_of(KINDS[kind]).items():
        with pytest.raises(InvalidValueError, match=f'invalid {name} .*expected'):
            described(kind, **{name: quantity.high + 1})


def test_key_stands_for_the_values():
    one = described('chute', bodies={'wall': {'friction': 0.2}, 'belt': {'speed': 0.1}})
    other = described('chute', bodies={'belt': {'speed': 0.1}, 'wall': {'friction': 0.2}})
    assert one.key == other.key
    # The level plane has none, unless it has values of its own.
    assert described('plane').key == Surroundings(Slope(angle=0.0)).key == ''
    assert described('plane', bodies={'floor': {'friction': 0.1}}).key


def test_gravity_is_tilted_by_roll_and_pitch(mat):
    roll, pitch = 0.5, 0.3
    scene = Surroundings(Chute(roll=roll, pitch=pitch)).scene(mat, 0.02)
    # The component along x is that of the pitch; across it, gravity is rolled towards the wall.
    expected = [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
    np.testing.assert_allclose(scene.down, expected, atol=1e-12)
    assert np.linalg.norm(tray_from_scene(roll, pitch)) == pytest.approx(1, abs=1e-12)


def test_release_inside_a_wall_is_refused(mat):
    near = described('wall', release={'y_min': 0.01, 'y_max': 0.03})
    with pytest.raises(InvalidValueError, match=r'10 mm from the wall.*hull radius.*20 mm'):
        near.scene(mat, 0.02)


def test_a_belt_faster_than_the_time_step_resolves_is_refused(mat, part):
    fast = described('chute', bodies={'belt': {'speed': 50.0}})
    conditions = dataclasses.replace(mat, surroundings=fast)
    with pytest.raises(
        InvalidValueError, match=r'speed 50 m/s of the belt: expected at most 10\.6 m/s'
    ):
        make_job(part('l_bracket'), conditions, 1)


# -- The named surroundings of config/surroundings, and changes of single values ------------------


@pytest.mark.parametrize('name', surroundings_names())
def test_every_file_can_be_used_and_has_its_source(name, mat):
    found = named_surroundings(name)
    assert found.name == name
    assert found.scene(mat, 0.02).bodies
    text = (surroundings_folder() / f'{name}.yaml').read_text()
    assert '\nsource: ' in text
    assert text.startswith('# ')


def test_changes_have_units_and_name_bodies_with_a_dot():
    plain = named_surroundings('l_chute')
    assert plain.shape.roll == pytest.approx(0.7853981633974483)  # as published
    assert plain.bodies['wall'] == {'friction': 0.2}
    chute = named_surroundings('l_chute', {'roll': '30deg', 'belt.friction': 0.5})
    assert chute.shape.roll == pytest.approx(0.5235987755982988)
    assert chute.bodies['belt'] == {'friction': 0.5, 'speed': 0.1}


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('kind: chut', "'chut'.*did you mean 'chute'"),
        ('{kind: chute, rol: 0.1}', "'rol'.*roll"),
        ('{kind: chute, bodies: {bel: {}}}', "'bel'.*belt, wall"),
        ('{kind: chute, bodies: {belt: 3}}', 'belt 3.*mapping'),
        ('{kind: chute, release: {x_min: 2, x_max: 1}}', 'x_min 2.*at most x_max, 1'),
        ('{kind: chute, orientation: [0, 0, 0, 2]}', 'orientation.*unit quaternion'),
        ('{kind: slope}', 'missing angle of a slope'),
        ('{kind: slope, angle: 12mm}', "angle '12mm'.*rad, deg"),
        ('{kind: mesh, mesh: no.stl}', 'no.stl.*does not exist'),
    ],
)
def test_wrong_descriptions_are_refused_with_their_file(tmp_path, text, says):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(InvalidValueError, match=says) as caught:
        named_surroundings(path)
    assert 'mine.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)
