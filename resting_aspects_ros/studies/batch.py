"""Several parts: their files, a batch of drops, and the designs of a part side by side."""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree
from scipy.stats import norm

from resting_aspects_ros.api.conditions import given_conditions, with_surroundings
from resting_aspects_ros.api.result import make_folder, whole_file, write_page
from resting_aspects_ros.api.runner import Progress, given_workers, never
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.errors import (
    EngineError,
    InvalidValueError,
    OutputError,
    RestingAspectsError,
    analysis,
    shown,
)
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.part.library import PartLibrary, load_part, mesh_file
from resting_aspects_ros.part.loading import FILE_FORMATS
from resting_aspects_ros.part.near import face_normals
from resting_aspects_ros.part.part import UNITS, Part
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
    check_seed,
)
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.studies.points import seed_of
from resting_aspects_ros.system import parts_folder

if TYPE_CHECKING:
    from resting_aspects_ros.api.drop import DropResult

INDEX, DOCUMENT, PARTS = 'index.html', 'distribution.json', 'parts'
# Aspects whose down directions differ by more than this are not the same, rad.
MAX_ANGLE = np.radians(20.0)
# Heights of the centre of mass of the same aspect differ by at most this, R.
MAX_HEIGHT = 0.3
# Parts whose surfaces are on average further apart than this, R, are different parts.
MAX_APART = 0.15
# Points of a surface that are compared.
SAMPLES = 400
# Of more parts, only the first ones are compared with each other.
MAX_COMPARED = 20


def mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder, sorted; raises InvalidValueError if it has none."""
    endings = {f'.{ending}' for ending in FILE_FORMATS}
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in endings and p.is_file())
    if not found:
        raise InvalidValueError(
            f'invalid part {shown(str(folder))}: it is a folder, expected mesh files '
            f'({", ".join(sorted(endings))}) in it'
        )
    return found


def part_sources(
    given: Part | str | Path | Sequence[Part | str | Path],
) -> Iterator[Part | str | Path]:
    """Yield parts, their names and mesh files; a folder stands for the mesh files in it."""
    for each in [given] if isinstance(given, Part | str | Path) else given:
        folder = None if isinstance(each, Part) else part_folder(each)
        if folder is None:
            yield each
        else:
            yield from mesh_files(folder)


def part_folder(given: str | Path) -> Path | None:
    """Return a folder of mesh files; None for a file or the name of an example part."""
    path = Path(given)
    return path if path.is_dir() and not _is_name(given) else None


def _is_name(given: str | Path) -> bool:
    return mesh_file(given) is None and str(given) in PartLibrary(parts_folder()).names()


def load_parts(
    given: Part | str | Path | Sequence[Part | str | Path], base: Path | None = None
) -> list[Part]:
    """Return parts with different names; see part_sources. Files are relative to ``base``."""
    if base is not None:
        several = [given] if isinstance(given, Part | str | Path) else given
        given = [each if isinstance(each, Part) else _relative(each, base) for each in several]
    found = [each if isinstance(each, Part) else load_part(each) for each in part_sources(given)]
    names = [part.name for part in found]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(
                f'invalid parts: expected different names, not {name!r} several times'
            )
    if not found:
        raise InvalidValueError('missing part: expected a name or a mesh file')
    return found


def _relative(given: str | Path, base: Path) -> str | Path:
    """Return the file or folder in a folder, or the name of an example part as it is."""
    if _is_name(given) or not (mesh_file(given) or (base / given).is_dir()):
        return given
    return base / given


def save_part(part: Part, folder: Path) -> str:
    """Write the mesh and the YAML file of a part; returns the path of the mesh in the folder.

    The part that is read from them has the same hash. Raises OutputError, and InvalidValueError
    if the folder cannot be made.
    """
    mesh = folder / PARTS / f'{part.name}.{part.mesh_format}'
    make_folder('--out', mesh.parent)
    with whole_file(mesh) as file:
        file.write_bytes(part.mesh_bytes)
    known: dict[str, Any] = {
        'mass': part.mass,
        'centre_of_mass': (part.centre_of_mass / UNITS[part.unit]).tolist(),
        'inertia': [float(each) for each in part.inertia[np.triu_indices(3)]],
    }
    values = {'unit': part.unit, **({'body': part.body} if part.body else {})}
    # Only the values that were given can be necessary: the others follow from the mesh.
    for count in range(len(known) + 1):
        written = {**values, **dict(itertools.islice(known.items(), count))}
        with whole_file(mesh.with_suffix('.yaml')) as file:
            file.write_text(yaml_text(written), encoding='utf-8')
        with contextlib.suppress(RestingAspectsError):
            if load_part(mesh).part_sha256 == part.part_sha256:
                break
    return f'{PARTS}/{mesh.name}'


def match_aspects(
    first: Part, one: AspectSet, second: Part, other: AspectSet
) -> tuple[tuple[tuple[int, int], ...], float]:
    """Return which symmetry classes of two designs are the same, and how far these are apart.

    The designs are compared in the frames of their meshes. A class is matched with the one whose
    direction of gravity and height of the centre of mass are nearest. Parts that are too different
    share none.

    Returns
    -------
    pairs : tuple of (int, int)
        Numbers of the classes in the first and the second design, from 1.
    apart : float
        Mean distance of the surfaces about the centres of mass, R of the first.
    """
    apart = _distance(first, second)
    if apart > MAX_APART:
        return (), apart
    mine, theirs = one.classes(), other.classes()
    cost = np.array([[_difference(a, first, b, second) for b in theirs] for a in mine]).reshape(
        len(mine), len(theirs)
    )
    rows, columns = linear_sum_assignment(np.minimum(cost, 10.0))
    pairs = tuple(
        (int(r) + 1, int(c) + 1) for r, c in zip(rows, columns, strict=True) if cost[r, c] <= 1.0
    )
    return pairs, apart


def _difference(
    mine: tuple[Aspect, ...], first: Part, theirs: tuple[Aspect, ...], second: Part
) -> float:
    """Return how different two classes are; up to 1, they can be the same."""
    if mine[0].sweep.curved != theirs[0].sweep.curved:
        return np.inf
    height = abs(
        mine[0].com_height / first.hull_radius - theirs[0].com_height / second.hull_radius
    )
    down, other = (np.concatenate([a.directions for a in each]) for each in (mine, theirs))
    angle = float(np.arccos(np.clip((down @ other.T).max(), -1, 1)))
    return max(angle / MAX_ANGLE, height / MAX_HEIGHT)


def _distance(first: Part, second: Part) -> float:
    """Return the mean distance of the surfaces of two parts, R of the first."""
    one, other = _surface_points(first), _surface_points(second)
    both = [np.asarray(KDTree(a).query(b)[0]) for a, b in ((one, other), (other, one))]
    return float(np.mean(both)) / first.hull_radius


def _surface_points(part: Part) -> Array:
    """Return points on the surface of a part, evenly distributed, about its centre of mass, m."""
    corners = part.vertices[part.faces]
    twice = np.linalg.norm(face_normals(corners), axis=1)
    edges = np.concatenate([[0.0], np.cumsum(twice)])
    # Equally spaced along the cumulated area, with the points of a Sobol-like lattice inside.
    place = (np.arange(SAMPLES) + 0.5) / SAMPLES * edges[-1]
    face = np.clip(np.searchsorted(edges, place, side='right') - 1, 0, len(corners) - 1)
    u, v = (np.arange(SAMPLES) * np.array([[0.7548776662], [0.5698402910]])) % 1.0
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = np.moveaxis(corners[face], 1, 0)
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return np.asarray(points - part.centre_of_mass)


@dataclass(frozen=True)
class SharedClass:
    """A symmetry class that two designs share.

    first, second : int
        Its numbers in the designs, from 1.
    difference, lower, upper : float
        Second share - first share, with its interval.
    """

    first: int
    second: int
    difference: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class DesignComparison:
    """Two designs side by side; ``apart`` is the mean distance of their surfaces, R."""

    first: 'DropResult'
    second: 'DropResult'
    shared: tuple[SharedClass, ...]
    apart: float


def compare_designs(
    results: Sequence['DropResult'], confidence: float
) -> Iterator[DesignComparison]:
    """Yield a comparison of each pair of designs."""
    for first, second in itertools.combinations(results, 2):
        assert first.part is not None
        assert second.part is not None
        one, other = first.distribution.by_class(), second.distribution.by_class()
        pairs, apart = match_aspects(first.part, one.aspects, second.part, other.aspects)
        shared = tuple(_shared(one, other, a, b, confidence) for a, b in pairs)
        yield DesignComparison(first, second, shared, apart)


def _shared(
    first: Distribution, second: Distribution, a: int, b: int, confidence: float
) -> SharedClass:
    shares, variance = [], 0.0
    for found, number in ((first, a), (second, b)):
        count, drops = int(found.counts[number - 1]), max(found.drops, 1)
        # Without a drop in a class there is still a chance of it: add half a drop to each side.
        smooth = (count + 0.5) / (drops + 1)
        variance += smooth * (1 - smooth) / drops
        shares.append(count / drops)
    difference = shares[1] - shares[0]
    reach = float(norm.ppf((1 + confidence) / 2)) * variance**0.5
    return SharedClass(a, b, difference, difference - reach, difference + reach)


@dataclass(frozen=True, eq=False)
class BatchEntry:
    """A part of a batch.

    source : str
        Name or file, as it was given.
    result : DropResult or None
        None if the part failed.
    folder : str
        Folder of its report, in that of the batch.
    error : str
        Why it failed; empty otherwise.
    """

    source: str
    result: 'DropResult | None' = None
    folder: str = ''
    error: str = ''


@dataclass(frozen=True, eq=False)
class BatchResult:
    """The parts of a batch; ``complete`` if none failed and it was not stopped.

    seed : int
        From which the seeds of the parts follow.
    """

    entries: tuple[BatchEntry, ...]
    complete: bool
    confidence: float
    folder: Path | None = None
    seed: int = DEFAULT_SEED

    @property
    def results(self) -> 'list[DropResult]':
        """The results of the parts that did not fail."""
        return [entry.result for entry in self.entries if entry.result is not None]

    @cached_property
    def comparisons(self) -> list[DesignComparison]:
        """Pairs of parts that share aspects, as designs of one part do."""
        found = compare_designs(self.results[:MAX_COMPARED], self.confidence)
        return [each for each in found if each.shared]


def drop_batch(
    parts: Part | str | Path | Sequence[Part | str | Path],
    drops: int | None = None,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    precision: float = 0.0,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    surroundings: str | Path | Surroundings | None = None,
    model_range: bool = True,
    unit: str | None = None,
    out: str | Path | None = None,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> BatchResult:
    """Drop each of many parts; a part that fails does not cost the others.

    Parameters
    ----------
    parts : Part, str or Path, or a sequence of them
        Parts, or what `load_part` accepts; a folder stands for the mesh files in it.
    unit : str, optional
        Unit of the mesh files.
    out : str or Path, optional
        Folder for index.html and a folder with a report of each part.
    stopped : callable
        The batch ends after the current part if it returns True.
    seed : int
        Of the batch. Each part has a seed of its own, see `part_seed`, so that the drops of
        different parts are independent.
    drops, surface, precision, interval, confidence, surroundings, model_range
        As for `drop`.
    workers, progress
        As for `drop`.
    **conditions : float
        Conditions that differ from the surface, in SI units.

    Raises
    ------
    InvalidValueError
        A condition is out of bounds, or a folder has no mesh file.
    UnknownPartError
        A name is not known; a bad file is an error of its entry instead.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    OutputError
        A file cannot be written.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> batch = ra.drop_batch(['tetrahedron', 'missing.stl'], 20)
    >>> [entry.error for entry in batch.entries]
    ['', "mesh 'missing.stl' does not exist"]
    """
    # A study, which needs the files of parts too, does not need this module.
    from resting_aspects_ros.api.drop import drop

    check_seed(seed)
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    sources = list(part_sources(parts))
    _check_names(sources)
    folder = None if out is None else Path(out)
    if folder is not None:
        make_folder('--out', folder)
    entries: list[BatchEntry] = []
    try:
        with given_workers(workers) as pool:
            for source in sources:
                if stopped():
                    break
                entry = BatchEntry(source.name if isinstance(source, Part) else str(source))
                try:
                    mesh = None if isinstance(source, Part) else mesh_file(source)
                    part = source
                    if not isinstance(part, Part):
                        part = load_part(part, None if mesh is None else unit)
                    result = drop(
                        part,
                        drops,
                        surface=given,
                        precision=precision,
                        seed=part_seed(seed, part),
                        interval=interval,
                        confidence=confidence,
                        model_range=model_range,
                        workers=pool,
                        keep_poses=False,
                        progress=progress,
                    )
                    result = dataclasses.replace(result, mesh_file=mesh)
                    own = _folder(part.name, [each.folder for each in entries])
                    entry = dataclasses.replace(entry, result=result, folder=own)
                    if folder is not None:
                        make_folder('--out', folder / own)
                        result.save_json(folder / own / DOCUMENT)
                        with analysis(f'the report on {part.name}'):
                            result.report(folder / own)
                except (EngineError, OutputError):
                    raise
                except RestingAspectsError as error:
                    entry = dataclasses.replace(entry, error=str(error))
                entries.append(entry)
    finally:  # the parts that are done are in the index if the engine or the disk fails
        complete = len(entries) == len(sources) and not any(entry.error for entry in entries)
        batch = BatchResult(tuple(entries), complete, confidence, folder, seed)
        if folder is not None:
            with analysis('the index of the batch'):
                # This import takes about a second.
                from resting_aspects_ros.studies.pages import batch_page

                write_page(batch_page(batch, INDEX), folder)
    return batch


def _check_names(sources: Sequence[Part | str | Path]) -> None:
    """Raise UnknownPartError for a name that is not known, before the drops of other parts."""
    for source in sources:
        if not isinstance(source, Part) and mesh_file(source) is None and not _is_name(source):
            load_part(source)


def part_seed(seed: int, part: Part) -> int:
    """Return the seed of a part, which follows from that of the batch and from the part alone.

    It depends neither on the other parts nor on their order.
    """
    return seed_of(f'{seed} {part.part_sha256}')


def _folder(name: str, taken: Sequence[str]) -> str:
    """Return a folder for a part; two parts can have the same name."""
    number, found = 1, name
    while found in taken:
        number += 1
        found = f'{name}_{number}'
    return found
