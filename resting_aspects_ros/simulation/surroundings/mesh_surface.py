"""A mesh as the surface on which parts are dropped.

A document of such surroundings has the name of the file and its hash. Where only the document is
known, the mesh surface has no triangles: drops are counted and described, but cannot be made.
"""

import dataclasses
import functools
import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.geometry.mesh_file import read_triangles
from resting_aspects_ros.core.input_file import named, read_input
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.units import DEFAULT_UNIT, UNITS, check_size
from resting_aspects_ros.simulation.quantity import check_quantities, quantity
from resting_aspects_ros.simulation.surroundings.kinds import NO_CONTACT, Contacts, X, Y, Z
from resting_aspects_ros.simulation.surroundings.scene import HalfSpace, MeshBody, SceneBody

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.surroundings.flat_sides import MergedMesh

# Triangles that are near a part are tested in every step.
MAX_TRIANGLES = 100_000
MAX_BYTES = 64 << 20


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The file of a mesh surface.

    name : str
        Name of the file, without folders.
    data : bytes
    vertices, triangles : (n, 3) float and (m, 3) int
        As in the file: in its unit.
    """

    name: str
    data: bytes
    vertices: Array
    triangles: npt.NDArray[np.int64]

    @cached_property
    def sha256(self) -> str:
        """Hash of the bytes."""
        return hashlib.sha256(self.data).hexdigest()


def mesh_file(data: bytes, name: str, label: str) -> MeshFile:
    """Return the mesh in the bytes of an STL, OBJ, PLY or OFF file; ``label`` is for errors.

    Raises InvalidValueError or PartError. It parses untrusted data: a node calls it in a
    FileWorker.
    """
    name = Path(name).name
    mesh_format = Path(name).suffix.lower().lstrip('.')
    vertices, triangles, _ = read_triangles(data, mesh_format, label)
    if len(triangles) > MAX_TRIANGLES:
        raise InvalidValueError(
            f'{label} has {len(triangles)} triangles: expected at most {MAX_TRIANGLES}'
        )
    return MeshFile(name, data, vertices, triangles)


def read_mesh(path: Path) -> MeshFile:
    """Return the mesh in a file; raises InvalidValueError or PartError."""
    data = read_input(path, MAX_BYTES, 'mesh of the surroundings', InvalidValueError)
    return mesh_file(data, path.name, named('mesh of the surroundings', path))


@functools.lru_cache(maxsize=16)
def _merged(surface: 'MeshSurface', radius: float) -> 'MergedMesh':
    # Shapely is needed for meshes only.
    from resting_aspects_ros.simulation.surroundings.flat_sides import merged_mesh

    return merged_mesh(surface.vertices, surface.triangles, radius)


def _position(axis: str) -> Any:
    return quantity(
        axis, 'm', f'{axis} of the origin of the file', low=-100, high=100, default=0.0
    )


def _angle(axis: str) -> Any:
    return quantity(
        f'rotation about {axis}',
        'rad',
        f'rotation of the mesh about {axis}, in the order x, y, z about the axes of the tray',
        low=-2 * math.pi,
        high=2 * math.pi,
        default=0.0,
    )


@dataclass(frozen=True)
class MeshSurface:
    """A mesh whose triangles point outward, with its pose in the tray frame.

    mesh : str
        Path of an STL, OBJ, PLY or OFF file, which is read; it becomes the name of the file.
    unit : str
        Unit of its coordinates.
    x, y, z, rx, ry, rz : float
        Position of its origin, m, and rotations about the fixed axes x, y and z, in this order,
        rad.
    mesh_sha256 : str
        Hash of the file. If it is given, no file is read.
    file : MeshFile, optional
        The mesh, if it was read already.

    Raises
    ------
    InvalidValueError, PartError
        If a value is out of bounds, the hash differs, or the file cannot be read.
    """

    kind: ClassVar[str] = 'mesh'
    body_names: ClassVar[tuple[str, ...]] = ('surface',)
    free: ClassVar[int] = 0
    across: ClassVar[tuple[float, float]] = (0.0, 0.0)

    mesh: str
    unit: str = DEFAULT_UNIT
    x: float = _position('x')
    y: float = _position('y')
    z: float = _position('z')
    rx: float = _angle('x')
    ry: float = _angle('y')
    rz: float = _angle('z')
    mesh_sha256: str = ''
    file: MeshFile | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.unit not in UNITS:
            raise InvalidValueError(
                f'invalid unit {shown(self.unit)}: expected one of {", ".join(UNITS)}'
            )
        if not isinstance(self.mesh, str | Path):
            raise InvalidValueError(f'invalid mesh {shown(self.mesh)}: expected a path')
        mesh = self.file
        if mesh is None and not self.mesh_sha256:
            mesh = read_mesh(Path(self.mesh))
        label = named('mesh of the surroundings', Path(self.mesh))
        set_field = object.__setattr__
        set_field(self, 'mesh', Path(self.mesh).name)
        if mesh is None:
            return
        if self.mesh_sha256 not in ('', mesh.sha256):
            raise InvalidValueError(
                f'invalid {label}: it has changed; expected the hash {shown(self.mesh_sha256)}'
            )
        check_size(mesh.vertices, self.unit, label)
        set_field(self, 'file', mesh)
        set_field(self, 'mesh_sha256', mesh.sha256)

    @cached_property
    def vertices(self) -> Array:
        """(n, 3) corners in the tray frame, m; raises InvalidValueError without the mesh."""
        return self._placed(self._known.vertices * UNITS[self.unit])

    @property
    def triangles(self) -> npt.NDArray[np.int64]:
        """(m, 3) indices of the corners; raises InvalidValueError without the mesh."""
        return self._known.triangles

    @property
    def _known(self) -> MeshFile:
        if self.file is None:
            raise InvalidValueError(
                f'invalid mesh {shown(self.mesh)} of surroundings: expected its triangles, but '
                'only its name and hash are known'
            )
        return self.file

    def _placed(self, points: Array) -> Array:
        """Return points (n, 3) of the file in the tray frame, m."""
        for axis, angle in enumerate((self.rx, self.ry, self.rz)):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            turned = points.copy()
            turned[:, a] = math.cos(angle) * points[:, a] - math.sin(angle) * points[:, b]
            turned[:, b] = math.sin(angle) * points[:, a] + math.cos(angle) * points[:, b]
            points = turned
        return np.asarray(points + np.array([self.x, self.y, self.z]))

    @property
    def texts(self) -> dict[str, str]:
        """Values of the description that are not numbers."""
        return {'mesh': self.mesh, 'unit': self.unit, 'mesh_sha256': self.mesh_sha256}

    @property
    def tilt(self) -> tuple[float, float]:
        """See Kind."""
        return 0.0, 0.0

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the mesh seen from above, m."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        x, y = ((low + high) / 2)[:2].tolist()
        return x, y

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (MeshBody('surface', contacts['surface'], X, self.vertices, self.triangles),)

    def merged(self, body: MeshBody, radius: float) -> MeshBody:
        """Return the body in the shapes that are simulated, for a part of a hull radius, m."""
        found = _merged(self, radius)
        return dataclasses.replace(
            body,
            prisms=found.prisms,
            remaining=found.vertices[found.triangles],
            sides=found.sides,
            distance=found.distance,
        )

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """See Kind: a part that is below the mesh or beside it has left it."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        reach = 2 * radius
        return (
            HalfSpace('below', NO_CONTACT, X, Z, float(low[2]) - radius),
            *(
                HalfSpace('beside', NO_CONTACT, X, sign * axis, float(sign * end[k]) - reach)
                for k, axis in enumerate((X, Y))
                for sign, end in ((1.0, low), (-1.0, high))
            ),
        )
