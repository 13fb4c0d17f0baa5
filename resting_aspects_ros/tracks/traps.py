"""The traps of a track, and what they do to an orientation.

A trap is declared once: its dimensions with units and bounds are fields, from which flags, the
keys of YAML files, documents and texts follow.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import (
    Described,
    described_kind,
    made_from,
    quantities_of,
    quantity,
)
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.support import (
    FAR,
    critical_value,
    is_line,
    passage,
    supports,
)

# A part that is higher than a blade by less than this wedges below it instead of being pushed off.
WEDGE = 0.5e-3
# The nose of a part that is supported on one side of a hole dips and jams if the hole is longer
# than its critical length by less than this.
DIP = 1.7e-3
MAX_SIZE = 2.0
# Places of a part that are looked at before all others.
FEW = 20
# Between which dimensions critical values are sought, m.
SMALLEST, LARGEST = 1e-5, 0.5

Result = Literal['pass', 'reject', 'jam', 'turn', 'unknown']


@dataclass(frozen=True)
class Outcome:
    """What a trap does to an orientation.

    outcome : str
        'pass', 'reject', 'jam', 'turn' (it goes on in another orientation) or 'unknown'.
    critical : float
        Value of the dimension ``limited_by`` at which the outcome changes, m; infinite if no value
        rejects, minus infinity if every value does.
    margin : float
        How far the trap's dimension is from it, m; positive if the part passes.
    limited_by : str
        The dimension of the trap with the smallest margin.
    share : float or None
        Of a sensor: share of the parts that it lets pass.
    """

    outcome: Result
    critical: float = math.inf
    margin: float = math.inf
    limited_by: str = ''
    share: float | None = None


@dataclass(frozen=True)
class Surface(Described):
    """What traps are cut into: a track along a wall.

    width : float
        Distance of the outer edge from the wall, m.
    """

    width: float = quantity('width', 'm', 'width of the track', high=MAX_SIZE, above=True)
    roll: float = quantity(
        'roll', 'rad', 'inclination towards the wall', high=math.radians(60), default=0.0
    )
    pitch: float = quantity(
        'pitch',
        'rad',
        'inclination downhill',
        low=-math.radians(45),
        high=math.radians(45),
        default=0.0,
    )
    friction: float = quantity('friction', '', 'friction of the track', high=10.0, default=0.3)

    @property
    def area(self) -> shapely.Geometry:
        """The track without traps, x and y in m."""
        return shapely.box(-FAR, 0.0, FAR, self.width)


@dataclass(frozen=True, eq=False)
class Arrival:
    """A part that arrives at a trap: how it lies, and on what."""

    row: Orientation
    surface: Surface
    part: Part


@dataclass(frozen=True)
class Trap(Described):
    """Something on a track that some orientations pass; its fields are its dimensions."""

    # Two dimensions of which the first is the lower one.
    ordered: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        ends = [getattr(self, name) for name in self.ordered]
        if ends and not ends[0] < ends[1]:
            raise InvalidValueError(
                f'invalid {self.kind} from {ends[0]:g} to {ends[1]:g} m: expected the lower value '
                'first'
            )

    @property
    def document(self) -> dict[str, Any]:
        """The trap as plain values in SI units, as `read_trap` reads it."""
        return {'kind': self.kind, **self.numbers}

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation."""
        raise NotImplementedError


@dataclass(frozen=True)
class Wiper(Trap):
    """A blade across the track that pushes off what is higher than the gap below it."""

    kind: ClassVar[str] = 'wiper'
    height: float = quantity('height', 'm', 'gap below the blade', high=MAX_SIZE, above=True)

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation."""
        margin = self.height - arrival.row.height
        result: Result = 'pass' if margin > 0 else 'jam' if margin > -WEDGE else 'reject'
        return Outcome(result, arrival.row.height, margin, 'height')


@dataclass(frozen=True)
class HoldDown(Trap):
    """A cover above the track that keeps parts from rising; what is higher jams."""

    kind: ClassVar[str] = 'hold_down'
    height: float = quantity('height', 'm', 'gap below the cover', high=MAX_SIZE, above=True)

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation."""
        margin = self.height - arrival.row.height
        return Outcome('pass' if margin > 0 else 'jam', arrival.row.height, margin, 'height')


# Critical values of the dimensions of cuts in a surface; they go with their rows.
_known: WeakKeyDictionary[Orientation, dict[tuple['Cut', str, Surface], float]] = (
    WeakKeyDictionary()
)


@dataclass(frozen=True)
class Cut(Trap):
    """A piece that is cut out of the track; parts fall through it or over its edge."""

    # Length by which the piece grows if a dimension grows by one, m per unit of the dimension.
    unit: ClassVar[float] = 1.0

    def removed(self) -> shapely.Geometry:
        """Return the piece, x and y in m; it begins at x = 0."""
        raise NotImplementedError

    def span(self) -> tuple[float, float] | None:
        """Return where the piece begins and ends along the track, m; None if it has no end."""
        return None

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """For each dimension, between which values its critical value is sought, m."""
        return dict.fromkeys(quantities_of(self), (SMALLEST, LARGEST))

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation."""
        found = [(name, self.critical(arrival, name)) for name in self.ranges]
        limited, critical = min(found, key=lambda each: abs(getattr(self, each[0]) - each[1]))
        margin = self.unit * abs(getattr(self, limited) - critical)
        if self.passes(arrival):
            return Outcome('pass', critical, margin, limited)
        if is_line(arrival.row):
            result: Result = 'unknown'
        else:
            result = 'jam' if self.span() is not None and margin < DIP else 'reject'
        return Outcome(result, critical, -margin, limited)

    def passes(self, arrival: Arrival) -> bool:
        """Return whether the rest of the track supports the part all the way."""
        hole = self.removed()
        if self.span() is None:
            return supports(arrival.row, arrival.surface, hole)
        places = passage(arrival.row, hole)
        # A few places tell sooner that a part falls through a large hole.
        few = places[:: max(1, len(places) // FEW)]
        return all(supports(arrival.row, arrival.surface, hole, each) for each in (few, places))

    def critical(self, arrival: Arrival, name: str) -> float:
        """Return the value of a dimension at which the outcome changes; see `critical_value`."""
        # It does not depend on the present value of the dimension, such as that of an alternative.
        alike = dataclasses.replace(self, **{name: self.ranges[name][1]})
        known = _known.setdefault(arrival.row, {})
        key = alike, name, arrival.surface
        if key not in known:

            def passes(value: float) -> bool:
                return dataclasses.replace(alike, **{name: value}).passes(arrival)

            known[key] = critical_value(passes, *self.ranges[name])
        return known[key]


@dataclass(frozen=True)
class Balcony(Cut):
    """A narrowed track: beyond its width, parts have no support."""

    kind: ClassVar[str] = 'balcony'
    width: float = quantity('width', 'm', 'width that is left', high=MAX_SIZE, above=True)

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.box(-FAR, self.width, FAR, FAR)


@dataclass(frozen=True)
class Gap(Cut):
    """A gap across the whole track."""

    kind: ClassVar[str] = 'gap'
    length: float = quantity('length', 'm', 'length along the track', high=MAX_SIZE, above=True)

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.box(0.0, -FAR, self.length, FAR)

    def span(self) -> tuple[float, float]:
        """See Cut."""
        return 0.0, self.length


@dataclass(frozen=True)
class Canyon(Cut):
    """A slit along the track, between two distances from the wall, longer than every part."""

    kind: ClassVar[str] = 'canyon'
    ordered: ClassVar[tuple[str, ...]] = ('start', 'end')
    start: float = quantity('start', 'm', 'distance of its near side from the wall', high=MAX_SIZE)
    end: float = quantity(
        'end', 'm', 'distance of its far side from the wall', high=MAX_SIZE, above=True
    )

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.box(-FAR, self.start, FAR, self.end)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """See Cut."""
        return {'start': (0.0, self.end - SMALLEST), 'end': (self.start + SMALLEST, LARGEST)}


class _Strip(Canyon):
    """A slit along the track into which a part can drop, and then goes on in another way."""

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation; statics does not tell how a part drops."""
        found = super().outcome(arrival)
        return found if found.outcome == 'pass' else dataclasses.replace(found, outcome='unknown')


@dataclass(frozen=True)
class Rail(_Strip):
    """Two rails with a slit between them, in which parts can hang by their heads."""

    kind: ClassVar[str] = 'rail'


@dataclass(frozen=True)
class Groove(_Strip):
    """A groove along the track."""

    kind: ClassVar[str] = 'groove'
    depth: float = quantity('depth', 'm', 'depth', high=MAX_SIZE, above=True, default=0.01)


@dataclass(frozen=True)
class Riser(Trap):
    """A strip at the outer edge that is higher than the track and lifts what reaches it."""

    kind: ClassVar[str] = 'riser'
    start: float = quantity('start', 'm', 'distance of the strip from the wall', high=MAX_SIZE)
    height: float = quantity('height', 'm', 'height above the track', high=MAX_SIZE, above=True)

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation; statics does not tell how it is lifted."""
        reach = float(arrival.row.corners[:, 1].max())
        margin = self.start - reach
        return Outcome('pass' if margin > 0 else 'unknown', reach, margin, 'start')


@dataclass(frozen=True)
class Slot(Canyon):
    """A rectangular hole in the track."""

    kind: ClassVar[str] = 'slot'
    length: float = quantity('length', 'm', 'length along the track', high=MAX_SIZE, above=True)

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.box(0.0, self.start, self.length, self.end)

    def span(self) -> tuple[float, float]:
        """See Cut."""
        return 0.0, self.length

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """See Cut."""
        return {**super().ranges, 'length': (SMALLEST, LARGEST)}


@dataclass(frozen=True)
class Scallop(Cut):
    """A round piece that is cut out of the outer edge, or a round hole."""

    kind: ClassVar[str] = 'scallop'
    centre: float = quantity('centre', 'm', 'distance of its centre from the wall', high=MAX_SIZE)
    radius: float = quantity('radius', 'm', 'radius', high=MAX_SIZE, above=True)

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.Point(self.radius, self.centre).buffer(self.radius, quad_segs=32)

    def span(self) -> tuple[float, float]:
        """See Cut."""
        return 0.0, 2 * self.radius


@dataclass(frozen=True)
class CutOut(Cut):
    """A polygon that is cut out of the track; an asymmetric one separates mirror images.

    points : tuple of (float, float)
        x and y of its corners, m.
    """

    kind: ClassVar[str] = 'cut_out'

    @property
    def unit(self) -> float:  # type: ignore[override]
        """The smaller one of the length and the width of the polygon, m."""
        return float(np.ptp(np.asarray(self.points), axis=0).min())

    scale: float = quantity(
        'scale', '', 'factor of all coordinates', high=100.0, above=True, default=1.0
    )
    points: tuple[tuple[float, float], ...] = field(default=(), kw_only=True, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            given = np.asarray(self.points, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            given = np.zeros(0)
        if given.ndim != 2 or given.shape[1:] != (2,) or len(given) < 3:
            raise InvalidValueError(
                f'invalid points {shown(self.points)}: expected three or more pairs of x and y, m'
            )
        if not shapely.Polygon(given).is_valid:
            raise InvalidValueError(
                f'invalid points {shown(self.points)}: expected a polygon that does not cross '
                'itself'
            )
        object.__setattr__(self, 'points', tuple((x, y) for x, y in given.tolist()))

    @property
    def document(self) -> dict[str, Any]:
        """See Trap."""
        return {**super().document, 'points': [list(each) for each in self.points]}

    def removed(self) -> shapely.Geometry:
        """See Cut."""
        return shapely.Polygon(self.scale * np.asarray(self.points))

    def span(self) -> tuple[float, float]:
        """See Cut."""
        x = self.scale * np.asarray(self.points)[:, 0]
        return float(x.min()), float(x.max())

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """See Cut."""
        return {'scale': (0.01, 10.0)}


@dataclass(frozen=True)
class Projection(Trap):
    """A strip on the wall that pushes parts outwards, over the edge of a track of some width."""

    kind: ClassVar[str] = 'projection'
    ordered: ClassVar[tuple[str, ...]] = ('low', 'high')
    depth: float = quantity('depth', 'm', 'how far it stands out', high=MAX_SIZE, above=True)
    low: float = quantity('low', 'm', 'height of its lower side', high=MAX_SIZE, default=0.0)
    high: float = quantity(
        'high', 'm', 'height of its upper side', high=MAX_SIZE, above=True, default=MAX_SIZE
    )

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation."""
        row, surface = arrival.row, arrival.surface
        nearest = _nearest_between(row, arrival.part, self.low, self.high)
        if math.isinf(nearest):
            return Outcome('pass', math.inf, math.inf, 'depth')

        pushed = dataclasses.replace(row, wall_top=min(row.height, self.high))

        def passes(depth: float) -> bool:
            return supports(pushed, surface, shift=max(0.0, depth - nearest))

        critical = critical_value(passes, SMALLEST, LARGEST)
        margin = critical - self.depth
        return Outcome('pass' if margin > 0 else 'reject', critical, margin, 'depth')


@dataclass(frozen=True)
class Sensor(Trap):
    """A camera with an air jet that blows off what it does not identify as a wanted orientation.

    Its outcomes follow from the confusion matrix of the identification; see rate.py.

    spacing : float
        Least distance of two parts, m, so that the jet hits only one of them. It limits the rate.
    """

    kind: ClassVar[str] = 'sensor'
    spacing: float = quantity(
        'spacing', 'm', 'distance between two parts', high=MAX_SIZE, default=0.01
    )
    noise: float = quantity(
        'noise',
        'm',
        'standard deviation of the outline that the camera sees',
        high=0.01,
        above=True,
        default=1e-4,
    )


@dataclass(frozen=True)
class AirJet(Trap):
    """A jet out of the wall that blows off what is high enough and light enough.

    The force is that of the jet on the part; measure it, because it depends on the part's shape.
    """

    kind: ClassVar[str] = 'air_jet'
    height: float = quantity('height', 'm', 'height of the jet', high=MAX_SIZE, above=True)
    force: float = quantity('force', 'N', 'force on a part', high=1000.0, above=True)

    def outcome(self, arrival: Arrival) -> Outcome:
        """Return what the trap does to an orientation.

        The part slides off if the force exceeds its friction and its weight along the track. It
        tips over the outer end of its contact if the moment of the force exceeds that of gravity.
        """
        row, surface = arrival.row, arrival.surface
        weight = arrival.part.mass * 9.80665
        cosine, sine = math.cos(surface.roll), math.sin(surface.roll)
        slides = self.force > weight * (surface.friction * cosine + sine)
        outer = float(shapely.bounds(row.contact)[3]) - row.yaw.distance
        tips = self.force * self.height > weight * (outer * cosine + row.com_height * sine)
        if not (slides or tips):  # at any height
            return Outcome('pass')
        margin = self.height - row.height
        result: Result = 'pass' if margin > 0 else 'reject' if slides else 'turn'
        return Outcome(result, row.height, margin, 'height')


def _nearest_between(row: Orientation, part: Part, low: float, high: float) -> float:
    """Return the least distance from the wall of what is between two heights, m."""
    z = row.corners[:, 2]
    y = row.corners[:, 1]
    within = (z >= low) & (z <= high)
    near = float(y[within].min(initial=math.inf))
    one, two = part.faces.ravel(), np.roll(part.faces, -1, axis=1).ravel()
    for level in (low, high):
        crossing = (z[one] < level) & (z[two] > level)
        a, b = one[crossing], two[crossing]
        if len(a):
            share = (level - z[a]) / (z[b] - z[a])
            near = min(near, float((y[a] + share * (y[b] - y[a])).min()))
    return near


KINDS: dict[str, type[Trap]] = {
    each.kind: each
    for each in (
        Wiper,
        HoldDown,
        Balcony,
        Gap,
        Canyon,
        Groove,
        Rail,
        Slot,
        Scallop,
        CutOut,
        Riser,
        Projection,
        AirJet,
        Sensor,
    )
}


def read_trap(document: Any) -> Trap:
    """Return a trap from a mapping with its kind and its values; raises InvalidValueError."""
    kind, values, _ = described_kind('trap', document, KINDS)
    return made_from(KINDS, 'trap', kind, values, ('points',) if kind == CutOut.kind else ())


def trap_text(trap: Trap) -> str:
    """Return a trap in words, such as 'wiper, height 12.7 mm'."""
    words = [
        f'{each.label} {value_text(getattr(trap, name), each.unit)}'
        for name, each in quantities_of(trap).items()
    ]
    return ', '.join([trap.kind.replace('_', ' '), *words])


def value_text(value: float, unit: str) -> str:
    """Return a value of a track in mm, mm/s, degrees, or its unit."""
    if unit in ('m', 'm/s'):
        return f'{1000 * value:.4g} m{unit}'
    if unit == 'rad':
        return f'{math.degrees(value):.4g} deg'
    return f'{value:.4g} {unit}'.rstrip()


def outcomes(
    rows: Sequence[Orientation], trap: Trap, surface: Surface, part: Part
) -> list[Outcome]:
    """Return what a trap does to each orientation; a part that rolls is not known."""
    arrivals = [Arrival(row, surface, part) for row in rows]
    return [Outcome('unknown') if a.row.rolls else trap.outcome(a) for a in arrivals]
