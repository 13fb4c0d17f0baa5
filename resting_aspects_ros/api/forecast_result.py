"""The result of a forecast: parts per minute with intervals, its document and its report."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.condition_text import condition_facts, surface_text
from resting_aspects_ros.api.look_alike_notes import look_alike_texts
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.report.forecast import (
    NamedForecast,
    controlled_fields,
    forecast_fields,
    forecast_notes,
    forecast_sentence,
)
from resting_aspects_ros.report.transitions import matrix_fields

# Fields of the document of a reorientation that the document of a forecast has, too.
_SHARED = (
    'mesh_sha256',
    'action',
    'actions_asked',
    'complete',
    'energy_growth',
    'confidence',
    'interval',
    'aspects',
    'drop',
)


@dataclasses.dataclass(frozen=True, eq=False)
class ForecastResult:
    """The parts per minute of a feeder.

    Attributes
    ----------
    reorientation : ReorientResult
        The drops and the action that the forecast follows from.
    pickable : tuple of int
        Ids of the aspects in which the robot can pick the part.
    named : NamedForecast
        The model of the feeder, ``named.model``, and all numbers, ``named.forecast``.
    controlled : ControlledRuns or None
        What `forecast_controlled` returned, if it was requested.
    """

    reorientation: ReorientResult
    pickable: tuple[int, ...]
    named: NamedForecast
    controlled: ControlledRuns | None = None

    @property
    def parts_per_minute(self) -> float:
        """Parts per minute in the long run."""
        return self.named.forecast.rate

    @property
    def lower(self) -> float:
        """Lower bound of the parts per minute in the long run."""
        return self.named.forecast.lower

    @property
    def upper(self) -> float:
        """Upper bound of the parts per minute in the long run."""
        return self.named.forecast.upper

    @property
    def prediction(self) -> tuple[float, float]:
        """Interval of the parts per minute of a run of the given duration."""
        return self.named.forecast.prediction

    @property
    def best_number(self) -> int | None:
        """Number of parts on the tray with the highest rate; None if none can be picked."""
        return self.named.forecast.best_number

    @property
    def limited_by(self) -> str | None:
        """'robot', 'feeder' or 'vision': what raises the rate most if it is 10 % faster."""
        return self.named.forecast.limited_by

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        return forecast_sentence(self.named)

    @property
    def notes(self) -> list[str]:
        """Sentences on where the model ends, and on classes that a camera confuses."""
        found = self.reorientation
        alike = look_alike_texts(found.part, found.matrix.aspects, self.pickable)
        return [*forecast_notes(self.named), *alike]

    def document(self, alternatives: 'Sequence[ForecastResult]' = ()) -> dict[str, Any]:
        """Return the document that `resting_aspects forecast --json` prints.

        Parameters
        ----------
        alternatives : sequence of ForecastResult
            Other parts or other pickable aspects; their documents are in ``alternatives``.
        """
        found = self.reorientation
        base = found.document()
        run = found.run.document()
        for name in ('drops', 'precision'):
            del run[name]
        return {
            'schema_version': base['schema_version'],
            **run,
            **{name: base[name] for name in _SHARED},
            'pickable': list(self.pickable),
            **forecast_fields(self.named),
            'controller': None if self.controlled is None else controlled_fields(self.controlled),
            'transitions': matrix_fields(found.matrix),
            'alternatives': [each.document() for each in alternatives],
        }

    def to_json(self, alternatives: 'Sequence[ForecastResult]' = ()) -> str:
        """Return the document as text."""
        return json_text(self.document(alternatives))

    def report(self, folder: str | Path, alternatives: 'Sequence[ForecastResult]' = ()) -> Path:
        """Write a page with the curves and all numbers into a folder, which is made if necessary.

        Returns the path of the page; raises OutputError if it cannot be written.
        """
        check_forecast_report('folder', Path(folder))
        return write_forecast_report([self, *alternatives], Path(folder))


def check_forecast_report(flag: str, folder: Path) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    from resting_aspects_ros.api.report_files import check_files
    from resting_aspects_ros.report.forecast_page import FILES

    check_files(flag, folder, FILES)


def write_forecast_report(results: Sequence[ForecastResult], folder: Path) -> Path:
    """Write a report on one or several forecasts, and return the path of the page.

    Raises OutputError if a file cannot be written.
    """
    # These imports take about a second.
    from resting_aspects_ros.api.report_files import (
        part_facts,
        run_facts,
        warning_notes,
        write_files,
    )
    from resting_aspects_ros.report.forecast_page import (
        FILES,
        PAGE,
        ForecastReport,
        forecast_files,
    )

    first = results[0].reorientation
    parts = {each.reorientation.run.part: each.reorientation for each in results}
    facts: dict[str, list[tuple[str, str]]] = {
        'Feeder, camera and robot': list(_cell_facts(results[0]))
    }
    for name, found in parts.items():
        label = f' {name}' if len(parts) > 1 else ''
        facts[f'Part{label}'] = part_facts(found.part, found.run, found.matrix.aspects)
        facts[f'Run{label}'] = [
            *run_facts(found.run, int(found.matrix.actions.sum()), 'actions'),
            ('number of drops', str(found.drop.drops)),
        ]
    facts['Conditions'] = [
        ('surface', surface_text(first.run.conditions)),
        *condition_facts(first.run.conditions),
    ]
    report = ForecastReport(
        title=', '.join(parts),
        subtitle=_subtitle(results[0]),
        forecasts=[each.named for each in results],
        confidence=first.matrix.confidence,
        notes=[note for found in parts.values() for note in warning_notes(found.part)],
        facts=facts,
    )
    write_files(folder, forecast_files(report), FILES)
    return folder / PAGE


def save_forecast_picture(results: Sequence[ForecastResult], path: Path) -> None:
    """Write the curves as PNG; raises OutputError."""
    from resting_aspects_ros.report.figure import png_bytes
    from resting_aspects_ros.report.forecast import forecast_figure

    parts = dict.fromkeys(each.reorientation.run.part for each in results)
    title = f'{", ".join(parts)}, {_subtitle(results[0])}'
    data = png_bytes(forecast_figure([each.named for each in results], title))
    with whole_file(path) as part:
        part.write_bytes(data)


def _subtitle(result: ForecastResult) -> str:
    run = result.reorientation.run
    action = result.reorientation.action.name
    return f'{action} on {surface_text(run.conditions)}, seed {run.seed}'


def _cell_facts(result: ForecastResult) -> Iterator[tuple[str, str]]:
    """Yield label and value of the times, the tray and the gripper."""
    model, action = result.named.model, result.reorientation.action
    times, tray = model.times, model.tray
    yield 'action', f'{action.name}: {action.text}'
    yield 'robot, from pick to pick', f'{times.robot:g} s'
    yield 'motion of the feeder', f'{times.vibrate:g} s'
    yield 'until the parts are at rest', f'{times.settle:g} s'
    yield 'image', f'{times.image:g} s'
    yield 'supply of a part', f'{times.supply:g} s'
    yield 'overlap of feeder and robot', f'{times.overlap:g} s' if times.place else 'none'
    yield 'tray', ' x '.join(f'{1000 * side:g}' for side in tray.size) + ' mm'
    yield 'clearance', f'{1000 * tray.clearance:g} mm'
    yield 'footprint of the gripper', tray.gripper.text if tray.gripper else 'none'
    yield 'maximum number of picks', str(model.max_picks or 'all free parts')
