"""Rendered trays: outlines at random places, and what a camera and OpenCV see of them."""

import numpy as np
import pytest
import shapely

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.vision_example.contours import clearances, find_blobs
from resting_aspects_ros.vision.tray_image import (
    DARK,
    LIGHT,
    OutlinePlaces,
    TrayCamera,
    render_tray,
)

TRAY = (0.2, 0.16)
LEVEL = (LIGHT + DARK) / 2


@pytest.fixture
def bracket(known):
    return known('l_bracket')


def placed(known, classes, seed=1):
    places = OutlinePlaces(known.outlines, TRAY, np.random.default_rng(seed))
    places.shake(np.array(classes))
    return places


def test_parts_lie_on_the_tray_without_overlap(bracket):
    places = placed(bracket, [0, 1, 2, 3, 4] * 2)
    box = shapely.box(-0.1, -0.08, 0.1, 0.08)
    assert all(box.buffer(1e-9).contains(each) for each in places.polygons)
    pairs = [(a, b) for k, a in enumerate(places.polygons) for b in places.polygons[:k]]
    assert not any(a.intersects(b) for a, b in pairs)
    assert places.clearance().min() > 0
    nearest = [min(a.distance(b) for b in places.polygons if b is not a) for a in places.polygons]
    assert places.clearance() == pytest.approx(nearest)


def test_places_follow_removed_and_added_parts(bracket):
    places = placed(bracket, [0, 1, 2])
    kept = places.polygons[1]
    places.keep(np.array([False, True, False]))
    assert places.polygons == [kept]
    places.add(np.array([1, 4, 4]))
    assert places.polygons[0] is kept
    area = [bracket.outlines[k].area for k in (1, 4, 4)]
    assert [each.area for each in places.polygons] == pytest.approx(area)
    assert np.isinf(placed(bracket, [0]).clearance()).all()
    # A part without room lies on another one.
    assert placed(bracket, [0] * 60).clearance().min() == 0


def test_part_fits_in_few_directions_or_is_refused(bracket):
    """The part is 40 x 30 mm."""
    places = OutlinePlaces(bracket.outlines[:1], (0.045, 0.031), np.random.default_rng(1))
    tray = shapely.box(-0.0225, -0.0155, 0.0225, 0.0155).buffer(1e-9)
    for _ in range(20):
        places.shake(np.array([0]))
        assert tray.contains(places.polygons[0])
    with pytest.raises(InvalidValueError, match=r'tray 39 x 31 mm.*class 1.*40 x 30 mm'):
        OutlinePlaces(bracket.outlines, (0.039, 0.031), np.random.default_rng(1))
    for scale in (0.0, 1e4, float('nan')):
        with pytest.raises(InvalidValueError, match='invalid px_per_mm'):
            TrayCamera(TRAY, scale)


@pytest.mark.parametrize(('name', 'scale'), [('washer', 5.0), ('l_bracket', 3.0)])
def test_contours_are_where_the_outlines_are(known, name, scale):
    classes = [k % len(known(name).outlines) for k in range(8)]
    places, camera = placed(known(name), classes, seed=3), TrayCamera(TRAY, scale)
    generator = np.random.default_rng(2)
    image = render_tray(places.polygons, camera, generator, blur=0.7, noise=4.0)
    blobs = find_blobs(image, LEVEL, scale**2)
    to_tray = camera.model.to_tray
    seen = [shapely.Polygon(to_tray(b.outer), [*map(to_tray, b.holes)]) for b in blobs]
    assert len(seen) == len(classes)
    free = clearances([to_tray(blob.boundary) for blob in blobs])
    for k, polygon in enumerate(seen):
        apart = [polygon.centroid.distance(each.centroid) for each in places.polygons]
        true = int(np.argmin(apart))
        expected = places.polygons[true]
        assert apart[true] < 2e-5
        assert len(polygon.interiors) == len(expected.interiors)
        # The mean offset of the boundary.
        assert (polygon.area - expected.area) / expected.length == pytest.approx(
            0, abs=1e-4 / scale
        )
        assert free[k] == pytest.approx(places.clearance()[true], abs=2e-3 / scale)


def test_touching_parts_are_one_blob_and_an_empty_tray_has_none():
    camera = TrayCamera(TRAY, 4.0)
    boxes = [shapely.box(0, 0, 0.01, 0.01), shapely.box(0.01, 0, 0.02, 0.01)]
    generator = np.random.default_rng(1)
    image = render_tray(boxes, camera, generator, blur=0.7, noise=4.0)
    assert len(find_blobs(image, LEVEL, 10)) == 1
    empty = render_tray([], camera, generator, noise=4.0)
    assert find_blobs(empty, LEVEL, 10) == []
    assert find_blobs(np.full_like(empty, 0), LEVEL, 10)  # a covered lens
    assert clearances([]).tolist() == []


def test_contour_of_very_many_points_is_found():
    image = np.full((600, 600), LIGHT, np.uint8)
    for left in range(10, 590, 12):  # a comb, whose boundary is longer than 2^15 pixels
        image[10:590, left : left + 6] = DARK
    image[10:20, 10:590] = DARK
    (blob,) = find_blobs(image, LEVEL, 10)
    assert len(blob.outer) > 1 << 15
    assert blob.outer.min() == pytest.approx(9.5, abs=0.1)


def test_part_in_the_hole_of_another_one_is_close_to_it():
    """The gripper for either has only the room in the hole."""
    ring = shapely.Point(0, 0).buffer(0.02).difference(shapely.Point(0, 0).buffer(0.015))
    inner = shapely.Point(0.001, 0).buffer(0.01)
    camera = TrayCamera((0.06, 0.06), 10.0)
    image = render_tray([ring, inner], camera, np.random.default_rng(1))
    blobs = find_blobs(image, LEVEL, 10)
    free = clearances([camera.model.to_tray(blob.boundary) for blob in blobs])
    assert free == pytest.approx([ring.distance(inner)] * 2, abs=1e-4)
