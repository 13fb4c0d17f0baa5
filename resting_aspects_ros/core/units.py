"""Units of mesh coordinates, and checks of the size of a part."""

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import PartError

Array = npt.NDArray[np.float64]

# Metres in one unit of a mesh's coordinates.
UNITS: dict[str, float] = {
    'um': 1e-6,
    'mm': 1e-3,
    'cm': 1e-2,
    'm': 1.0,
    'in': 0.0254,
    'ft': 0.3048,
}
if TYPE_CHECKING:
    Unit: TypeAlias = str
else:
    Unit = Literal[tuple(UNITS)]  # of a field in a file
UNIT_NAMES = {
    'um': 'micrometres',
    'mm': 'millimetres',
    'cm': 'centimetres',
    'm': 'metres',
    'in': 'inches',
    'ft': 'feet',
}
DEFAULT_UNIT = 'mm'  # of STL, OBJ, PLY and OFF files; most parts are designed in mm

# Ranges of the longest side, m. Outside POSSIBLE_SIZE the unit is probably wrong, even if it was
# given; outside USUAL_SIZE it may be wrong if it is only the default. LIKELY_SIZE is the range of
# parts in feeders; only units that bring a part into it are suggested.
POSSIBLE_SIZE = (1e-4, 2.0)
USUAL_SIZE = (3e-3, 2.0)
LIKELY_SIZE = (5e-3, 0.3)
# Change of the volume by rounding in the file, as a share, up to which there is no warning.
MAX_VOLUME_CHANGE = 1e-4
# Change from which the aspects cannot be right: the steps are as large as the part is thick.
REFUSED_VOLUME_CHANGE = 0.5
MAX_SIZE = 1e6  # m, any coordinate: far above any part, far below overflow in the integrals
MIN_SIZE = 1e-9  # m


def check_size(vertices: Array, unit: str, label: str) -> None:
    """Raise PartError if the coordinates (n, 3), in the unit, are too large or too small."""
    with np.errstate(over='ignore'):
        reach = float(np.abs(vertices).max()) * UNITS[unit]
        size = float(np.ptp(vertices, axis=0).max()) * UNITS[unit]
    if reach > MAX_SIZE:
        raise PartError(
            f'{label} has a coordinate of {reach:.3g} m: expected at most {MAX_SIZE:.0e} m'
        )
    if size < MIN_SIZE:
        raise PartError(
            f'{label} has no volume: its longest side is {size:.3g} m, expected at least '
            f'{MIN_SIZE:.0e} m'
        )


def box_text(sides: Array, unit: str) -> str:
    """Return the sides of a box (3,), given in the unit, as text in mm: '40 x 30 x 20 mm'."""
    lengths = 1e3 * UNITS[unit] * sides
    return ' x '.join(f'{x:.4g}' if x < 1e4 else f'{x:.0f}' for x in lengths.tolist()) + ' mm'


def size_warnings(vertices: Array, unit: str, *, given: bool) -> list[str]:
    """Return a warning if the size suggests another unit, with the size in each likely unit.

    given : whether the unit was given, or is the default.
    """
    sides = np.ptp(vertices, axis=0)
    size = float(sides.max())
    low, high = POSSIBLE_SIZE if given else USUAL_SIZE
    if low <= size * UNITS[unit] <= high:
        return []
    likely = [
        f'in {text} it would be {box_text(sides, other)}'
        for other, text in UNIT_NAMES.items()
        if other != unit and LIKELY_SIZE[0] <= size * UNITS[other] <= LIKELY_SIZE[1]
    ]
    sizes = '; '.join([f'the part is {box_text(sides, unit)} with the unit {unit}', *likely])
    return [f'{sizes}. Is the unit correct?']


def coarseness(
    vertices: Array, faces: npt.NDArray[np.int64], unit: str, steps: Array
) -> tuple[float, str]:
    """Return the relative error of the volume by coarse coordinates, and a warning; 0, '' if fine.

    The effect of the steps on the volume is estimated by moving each side of the part by half a
    step.

    Parameters
    ----------
    vertices : (n, 3) float64
        In the unit.
    faces : (m, 3) int64
    steps : (3,) float64
        Steps in which the file stores the coordinates of each axis, in the unit. STL and many
        other files store float32, whose steps grow with the distance from the origin.
    """
    sides = np.ptp(vertices, axis=0)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    a, b, c = np.moveaxis((vertices - middle)[faces], 1, 0)
    areas = np.cross(b - a, c - a) / 2
    volume = abs(float(np.einsum('ij,ij->', a, areas))) / 3
    change = float(np.abs(areas).sum(axis=0) @ steps) / 2
    # A surface without volume is not coarse, unless its sides are.
    fine = change <= MAX_VOLUME_CHANGE * volume
    if fine or (volume <= change and steps.max() < MAX_VOLUME_CHANGE * sides.max()):
        return 0.0, ''
    millimetres = 1e3 * UNITS[unit]
    share = f'{100 * change / volume:.2g} %' if change < volume else '100 % or more'
    text = (
        f'its coordinates of up to {np.abs(vertices).max() * millimetres:.4g} mm are stored in '
        f'steps of {steps.max() * millimetres:.2g} mm, which is coarse for a part of '
        f'{box_text(sides, unit)}: its volume may be wrong by {share}, and it may have aspects '
        'that it should not have. Move the part to the origin before it is exported, or export '
        'it with more digits'
    )
    return change / max(volume, change), text
