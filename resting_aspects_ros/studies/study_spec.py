"""What a study consists of, and the file study.yaml that describes it."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.surroundings import conditions_document
from resting_aspects_ros.core.errors import InvalidValueError, located, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.schema import validated
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, check_confidence
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, check_drops, check_seed
from resting_aspects_ros.simulation.surfaces import Surfaces
from resting_aspects_ros.studies.design import Factor, Setting, check_factors, read_factor
from resting_aspects_ros.studies.designs import (
    DEFAULT_DESIGN,
    DEFAULT_POINTS,
    design_points,
)
from resting_aspects_ros.studies.part_files import load_parts, save_part
from resting_aspects_ros.studies.study_file import (
    DEFAULT_STUDY_DROPS,
    DEFAULT_TOLERANCE,
    EXPECTED,
    StudyFile,
)

SPEC = 'study.yaml'


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


def read_spec(
    path: Path, changes: Mapping[str, Any] | None = None, surfaces: Surfaces | None = None
) -> StudySpec:
    """Read a study from a file; ``changes`` replace its values. Raises InvalidValueError."""
    document = read_yaml(path, 'study')
    if not isinstance(document, dict):
        raise InvalidValueError(
            f'invalid {named("study", path)}: expected a mapping with parts and vary'
        )
    with located(named('study', path)):
        spec = make_spec({**document, **(changes or {})}, path.parent, surfaces)
        spec.points()  # raises an error of the design
    return spec


def make_spec(
    document: Mapping[str, Any], folder: Path | None = None, surfaces: Surfaces | None = None
) -> StudySpec:
    """Return the study of a mapping; raises InvalidValueError.

    Files are relative to ``folder``. The surface is one of ``surfaces``, by default of the suite.
    """
    given = validated(StudyFile, document, expected=EXPECTED)
    base = given.setting(folder, surfaces or shipped_surfaces())
    return StudySpec(
        tuple(load_parts([given.parts] if isinstance(given.parts, str) else given.parts, folder)),
        base,
        tuple(read_factor(name, each, base) for name, each in given.vary.items()),
        given.design,
        (given.points,) if isinstance(given.points, int) else tuple(given.points),
        given.drops,
        given.seed,
        given.tolerance,
        given.confidence,
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
