"""Pictures of a part: a renderer, coarse meshes, poses on the tray, and contacts with planes."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.aspects.support import NONE, ContactPlane
from resting_aspects_ros.part.near import face_normals
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import down_in_part, rotate, turned_about_vertical
from resting_aspects_ros.system import available_cores

Mask = npt.NDArray[np.bool_]

NOTHING = -1
# An edge is drawn where surfaces meet at more than 25 degrees, also across a fillet that is a few
# pixels wide, but not between the facets of a curved side.
CREASE = np.cos(np.radians(25.0))
# An edge is drawn at a step in depth of more than this, pixels.
STEP = 3.0
# Pixel centres this close outside a triangle count as inside, because rounding would leave holes.
BORDER = 1e-7


@dataclass(frozen=True, eq=False)
class Rendering:
    """The visible triangle of each pixel; row 0 is the lowest.

    face : (size, size) int
        Index of the triangle; NOTHING if there is none.
    depth : (size, size) float
        Depth towards the viewer, pixels; -inf if there is no triangle.
    slope : (m, 2) float
        Change of depth per pixel to the right and up, on each triangle that faces the viewer.
    """

    face: Indices
    depth: Array
    slope: Array


def rasterise(points: Array, faces: Indices, size: int) -> Rendering:
    """Find the nearest triangle in each pixel of a square picture with ``size`` rows.

    Parameters
    ----------
    points : (n, 3) float
        Coordinates to the right, up, and towards the viewer, pixels. The centre of pixel (row,
        column) is at (column + 0.5, row + 0.5).
    faces : (m, 3) int
        Counter-clockwise as seen from outside; triangles that face away are invisible.
    """
    corners = points[faces]
    normal = face_normals(corners)
    facing = np.flatnonzero(normal[:, 2] > 1e-12)
    slope = np.zeros((len(faces), 2))
    slope[facing] = -normal[facing, :2] / normal[facing, 2:]
    face, row, column = _covered(corners, facing, size)

    # A column of coordinates for each term: sums over short axes are slow.
    (x, y, z), (right, up) = corners[:, 0].T, slope.T
    inside = right[face] * (column + 0.5 - x[face]) + up[face] * (row + 0.5 - y[face])
    low, high = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    # Clipped to the depths of the corners: a triangle seen edge-on has an almost infinite slope.
    depth = np.clip(z[face] + inside, low[face], high[face])
    pixel = row * size + column
    nearest = np.full(size * size, -np.inf)
    np.maximum.at(nearest, pixel, depth)
    seen = np.full(size * size, NOTHING)
    on_top = depth == nearest[pixel]
    seen[pixel[on_top]] = face[on_top]
    return Rendering(seen.reshape(size, size), nearest.reshape(size, size), slope)


def edges(seen: Rendering, normals: Array) -> Mask:
    """Return the (size, size) mask of pixels on edges: outlines, steps in depth, and creases.

    ``normals`` are the unit normals (m, 3) of the triangles, any frame.
    """
    size = len(seen.face)
    marked = np.zeros(size * size, dtype=bool)
    number = np.arange(size * size).reshape(size, size)
    for axis, near, far in ((0, number[:, :-1], number[:, 1:]), (1, number[:-1], number[1:])):
        differ = seen.face.ravel()[near] != seen.face.ravel()[far]
        a, b = near[differ], far[differ]
        edge = _is_edge(seen, normals, a, b, axis)
        marked[a[edge]] = marked[b[edge]] = True
    return marked.reshape(size, size)


def _is_edge(seen: Rendering, normals: Array, a: Indices, b: Indices, axis: int) -> Mask:
    """Return whether there is an edge between neighbouring pixels a and b (k,) that differ."""
    face_a, face_b = seen.face.ravel()[a], seen.face.ravel()[b]
    outline = (face_a == NOTHING) | (face_b == NOTHING)
    crease = (normals[face_a] * normals[face_b]).sum(axis=1) < CREASE
    with np.errstate(invalid='ignore'):  # -inf - -inf occurs only on outlines
        rise = seen.depth.ravel()[b] - seen.depth.ravel()[a]
    slopes = seen.slope[np.stack([face_a, face_b]), axis]
    step = np.abs(rise - slopes).min(axis=0) > STEP
    return outline | crease | step


def _covered(corners: Array, facing: Indices, size: int) -> tuple[Indices, Indices, Indices]:
    """Return triangle, row and column of every pixel whose centre is in a triangle."""
    y = corners[facing, :, 1]
    which, row = _spread(y.min(axis=1), y.max(axis=1), size)
    face = facing[which]
    low = np.full(len(row), -np.inf)
    high = np.full(len(row), np.inf)
    for start, stop in ((0, 1), (1, 2), (2, 0)):
        x0, y0 = corners[face, start, 0], corners[face, start, 1]
        dx, dy = corners[face, stop, 0] - x0, corners[face, stop, 1] - y0
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            crossing = x0 + dx * ((row + 0.5 - y0) / dy)
        # Counter-clockwise: the inside is left of an upward edge and right of a downward edge.
        np.minimum(high, crossing, out=high, where=dy > 0)
        np.maximum(low, crossing, out=low, where=dy < 0)
    which, column = _spread(low, high, size)
    return face[which], row[which], column


def _spread(low: Array, high: Array, size: int) -> tuple[Indices, Indices]:
    """Return, for every pixel centre in one of the ranges (k,), the range and the pixel index."""
    first = np.ceil(np.clip(low - 0.5 - BORDER, 0, size)).astype(np.int64)
    last = np.floor(np.clip(high - 0.5 + BORDER, -1, size - 1)).astype(np.int64)
    count = np.maximum(last - first + 1, 0)
    which = np.repeat(np.arange(len(count)), count)
    begin = np.cumsum(count) - count
    return which, first[which] + np.arange(len(which)) - begin[which]


# Minimum number of cells along the longest side: even the coarsest mesh is still a rough body.
MIN_CELLS = 3


def coarse_mesh(vertices: Array, faces: Indices, max_faces: int) -> tuple[Array, Indices]:
    """Return vertices and faces of a coarser mesh; the same ones if there are few enough faces.

    Vertices in one cell of a cubic grid are merged into their mean (clustering: Rossignac, Borrel
    1993). The cells are enlarged until there are at most ``max_faces``, or until the grid has
    MIN_CELLS along the longest side. Shapes: (n, 3) and (m, 3).
    """
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    cells = max(round(max_faces**0.5), MIN_CELLS)
    points, corners = vertices, faces
    while len(corners) > max_faces and cells >= MIN_CELLS:
        place = np.floor((vertices - low) * (cells / size)).astype(np.int64)
        cell = place @ np.array([1, cells + 1, (cells + 1) ** 2])
        _, number, count = np.unique(cell, return_inverse=True, return_counts=True)
        sums = [np.bincount(number, weights=along) for along in vertices.T]
        points, merged = np.stack(sums, axis=1) / count[:, None], number[faces]
        a, b, c = merged.T
        whole = (a != b) & (b != c) & (c != a)
        corners = merged[whole]
        # A face that was turned over by the merge is flipped back, so that it is visible.
        turned = face_normals(points[corners]) * face_normals(vertices[faces[whole]])
        flipped = turned.sum(axis=1) < 0
        corners[flipped] = corners[flipped, ::-1]
        # Duplicate faces, such as of thin walls that collapsed, are kept once.
        _, first = np.unique(np.sort(corners), axis=0, return_index=True)
        corners = corners[np.sort(first)]
        cells = cells * 4 // 5
    return points, corners


Image = npt.NDArray[np.float32]

# Each pixel of a picture is the mean of FINE x FINE rendered pixels, for smooth borders.
FINE = 3
# Share of the side of a picture that the largest part with its shadow fills.
FILLED = 0.94

PREVIEW = 96  # side of the picture with which the side that shows more edges is chosen, pixels

# The viewer is in front of the tray, a little to the right, and looks down; tray frame.
AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(36.0)


def view_from(azimuth: float, elevation: float) -> Array:
    """Return a view (3, 3): the directions right, up and towards the viewer; tray frame."""
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    towards = np.cos(elevation) * level + [0.0, 0.0, np.sin(elevation)]
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


OBLIQUE = view_from(AZIMUTH, ELEVATION)
FROM_ABOVE = np.eye(3)  # the view of a camera above the tray
# The light comes from above, over the viewer's left shoulder.
LIGHT = np.array([0.0, 0.0, 1.0]) - 0.45 * OBLIQUE[0] + 0.3 * OBLIQUE[2]
LIGHT /= np.linalg.norm(LIGHT)

# A picture of 320 pixels takes 100 MB while it is drawn.
MAX_THREADS = 4
MIN_SHADE = 0.5  # brightness of a side that faces away from the light
EDGE_COLOUR = np.array([0.13, 0.13, 0.15])
MAX_EDGE_SHARE = 0.6  # of the part's pixels; with more, edges are not drawn
SHADOW = 0.28  # opacity
SOFT = 7  # half width of the blur of the shadow, rendered pixels


@dataclass(frozen=True, eq=False)
class PosedPart:
    """A part on the surface z = 0, in the pose that shows an aspect; tray frame.

    Points (n, 3), m; unit normals (m, 3) and areas (m,), m2, of the faces (m, 3); orientation: a
    unit quaternion xyzw, tray from part.
    """

    points: Array
    faces: Indices
    normals: Array
    areas: Array
    orientation: Array


def pose_parts(part: Part, aspects: Sequence[Aspect]) -> list[PosedPart]:
    """Return the part in each aspect, with a rotation about the vertical that suits a drawing.

    The part's sides are parallel to the axes of the tray, the longer one from left to right. Of
    the two long sides, the one with more visible edges is in front.
    """
    solid = _untransformed(part)
    return [_posed(solid, aspect) for aspect in aspects]


def draw_parts(
    posed_parts: Sequence[PosedPart],
    colours: Sequence[tuple[float, float, float]],
    pixels: int,
    view: Array = OBLIQUE,
) -> list[Image]:
    """Draw parts on the surface, all from the same viewpoint and at the same scale.

    ``colours`` are red, green and blue from 0 to 1, and ``view`` is OBLIQUE or FROM_ABOVE. The
    pictures are (pixels, pixels, 4): red, green, blue and opacity, 0 to 1; row 0 is the top row.
    The background is transparent.
    """
    spans = [
        np.ptp(np.concatenate([p.points, _on_surface(p.points)]) @ view[:2].T, axis=0).max()
        for p in posed_parts
    ]
    scale = FILLED * pixels * FINE / max(spans, default=1.0)

    def draw(one: tuple[PosedPart, tuple[float, float, float]]) -> Image:
        return _draw_part(one[0], np.array(one[1]), scale, pixels, view)

    with ThreadPoolExecutor(min(available_cores(), MAX_THREADS)) as threads:
        return list(threads.map(draw, zip(posed_parts, colours, strict=True)))


def _untransformed(part: Part) -> PosedPart:
    points, faces = np.array(part.vertices), visible_faces(part)
    normals = face_normals(points[faces])
    twice = np.linalg.norm(normals, axis=1)
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    normals /= np.maximum(twice, 1e-300)[:, None]
    return PosedPart(points, faces, normals, twice / 2, upright)


def visible_faces(part: Part) -> Indices:
    """Return the (m, 3) faces of a part; those of an open mesh are visible from inside, too."""
    faces = np.array(part.faces)
    return np.concatenate([faces, faces[:, ::-1]]) if np.isnan(part.volume) else faces


def _posed(solid: PosedPart, aspect: Aspect) -> PosedPart:
    posed = _on_tray(solid, aspect.orientation)
    # The mean direction of the upright sides, modulo 90 degrees, so that perpendicular and
    # opposite sides have the same direction.
    x, y, _ = posed.normals.T
    upright = posed.areas * np.hypot(x, y) ** 4
    side = float(np.angle((upright * np.exp(4j * np.arctan2(y, x))).sum())) / 4
    along = _on_tray(solid, turned_about_vertical(aspect.orientation, -side))
    width, depth, _ = np.ptp(along.points, axis=0)
    angle = -side + (np.pi / 2 if depth > width else 0.0)
    both = [turned_about_vertical(aspect.orientation, turn) for turn in (angle, angle + np.pi)]
    return max((_on_tray(solid, orientation) for orientation in both), key=_visible_edge_length)


def _on_tray(solid: PosedPart, orientation: Array) -> PosedPart:
    points = rotate(orientation, solid.points)
    points[:, 2] -= points[:, 2].min()
    normals = rotate(orientation, solid.normals)
    return dataclasses.replace(solid, points=points, normals=normals, orientation=orientation)


def _visible_edge_length(solid: PosedPart) -> int:
    """Return the length of the visible edges, pixels: how much a viewer sees of the shape."""
    points = solid.points @ OBLIQUE.T
    low, span = points.min(axis=0), np.ptp(points[:, :2], axis=0).max()
    seen = rasterise((points - low) * (PREVIEW / span), solid.faces, PREVIEW)
    return int(np.count_nonzero(edges(seen, solid.normals)))


def _on_surface(points: Array) -> Array:
    """Return the shadows of the points on the surface, tray frame."""
    return points - points[:, 2:] * (LIGHT / LIGHT[2])


def _draw_part(solid: PosedPart, colour: Array, scale: float, pixels: int, view: Array) -> Image:
    from scipy.ndimage import binary_dilation, uniform_filter

    size = pixels * FINE
    shadow_points = _on_surface(solid.points)
    both = np.concatenate([solid.points, shadow_points]) @ view[:2].T * scale
    centre = np.append(size / 2 - (both.min(axis=0) + both.max(axis=0)) / 2, 0.0)
    seen = rasterise(solid.points @ view.T * scale + centre, solid.faces, size)
    lit = solid.faces[solid.normals @ LIGHT > 0]  # the shadow of these faces is the whole shadow
    shadow = rasterise(shadow_points @ view.T * scale + centre, lit, size).face != NOTHING

    shade = brightness(solid.normals)
    image = np.zeros((size, size, 4))
    soft = shadow.astype(float)
    for _ in range(2):
        soft = uniform_filter(soft, 2 * SOFT + 1, mode='constant')
    image[..., 3] = SHADOW * soft.round(9)  # removes rounding errors of zero
    part = seen.face != NOTHING
    image[part, :3] = shade[seen.face[part], None] * colour
    image[part, 3] = 1.0
    edge = binary_dilation(edges(seen, solid.normals))  # one pixel wider on all four sides
    # A part that is only a few pixels thick would consist of edges only.
    if np.count_nonzero(edge & part) < MAX_EDGE_SHARE * np.count_nonzero(part):
        image[edge, :3] = EDGE_COLOUR
        image[edge, 3] = 1.0
    return downsample(image, FINE)[::-1]


def brightness(normals: Array) -> Array:
    """Return the (m,) brightness of sides with unit normals (m, 3), tray frame."""
    return MIN_SHADE + (1 - MIN_SHADE) * (0.5 + 0.5 * normals @ LIGHT) ** 1.5


def downsample(image: npt.NDArray[np.floating[Any]], factor: int) -> Image:
    """Return the means over factor x factor pixels of an RGBA image; opacity weights colours."""
    weighted = image.copy()
    for channel in range(3):
        weighted[..., channel] *= image[..., 3]
    # First the rows, then the columns of a third as many pixels: sums over short axes are slow.
    rows = sum(weighted[start::factor] for start in range(factor))
    mean = sum(rows[:, start::factor] for start in range(factor)) / factor**2
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-9)
    return mean.astype(np.float32)


# Distance between neighbouring centres of mass, hull radii R: no point of a part is further than
# R from its centre of mass.
PITCH = 2.5
# Aspects in a row of the grid.
ROW = 6
# Maximum number of triangles of all aspects together: a message of 1.4 MB, sent in 20 ms.
MAX_TRIANGLES = 20_000
# The limit for one aspect is never lower than this, however many aspects there are.
MIN_TRIANGLES = 100
# Maximum number of triangles in pictures and in the 3D view of a page: with more, triangles are
# smaller than pixels.
MAX_PICTURE_TRIANGLES = 50_000


@dataclass(frozen=True, eq=False)
class AspectPose:
    """A pose of the part on the surface z = 0 that shows an aspect; tray frame, m.

    Position of the part frame; orientation of the aspect, a unit quaternion xyzw, tray from part;
    and the height of the highest point.
    """

    aspect_id: int
    position: Array
    orientation: Array
    centre_of_mass: Array
    top: float


def aspect_poses(part: Part, aspects: Sequence[Aspect]) -> list[AspectPose]:
    """Return a pose for each aspect, in order from left to right (x), row by row towards -y.

    The poses are PITCH R apart, and the grid is centred on the tray's origin.
    """
    places = _places(len(aspects)) * (PITCH * part.hull_radius)
    return [_pose_at(part, a, place) for a, place in zip(aspects, places, strict=True)]


def message_part(part: Part, count: int) -> Part:
    """Return the part, with a coarse mesh if a message of ``count`` aspects would be too large."""
    return _coarse_part(part, max(MAX_TRIANGLES // max(count, 1), MIN_TRIANGLES))


def picture_part(part: Part) -> Part:
    """Return the part for pictures: with a coarse mesh if it has too many triangles."""
    return _coarse_part(part, MAX_PICTURE_TRIANGLES)


def _coarse_part(part: Part, max_faces: int) -> Part:
    if len(part.faces) <= max_faces:
        return part
    vertices, faces = coarse_mesh(part.vertices, part.faces, max_faces)
    return dataclasses.replace(part, vertices=vertices, faces=faces)


def _places(count: int) -> Array:
    """Return (count, 2) x and y on a grid of unit steps around the origin."""
    columns = min(ROW, max(count, 1))
    number = np.arange(count)
    x, y = number % columns, -(number // columns)
    rows = -(-count // columns)
    return np.stack([x - (columns - 1) / 2, y + (rows - 1) / 2], axis=-1)


def _pose_at(part: Part, aspect: Aspect, place: Array) -> AspectPose:
    heights = np.asarray(part.vertices @ -down_in_part(aspect.orientation))
    centre = rotate(aspect.orientation, part.centre_of_mass)
    position = np.append(place - centre[:2], -heights.min())
    return AspectPose(
        aspect.id, position, aspect.orientation, position + centre, float(np.ptp(heights))
    )


# -- Contacts with planes -------------------------------------------------------------------------


# Colours of the planes and of the contacts on them, in the order of the planes; others are grey.
PLANE_COLOURS = np.array([[0.90, 0.90, 0.92], [0.93, 0.89, 0.82], [0.86, 0.92, 0.87]])
CONTACT_COLOURS = np.array([[0.10, 0.42, 0.75], [0.88, 0.42, 0.05], [0.13, 0.55, 0.25]])
# Half of the side of a plane, of which the picture shows what is near the part, and the radius of
# the disc by which a contact is enlarged, R.
PATCH, RIM = 1.6, 0.09
# Distance of a contact from its plane in the picture, R, so that the plane does not hide it.
ABOVE = 0.004
# Points of the hull that are at most this much further from a plane, R, touch it too.
TOUCHING = 0.012
AZIMUTHS = np.radians([-62, 62, 118, -118, -28, 28, -15, 15, 165, -165, 75, -75])

Mesh = tuple[Array, Indices, Array]  # points, faces, colours of the faces


def contact_image(
    part: Part,
    orientation: Array,
    contacts: Sequence[int],
    planes: Sequence[ContactPlane],
    colour: Array,
    pixels: int,
) -> Image:
    """Return a picture (pixels, pixels, 4) of a part that touches planes.

    ``orientation`` is a unit quaternion xyzw, tray from part. ``contacts`` are what touches each
    plane, see aspects/support.py; planes without contact are not drawn.
    """
    touched = [k for k, code in enumerate(contacts) if code != NONE]
    radius = part.hull_radius
    corners = rotate(orientation, part.hull_vertices)
    place = _place(corners, [planes[k] for k in touched])
    corners = corners + place
    meshes: list[Mesh] = [_part_mesh(part, orientation, place, colour)]
    patches: list[Mesh] = []
    centre = corners.mean(axis=0)
    for k in touched:
        number = min(k, len(PLANE_COLOURS) - 1)
        others = [planes[j] for j in touched if j != k]
        patch = plane_patch(planes[k], others, centre, PATCH * radius)
        patches.append(_two_sided(*patch, PLANE_COLOURS[number]))
        meshes.append(_contact(planes[k], corners, radius, CONTACT_COLOURS[number]))
    return _drawn_meshes(
        meshes, patches, _facing_view([planes[k].normal for k in touched]), pixels
    )


def _place(corners: Array, planes: Sequence[ContactPlane]) -> Array:
    """Return the (3,) translation with which the corners (n, 3) touch the planes."""
    if not planes:
        return np.zeros(3)
    normals = np.array([plane.normal for plane in planes])
    gaps = [p.offset - float((corners @ p.normal).min()) for p in planes]
    found = np.linalg.lstsq(normals, np.array(gaps), rcond=None)[0]
    return np.asarray(found)


def _part_mesh(part: Part, orientation: Array, place: Array, colour: Array) -> Mesh:
    faces = visible_faces(part)
    return rotate(orientation, part.vertices) + place, faces, np.tile(colour, (len(faces), 1))


def _axes(normal: Array) -> Array:
    level = np.cross([0.0, 0.0, 1.0], normal)
    first = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(level) < 1e-6 else level
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def plane_patch(
    plane: ContactPlane, others: Sequence[ContactPlane], centre: Array, size: float
) -> tuple[Array, Indices]:
    """Return a square of a plane, as far as it is in front of the other planes.

    Parameters
    ----------
    centre : (3,) float64
        The middle of the square is the point of the plane next to it, m.
    size : float
        Half the length of its sides, m.

    Returns
    -------
    points : (n, 3) float64
        m.
    faces : (m, 3) int64
        Empty if nothing is in front of the others.
    """
    from trimesh.intersections import slice_faces_plane

    middle = centre - plane.normal * (centre @ plane.normal - plane.offset)
    square = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    points = middle + size * square @ _axes(plane.normal)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    for other in others:
        if len(faces):
            end = other.offset * other.normal
            points, faces, *_ = slice_faces_plane(points, faces, other.normal, end)
    return points, faces


def _contact(plane: ContactPlane, corners: Array, radius: float, colour: Array) -> Mesh:
    """Return the area in which the hull touches the plane, enlarged by a rim, just above it."""
    import shapely

    heights = corners @ plane.normal - plane.offset
    touching = corners[heights <= heights.min() + TOUCHING * radius]
    axes = _axes(plane.normal)
    flat = shapely.MultiPoint(touching @ axes.T).convex_hull.buffer(RIM * radius)
    outline = np.asarray(flat.exterior.coords)[:-1]
    height = plane.offset + ABOVE * radius
    faces = np.array([(0, k, k + 1) for k in range(1, len(outline) - 1)])
    return _two_sided(outline @ axes + height * plane.normal, faces, colour)


def _two_sided(points: Array, faces: Indices, colour: Array) -> Mesh:
    """Return triangles that are visible from both sides."""
    both = np.concatenate([faces, faces[:, ::-1]]).reshape(-1, 3)
    return points, both, np.tile(colour, (len(both), 1))


def _facing_view(normals: Sequence[Array]) -> Array:
    """Return the view (3, 3), from the side to which the planes face."""
    views = [view_from(azimuth, ELEVATION) for azimuth in AZIMUTHS]
    faces = [min((float(view[2] @ n) for n in normals), default=0.0) for view in views]
    # The first view, which all other pictures have, unless another one shows clearly more.
    best = int(np.argmax(faces))
    return views[0] if faces[0] > 0.3 else views[best]


def _drawn_meshes(
    framed: Sequence[Mesh], patches: Sequence[Mesh], view: Array, pixels: int
) -> Image:
    """Return the picture of meshes that fill it, the part first, and of the planes below them."""
    from scipy.ndimage import binary_dilation

    meshes = [*framed, *patches]
    starts = np.cumsum([0, *(len(points) for points, _, _ in meshes)])
    points = np.concatenate([points for points, _, _ in meshes])
    faces = np.concatenate([f + s for (_, f, _), s in zip(meshes, starts, strict=False)])
    colours = np.concatenate([colour for _, _, colour in meshes])
    size = pixels * FINE
    seen_points = points @ view.T
    inside = seen_points[: sum(len(points) for points, _, _ in framed), :2]
    low, high = inside.min(axis=0), inside.max(axis=0)
    scale = FILLED * size / float((high - low).max())
    shift = np.append(size / 2 - scale * (low + high) / 2, 0.0)
    seen = rasterise(seen_points * scale + shift, faces, size)
    normals = face_normals(points[faces])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    of_part = len(meshes[0][1])
    shade = brightness(normals)
    shade[of_part:] = 1.0
    image = np.zeros((size, size, 4))
    drawn = seen.face != NOTHING
    image[drawn, :3] = shade[seen.face[drawn], None] * colours[seen.face[drawn]]
    image[drawn, 3] = 1.0
    part = drawn & (seen.face < of_part)
    lines = binary_dilation(edges(seen, normals) & binary_dilation(part))
    image[lines, :3] = EDGE_COLOUR
    image[lines, 3] = 1.0
    return downsample(image, FINE)[::-1]
