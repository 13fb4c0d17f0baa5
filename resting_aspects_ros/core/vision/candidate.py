"""A class of a part that an observed polygon may show, with its poses."""

from dataclasses import dataclass

from resting_aspects_ros.core.vision.location import Pose


@dataclass(frozen=True, eq=False)
class Candidate:
    """A class of a part that an observed polygon may show.

    part : str
    symmetry_class : int
    aspects : tuple of int
        The aspects of the class, which look the same.
    x, y, yaw : float
        Camera pose of the outline: projection of the centre of mass, m, and yaw, rad.
    overlap : float
        Intersection over union; the noise of the observed polygon is smoothed.
    distance : float
        Largest distance between the boundaries, m.
    residual : float
        Root mean square of the distances between the boundaries, m.
    log_likelihood : float
        Natural logarithm up to a constant that all answers share; see `likelihood`.
    prior, posterior : float
        Probabilities; those of all candidates, none and touching add up to 1.
    roll : float
        Angle by which the part has rolled about the axis of the aspect, rad: that of the first
        pose, one of several if the outline does not tell it. 0 if the part does not roll.
    poses : tuple of Pose
        All poses of the part that look like this, tray frame; the most probable first.
    """

    part: str
    symmetry_class: int
    aspects: tuple[int, ...]
    x: float
    y: float
    yaw: float
    overlap: float
    distance: float
    residual: float
    log_likelihood: float
    prior: float
    posterior: float
    roll: float
    poses: tuple[Pose, ...]
