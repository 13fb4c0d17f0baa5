"""Images of outlines for vision systems: templates, masks, and their COCO annotations."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import Polygon
from shapely.affinity import affine_transform

from resting_aspects_ros.arrays import Array, Bytes
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.outline_drawing import MM
from resting_aspects_ros.vision.outline import Outline, covered_share, rings

PIXELS_PER_MM = 10.0
# Empty pixels around the part in each image.
MARGIN = 8
MAX_PIXELS = 1 << 24

# The entry of an image in a COCO document, and its annotation.
Described = tuple[dict[str, object], dict[str, object]]


@dataclass(frozen=True, eq=False)
class OutlineImage:
    """The image of an outline as a telecentric camera straight above sees it.

    Image coordinates are in pixels, x to the right and y down, and (0, 0) is the outer corner of
    the upper left pixel, whose centre is at (0.5, 0.5).

    symmetry_class : int
    scale : float
        px/m.
    origin : (2,) float
        Image coordinates of the origin of the outline, below the centre of mass.
    polygon : shapely.Polygon
        The outline in image coordinates.
    covered : (height, width) float
        Share of each pixel that the part covers.
    """

    symmetry_class: int
    scale: float
    origin: Array
    polygon: Polygon
    covered: Array

    @property
    def mask(self) -> Bytes:
        """The (height, width) image with 255 where at least half of the pixel is covered."""
        return np.where(self.covered >= 0.5, 255, 0).astype(np.uint8)

    @property
    def template(self) -> Bytes:
        """The (height, width) image on a backlight: the part 0, the surroundings 255."""
        return np.round(255 * (1 - self.covered)).astype(np.uint8)


def check_px_per_mm(outlines: Sequence[Outline], px_per_mm: float) -> None:
    """Raise InvalidValueError if an image would be too large, or a part smaller than a pixel."""
    sides = [np.ptp(np.reshape(each.polygon.bounds, (2, 2)), axis=0) * MM for each in outlines]
    largest = max((float(side.max()) for side in sides), default=1.0)
    smallest = min((float(side.max()) for side in sides), default=1.0)
    high = (MAX_PIXELS**0.5 - 2 * MARGIN - 2) / largest
    low = 1 / smallest
    if not low <= px_per_mm <= high:  # also refuses nan
        raise InvalidValueError(
            f'invalid px_per_mm {shown(px_per_mm)}: expected {low:.3g} to {high:.3g} for a part '
            f'of this size'
        )


def outline_image(outline: Outline, px_per_mm: float = PIXELS_PER_MM) -> OutlineImage:
    """Return the image of an outline. Raises InvalidValueError as `check_px_per_mm` does."""
    check_px_per_mm([outline], px_per_mm)
    scale = MM * px_per_mm
    left, low, right, high = (scale * each for each in outline.polygon.bounds)
    # The origin is a corner of a pixel, so that the images of all classes have the same raster.
    origin = np.array([np.ceil(-left), np.ceil(high)]) + MARGIN
    width, height = np.ceil([right, -low]) + origin + MARGIN
    polygon = affine_transform(outline.polygon, [scale, 0, 0, -scale, *origin])
    covered = covered_share(polygon, int(width), int(height))
    return OutlineImage(outline.symmetry_class, scale, origin, polygon, covered)


def png_file(image: Bytes) -> bytes:
    """Return an 8-bit grey image as a PNG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image).save(file, format='PNG')
    return file.getvalue()


def coco_document(part: Part, described: Sequence[Described]) -> dict[str, object]:
    """Return images and their annotations, from `described_image`, as a COCO document.

    The id of image, category and annotation is the number of the symmetry class.
    """
    numbers = [image['id'] for image, _ in described]
    return {
        'info': {'description': f'Outlines of {part.name}, one for each symmetry class'},
        'licenses': [],
        'images': [image for image, _ in described],
        'categories': [
            {'id': k, 'name': f'{part.name}_class_{k}', 'supercategory': part.name}
            for k in numbers
        ],
        'annotations': [annotation for _, annotation in described],
    }


def described_image(image: OutlineImage) -> Described:
    """Return the entry of an image in a COCO document, and its annotation.

    COCO polygons cannot have holes: a class without holes has a polygon, and a class with holes an
    uncompressed run-length encoding of its mask.
    """
    number = image.symmetry_class
    height, width = image.covered.shape
    entry = {
        'id': number,
        'file_name': template_name(number),
        'mask_file_name': mask_name(number),
        'width': width,
        'height': height,
        'px_per_mm': image.scale / MM,
        'origin': image.origin.tolist(),
    }
    return entry, _annotation(image)


def template_name(symmetry_class: int) -> str:
    """Return the name of the template of a class."""
    return f'class_{symmetry_class}_template.png'


def mask_name(symmetry_class: int) -> str:
    """Return the name of the mask of a class."""
    return f'class_{symmetry_class}_mask.png'


def _annotation(image: OutlineImage) -> dict[str, object]:
    left, top, right, bottom = image.polygon.bounds
    area, segmentation = image.polygon.area, _segmentation(image)
    if image.polygon.interiors:
        area = float(np.count_nonzero(image.mask))
    return {
        'id': image.symmetry_class,
        'image_id': image.symmetry_class,
        'category_id': image.symmetry_class,
        'iscrowd': 0,
        'segmentation': segmentation,
        'area': area,
        'bbox': [left, top, right - left, bottom - top],
    }


def _segmentation(image: OutlineImage) -> object:
    if not image.polygon.interiors:
        (ring,) = rings(image.polygon)
        return [ring.ravel().tolist()]
    # Lengths of alternating runs, column by column, beginning with a run of zeros.
    flat = np.concatenate([[0], (image.mask > 0).T.ravel().astype(np.int8)])
    starts = np.flatnonzero(np.diff(flat))
    counts = np.diff(np.concatenate([[0], starts, [image.mask.size]]))
    return {'size': list(image.mask.shape), 'counts': counts.tolist()}
