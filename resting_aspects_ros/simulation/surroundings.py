"""Surroundings of drops: how they are described, named and changed."""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.input_files import named, read_yaml
from resting_aspects_ros.rotations import LENGTH_TOLERANCE, canonical
from resting_aspects_ros.simulation.conditions import (
    QUANTITIES,
    DropConditions,
    Quantity,
    described_kind,
    made_from,
    quantities_of,
)
from resting_aspects_ros.simulation.scene import MeshBody, PairValues, Scene, check_release
from resting_aspects_ros.simulation.surroundings_kinds import (
    KINDS,
    Kind,
    MeshFile,
    MeshSurface,
    ground_of,
    tray_from_scene,
)
from resting_aspects_ros.system import config_folder


def group_text(
    name: str,
    values: Mapping[str, float],
    quantities: Mapping[str, Quantity],
    texts: Iterable[str] = (),
) -> str:
    """Return a name and its values: 'chute (roll 45 deg, pitch 0 deg)'.

    ``texts`` are shown before the values.
    """
    words = [
        f'{quantities[key].label} {value_text(value, quantities[key].unit)}'
        for key, value in values.items()
    ]
    inner = ', '.join([*texts, *words])
    label = name.replace('_', ' ')
    return f'{label} ({inner})' if inner else label


def value_text(value: float, unit: str) -> str:
    """Return a value of SI unit ``unit`` as people read it: angles in degrees, lengths in mm."""
    if unit == 'rad':
        return f'{math.degrees(value):.6g} deg'
    if unit == 'm':
        return f'{1000 * value:.6g} mm'
    return f'{value:g} {unit}'.rstrip()


# -- Description ----------------------------------------------------------------------------------


# Values of a body; those of the pair are taken from the conditions unless they are given.
BODY_VALUES: dict[str, Quantity] = {
    **{name: QUANTITIES[name] for name in ('friction', 'restitution', 'rolling_friction')},
    'speed': Quantity('speed', 'm/s', 'speed of the surface', low=-100.0, high=100.0),
}
# Where parts are released, m in the tray frame: x and y are those of the centre of mass.
RELEASE_VALUES: dict[str, Quantity] = {
    name: Quantity(name.replace('_', ' '), 'm', text, low=-100.0, high=100.0)
    for name, text in {
        'x_min': 'lowest x of the release',
        'x_max': 'highest x of the release',
        'y_min': 'lowest y of the release',
        'y_max': 'highest y of the release',
    }.items()
}


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Surroundings of a drop: a kind with its dimensions, values of its bodies, and the release.

    Parameters
    ----------
    shape : Kind
        Such as ``Slope(angle=0.3)``; one of the classes in KINDS.
    bodies : mapping of str to mapping of str to float
        Values of a body that differ from the conditions, by the name of the body, such as
        ``{'belt': {'friction': 0.4, 'speed': 0.1}}``; see BODY_VALUES.
    release : mapping of str to float
        Place of release; see RELEASE_VALUES. A value that is not given follows from the kind and
        the size of the part.
    orientation : (4,) sequence of float, optional
        Orientation at release, xyzw, tray from part; by default uniformly random.
    name : str
        Name of the surroundings; not part of their values, which are compared.

    Raises InvalidValueError if a name is not known, or a value is out of bounds.
    """

    shape: Kind
    bodies: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    release: Mapping[str, float] = dataclasses.field(default_factory=dict)
    orientation: tuple[float, ...] | None = None
    name: str = ''

    def __post_init__(self) -> None:
        if not isinstance(self.shape, tuple(KINDS.values())):
            raise InvalidValueError(
                f'invalid surroundings {shown(self.shape)}: expected one of '
                f'{", ".join(each.__name__ for each in KINDS.values())}'
            )
        names = self.shape.body_names
        bodies = _mapping('bodies', self.bodies, names)
        for body, values in bodies.items():
            bodies[body] = _checked(body, values, BODY_VALUES)
        release = _checked('release', self.release, RELEASE_VALUES)
        for axis in 'xy':
            low, high = release.get(f'{axis}_min'), release.get(f'{axis}_max')
            if low is not None and high is not None and low > high:
                raise InvalidValueError(
                    f'invalid release {axis}_min {low:g}: expected at most {axis}_max, {high:g} m'
                )
        object.__setattr__(self, 'bodies', {k: bodies[k] for k in names if bodies.get(k)})
        object.__setattr__(self, 'release', release)
        if self.orientation is not None:
            object.__setattr__(self, 'orientation', _quaternion(self.orientation))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Surroundings) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def level(self) -> bool:
        """Whether these are the infinite level plane, with the values of the conditions."""
        return self.shape.level and not self.bodies and self.orientation is None

    @property
    def document(self) -> dict[str, Any]:
        """Everything that the simulation depends on, as a mapping of plain values."""
        document: dict[str, Any] = {'kind': self.shape.kind, **self.shape_values}
        if self.bodies:
            document['bodies'] = {k: dict(v) for k, v in self.bodies.items()}
        if self.release:
            document['release'] = dict(self.release)
        if self.orientation is not None:
            document['orientation'] = list(self.orientation)
        return document

    @property
    def shape_values(self) -> dict[str, Any]:
        """Dimensions of the kind, SI units."""
        return {**self.shape.numbers, **self.shape.texts}

    @property
    def known(self) -> bool:
        """Whether parts can be dropped in them: not without the triangles of a mesh surface."""
        return not isinstance(self.shape, MeshSurface) or self.shape.file is not None

    @cached_property
    def key(self) -> str:
        """The document as canonical JSON; equal for equal surroundings, empty if level."""
        if self.level:
            return ''
        return json.dumps(self.document, sort_keys=True, separators=(',', ':'))

    def with_mesh(self, file: MeshFile | None) -> 'Surroundings':
        """Return the surroundings with the file of a mesh surface; unchanged without one."""
        if not isinstance(self.shape, MeshSurface):
            return self
        return dataclasses.replace(self, shape=dataclasses.replace(self.shape, file=file))

    @property
    def text(self) -> str:
        """The surroundings in words: 'chute (roll 45 deg), belt (friction 0.4)'."""
        shape, values = self.shape, self.shape.numbers
        texts = [Path(text).name for key, text in shape.texts.items() if key == 'mesh']
        if texts:  # the pose of the mesh, if it is not that of the file
            values = {name: value for name, value in values.items() if value}
        parts = [group_text(self.name or shape.kind, values, quantities_of(shape), texts)]
        parts += [group_text(body, each, BODY_VALUES) for body, each in self.bodies.items()]
        if self.release:
            parts.append(group_text('release', self.release, RELEASE_VALUES))
        if self.orientation is not None:
            parts.append('given orientation')
        return ', '.join(parts)

    def scene(self, conditions: DropConditions, radius: float) -> Scene:
        """Return bodies, gravity and release for a part of a hull radius, m.

        Raises InvalidValueError if a part could touch a body at the release.
        """
        contacts = {name: self._contact(name, conditions) for name in self.shape.body_names}
        bodies, region = self.shape.bodies(contacts), self._region(radius)
        scene = Scene(
            bodies=bodies,
            tray_from_scene=tray_from_scene(*self.shape.tilt),
            free=self.shape.free,
            region=region,
            ground=max(
                (ground_of(b, region, radius) for b in bodies if isinstance(b, MeshBody)),
                default=0.0,
            ),
            lost=self.shape.lost(radius),
            orientation=None if self.orientation is None else np.array(self.orientation),
        )
        check_release(scene, radius)
        return dataclasses.replace(scene, bodies=self.shape.simplified(bodies, radius))

    def _contact(self, name: str, conditions: DropConditions) -> PairValues:
        pair = {k: getattr(conditions, k) for k in BODY_VALUES if k != 'speed'}
        return PairValues(**{**pair, **self.bodies.get(name, {})})

    def _region(self, radius: float) -> tuple[Any, Any]:
        low, high = (radius * r for r in self.shape.across)
        x, y = self.shape.centre
        found = []
        for axis, default in (('x', [x]), ('y', [y + low, y + high])):
            names = f'{axis}_min', f'{axis}_max'
            ends = [self.release[name] for name in names if name in self.release] or default
            found.append(np.array([ends[0], ends[-1]]))
        return found[0], found[1]


def _mapping(name: str, given: Any, allowed: Any) -> dict[str, Any]:
    if not isinstance(given, Mapping):
        raise InvalidValueError(f'invalid {name} {shown(given)}: expected a mapping')
    unknown = [key for key in given if key not in allowed]
    if unknown:
        raise InvalidValueError(
            f'invalid name {shown(unknown[0])} in {name}: expected one of {", ".join(allowed)}'
            f'{did_you_mean(unknown[0], allowed)}'
        )
    return dict(given)


def _checked(name: str, given: Any, quantities: Mapping[str, Quantity]) -> dict[str, float]:
    values = _mapping(name, given, quantities)
    return {
        k: each.check(f'{name} {k}', values[k]) for k, each in quantities.items() if k in values
    }


# Error of the length of a quaternion that was normalised.
_ROUNDING = 1e-15


def _quaternion(given: Any) -> tuple[float, ...]:
    try:
        xyzw = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        xyzw = np.zeros(0)
    off = abs(math.hypot(*xyzw) - 1) if xyzw.shape == (4,) else math.inf
    if not off <= LENGTH_TOLERANCE:
        raise InvalidValueError(
            f'invalid orientation {shown(given)}: expected a unit quaternion x, y, z, w'
        )
    # One that is canonical stays the same, so that a copy of a copy has the same key.
    return tuple((xyzw if off <= _ROUNDING and xyzw[3] >= 0 else canonical(xyzw)).tolist())


# -- Names and changes ----------------------------------------------------------------------------


ENDINGS = ('.yaml', '.yml')


def surroundings_folder() -> Path:
    """Return the folder of the named surroundings."""
    return config_folder() / 'surroundings'


def surroundings_names() -> list[str]:
    """Return the names of the surroundings in config/surroundings, sorted."""
    return sorted(path.stem for path in surroundings_folder().glob('*.yaml'))


def named_surroundings(name: str | Path, changes: Mapping[str, Any] | None = None) -> Surroundings:
    """Return the surroundings of a name, a kind or a YAML file, with changed values.

    Parameters
    ----------
    name : str or Path
        A path with a directory or an ending is a file; otherwise a name of `surroundings_names`,
        or a kind, such as 'slope'.
    changes : mapping, optional
        Values by their names, such as ``{'roll': 0.8, 'belt.friction': '0.4', 'release.y_min':
        '10mm'}``. A number is in SI units; a text may have a unit.

    Raises InvalidValueError if the name is not known, the file cannot be read, or a value is out
    of bounds.
    """
    text = str(name)
    is_file = isinstance(name, Path) or '/' in text or text.endswith(ENDINGS)
    file = Path(text) if is_file else surroundings_folder() / f'{text}.yaml'
    if is_file or text in surroundings_names():
        document = read_yaml(file, 'surroundings file')
        where = named('surroundings file', file) if is_file else f'surroundings {text}'
    elif text in KINDS:
        document, where = {'kind': text}, f'surroundings {text}'
    else:
        known = sorted({*surroundings_names(), *KINDS})
        raise InvalidValueError(
            f'invalid surroundings {shown(text)}: expected a YAML file (with its folder or its '
            f'ending) or one of '
            f'{", ".join(known)}{did_you_mean(text, known)}'
        )
    try:
        described_kind('surroundings', document, KINDS)
        mesh = document.get('mesh')
        if isinstance(mesh, str):
            document['mesh'] = str(file.parent / mesh)
        values = _changed(document, changes or {})
        sha256 = values.pop('mesh_sha256', '') if 'mesh' in values else ''
        found = make_surroundings(values, file.stem if is_file or not changes else text)
        if sha256 and sha256 != found.shape_values.get('mesh_sha256'):
            raise InvalidValueError(
                f'invalid {named("mesh of the surroundings", Path(values["mesh"]))}: it has '
                f'changed; expected the hash {shown(sha256)}'
            )
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None
    return found


def changed_surroundings(base: Surroundings, changes: Mapping[str, Any]) -> Surroundings:
    """Return surroundings with changes; see named_surroundings. Raises InvalidValueError."""
    return described_surroundings(base.document, changes, base.name).with_mesh(base.shape.file)


def surroundings_from(text: str) -> Surroundings | None:
    """Return the surroundings with a key, or of a JSON document; None for an empty one.

    See described_surroundings. Raises InvalidValueError.
    """
    if not text:
        return None
    try:
        return described_surroundings(json.loads(text))
    except (ValueError, RecursionError) as error:
        raise InvalidValueError(f'invalid surroundings {shown(text)}: {error}') from None


def described_surroundings(
    document: Any, changes: Mapping[str, Any] | None = None, name: str = ''
) -> Surroundings:
    """Return the surroundings of a description that another program sent; reads no file.

    A mesh surface has only the name and the hash of its mesh. See named_surroundings for the
    changes. Raises InvalidValueError.
    """
    kind, values, _ = described_kind('surroundings', document, KINDS)
    sha256 = values.get('mesh_sha256')
    if kind == MeshSurface.kind and not (isinstance(sha256, str) and sha256):
        raise InvalidValueError(
            f'invalid mesh_sha256 {shown(sha256)}: expected the hash of the mesh'
        )
    return make_surroundings(_changed(document, changes or {}), name)


def make_surroundings(document: Any, name: str = '') -> Surroundings:
    """Return the surroundings that a mapping describes; see Surroundings.document.

    Raises InvalidValueError, with the name of the key.
    """
    kind, values, _ = described_kind('surroundings', document, KINDS)
    others = ('bodies', 'release', 'orientation')
    common = {key: values.pop(key) for key in others if key in values}
    return Surroundings(
        made_from(KINDS, 'surroundings', kind, values, others), name=name, **common
    )


def _changed(document: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a description with changed values.

    A body or the release is named before a dot in the name of a change.
    """
    values = dict(document)
    for key, value in changes.items():
        if key == 'kind':
            raise InvalidValueError('invalid name kind of a value: expected another value')
        group, dot, name = key.partition('.')
        path = [] if not dot else [group] if group == 'release' else ['bodies', group]
        target: Any = values
        for each in path:
            target = target.setdefault(each, {})
            if not isinstance(target, dict):
                raise InvalidValueError(f'invalid {each} {shown(target)}: expected a mapping')
        target[name if dot else key] = value
    return values
