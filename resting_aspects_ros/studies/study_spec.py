"""What a study consists of, and the file study.yaml that describes it."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.api.surroundings import conditions_document
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, check_confidence
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.actions import NamedAction, make_action
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, check_drops, check_seed
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.library import (
    make_surroundings,
    named_surroundings,
)
from resting_aspects_ros.studies.designs import DEFAULT_DESIGN, DEFAULT_POINTS, design_points
from resting_aspects_ros.studies.factors import Factor, check_factors, read_factor
from resting_aspects_ros.studies.part_files import load_parts, save_part
from resting_aspects_ros.studies.setting import Setting

SPEC = 'study.yaml'
DEFAULT_STUDY_DROPS = 2000
# A change of a share that matters to the reader of the page.
DEFAULT_TOLERANCE = 0.05
KEYS = (
    *('parts', 'surface', 'conditions', 'surroundings', 'action', 'vary', 'design', 'points'),
    *('drops', 'seed', 'tolerance', 'confidence'),
)
# Keys that only describe what a study was made with.
NOTES = ('versions', 'part_sha256')


@dataclass(frozen=True, eq=False)
class StudySpec:
    """Parts, factors, design and drops of a study.

    base : Setting
        What is simulated, but for the factors.
    blocks : tuple of int
        Numbers of points; see design_points.
    drops : int
        Number of drops at each point; with an action, of actions from each aspect.
    tolerance : float
        Change of a share that matters.

    Raises
    ------
    InvalidValueError
        If a value is out of bounds.
    """

    parts: tuple[Part, ...]
    base: Setting
    factors: tuple[Factor, ...]
    design: str = DEFAULT_DESIGN
    blocks: tuple[int, ...] = (DEFAULT_POINTS,)
    drops: int = DEFAULT_STUDY_DROPS
    seed: int = DEFAULT_SEED
    tolerance: float = DEFAULT_TOLERANCE
    confidence: float = CONFIDENCE

    def __post_init__(self) -> None:
        check_factors(self.factors)
        check_drops(self.drops)
        check_seed(self.seed)
        check_confidence(self.confidence)
        if not isinstance(self.tolerance, int | float) or not 0 < self.tolerance < 1:
            raise InvalidValueError(
                f'invalid tolerance {shown(self.tolerance)}: expected more than 0 and less than 1'
            )

    def points(self) -> Any:
        """Return the points (m, d) of the unit cube."""
        return design_points(self.design, self.factors, self.blocks, self.seed)

    def document(self, parts: Sequence[str]) -> dict[str, Any]:
        """Return the study as plain values; ``parts`` are the files of its parts."""
        conditions = conditions_document(self.base.conditions)
        conditions.pop('surroundings')
        conditions['height_of'] = HeightOf(self.base.conditions.height_of).name
        document: dict[str, Any] = {'parts': list(parts)}
        if name := conditions.pop('surface'):
            document['surface'] = name
        document['conditions'] = conditions
        if self.base.surroundings is not None:
            document['surroundings'] = self.base.surroundings.document
        if self.base.action is not None:
            document['action'] = self.base.action.values
        document['vary'] = {factor.name: factor.document for factor in self.factors}
        document['design'] = self.design
        if self.design != 'factorial':
            document['points'] = list(self.blocks)
        for name in ('drops', 'seed', 'tolerance', 'confidence'):
            document[name] = getattr(self, name)
        return document

    def extended(self, before: 'StudySpec') -> 'StudySpec':
        """Return this study with the points and drops of one that it continues.

        Raises InvalidValueError if it is another study.
        """
        mine, theirs = (
            {
                **spec.document([part.part_sha256 for part in spec.parts]),
                **dict.fromkeys(('surface', 'points', 'drops', 'tolerance', 'confidence')),
            }
            for spec in (self, before)
        )
        different = [key for key in mine if mine[key] != theirs.get(key)]
        different += [key for key in theirs if key not in mine]
        if different:
            raise InvalidValueError(
                f'invalid folder: expected the same study, but it differs in {different[0]}; '
                'choose another folder, or continue the study by its study.yaml'
            )
        blocks, more = before.blocks, sum(self.blocks) - sum(before.blocks)
        if more > 0:
            # A Sobol sequence is the same in any number of blocks.
            blocks = (sum(self.blocks),) if self.design == 'sobol' else (*blocks, more)
        return dataclasses.replace(self, blocks=blocks, drops=max(self.drops, before.drops))


def read_spec(path: Path, changes: Mapping[str, Any] | None = None) -> StudySpec:
    """Read a study from a file; ``changes`` replace its values. Raises InvalidValueError."""
    document = read_yaml(path, 'study')
    label = named('study', path)
    if not isinstance(document, dict):
        raise InvalidValueError(f'invalid {label}: expected a mapping with parts and vary')
    try:
        return make_spec({**document, **(changes or {})}, path.parent)
    except InvalidValueError as error:
        raise InvalidValueError(f'{label}: {error}') from None


def make_spec(document: Mapping[str, Any], folder: Path | None = None) -> StudySpec:
    """Return the study of a mapping; files are relative to ``folder``. InvalidValueError."""
    unknown = [key for key in document if key not in {*KEYS, *NOTES}]
    if unknown:
        raise InvalidValueError(
            f'invalid key {shown(unknown[0])}: expected one of {", ".join(KEYS)}'
        )
    missing = [key for key in ('parts', 'vary') if not document.get(key)]
    if missing:
        raise InvalidValueError(f'missing {missing[0]}: expected parts and vary')
    if not isinstance(document['vary'], Mapping):
        raise InvalidValueError(
            f'invalid vary {shown(document["vary"])}: expected a mapping of factors to ranges'
        )
    parts = document['parts']
    base = Setting(
        _conditions(document.get('surface', ''), document.get('conditions') or {}),
        _surroundings(document.get('surroundings'), folder),
        _action(document.get('action')),
    )
    points = document.get('points', DEFAULT_POINTS)
    given = {
        key: document[key]
        for key in ('design', 'drops', 'seed', 'tolerance', 'confidence')
        if document.get(key) is not None
    }
    return StudySpec(
        tuple(load_parts(parts if isinstance(parts, list | tuple) else [parts], folder)),
        base,
        tuple(read_factor(str(name), each, base) for name, each in document['vary'].items()),
        blocks=tuple(points) if isinstance(points, list | tuple) else (points,),
        **given,
    )


def write_spec(spec: StudySpec, folder: Path, versions: Mapping[str, str]) -> None:
    """Write the parts and study.yaml; raises OutputError."""
    files = [save_part(part, folder) for part in spec.parts]
    document = spec.document(files)
    document['part_sha256'] = [part.part_sha256 for part in spec.parts]
    document['versions'] = dict(versions)
    text = '# To repeat the study: resting_aspects study study.yaml\n'
    text += yaml.safe_dump(document, sort_keys=False)
    with whole_file(folder / SPEC) as file:
        file.write_text(text, encoding='utf-8')


def _conditions(surface: Any, changes: Any) -> DropConditions:
    if not isinstance(surface, str) or not isinstance(changes, Mapping):
        raise InvalidValueError(
            'invalid conditions: expected the name of a surface, and a mapping'
        )
    values: dict[str, Any] = {}
    for name, value in changes.items():
        if name == 'height_of':
            values[name] = HeightOf.__members__.get(str(value).upper(), value)
        elif name in QUANTITIES:
            unit = QUANTITIES[name].unit
            values[name] = parse_quantity(name, value, unit) if isinstance(value, str) else value
        else:
            raise InvalidValueError(
                f'invalid condition {shown(name)}: expected one of {", ".join(QUANTITIES)}'
            )
    return shipped_surfaces().get(surface).changed(**values)


def _surroundings(given: Any, folder: Path | None) -> Surroundings | None:
    if given is None or isinstance(given, Surroundings):
        return given
    if isinstance(given, Mapping):
        return make_surroundings(given)
    text = str(given)
    is_file = folder is not None and text.endswith(('.yaml', '.yml'))
    return named_surroundings(folder / text if is_file and folder is not None else text)


def _action(given: Any) -> NamedAction | None:
    if given is None:
        return None
    if not isinstance(given, Mapping):
        return named_action(given)
    values = dict(given)
    name, kind = values.pop('name', None), values.pop('kind', None)
    time = values.pop('time', 1.0)
    return NamedAction(str(name or kind), make_action(str(kind), values), time)
