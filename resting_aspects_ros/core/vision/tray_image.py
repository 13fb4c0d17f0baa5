"""The image of the parts on a tray, as a telecentric camera above a backlight takes it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import gaussian_filter

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.camera import Telecentric
from resting_aspects_ros.core.vision.raster import covered_share

MM = 1e-3  # m/mm
# Grey values of the backlight and of a part.
LIGHT, DARK = 225.0, 30.0
# What the image shows around the tray, m.
MARGIN = 4e-3
MAX_PIXELS = 1 << 24

Bytes = npt.NDArray[np.uint8]


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
        return shapely.transform(polygon, self._pixels)

    def _pixels(self, points: Array) -> Array:
        return np.asarray(np.array(self.centre) + points * [self.scale, -self.scale])


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
