"""Images of the parts on a simulated tray, and random places of outlines on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import gaussian_filter
from shapely import affinity

from resting_aspects_ros.arrays import Array, Bytes
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.vision.camera import Telecentric
from resting_aspects_ros.vision.outline import Outline, covered_share

MM = 1e-3  # m/mm
# Grey values of the backlight and of a part.
LIGHT, DARK = 225.0, 30.0
# What the image shows around the tray, m.
MARGIN = 4e-3
MAX_PIXELS = 1 << 24


@dataclass(frozen=True)
class TrayCamera:
    """A telecentric camera straight above the middle of a tray.

    Image coordinates are in pixels, u to the right and v down, and (0, 0) is the centre of the
    upper left pixel. The origin of the tray frame is the middle of the tray and of the image.

    tray : (float, float)
        Width and depth of the tray, m.
    px_per_mm : float
    """

    tray: tuple[float, float]
    px_per_mm: float

    def __post_init__(self) -> None:
        most = MM * (MAX_PIXELS / np.prod(np.add(self.tray, 2 * MARGIN))) ** 0.5
        if not 0.1 <= self.px_per_mm <= most:  # also refuses nan
            raise InvalidValueError(
                f'invalid px_per_mm {shown(self.px_per_mm)}: expected 0.1 to {most:.3g} for a '
                'tray of this size'
            )

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.px_per_mm / MM

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        width, height = np.ceil(np.add(self.tray, 2 * MARGIN) * self.scale).astype(int)
        return int(width), int(height)

    @property
    def centre(self) -> tuple[float, float]:
        """Where the origin of the tray frame is seen, px."""
        width, height = self.size
        return (width - 1) / 2, (height - 1) / 2

    @property
    def model(self) -> Telecentric:
        """The camera with its homography."""
        (u, v), size = self.centre, 1 / self.scale
        return Telecentric(
            np.array([[size, 0.0, -u * size], [0.0, -size, v * size], [0.0, 0.0, 1.0]])
        )

    def to_image(self, polygon: shapely.Polygon) -> shapely.Polygon:
        """Return a polygon of the tray frame, m, in image coordinates, px."""
        return shapely.transform(polygon, self.model.to_image)


def render_tray(
    polygons: Sequence[shapely.Polygon],
    camera: TrayCamera,
    generator: np.random.Generator,
    *,
    blur: float = 0.0,
    noise: float = 0.0,
) -> Bytes:
    """Return the image (height, width) of parts on a backlight, without shadows and reflections.

    Parameters
    ----------
    polygons : sequence of Polygon
        Outlines of the parts on the tray, tray frame, m.
    camera : TrayCamera
    generator : Generator
        Of the noise.
    blur : float
        Standard deviation of a Gaussian blur, px.
    noise : float
        Standard deviation of the independent noise of each pixel, grey values.
    """
    width, height = camera.size
    # In covered_share, (0, 0) is the corner of the first pixel, and not its centre.
    seen = [shapely.transform(camera.to_image(each), lambda p: p + 0.5) for each in polygons]
    image = LIGHT + (DARK - LIGHT) * covered_share(seen, width, height).astype(np.float32)
    if blur > 0:
        image = gaussian_filter(image, blur, mode='nearest')
    if noise > 0:
        image += noise * generator.standard_normal(image.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8)


# -- Places ---------------------------------------------------------------------------------------


# Random places that are tried for a part; if none is empty, the part lies on another one.
TRIES = 60
# Corners of the outlines are left out up to this distance, m, so that the places are found faster.
DETAIL = 5e-6
# Number of yaws that are tried for an outline that does not fit on the tray in a random one.
YAWS = 360


class OutlinePlaces:
    """Random places of the outlines without overlap, which stay until the next vibration.

    Each part of a rolling class has a random outline of its family.

    Parameters
    ----------
    outlines : sequence of Outline
        One for each class.
    size : (float, float)
        Width and depth of the tray, within which all parts lie, m.
    generator : Generator

    Attributes
    ----------
    poses : (n, 3) float
        Camera poses of the parts in their order: x and y of the centre of mass, m, and yaw, rad,
        in the tray frame, whose origin is the middle of the tray.
    polygons : list of Polygon
        Their outlines, tray frame, m.

    Raises
    ------
    InvalidValueError
        An outline does not fit on the tray in any direction.
    """

    def __init__(
        self,
        outlines: Sequence[Outline],
        size: tuple[float, float],
        generator: np.random.Generator,
    ) -> None:
        self._shapes = [
            [shapely.simplify(each, DETAIL) for each in (outline.polygon, *outline.family)]
            for outline in outlines
        ]
        self._half = np.array(size) / 2
        self._generator = generator
        for outline, shapes in zip(outlines, self._shapes, strict=True):
            if not all(len(self._fitting_yaws(shape)) for shape in shapes):
                sides = ' x '.join(f'{1000 * side:.4g}' for side in size)
                raise InvalidValueError(
                    f'invalid tray {sides} mm: expected one into which the outline of class '
                    f'{outline.symmetry_class} fits, {1000 * outline.length:.4g} x '
                    f'{1000 * outline.width:.4g} mm'
                )
        self.poses: Array = np.zeros((0, 3))
        self.polygons: list[shapely.Polygon] = []

    @property
    def centres(self) -> Array:
        """(n, 2) float: centroids of the outlines, m."""
        polygons = np.array(self.polygons, dtype=object)
        return np.asarray(shapely.get_coordinates(shapely.centroid(polygons)))

    def shake(self, classes: npt.NDArray[np.int64]) -> None:
        """Give parts of these classes (n,) new places; nothing else is on the tray."""
        self.poses, self.polygons = np.zeros((0, 3)), []
        self.add(classes)

    def add(self, classes: npt.NDArray[np.int64]) -> None:
        """Add places for the last of the classes (n,), which do not have a place yet."""
        for kind in classes[len(self.polygons) :]:
            shapes = self._shapes[kind]
            shape = shapes[self._generator.integers(len(shapes))]
            pose, polygon = self._empty_place(shape)
            self.poses = np.vstack([self.poses, pose])
            self.polygons.append(polygon)

    def keep(self, which: npt.NDArray[np.bool_]) -> None:
        """Remove all but some of the parts."""
        self.poses = self.poses[which]
        self.polygons = [self.polygons[k] for k in np.flatnonzero(which)]

    def clearance(self) -> Array:
        """Return the distance (n,) of each outline from the next, m; infinite for a single one."""
        all_of_them = np.array(self.polygons, dtype=object)
        apart = shapely.distance(all_of_them[:, None], all_of_them[None, :])
        np.fill_diagonal(apart, np.inf)
        return np.asarray(apart.min(axis=1, initial=np.inf))

    def _empty_place(self, shape: shapely.Polygon) -> tuple[Array, shapely.Polygon]:
        """Return the first of random camera poses (3,) with an empty place, and its outline."""
        others = np.array(self.polygons, dtype=object)
        for _ in range(TRIES):
            yaw = self._generator.uniform(-np.pi, np.pi)
            turned, low, high = _turned(shape, yaw)
            if (high - low > 2 * self._half).any():
                yaw = self._generator.choice(self._fitting_yaws(shape))
                turned, low, high = _turned(shape, yaw)
            # One that only just fits may be larger by rounding.
            middle, room = -(low + high) / 2, np.maximum(self._half - (high - low) / 2, 0.0)
            place = middle + room * self._generator.uniform(-1, 1, 2)
            placed = affinity.translate(turned, *place)
            if not shapely.intersects(placed, others).any():
                break
        return np.array([*place, yaw]), placed

    def _fitting_yaws(self, shape: shapely.Polygon) -> Array:
        """Return the yaws (k,) of YAWS in which an outline fits on the tray, rad."""
        yaws = np.linspace(-np.pi, np.pi, YAWS, endpoint=False)
        points = shapely.get_coordinates(shape.convex_hull) @ np.array([1, 1j])
        turned = points * np.exp(1j * yaws)[:, None]
        half = np.column_stack([np.ptp(turned.real, axis=1), np.ptp(turned.imag, axis=1)]) / 2
        return yaws[(half <= self._half + DETAIL).all(axis=1)]


def _turned(shape: shapely.Polygon, yaw: float) -> tuple[shapely.Polygon, Array, Array]:
    """Return a polygon rotated about the origin, with the corners (2,) of its bounds."""
    turned = affinity.rotate(shape, yaw, origin=(0, 0), use_radians=True)
    low, high = np.reshape(turned.bounds, (2, 2))
    return turned, low, high
