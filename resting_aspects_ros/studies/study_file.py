"""The schema of the file study.yaml, and what it says of the conditions."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import StrictInt, StrictStr

from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.core.schema import FileModel, Number
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE
from resting_aspects_ros.simulation.actions import DEFAULT_TIME, KINDS, NamedAction, make_action
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.quantity import check_name, described_kind
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED
from resting_aspects_ros.simulation.surfaces import Surfaces
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.library import (
    make_surroundings,
    named_surroundings,
)
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.designs import DEFAULT_DESIGN, DEFAULT_POINTS, DESIGNS

DEFAULT_STUDY_DROPS = 2000
# A change of a share that matters to the reader of the page.
DEFAULT_TOLERANCE = 0.05
EXPECTED = {
    'parts': 'the name of a part, a mesh file or a list of them',
    'surface': 'the name of a surface',
    'conditions': 'a mapping of conditions to numbers, or texts with a unit',
    'vary': 'a mapping of factors to ranges',
    'design': f'one of {", ".join(DESIGNS)}',
    'points': 'a number of points, or a list of numbers',
}


class StudyFile(FileModel):
    """The file study.yaml; see StudySpec, which checks the bounds of the numbers."""

    parts: StrictStr | list[StrictStr]
    surface: StrictStr = ''
    conditions: dict[StrictStr, Number | StrictStr] | None = None
    surroundings: Any = None
    action: Any = None
    vary: dict[StrictStr, Any]
    design: Literal[tuple(DESIGNS)] = DEFAULT_DESIGN  # type: ignore[valid-type]
    points: StrictInt | list[StrictInt] = DEFAULT_POINTS
    drops: StrictInt = DEFAULT_STUDY_DROPS
    seed: StrictInt = DEFAULT_SEED
    tolerance: Number = DEFAULT_TOLERANCE
    confidence: Number = CONFIDENCE
    # What a study was made with.
    versions: Any = None
    part_sha256: Any = None

    def setting(self, folder: Path | None, surfaces: Surfaces) -> Setting:
        """Return what is simulated, but for the factors; raises InvalidValueError.

        The files of surroundings are relative to ``folder``.
        """
        return Setting(
            _conditions(self.surface, self.conditions or {}, surfaces),
            _surroundings(self.surroundings, folder),
            _action(self.action),
        )


def _conditions(
    surface: str, changes: Mapping[str, float | str], surfaces: Surfaces
) -> DropConditions:
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
    if len(values) > len(QUANTITIES) and surface not in ('', *surfaces.names()):
        # A saved study has all values of a surface whose file need not exist any more.
        return DropConditions(surface=check_name('a surface', surface), **values)
    return surfaces.get(surface).changed(**values)


def _surroundings(given: Any, folder: Path | None) -> Surroundings | None:
    if given is None or isinstance(given, Surroundings):
        return given
    if not isinstance(given, str):
        return make_surroundings(given)
    is_file = folder is not None and given.endswith(('.yaml', '.yml'))
    return named_surroundings(folder / given if is_file and folder is not None else given)


def _action(given: Any) -> NamedAction | None:
    if given is None:
        return None
    if isinstance(given, str):
        return named_action(given)
    kind, values, _ = described_kind('action', given, KINDS)
    name, time = values.pop('name', kind), values.pop('time', DEFAULT_TIME)
    if not isinstance(name, str):
        raise InvalidValueError(f'invalid name {shown(name)} of an action: expected text')
    return NamedAction(name, make_action(kind, values), time)
