"""Units of a mesh's coordinates, and the sizes that make sense in them."""

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
DEFAULT_UNIT = 'mm'  # none of STL, OBJ and PLY says its unit; most parts are drawn in mm


USUAL_SIZE = (1e-4, 2.0)  # m; outside of it the unit is probably wrong
LIKELY_SIZE = (1e-3, 1.0)  # m; of a part that is fed
MAX_SIZE = 1e6  # m, of any coordinate: far above any part, far below overflow in the integrals
MIN_SIZE = 1e-9  # m


def check_size(vertices: Array, unit: str, label: str) -> None:
    """Raise PartError for coordinates (n, 3), in the unit, that no part can have."""
    with np.errstate(over='ignore'):
        reach = float(np.abs(vertices).max()) * UNITS[unit]
        size = float(np.ptp(vertices, axis=0).max()) * UNITS[unit]
    if reach > MAX_SIZE:
        raise PartError(
            f'{label} has a coordinate of {reach:.3g} m: at most {MAX_SIZE:.0e} m are allowed'
        )
    if size < MIN_SIZE:
        raise PartError(
            f'{label} has no volume: its longest side is {size:.3g} m, and at least '
            f'{MIN_SIZE:.0e} m are needed'
        )


def size_warnings(vertices: Array, unit: str) -> list[str]:
    """Warn of a size that suggests another unit, and name those that give a likely one."""
    sides = np.ptp(vertices, axis=0)
    size = float(sides.max())
    if USUAL_SIZE[0] <= size * UNITS[unit] <= USUAL_SIZE[1]:
        return []
    likely = [
        f'{1e3 * size * metres:.4g} mm with {other}'
        for other, metres in UNITS.items()
        if LIKELY_SIZE[0] <= size * metres <= LIKELY_SIZE[1]
    ]
    box = ' x '.join(f'{1e3 * side * UNITS[unit]:.6g}' for side in sides)
    hint = f' (its longest side would be {" or ".join(likely)})' if likely else ''
    return [f'the part is {box} mm with the unit {unit}: is the unit right{hint}?']
