"""Errors of given initial states; a module without NumPy, from which flags are made."""

from dataclasses import dataclass

from resting_aspects_ros.simulation.quantity import check_quantities, quantity


@dataclass(frozen=True)
class Noise:
    """Standard deviations of normal errors of given states, for each component in tray axes."""

    orientation: float = quantity(
        'orientation noise', 'rad', 'noise of the orientation', high=10.0, default=0.0
    )
    velocity: float = quantity(
        'velocity noise', 'm/s', 'noise of the velocity', high=100.0, default=0.0
    )
    spin: float = quantity('spin noise', 'rad/s', 'noise of the spin', high=1e4, default=0.0)

    def __post_init__(self) -> None:
        check_quantities(self)
