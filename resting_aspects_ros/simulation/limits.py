"""Defaults and limits of a run and its engines, which need no NumPy: help shows them at once."""

from resting_aspects_ros.errors import InvalidValueError, shown

MAX_DROPS = 2_000_000
MAX_SEED = 2**64 - 1
# The default seed is fixed, so that identical requests have identical results.
DEFAULT_SEED = 1
DEFAULT_DROPS = 1000
# The engines: the kernel, for parts that only touch planes, also on a GPU, and Bullet.
KERNEL, CUDA, BULLET = 'kernel', 'cuda', 'bullet'
NO_BULLET = (
    'Bullet, which simulates drops on blocks, meshes and edges, is not installed: '
    'pip install pybullet'
)


def check_drops(drops: int) -> None:
    """Raise InvalidValueError if the number of drops of a run is out of bounds."""
    check_integer('drops', drops, 1, MAX_DROPS)


def check_seed(seed: int) -> None:
    """Raise InvalidValueError if the seed is out of bounds."""
    check_integer('seed', seed, 0, MAX_SEED)


def check_integer(name: str, value: object, low: int, high: int) -> None:
    """Raise InvalidValueError unless a value is an integer within bounds."""
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )
