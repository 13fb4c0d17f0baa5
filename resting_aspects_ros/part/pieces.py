"""Approximation of a part by convex pieces, for surroundings whose edges touch its real shape."""

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, KDTree

from resting_aspects_ros.arrays import Array, Faces
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.hull import convex_hull, outward_hull, simplify_hull, triangle_angles
from resting_aspects_ros.part.mesh_files import without_unused
from resting_aspects_ros.part.near import TriangleTree, face_normals
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.surface import connected

# A part that fills at least this share of its convex hull is treated as convex.
CONVEX = 0.98
# Concavity at which CoACD stops cutting, as a share of half the longest side of the bounding box.
# Each piece may then exceed the part by about this much.
THRESHOLD = 0.05
# Each piece is one more shape in every step of a simulation; 32 are enough for a cup.
MAX_PIECES = 32
# Bullet tests each corner of a piece in every step.
MAX_PIECE_CORNERS = 64
# CoACD takes about a minute for this number of triangles.
MAX_TRIANGLES = 20_000
SEED = 1
# CoACD shifts corners by some 1e-4 of the size. Those closer than this, R, to a vertex of the part
# are moved back to it, so that flat sides stay flat.
SNAP = 1e-3
# Random points on each of the two surfaces, in addition to their corners, between which the
# distances are measured.
SAMPLES = 4000
# Pieces of this number of parts are kept, because some minutes may have been spent on them.
MAX_KNOWN = 16


@dataclass(frozen=True, eq=False)
class ConvexPieces:
    """Convex pieces of a part, and their difference from it.

    corners : tuple of (k, 3) float64
        Corners of each piece, part frame, m. The piece is their convex hull.
    missing : float
        m; maximum distance from the pieces of a point of the part.
    excess : float
        m; maximum distance from the part of a point of the pieces.
    volume_error : float
        Sum of the volumes of the pieces, as a share of the volume of the part, minus 1. Cavities,
        which nothing can touch, count as filled; a mesh that is not closed counts as its hull.
    """

    corners: tuple[Array, ...]
    missing: float
    excess: float
    volume_error: float

    def summary(self) -> dict[str, float]:
        """Return the number of pieces and their difference from the part."""
        return {
            'number': len(self.corners),
            'missing': self.missing,
            'excess': self.excess,
            'volume_error': self.volume_error,
        }


_known: OrderedDict[str, ConvexPieces] = OrderedDict()
# CoACD ends the whole process if two threads use it at the same time.
_lock = threading.Lock()


def convex_pieces(part: Part) -> ConvexPieces:
    """Return convex pieces of a part, the same bytes for the same part.

    A part that fills CONVEX of its hull, or whose mesh is not closed, is one piece: its hull,
    simplified as ``part.hull_vertices``. The result is kept for each process.

    Raises
    ------
    PartError
        If CoACD is not installed, or the part has more than MAX_TRIANGLES triangles.
    """
    found = _known.pop(part.part_sha256, None)
    if found is None:
        found = _decomposed(part)
    _known[part.part_sha256] = found
    while len(_known) > MAX_KNOWN:
        _known.popitem(last=False)
    return found


def _decomposed(part: Part) -> ConvexPieces:
    hull, hull_faces, hull_volume = outward_hull(part.hull_vertices)
    vertices, faces = part.vertices, part.faces
    if np.isnan(part.volume):
        vertices, faces = hull, hull_faces
    else:
        faces = _without_cavities(vertices, faces)
    surface = vertices[faces]
    middle = vertices.mean(axis=0)
    volume = float(np.linalg.det(surface - middle).sum() / 6)
    if volume >= CONVEX * hull_volume:
        pieces: tuple[Array, ...] = (part.hull_vertices,)
    else:
        pieces = _cut(part, faces)
    triangles = [piece[ConvexHull(piece).simplices] for piece in pieces]
    excess = _excess(np.concatenate(triangles), surface)
    missing = _missing(surface, triangles)
    total = sum(outward_hull(piece)[2] for piece in pieces)
    return ConvexPieces(pieces, missing, excess, total / volume - 1)


def _without_cavities(vertices: Array, faces: Faces) -> Faces:
    """Return the faces of the shells that face outward."""
    shell = connected(len(vertices), faces[:, [0, 1, 1, 2]].reshape(-1, 2))[faces[:, 0]]
    corners = (vertices - vertices.mean(axis=0))[faces]
    volumes = np.bincount(shell, weights=np.linalg.det(corners))
    return np.asarray(faces[volumes[shell] > 0])


def _cut(part: Part, faces: Faces) -> tuple[Array, ...]:
    """Return the corners of the pieces that CoACD finds."""
    if len(faces) > MAX_TRIANGLES:
        raise PartError(
            f'{part.name} has {len(faces)} triangles: expected at most {MAX_TRIANGLES} for its '
            'decomposition into convex pieces'
        )
    try:
        import coacd
    except ImportError:
        raise PartError(
            f'the decomposition of {part.name} into convex pieces needs CoACD, which is not '
            'installed (pip install coacd)'
        ) from None
    vertices, faces = without_unused(part.vertices, faces)
    vertices = (vertices - part.centre_of_mass) / part.hull_radius
    with _lock:
        coacd.set_log_level('off')
        found = coacd.run_coacd(
            coacd.Mesh(vertices, faces),
            threshold=THRESHOLD,
            max_convex_hull=MAX_PIECES,
            preprocess_mode='off',
            seed=SEED,
        )
    near = KDTree(vertices)
    pieces = []
    for corners, _ in found:
        distance, which = (np.asarray(each) for each in near.query(corners))
        snapped = np.where(distance[:, None] < SNAP, vertices[which], corners)
        snapped = np.unique(snapped, axis=0)
        try:
            kept = simplify_hull(*convex_hull(snapped, part.name), MAX_PIECE_CORNERS)[0]
        except PartError:  # a flat sliver of the cut
            continue
        pieces.append(kept * part.hull_radius + part.centre_of_mass)
    return tuple(pieces)


def _missing(surface: Array, pieces: list[Array]) -> float:
    """Return the maximum distance of a surface (m, 3, 3) from the union of the pieces."""
    points = _samples(surface)
    outside = np.ones(len(points), dtype=bool)
    for triangles in pieces:
        hull = ConvexHull(triangles.reshape(-1, 3))
        planes = hull.equations
        above = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        outside &= above > 0
    return float(_distances(points[outside], np.concatenate(pieces)).max(initial=0.0))


def _excess(pieces: Array, surface: Array) -> float:
    """Return the maximum distance of the pieces (m, 3, 3) from the solid in a surface."""
    points = _samples(pieces)
    distance = _distances(points, surface)
    # Points inside the solid have no distance; the furthest one that is outside is wanted.
    for k in np.argsort(-distance, kind='stable'):
        a, b, c = np.moveaxis(surface - points[k], 1, 0)
        if triangle_angles(a, b, c).sum() < 2 * np.pi:
            return float(distance[k])
    return 0.0


def _samples(triangles: Array) -> Array:
    """Return points of a surface (m, 3, 3): all corners, and random ones, uniform by area."""
    generator = np.random.default_rng(SEED)
    areas = np.linalg.norm(face_normals(triangles), axis=1)
    chosen = generator.choice(len(triangles), SAMPLES, p=areas / areas.sum())
    # Weights of the corners of a point that is uniform in its triangle.
    root, share = np.sqrt(generator.random(SAMPLES)), generator.random(SAMPLES)
    weights = np.stack([1 - root, root * (1 - share), root * share], axis=-1)
    points = np.einsum('nk,nki->ni', weights, triangles[chosen])
    return np.concatenate([np.unique(triangles.reshape(-1, 3), axis=0), points])


def _distances(points: Array, triangles: Array) -> Array:
    """Return the distances (n,) of points (n, 3) from the nearest of the triangles (m, 3, 3)."""
    about = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) * THRESHOLD
    return TriangleTree(triangles).distances(points, about)[0]
