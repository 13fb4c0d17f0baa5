"""Two parts, or two conditions, side by side."""

from collections.abc import Iterator

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.conditions import conditions_text, shipped_surfaces
from resting_aspects_ros.api.count_files import counted_drops
from resting_aspects_ros.api.counts import counted_by_class
from resting_aspects_ros.api.drop import drop
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.report.drop_page import comparison_items
from resting_aspects_ros.report.format import class_rows
from resting_aspects_ros.report.page import Gallery, Item, Text, Tile
from resting_aspects_ros.studies.batch import BatchEntry, compare_cases
from resting_aspects_ros.studies.pages import case_colours
from resting_aspects_ros.studies.pages import comparison_items as design_items
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings, condition_sliders
from resting_aspects_ros.studio.work import Work, controls_html, drop_options


def controls(settings: Settings, opened: Opened) -> str:
    """Return the part and the conditions of the second side."""
    del opened
    return controls_html(
        'other',
        surfaces=shipped_surfaces().names(),
        sliders=condition_sliders(settings.other, 'other.'),
    )


def show(work: Work) -> None:
    """Drop both sides and show how they differ."""
    work.publish('same', {'text': ''})
    second = work.second or work.opened
    first_result, second_result = work.drops(), _other_drops(work, second)
    if work.stopped():
        return
    items: list[Item] = [_side('A', first_result), _side('B', second_result)]
    if second.part.part_sha256 == work.opened.part.part_sha256:
        items += _conditions(first_result, second_result)
    else:
        items += _designs(work, second, first_result, second_result)
    work.show('compare', items)


def _side(name: str, result: DropResult) -> Text:
    where = conditions_text(result.run.conditions)
    drops = result.distribution.drops
    return Text(f'{name}: {result.run.part}, {drops:,} drops on {where}', 'verdict')


def _other_drops(work: Work, second: Opened) -> DropResult:
    # Other drops than those of the first side: the two must be independent.
    options = {
        **drop_options(work.settings),
        'surface': work.settings.other,
        'seed': work.settings.seed + 1,
    }
    key = ('drops', second.part.part_sha256, *map(repr, options.values()))
    return work.keep(
        key, lambda: drop(second.part, keep_poses=False, **options, **work.options('drops'))
    )


def _conditions(a: DropResult, b: DropResult) -> Iterator[Item]:
    """Yield the comparison of one part under two sets of conditions."""
    one, other = (counted_by_class(counted_drops(each)) for each in (a, b))
    found = compare(one, other)
    yield from comparison_items(class_rows(a.distribution), found.comparison, found.sides)


def _designs(work: Work, second: Opened, a: DropResult, b: DropResult) -> Iterator[Item]:
    """Yield the comparison of two parts, whose classes are matched in one frame."""
    cases = [BatchEntry(each.run.part, each).case for each in (a, b)]
    pictures = {id(cases[0]): list(work.opened.pictures), id(cases[1]): list(second.pictures)}
    confidence = a.distribution.confidence
    for found in compare_cases(cases, confidence):
        yield from design_items(found, pictures, confidence)
    for case, opened in zip(cases, (work.opened, second), strict=True):
        tiles = [
            Tile(name, colour, picture, [])
            for name, colour, picture in zip(
                opened.names, case_colours(case), opened.pictures, strict=False
            )
        ]
        yield Gallery(tiles, case.name)
