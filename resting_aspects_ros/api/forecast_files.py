"""The files of a report on forecasts."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from resting_aspects_ros.api.condition_text import condition_facts, surface_text
from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.report_files import (
    check_files,
    part_facts,
    run_facts,
    warning_notes,
    write_files,
)
from resting_aspects_ros.report.figure_style import png_bytes
from resting_aspects_ros.report.forecast_figure import forecast_figure
from resting_aspects_ros.report.forecast_page import FILES, PAGE, ForecastReport, forecast_files

Facts = list[tuple[str, str]]


def check_forecast_report(flag: str, folder: Path) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    check_files(flag, folder, FILES)


def write_forecast_report(results: Sequence[ForecastResult], folder: Path) -> Path:
    """Write a report on one or several forecasts, and return the path of the page.

    Raises OutputError if a file cannot be written.
    """
    first = results[0].reorientation
    parts = {each.reorientation.run.part: each.reorientation for each in results}
    facts: dict[str, Facts] = {'Feeder, camera and robot': list(_cell_facts(results[0]))}
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
