"""Which part and aspect an observed polygon shows, with probabilities."""

import dataclasses

import numpy as np
import pytest
import shapely
from scipy.stats import binom
from shapely import affinity

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.boundary import placed as moved
from resting_aspects_ros.vision.fitting import OutlineNoise, mirrored
from resting_aspects_ros.vision.identification import identify
from resting_aspects_ros.vision.outline import look_alikes

# Random poses of each class.
POSES = 12
NAMES = ('angle_45x30x8', 'hex_nut', 'l_bracket', 'u_bracket', 'washer')


def touching(one, other):
    """Return two polygons as one, the second moved in x until it just touches."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        apart = not one.intersects(affinity.translate(other, middle, 0))
        low, high = (low, middle) if apart else (middle, high)
    return one.union(affinity.translate(other, low - 1e-5, 0))


@pytest.mark.parametrize('name', NAMES)
def test_class_and_camera_pose_are_found(known, name):
    candidate = known(name)
    for outline in candidate.outlines:
        yaw = 2.0
        polygon = moved(outline.polygon, 0.05, -0.08, yaw)
        found = identify(polygon, [candidate])
        assert found.answer == 'part'
        total = sum(each.posterior for each in found.candidates) + found.none + found.touching
        assert total == pytest.approx(1, abs=1e-4)
        (match,) = [
            each for each in found.candidates if each.symmetry_class == outline.symmetry_class
        ]
        assert match.posterior > 0.2
        assert match.overlap > 0.99
        back = moved(outline.polygon, match.x, match.y, match.yaw)
        assert back.centroid.distance(polygon.centroid) < 1e-6
        if order := outline.yaw_symmetry:
            off = np.angle(np.exp(1j * order * (match.yaw - yaw))) / order
            assert abs(np.degrees(off)) < 1


@pytest.mark.slow
@pytest.mark.parametrize('name', ['angle_45x30x8', 'u_bracket', 'washer'])
def test_confusion_of_many_noisy_images_is_diagonal(known, noisy, name):
    """Errors of 0.1 to 0.3 mm, independent after 1 mm; position within five standard errors."""
    generator = np.random.default_rng(3)
    candidate = known(name)
    alike = look_alikes(candidate.outlines)
    for outline in candidate.outlines:
        same = {a.symmetry_class for a in alike[outline.symmetry_class] if a.verdict == 'same'}
        wrong, off = 0, []
        for _ in range(POSES):
            x, y, yaw = generator.uniform(-0.1, 0.1), generator.uniform(-0.1, 0.1), 3.0
            polygon = moved(outline.polygon, x, y, yaw * generator.uniform(-1, 1))
            sd = generator.uniform(1e-4, 3e-4)
            best = identify(noisy(polygon, sd, generator), [candidate], OutlineNoise(sd)).best
            if best is None or best.symmetry_class not in {outline.symmetry_class, *same}:
                wrong += 1
            elif best.symmetry_class == outline.symmetry_class:
                back = moved(outline.polygon, best.x, best.y, best.yaw).centroid
                off.append(back.distance(polygon.centroid) / sd)
        # The independent errors along half the shorter side fix the position across it.
        count = 1e3 * outline.width
        assert wrong <= binom.ppf(0.9999, POSES, 0.01)
        # A class that another one with the same outline always precedes has no positions.
        assert np.percentile(off or [0.0], 99) < 5 / np.sqrt(count)


def test_prior_decides_between_equal_outlines(known):
    # The flat sides of u_bracket look the same.
    candidate = dataclasses.replace(known('u_bracket'), shares=np.array([0.3, 0.3, 0.3, 0.1]))
    found = identify(candidate.outlines[0].polygon, [candidate])
    assert [each.symmetry_class for each in found.candidates] == [1, 4]
    assert [each.posterior for each in found.candidates] == pytest.approx([0.75, 0.25], abs=0.01)


def test_mirror_image_is_the_part_turned_over_or_is_named(known):
    candidate = known('angle_45x30x8')
    seen = moved(mirrored(candidate.outlines[1].polygon), 0.02, 0.05, 1)
    found = identify(seen, [candidate])
    assert found.best.symmetry_class == 3
    assert found.best.posterior > 0.99
    one = dataclasses.replace(candidate, outlines=candidate.outlines[1:2], shares=np.ones(1))
    found = identify(seen, [one])
    assert found.answer != 'part'
    assert [each.symmetry_class for each in found.mirrored] == [2]


def test_another_part_is_none_of_these(known):
    others = [known(each) for each in NAMES if each != 'hex_nut']
    larger = known('hex_nut').outlines[1].polygon.buffer(0.002, join_style='mitre')
    found = identify(larger, others)
    assert found.best is None
    assert found.none > 0.5


def test_touching_parts_are_recognized(known):
    parts = [known('l_bracket'), known('hex_nut')]
    one, other = (part.outlines[0].polygon for part in parts)
    for second in (moved(one, 0, 0, 1.8), moved(other, 0, 0, 0.3)):
        found = identify(touching(one, second), parts)
        assert found.answer == 'touching'
        assert found.touching > 0.9


def test_wrong_values_are_refused(known):
    with pytest.raises(InvalidValueError, match='invalid number of parts'):
        identify(shapely.box(0, 0, 1, 1), [])
    for wrong in ({'sd': 0}, {'sd': float('nan')}, {'correlation': 1.0}):
        with pytest.raises(InvalidValueError, match='of the noise'):
            OutlineNoise(**wrong)
