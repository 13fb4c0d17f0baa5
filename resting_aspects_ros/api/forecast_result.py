"""The result of a forecast: parts per minute with intervals, its document and its report."""

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.api.conditions import surface_text
from resting_aspects_ros.api.pages import part_facts, run_facts, surface_facts, warning_notes
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.forecast import (
    FORECAST_NOTE,
    NamedForecast,
    cell_text,
    forecast_fields,
    forecast_figure,
    forecast_notes,
    forecast_sentence,
    forecast_table,
    mix_table,
    range_text,
)
from resting_aspects_ros.report.format import numbers_text
from resting_aspects_ros.report.page import (
    Chart,
    Item,
    Page,
    Section,
    Text,
    file_names,
    reading,
)
from resting_aspects_ros.report.transitions import matrix_fields

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def look_alike_texts(part: Part, aspects: AspectSet, pickable: Collection[int]) -> list[str]:
    """Return a sentence for each group of classes with one outline that are pickable in part."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.vision.outline import find_outlines, look_alikes, same_groups

    picked = {
        members[0].symmetry_class
        for members in aspects.classes()
        if all(aspect.id in pickable for aspect in members)
    }
    texts = []
    for group in same_groups(look_alikes(find_outlines(part, aspects))):
        inside = [number for number in group if number in picked]
        if 0 < len(inside) < len(group):
            texts.append(
                f'A camera sees the same outline of classes {numbers_text(group)}, of which only '
                f'{numbers_text(inside)} can be picked: the forecast assumes that vision '
                'distinguishes them in another way.'
            )
    return texts


PAGE, FIGURE = 'forecast.html', 'forecast'
FILES = file_names(PAGE, [FIGURE])
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
class ForecastResult(Result):
    """The parts per minute of a feeder.

    Attributes
    ----------
    reorientation : ReorientResult
        The drops and the action that the forecast follows from.
    pickable : tuple of int
        Ids of the aspects in which the robot can pick the part, of whole symmetry classes.
    named : NamedForecast
        The model of the feeder, ``named.model``, and all numbers, ``named.forecast``.
    """

    reorientation: ReorientResult
    pickable: tuple[int, ...]
    named: NamedForecast

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
            'transitions': matrix_fields(found.matrix),
            'alternatives': [each.document() for each in alternatives],
        }

    def figure(self, alternatives: 'Sequence[ForecastResult]' = ()) -> 'Figure':
        """Return the curves of this forecast and of its alternatives."""
        results = [self, *alternatives]
        title = f'{_parts_text(results)}, {_subtitle(self)}'
        return forecast_figure([each.named for each in results], title)

    def page(self, alternatives: 'Sequence[ForecastResult]' = ()) -> Page:
        """Return a page with the curves and all numbers."""
        results = [self, *alternatives]
        parts = {each.reorientation.run.part: each.reorientation for each in results}
        return Page(
            file=PAGE,
            title=', '.join(parts),
            topic='parts per minute',
            lead='How many parts per minute a robot picks from the tray',
            subtitle=_subtitle(self),
            sections=[
                Section('Parts per minute', 'rate', list(_rate_items(results))),
                Section('What lies on the tray', 'mix', list(_mix_items(results))),
            ],
            reading=reading('forecast'),
            facts=_facts(self, parts),
            notes=[note for found in parts.values() for note in warning_notes(found.part)],
            names=FILES,
        )


def _rate_items(results: Sequence[ForecastResult]) -> Iterator[Item]:
    forecasts = [each.named for each in results]
    several = len(forecasts) > 1
    for each in forecasts:
        name = f'{each.title}: ' if several else ''
        yield Text(f'{name}{forecast_sentence(each)}.', 'verdict')
    notes = {each.named.title: each.notes for each in results}
    for note in dict.fromkeys(note for found in notes.values() for note in found):
        names = ', '.join(name for name, found in notes.items() if note in found)
        common = all(note in found for found in notes.values())
        yield Text(note if common else f'{names}: {note}', 'note')
    yield cell_text(forecasts[0])
    first, *others = results
    yield Chart(
        FIGURE,
        'Line charts of parts per minute and of cycles without a pick against the number of parts',
        partial(forecast_figure, forecasts, ''),
        FORECAST_NOTE,
        partial(first.figure, others),
    )
    yield forecast_table(forecasts)
    for each in forecasts:
        if text := range_text(each):
            yield f'{each.title}: {text}' if several else text
    confidence = 100 * results[0].reorientation.matrix.confidence
    yield (
        f'The interval of the parts per minute is that of the long run, with {confidence:g} % '
        f'confidence. The parts of a single run of {forecasts[0].forecast.minutes:g} minutes vary '
        'more.'
    )


def _mix_items(results: Sequence[ForecastResult]) -> Iterator[Item]:
    for each in results:
        if len(results) > 1:
            yield Text(each.named.title, 'part')
        yield mix_table(each.named)
    yield (
        'Shares of the aspects among dropped parts, and among the parts on the tray when an image '
        'is taken; how often a part of the aspect is free, and how often it is picked after an '
        'image.'
    )


def _facts(
    first: ForecastResult, parts: Mapping[str, ReorientResult]
) -> dict[str, list[tuple[str, str]]]:
    conditions = first.reorientation.run.conditions
    facts = {}
    for name, found in parts.items():
        label = f' {name}' if len(parts) > 1 else ''
        facts[f'Part{label}'] = part_facts(found.part, found.run, found.matrix.aspects)
        facts[f'Run{label}'] = [
            *run_facts(found.run, int(found.matrix.actions.sum()), 'actions'),
            ('number of drops', str(found.drop.drops)),
            ('action', found.action.text),
        ]
    facts['Conditions'] = surface_facts(conditions)
    return facts


def _parts_text(results: Sequence[ForecastResult]) -> str:
    return ', '.join(dict.fromkeys(each.reorientation.run.part for each in results))


def _subtitle(result: ForecastResult) -> str:
    run = result.reorientation.run
    action = result.reorientation.action.name
    return f'{action} on {surface_text(run.conditions)}, seed {run.seed}'
