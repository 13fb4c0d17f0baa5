"""Pictures of parts among other things: their contacts with planes, and parts on a tray."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy.ndimage import binary_dilation, gaussian_filter
from shapely import affinity
from trimesh.intersections import slice_faces_plane

from resting_aspects_ros.arrays import Array, Bytes, Indices
from resting_aspects_ros.aspects.support import NONE, ContactPlane
from resting_aspects_ros.part.near import face_normals
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.figure import FAINT, PAPER, TEXT, new_figure
from resting_aspects_ros.report.format import COLOURS, GREY
from resting_aspects_ros.report.picture import (
    EDGE_COLOUR,
    ELEVATION,
    FILLED,
    FINE,
    NOTHING,
    Image,
    brightness,
    downsample,
    edges,
    rasterise,
    view_from,
    visible_faces,
)
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.tray_image import TrayCamera

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
        patches.append(_patch(planes[k], others, centre, radius, PLANE_COLOURS[number]))
        meshes.append(_contact(planes[k], corners, radius, CONTACT_COLOURS[number]))
    return _drawn(meshes, patches, _view([planes[k].normal for k in touched]), pixels)


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
    """Return (2, 3) unit vectors along a plane; the first is level."""
    level = np.cross([0.0, 0.0, 1.0], normal)
    first = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(level) < 1e-6 else level
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def _patch(
    plane: ContactPlane,
    others: Sequence[ContactPlane],
    centre: Array,
    radius: float,
    colour: Array,
) -> Mesh:
    """Return a square of the plane below the part, as far as it is outside the other bodies."""
    middle = centre - plane.normal * (centre @ plane.normal - plane.offset)
    square = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    points = middle + PATCH * radius * square @ _axes(plane.normal)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    for other in others:
        if len(faces):
            end = other.offset * other.normal
            points, faces, *_ = slice_faces_plane(points, faces, other.normal, end)
    return _two_sided(points, faces, colour)


def _contact(plane: ContactPlane, corners: Array, radius: float, colour: Array) -> Mesh:
    """Return the area in which the hull touches the plane, enlarged by a rim, just above it."""
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


def _view(normals: Sequence[Array]) -> Array:
    """Return the view (3, 3), from the side to which the planes face."""
    views = [view_from(azimuth, ELEVATION) for azimuth in AZIMUTHS]
    faces = [min((float(view[2] @ n) for n in normals), default=0.0) for view in views]
    # The first view, which all other pictures have, unless another one shows clearly more.
    best = int(np.argmax(faces))
    return views[0] if faces[0] > 0.3 else views[best]


def _drawn(framed: Sequence[Mesh], patches: Sequence[Mesh], view: Array, pixels: int) -> Image:
    """Return the picture of meshes that fill it, the part first, and of the planes below them."""
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


# Inches.
WIDTH, HEAD, FOOT, MARGIN = 6.2, 0.78, 0.42, 0.12
DOTS_PER_INCH = 130
_CHARACTERS = 84


@dataclass(frozen=True)
class DrawnPart:
    """What a vision system has seen.

    symmetry_class : int
        0: not recognised, or parts that touch.
    x, y, yaw : float
        Camera pose, m and rad.
    rank : int
        Place among the parts to be picked, from 1; 0: it is not picked.
    """

    symmetry_class: int
    x: float
    y: float
    yaw: float
    rank: int = 0


def save_tray_picture(
    path: Path,
    image: Bytes,
    camera: TrayCamera,
    parts: Sequence[DrawnPart],
    outlines: Sequence[Outline],
    title: str,
    reason: str,
    pickable: Sequence[int],
) -> None:
    """Write a PNG file with the image of a tray (height, width), outlines of parts, and advice.

    ``outlines`` are those of all classes, and ``pickable`` the numbers of the pickable ones.
    ``title`` and ``reason`` are the advice in a few words, and its reason.
    """
    width, height = camera.size
    size = WIDTH - 2 * MARGIN
    drawn = size * height / width
    total = HEAD + drawn + FOOT
    figure = new_figure(WIDTH, total)
    axes = figure.add_axes((MARGIN / WIDTH, FOOT / total, size / WIDTH, drawn / total))
    # Half of the contrast, so that outlines and numbers stand out.
    # Without the noise, the file is a fifth as large.
    smooth = 8 * np.rint(gaussian_filter(image.astype(np.float32), 1.5) / 8)
    axes.imshow(smooth, cmap='gray', vmin=-180, vmax=235, interpolation='nearest')
    axes.set_axis_off()
    for part in parts:
        _draw_part(axes, part, camera, outlines)
    left = MARGIN / WIDTH
    figure.text(left, 1 - 0.3 / total, title, size=11, weight='bold', color=TEXT)
    text = '\n'.join(textwrap.wrap(reason, _CHARACTERS)[:2])
    figure.text(left, 1 - 0.44 / total, text, size=8, color=FAINT, va='top')
    seen = sorted({part.symmetry_class for part in parts})
    x = left
    for number in seen:
        name = 'not recognised, or touching'
        if number:
            name = f'class {number}' + (', pickable' if number in pickable else '')
        figure.text(x, 0.15 / total, '■', size=10, color=_colour(number))
        figure.text(x + 0.15 / WIDTH, 0.16 / total, name, size=8, color=TEXT)
        x += (0.33 + 0.066 * len(name)) / WIDTH
    figure.savefig(path, format='png', dpi=DOTS_PER_INCH, facecolor=PAPER)


def _draw_part(
    axes: 'Axes', part: DrawnPart, camera: TrayCamera, outlines: Sequence[Outline]
) -> None:
    """Draw the outline of a part with its class, or its place among the picks."""
    colour = _colour(part.symmetry_class)
    (point,) = camera.model.to_image([[part.x, part.y]])
    if part.symmetry_class:
        outline = outlines[part.symmetry_class - 1].polygon
        turned = affinity.rotate(outline, part.yaw, origin=(0, 0), use_radians=True)
        polygon = camera.to_image(affinity.translate(turned, part.x, part.y))
        for ring in (polygon.exterior, *polygon.interiors):
            u, v = shapely.get_coordinates(ring).T
            axes.plot(u, v, color=colour, linewidth=2.6 if part.rank else 1.4)
        (point,) = shapely.get_coordinates(polygon.representative_point())
    box = {'boxstyle': 'circle,pad=0.25', 'facecolor': colour, 'edgecolor': PAPER}
    text = f'{part.rank}' if part.rank else '' if part.symmetry_class else '?'
    if text:
        axes.text(
            float(point[0]),
            float(point[1]),
            text,
            bbox=box if part.rank else None,
            ha='center',
            va='center',
            color=PAPER,
            size=9,
            weight='bold',
        )


def _colour(symmetry_class: int) -> str:
    return COLOURS[(symmetry_class - 1) % len(COLOURS)] if symmetry_class else GREY
