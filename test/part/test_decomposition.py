"""Convex pieces of parts: where they lie, and how far they are from the part."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part import pieces
from resting_aspects_ros.part.pieces import THRESHOLD, convex_pieces


@pytest.fixture(autouse=True)
def nothing_known(monkeypatch):
    monkeypatch.setattr(pieces, '_known', type(pieces._known)())


def volume(corners):
    return ConvexHull(corners).volume


def check_pieces(shape, found, count):
    assert len(found.corners) == count
    # Exact cuts: what is left is the shift of the cuts by CoACD.
    assert max(found.missing, found.excess) < 1e-3 * shape.hull_radius
    assert abs(found.volume_error) < 1e-3
    total = sum(volume(corners) for corners in found.corners)
    assert total == pytest.approx(shape.volume * (1 + found.volume_error), rel=1e-9)
    # Each corner of the hull is a corner of a piece, so that the part lies on the same points.
    together = np.concatenate(found.corners)
    away = np.linalg.norm(shape.hull_vertices[:, None] - together, axis=2).min(axis=1)
    assert away.max() < 1e-9
    assert volume(together) == pytest.approx(volume(shape.hull_vertices), rel=1e-6)


def test_bracket_is_cut_at_its_inner_corner(part):
    check_pieces(part('l_bracket'), convex_pieces(part('l_bracket')), 2)


@pytest.mark.slow
def test_threads_cut_parts_at_the_same_time_bit_for_bit(part, capfd):
    shapes = [part(name) for name in ('l_bracket', 'angle_45x30x8', 't_prism', 'u_bracket')]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(convex_pieces, shapes))
    for shape, each, count in zip(shapes, found, (2, 2, 2, 3), strict=True):
        check_pieces(shape, each, count)
    assert convex_pieces(shapes[0]) is found[0]
    pieces._known.clear()
    again = convex_pieces(shapes[0])
    assert [c.tobytes() for c in again.corners] == [c.tobytes() for c in found[0].corners]
    assert (again.missing, again.excess) == (found[0].missing, found[0].excess)
    assert capfd.readouterr() == ('', '')


def test_convex_part_is_its_own_piece_without_coacd(part, monkeypatch):
    monkeypatch.setitem(sys.modules, 'coacd', None)
    shape = part('cylinder_d20_h20')
    found = convex_pieces(shape)
    assert len(found.corners) == 1
    np.testing.assert_array_equal(found.corners[0], shape.hull_vertices)
    assert max(found.missing, found.excess) < 1e-9 * shape.hull_radius
    with pytest.raises(PartError, match='pip install coacd'):
        convex_pieces(part('l_bracket'))


@pytest.mark.slow
def test_round_hole_is_approximated_within_the_threshold(solid):
    washer = solid(trimesh.creation.annulus(4.2, 8, 1.6, sections=24))
    found = convex_pieces(washer)
    half = np.ptp(washer.vertices, axis=0).max() / 2
    assert 3 <= len(found.corners) <= pieces.MAX_PIECES
    assert max(len(corners) for corners in found.corners) <= pieces.MAX_PIECE_CORNERS
    assert found.missing < 1e-3 * half
    assert 1e-3 * half < found.excess < THRESHOLD * half
    # The pieces cover part of the hole, and their overlaps count twice.
    assert 0 < found.volume_error < 0.1


def test_distances_are_those_between_the_shapes():
    # A cube with side 2, and a slab that covers its lower half and exceeds it by 0.5 in x.
    cube = trimesh.creation.box((2, 2, 2)).triangles
    slab = trimesh.creation.box((3, 2, 1)).apply_translation((0, 0, -0.5)).triangles
    assert pieces._excess(slab, cube) == pytest.approx(0.5)
    assert pieces._missing(cube, [slab]) == pytest.approx(1.0)
    assert pieces._missing(slab, [cube, slab]) < 1e-12


def test_cavity_is_ignored(solid):
    outer, inner = trimesh.creation.box((20, 20, 20)), trimesh.creation.box((15, 15, 15))
    inner.invert()
    found = convex_pieces(solid(trimesh.util.concatenate([outer, inner])))
    assert len(found.corners) == 1
    assert abs(found.volume_error) < 1e-9


def test_part_with_too_many_triangles_is_refused(part, monkeypatch):
    monkeypatch.setattr(pieces, 'MAX_TRIANGLES', 19)
    with pytest.raises(PartError, match='l_bracket has 20 triangles: expected at most 19'):
        convex_pieces(part('l_bracket'))
