"""The kinds of surroundings: which bodies each has, in the scene frame; see scene.py.

The metadata of the fields is the only declaration of units, bounds and descriptions. A document
of a mesh surface has the name of the file and its hash. Where only the document is known, the
mesh surface has no triangles: drops are counted and described, but cannot be made.
"""

import dataclasses
import functools
import hashlib
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import named, read_input
from resting_aspects_ros.part.mesh_files import read_triangles
from resting_aspects_ros.part.near import face_normals
from resting_aspects_ros.part.part import DEFAULT_UNIT, UNITS, check_size
from resting_aspects_ros.simulation.conditions import Described, quantity
from resting_aspects_ros.simulation.scene import (
    Block,
    HalfSpace,
    MeshBody,
    PairValues,
    SceneBody,
    X,
    Y,
    Z,
    ground_below,
)

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.mesh_simplification import MergedMesh


# Maximum inclination, rad: 85 degrees.
MAX_TILT = math.radians(85)
# Depth of blocks below the surface on which parts rest, m.
DEPTH = 1.0
# Length of a track along x in both directions, m, as it is drawn; parts meet no end of it.
LENGTH = 10.0

Contacts = Mapping[str, PairValues]


class Kind(Described):
    """A kind of surroundings: bodies in the scene frame, level unless they have a roll or a pitch.

    It is a frozen dataclass whose dimensions are declared by `quantity`.

    Attributes
    ----------
    body_names : tuple of str
        The first is the body on which aspects are counted.
    free : int
        In how many directions the surroundings are the same everywhere: 2 (x and y), 1 (x) or 0.
    across : (float, float)
        Lowest and highest place of release across x, in hull radii from ``centre``.
    place : str
        Where parts are, such as 'on a'.
    loss : str
        How parts leave the surroundings, if they can.
    file : MeshFile or None
        The mesh, if there is one and it is known.
    """

    body_names: ClassVar[tuple[str, ...]] = ('floor',)
    free: ClassVar[int] = 0
    across: ClassVar[tuple[float, float]] = (0.0, 0.0)
    place: ClassVar[str] = 'on a'
    loss: ClassVar[str] = 'they left the surroundings'
    file: 'MeshFile | None' = None

    @property
    def texts(self) -> dict[str, str]:
        """Values of the description that are not numbers."""
        return {}

    @property
    def level(self) -> bool:
        """Whether these are the infinite level plane."""
        return False

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll about x, and then pitch about y, of the scene in the tray frame, rad."""
        return getattr(self, 'roll', 0.0), getattr(self, 'pitch', 0.0)

    @property
    def centre(self) -> tuple[float, float]:
        """Place of release, m, unless it is given; see ``across``."""
        return 0.0, 0.0

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """Return the bodies; ``contacts`` by their names."""
        raise NotImplementedError

    def simplified(self, bodies: tuple[SceneBody, ...], radius: float) -> tuple[SceneBody, ...]:
        """Return the bodies in the shapes that are simulated, for a part of a hull radius, m."""
        del radius
        return bodies

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """Return where a part of a hull radius, m, has left the surroundings."""
        del radius
        return ()


def _angle(label: str, text: str, *, low: float = -MAX_TILT, **more: Any) -> Any:
    return quantity(label, 'rad', text, low=low, high=MAX_TILT, **more)


_ROLL_TEXT = 'rotation about the direction along it, towards the wall'
_PITCH_TEXT = 'inclination along it; positive: downhill in the direction x'


@dataclass(frozen=True)
class Plane(Kind):
    """An infinite level plane."""

    kind: ClassVar[str] = 'plane'
    free: ClassVar[int] = 2

    @property
    def level(self) -> bool:
        """See Kind."""
        return True

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (_floor('floor', contacts),)


@dataclass(frozen=True)
class Slope(Plane):
    """An infinite inclined plane; x is downhill."""

    kind: ClassVar[str] = 'slope'

    angle: float = _angle('angle', 'inclination', low=0.0)

    @property
    def level(self) -> bool:
        """See Kind."""
        return self.angle == 0

    @property
    def tilt(self) -> tuple[float, float]:
        """See Kind."""
        return 0.0, self.angle


@dataclass(frozen=True)
class Wall(Kind):
    """A level plane with a vertical wall along x, on the side of negative y."""

    kind: ClassVar[str] = 'wall'
    place: ClassVar[str] = 'at a'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (1.0, 3.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        floor, wall = self.body_names[:2]
        return _floor(floor, contacts), HalfSpace(wall, contacts[wall], X, Y)


@dataclass(frozen=True)
class VGroove(Kind):
    """Two planes that meet along x; without roll, both are equally steep."""

    kind: ClassVar[str] = 'v_groove'
    place: ClassVar[str] = 'in a'
    body_names: ClassVar[tuple[str, ...]] = ('right', 'left')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (-0.5, 0.5)

    opening: float = quantity(
        'opening', 'rad', 'angle between the planes', low=math.radians(5), high=math.radians(179)
    )
    roll: float = _angle('roll', 'rotation about the direction along the groove', default=0.0)
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind. The plane on the right is that at negative y, seen in the direction x."""
        c, s = math.cos(self.opening / 2), math.sin(self.opening / 2)
        right, left = np.array([0.0, c, s]), np.array([0.0, -c, s])
        return (
            HalfSpace('right', contacts['right'], X, right),
            HalfSpace('left', contacts['left'], X, left),
        )


@dataclass(frozen=True)
class Chute(Wall):
    """A belt and a wall at a right angle, an L, rolled towards the wall and pitched along x."""

    kind: ClassVar[str] = 'chute'
    place: ClassVar[str] = 'in a'
    body_names: ClassVar[tuple[str, ...]] = ('belt', 'wall')
    across: ClassVar[tuple[float, float]] = (-0.5, 0.5)

    roll: float = _angle('roll', _ROLL_TEXT, default=math.radians(45))
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)


@dataclass(frozen=True)
class Corner(Wall):
    """A plane, a wall along x and a wall across x, tilted towards both walls."""

    kind: ClassVar[str] = 'corner'
    place: ClassVar[str] = 'in a'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall', 'end_wall')
    free: ClassVar[int] = 0
    across: ClassVar[tuple[float, float]] = (0.0, 1.0)

    roll: float = _angle('roll', _ROLL_TEXT, default=math.radians(20))
    pitch: float = _angle('pitch', 'inclination towards the end wall', default=math.radians(20))

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        end = HalfSpace('end_wall', contacts['end_wall'], Y, -X)
        return *super().bodies(contacts), end


@dataclass(frozen=True)
class Tray(Kind):
    """A level plane with four walls."""

    kind: ClassVar[str] = 'tray'
    place: ClassVar[str] = 'in a'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall')

    length: float = quantity('length', 'm', 'inner length, along x', high=10.0, above=True)
    width: float = quantity('width', 'm', 'inner width, along y', high=10.0, above=True)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        walls = [
            HalfSpace('wall', contacts['wall'], along, normal, -size / 2)
            for along, axis, size in ((Y, X, self.length), (X, Y, self.width))
            for normal in (axis, -axis)
        ]
        return _floor('floor', contacts), *walls


@dataclass(frozen=True)
class BowlTrack(Kind):
    """A track that is rolled towards a wall, with an edge over which parts fall off."""

    kind: ClassVar[str] = 'bowl_track'
    loss: ClassVar[str] = 'they fell over the edge of the track'
    body_names: ClassVar[tuple[str, ...]] = ('track', 'wall')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (0.0, 1.0)

    width: float = quantity('width', 'm', 'width of the track', high=10.0, above=True)
    roll: float = _angle('roll', _ROLL_TEXT, low=0.0, default=math.radians(5))
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        low, high = np.array([-LENGTH, -DEPTH, -DEPTH]), np.array([LENGTH, self.width, 0.0])
        return (
            Block('track', contacts['track'], X, low, high, Z),
            HalfSpace('wall', contacts['wall'], X, Y),
        )

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """See Kind: a part whose centre of mass is below the track has fallen off."""
        return (HalfSpace('below', NO_CONTACT, X, Z, -radius),)


NO_CONTACT = PairValues(0.0, 0.0, 0.0)


def _floor(name: str, contacts: Contacts) -> HalfSpace:
    return HalfSpace(name, contacts[name], X, Z)


def tray_from_scene(roll: float, pitch: float) -> Array:
    """Return the quaternion (4,) of a roll about x, followed by a pitch about y, rad."""
    a, b = math.sin(roll / 2), math.cos(roll / 2)
    c, d = math.sin(pitch / 2), math.cos(pitch / 2)
    return np.array([a * d, b * c, -a * c, b * d])


# -- The ground of a mesh -------------------------------------------------------------------------


# Extent of a mesh in hull radii of the part; one that is smaller or larger has a wrong unit.
MIN_EXTENT, MAX_EXTENT = 1.0, 5000.0
# A gap that is wider than this, in hull radii, is open for a part above it.
GAP = 1.0
# Triangles whose heights differ by less, in hull radii, meet.
ROUNDING = 1e-6
# Places in each direction at which the region of release is checked.
PLACES = 5


def ground_of(mesh: MeshBody, region: tuple[Array, Array], radius: float) -> float:
    """Return the highest z of a mesh below the place of release of a part of a hull radius, m.

    Raises InvalidValueError if the mesh is too small or too large for the part, if it is open
    below the release, or if it is seen from inside there.
    """
    _check_extent(mesh, radius)
    corners = mesh.vertices[mesh.triangles]
    inside_out = face_normals(corners)[:, 2] < 0
    half = GAP * radius / 2
    for place in itertools.product(*(np.unique(np.linspace(a, b, PLACES)) for a, b in region)):
        near = np.array(place) - half, np.array(place) + half
        top, wrong = (ground_below(corners[which], *near) for which in (~inside_out, inside_out))
        at = f'x {1000 * place[0]:.4g} mm, y {1000 * place[1]:.4g} mm'
        if max(top, wrong) == -math.inf:
            raise InvalidValueError(
                f'invalid release at {at}: expected a place above the mesh, which has no triangle '
                'there'
            )
        if wrong > top + ROUNDING * radius:
            raise InvalidValueError(
                f'invalid mesh of the surroundings: its highest triangle at {at} points down; '
                'expected triangles that point outward'
            )
    low, high = np.transpose(region)
    return ground_below(corners, low - radius, high + radius)


def _check_extent(mesh: MeshBody, radius: float) -> None:
    size = np.ptp(mesh.vertices, axis=0)
    least, most = MIN_EXTENT * radius, MAX_EXTENT * radius
    if not least <= size[:2].max() <= most or size[:2].min() < least:
        x, y, z = (1000 * size).tolist()
        raise InvalidValueError(
            f'invalid size {x:.4g} x {y:.4g} x {z:.4g} mm of the mesh of the surroundings: '
            f'expected {1000 * least:.4g} mm to {1000 * most:.4g} mm along x and y for this part; '
            'is its unit right?'
        )


# -- A mesh as the surface ------------------------------------------------------------------------


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
    triangles: Indices

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


@functools.lru_cache(maxsize=16)
def _merged(surface: 'MeshSurface', radius: float) -> 'MergedMesh':
    # Shapely is needed for meshes only.
    from resting_aspects_ros.simulation.mesh_simplification import merged_mesh

    return merged_mesh(surface.vertices, surface.triangles, radius)


def _position(axis: str) -> Any:
    return quantity(
        axis, 'm', f'{axis} of the origin of the file', low=-100, high=100, default=0.0
    )


def _rotation(axis: str) -> Any:
    return quantity(
        f'rotation about {axis}',
        'rad',
        f'rotation of the mesh about {axis}, in the order x, y, z about the axes of the tray',
        low=-2 * math.pi,
        high=2 * math.pi,
        default=0.0,
    )


@dataclass(frozen=True)
class MeshSurface(Kind):
    """A mesh whose triangles point outward, with its pose in the tray frame.

    mesh : str
        Path of an STL, OBJ, PLY or OFF file, which is read; it becomes the name of the file.
    unit : str
        Unit of its coordinates.
    x, y, z, rx, ry, rz : float
        Position of its origin, m, and rotations about the fixed axes x, y and z, in this order,
        rad.
    mesh_sha256 : str
        Hash of the file. If it is given without ``file``, no file is read.
    file : MeshFile, optional
        The mesh, if it was read already.

    Raises InvalidValueError or PartError if a value is out of bounds, or the file cannot be read.
    """

    kind: ClassVar[str] = 'mesh'
    loss: ClassVar[str] = 'they are beside the mesh or below it'
    body_names: ClassVar[tuple[str, ...]] = ('surface',)

    mesh: str
    unit: str = DEFAULT_UNIT
    x: float = _position('x')
    y: float = _position('y')
    z: float = _position('z')
    rx: float = _rotation('x')
    ry: float = _rotation('y')
    rz: float = _rotation('z')
    mesh_sha256: str = ''
    file: MeshFile | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit not in UNITS:
            raise InvalidValueError(
                f'invalid unit {shown(self.unit)}: expected one of {", ".join(UNITS)}'
            )
        if not isinstance(self.mesh, str | Path):
            raise InvalidValueError(f'invalid mesh {shown(self.mesh)}: expected a path')
        path, mesh = Path(self.mesh), self.file
        label = named('mesh of the surroundings', path)
        if mesh is None and not self.mesh_sha256:
            data = read_input(path, MAX_BYTES, 'mesh of the surroundings', InvalidValueError)
            mesh = mesh_file(data, path.name, label)
        object.__setattr__(self, 'mesh', path.name)
        if mesh is not None:
            check_size(mesh.vertices, self.unit, label)
            object.__setattr__(self, 'file', mesh)
            object.__setattr__(self, 'mesh_sha256', mesh.sha256)

    @cached_property
    def vertices(self) -> Array:
        """(n, 3) corners in the tray frame, m; raises InvalidValueError without the mesh."""
        turned = Rotation.from_euler('xyz', [self.rx, self.ry, self.rz])
        placed = turned.apply(self._known.vertices * UNITS[self.unit])
        return np.asarray(placed + np.array([self.x, self.y, self.z]))

    @property
    def triangles(self) -> Indices:
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

    @property
    def texts(self) -> dict[str, str]:
        """See Kind."""
        return {'mesh': self.mesh, 'unit': self.unit, 'mesh_sha256': self.mesh_sha256}

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the mesh seen from above, m."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        x, y = ((low + high) / 2)[:2].tolist()
        return x, y

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (MeshBody('surface', contacts['surface'], X, self.vertices, self.triangles),)

    def simplified(self, bodies: tuple[SceneBody, ...], radius: float) -> tuple[SceneBody, ...]:
        """See Kind: wide flat sides are prisms, and curved sides have fewer triangles."""
        return (dataclasses.replace(bodies[0], **_merged(self, radius)._asdict()),)

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


KINDS: dict[str, type[Kind]] = {
    each.kind: each
    for each in (Plane, Slope, Wall, VGroove, Chute, Corner, BowlTrack, Tray, MeshSurface)
}
