"""The result of a forecast: parts per minute with intervals, its document and its report."""

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.api.conditions import condition_facts, surface_text
from resting_aspects_ros.api.pages import part_facts, run_facts, warning_notes
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.api.result import Result, save_figure
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.forecast import (
    FORECAST_NOTE,
    NamedForecast,
    cell_facts,
    controlled_fields,
    forecast_fields,
    forecast_figure,
    forecast_notes,
    forecast_sentence,
    forecast_table,
    mix_table,
    range_text,
)
from resting_aspects_ros.report.format import ids_text, numbers_text
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
    from resting_aspects_ros.feeding.tray_simulation import ControlledRuns

# -- Look-alikes ----------------------------------------------------------------------------------


def divided_class_texts(aspects: AspectSet, pickable: Collection[int]) -> list[str]:
    """Return a sentence for each symmetry class of which only some aspects are pickable.

    Its aspects look the same and lie in the same way, so a robot cannot pick only some of them.
    """
    texts = []
    for members in aspects.classes():
        inside = tuple(aspect for aspect in members if aspect.id in pickable)
        outside = tuple(aspect for aspect in members if aspect.id not in pickable)
        if inside and outside:
            many, other = ('s' if len(each) > 1 else '' for each in (inside, outside))
            texts.append(
                f'the aspects {ids_text(members)} of class {members[0].symmetry_class} look the '
                f'same: a robot that picks aspect{many} {ids_text(inside)} also picks '
                f'aspect{other} {ids_text(outside)}, which {"are" if other else "is"} not '
                'requested as pickable'
            )
    return texts


def look_alike_texts(part: Part, aspects: AspectSet, pickable: Collection[int]) -> list[str]:
    """Return a sentence for each group of classes that look alike and are not all pickable.

    These are the classes with the same outline or its mirror image; see `look_alikes`.
    """
    picked = {
        members[0].symmetry_class
        for members in aspects.classes()
        if all(aspect.id in pickable for aspect in members)
    }
    same, mirrored = _groups(part, aspects)
    texts = [
        f'A camera sees the same outline of {names}: the forecast assumes that vision '
        'distinguishes them in another way.'
        for group in same
        if (names := _picked_text(group, group, picked))
    ]
    texts += [
        f'The outlines of {names}, are mirror images: vision must not match mirrored outlines.'
        for one, other in mirrored
        for pair in ((one, other), (other, one))
        if (names := _picked_text(*pair, picked))
    ]
    return texts


def counted_apart_texts(
    part: Part, aspects: AspectSet, groups: Collection[Collection[int]]
) -> list[str]:
    """Return a sentence for each group of classes with the same outline that are counted apart.

    groups : the symmetry classes that were counted together
    """
    return [
        f'If a camera counts, classes {numbers_text(group)} have the same outline, and can be '
        f'counted together as {"+".join(map(str, group))}.'
        for group in _groups(part, aspects)[0]
        if len(group) > 1 and not any(set(group) <= set(each) for each in groups)
    ]


def _picked_text(one: Sequence[int], other: Sequence[int], picked: Collection[int]) -> str:
    """Return the pickable classes of a group, and those of another that are not; can be empty."""
    inside = [number for number in one if number in picked]
    outside = [number for number in other if number not in picked]
    if not (inside and outside):
        return ''
    first, second = (
        f'class{"es" if len(each) > 1 else ""} {numbers_text(each)}, which '
        f'{"are" if len(each) > 1 else "is"}'
        for each in (inside, outside)
    )
    return f'{first} pickable, and {second} not'


def _groups(
    part: Part, aspects: AspectSet
) -> tuple[list[tuple[int, ...]], list[tuple[tuple[int, ...], tuple[int, ...]]]]:
    """Return the groups of classes with one outline, and the pairs of groups that are mirrored."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.vision.outline import find_outlines, look_alikes, same_groups

    found = look_alikes(find_outlines(part, aspects))
    groups = same_groups(found)
    mirrored = [
        (one, other)
        for one, other in combinations(groups, 2)
        for entry in found[one[0]]
        if entry.symmetry_class == other[0] and entry.verdict == 'mirrored'
    ]
    return groups, mirrored


# -- Results --------------------------------------------------------------------------------------


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
        Ids of the aspects in which the robot can pick the part.
    named : NamedForecast
        The model of the feeder, ``named.model``, and all numbers, ``named.forecast``.
    controlled : ControlledRuns or None
        What `forecast_controlled` returned, if it was requested.
    """

    reorientation: ReorientResult
    pickable: tuple[int, ...]
    named: NamedForecast
    controlled: 'ControlledRuns | None' = None

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
    def model_lower(self) -> float:
        """Lower bound of the parts per minute if the assumptions of the model may be broken."""
        return self.named.forecast.wide[0]

    @property
    def model_upper(self) -> float:
        """Upper bound of the parts per minute if the assumptions of the model may be broken."""
        return self.named.forecast.wide[1]

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

    def page(self, alternatives: 'Sequence[ForecastResult]' = ()) -> Page:
        """Return a page with the curves and all numbers."""
        return forecast_page([self, *alternatives])


def forecast_page(results: Sequence[ForecastResult]) -> Page:
    """Return a page on one or several forecasts."""
    first = results[0]
    parts = {each.reorientation.run.part: each.reorientation for each in results}
    return Page(
        file=PAGE,
        title=', '.join(parts),
        topic='parts per minute',
        lead='How many parts per minute a robot picks from the tray',
        subtitle=_subtitle(first),
        sections=[
            Section('Parts per minute', 'rate', list(_rate_items(results))),
            Section('What lies on the tray', 'mix', list(_mix_items(results))),
        ],
        reading=reading('forecast'),
        facts=_facts(first, parts),
        notes=[note for found in parts.values() for note in warning_notes(found.part)],
        names=FILES,
    )


def _rate_items(results: Sequence[ForecastResult]) -> Iterator[Item]:
    forecasts = [each.named for each in results]
    several = len(forecasts) > 1
    for each in forecasts:
        name = f'{each.title}: ' if several else ''
        yield Text(f'{name}{forecast_sentence(each)}.', 'verdict')
    for note in dict.fromkeys(note for each in forecasts for note in forecast_notes(each)):
        yield Text(note, 'note')
    title = f'{_parts_text(results)}, {_subtitle(results[0])}'
    yield Chart(
        FIGURE,
        'Line charts of parts per minute and of cycles without a pick against the number of parts',
        partial(forecast_figure, forecasts, ''),
        FORECAST_NOTE,
        partial(forecast_figure, forecasts, title),
    )
    yield forecast_table(forecasts)
    for each in forecasts:
        if text := range_text(each):
            yield text
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
    action = first.reorientation.action
    cell = [('action', f'{action.name}: {action.text}'), *cell_facts(first.named)]
    facts = {'Feeder, camera and robot': cell}
    for name, found in parts.items():
        label = f' {name}' if len(parts) > 1 else ''
        facts[f'Part{label}'] = part_facts(found.part, found.run, found.matrix.aspects)
        facts[f'Run{label}'] = [
            *run_facts(found.run, int(found.matrix.actions.sum()), 'actions'),
            ('number of drops', str(found.drop.drops)),
        ]
    facts['Conditions'] = [('surface', surface_text(conditions)), *condition_facts(conditions)]
    return facts


def save_forecast_picture(results: Sequence[ForecastResult], path: Path) -> None:
    """Write the curves as PNG; raises OutputError."""
    title = f'{_parts_text(results)}, {_subtitle(results[0])}'
    save_figure(forecast_figure([each.named for each in results], title), path)


def _parts_text(results: Sequence[ForecastResult]) -> str:
    return ', '.join(dict.fromkeys(each.reorientation.run.part for each in results))


def _subtitle(result: ForecastResult) -> str:
    run = result.reorientation.run
    action = result.reorientation.action.name
    return f'{action} on {surface_text(run.conditions)}, seed {run.seed}'
