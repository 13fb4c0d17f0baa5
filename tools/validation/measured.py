"""Dice, coins and blocks whose resting aspects were counted by hand or by a machine.

Only their proportions are published; all are taken to be about 20 mm in size. Sources:

* Steel square cuboids: The Mathematical Gazette, note 97.16, 2013; students' rolls by hand.
* Thick coin: 1000 flips by hand.
* Near cube: rolled by a machine onto plexiglas; a cube whose one axis is short by a share s (up
  to 13 %) lies on the two faces across it in 1/3 (1 + 2 s) of rolls. A cube had no bias in
  640,934 rolls.
* Die Binom3: Baktash, Sharp, Zhou, Crane, Jacobson, SIGGRAPH 2025; printed, rolled by hand.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part

Array = npt.NDArray[np.float64]

# mm: of the square faces of the cuboids and of the cubes, and of the coin's diameter; and of the
# unit of the numbers that the die is published with, which makes it as large.
SIZE = 20.0
DIE_UNIT = 14.0
# A pose is on a face if that points down within this.
FACE_ANGLE = np.radians(5.0)
# Besides sampling: neighbouring cuboids scatter by so much more than it explains.
SCATTER = 0.02

CUBOIDS = (
    (0.47, 0.916, 332),
    (0.75, 0.548, 799),
    (0.93, 0.399, 516),
    (1.16, 0.148, 1011),
    (1.44, 0.052, 654),
    (1.60, 0.017, 702),
    (1.87, 0.009, 680),
    (2.65, 0.006, 503),
)
SHORT = (0.03, 0.13)
BINOM3 = np.array(
    [
        (-0.7935591, 0, 0.4791195),
        (0.3202141, 0, 0.3201930),
        (0.1539833, 0.3543327, 0.3400605),
        (0.1539833, -0.3543327, 0.3400605),
        (0.1619182, 0, -0.9735855),
        (0.1602665, 0, 0.9658569),
        (-0.7891129, 0, -0.4764671),
        (0.3175497, 0, -0.3291496),
        (0.1573784, 0.3514274, -0.3330442),
        (0.1573784, -0.3514274, -0.3330442),
    ]
)
BINOM3_FACES = ((0.910, 0.415, -0.004), (0.910, -0.415, -0.004))


@dataclass(frozen=True, eq=False)
class Case:
    """A body, and the measured share of rolls that ended on some of its faces.

    faces : (k, 3) float
        Unit vectors of down in part for these faces; if empty, all directions across the z axis.
    share : float
        Measured share of rolls.
    rolls : int
        Number of rolls; 0 if it is not published.
    """

    name: str
    part: Part
    faces: Array
    share: float
    rolls: int

    def hits(self, down: Array) -> int:
        """Return how many of the down directions, (n, 3), are on these faces."""
        if len(self.faces):
            return int(((down @ self.faces.T) > np.cos(FACE_ANGLE)).any(axis=1).sum())
        return int((np.abs(down[:, 2]) < np.sin(FACE_ANGLE)).sum())

    @property
    def deviation(self) -> float:
        """Standard deviation of the measurement, from sampling and scatter."""
        sampling = self.share * (1 - self.share) / self.rolls if self.rolls else 0.0
        return float(np.hypot(np.sqrt(sampling), SCATTER))


def cases() -> list[Case]:
    """Return all measured cases."""
    ends = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    found = []
    for thickness, share, rolls in CUBOIDS:
        box = trimesh.creation.box((SIZE, SIZE, SIZE * thickness))
        found.append(Case(f'cuboid {thickness:.2f}', _part(box), ends, share, rolls))
    coin = trimesh.creation.cylinder(SIZE / 2, 0.577 * SIZE, sections=64)
    found.append(Case('coin 0.577, on its side', _part(coin), np.zeros((0, 3)), 0.410, 1000))
    for short in SHORT:
        cube = trimesh.creation.box((SIZE, SIZE, SIZE * (1 - short)))
        share = (1 + 2 * short) / 3
        found.append(Case(f'cube, {100 * short:.0f} % short', _part(cube), ends, share, 0))
    die = trimesh.convex.convex_hull(BINOM3 * DIE_UNIT)
    faces = np.array(BINOM3_FACES) / np.linalg.norm(BINOM3_FACES, axis=1, keepdims=True)
    found.append(Case('die Binom3, faces 0 and 3', _part(die), faces, (43 + 31) / 329, 329))
    return found


def _part(mesh: trimesh.Trimesh) -> Part:
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    return part_from_bytes(data, 'stl', 'measured')
