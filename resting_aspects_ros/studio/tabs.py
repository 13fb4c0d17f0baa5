"""The tabs of the page: the controls of each, and what it shows.

A tab calls public functions with the options of the work, and shows their results with the kit of
the reports. `page.py` has the titles. Read `_show_outlines` first, the simplest.
"""

import base64
import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.conditions import (
    conditions_text,
    outcome_hints,
    shipped_actions,
    shipped_surfaces,
)
from resting_aspects_ros.api.count_files import counted_drops, read_counts
from resting_aspects_ros.api.counts import counted_by_class
from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.api.forecast import PER_ASPECT, forecast
from resting_aspects_ros.api.model_range import covered_text
from resting_aspects_ros.api.outlines import OutlinesResult, outlines
from resting_aspects_ros.api.pages import reorientation_page
from resting_aspects_ros.api.reorient import (
    PlanResult,
    ReorientResult,
    plan_reorientation,
    reorient,
)
from resting_aspects_ros.api.runner import DropTally
from resting_aspects_ros.api.track import design_track, track
from resting_aspects_ros.api.track_result import TrackResult
from resting_aspects_ros.report.drop_page import NOT_LEVEL, comparison_items
from resting_aspects_ros.report.format import aspect_colour, aspects_text, class_rows, size_text
from resting_aspects_ros.report.outlines import (
    confused_class_texts,
    family_texts,
    members,
    outline_table,
    pair_table,
    svg_drawing,
)
from resting_aspects_ros.report.page import Gallery, Item, Text, Tile, items_html, reading
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import MAX_DROPS
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.studies import pages
from resting_aspects_ros.studies.batch import compare_designs
from resting_aspects_ros.studies.calibration.calibrate import CalibrationResult, calibrate
from resting_aspects_ros.studio.export import (
    FILES,
    SURFACES_FILE,
    drop_recipe,
    file_values,
    forecast_recipe,
    outlines_recipe,
    recipes,
    reorient_options,
    reorient_recipe,
    track_on,
    track_recipe,
)
from resting_aspects_ros.studio.page import controls_html
from resting_aspects_ros.studio.rows import Opened, changing_texts, pickable_text
from resting_aspects_ros.studio.settings import (
    TRAP_KINDS,
    Settings,
    action_sliders,
    cell_sliders,
    condition_sliders,
    counts_csv,
    rail_sliders,
    trap_sliders,
)
from resting_aspects_ros.studio.work import Work, drop_options, page_items, words_item

# -- Aspects: the share of each class, while the conditions are changed ---------------------------

# The bars are shown again when the number of drops has grown by this factor.
GROWTH = 1.1
# In the place of the model range while its drops are made, so that nothing moves then.
PENDING = 'model range ...'


def _show_aspects(work: Work) -> None:
    """Drop the part, and show the shares meanwhile."""
    work.show_command(drop_recipe(work.opened.source, work.settings).line)
    conditions = work.settings.conditions
    tally, shown, pending = DropTally(no_drops(work.opened.aspects), MAX_DROPS), 0, ''
    words = _words('drops', tally.distribution.confidence)
    if conditions.surroundings is None:
        pending = PENDING
        work.show('range', [Text(covered_text(conditions.uncertain), 'plain'), words])
    report = work.progress('drops')

    def progress(done: int, total: int) -> None:
        nonlocal shown
        if done and done >= GROWTH * shown:
            shown = done
            _show_bars(work, tally.distribution, '', pending)
        report(done, total)

    result = work.drops(consumers=[tally.add], progress=progress)
    _show_bars(work, result.distribution, result.subtitle)
    hints = outcome_hints(result.distribution, conditions)
    notes = [*([NOT_LEVEL] if conditions.surroundings else []), *hints]
    work.show('hints', [Text(note, 'note') for note in notes])
    work.show('range', [Text(result.range_text, 'plain'), words])


def _words(kind: str, confidence: float) -> Item:
    return words_item(reading(kind, confidence=f'{100 * confidence:g}'))


def _show_bars(work: Work, distribution: Distribution, caption: str, pending: str = '') -> None:
    if not distribution.drops:
        return
    work.publish(
        'bars',
        {
            'rows': changing_texts(distribution, pending),
            'caption': caption,
            'pickable': pickable_text(distribution, work.settings.pickable),
        },
    )


# -- Outlines: what a camera above sees of the part, and which classes look alike -----------------


def _show_outlines(work: Work) -> None:
    work.show_command(outlines_recipe(work.opened.source).line)
    part = work.opened.part
    result: OutlinesResult = work.keep(('outlines', part.part_sha256), lambda: outlines(part))
    seen, alike = result.outlines, result.look_alikes
    items: list[Item] = [
        Text(f'{part.name}, {size_text(part)}', 'verdict'),
        Gallery([_outline_tile(result, k) for k in range(len(seen))]),
        *(Text(text, 'note') for text in confused_class_texts(seen, alike)),
        outline_table(seen, alike, result.aspects, ''),
        *(Text(text, 'plain') for text in family_texts(seen)),
    ]
    if len(seen) > 1:
        items.append(pair_table(seen, alike, ''))
    work.show('outlines', [*items, words_item(reading('outlines'))])


def _outline_tile(result: OutlinesResult, k: int) -> Tile:
    outline = result.outlines[k]
    alike = members(outline, result.aspects)
    name, colour = f'class {outline.symmetry_class}', aspect_colour(alike[0])
    drawing = svg_drawing(outline.polygon, name, colour).encode()
    picture = f'data:image/svg+xml;base64,{base64.b64encode(drawing).decode()}'
    return Tile(name, colour, picture, [aspects_text(alike)])


# -- Reorientation: how an action brings the part from aspect to aspect, and the best plan --------

# The best plan chooses among the shown action and these.
PLAN_ACTIONS = ('hard_tap', 'tap', 'toss')
NO_PLAN = 'Mark a class as pickable in the tab Aspects to see the best plan that leads to it.'


def _reorientation_controls(settings: Settings, _opened: Opened) -> str:
    names = shipped_actions().names()
    return controls_html('action', actions=names, sliders=action_sliders(settings.action))


def _show_reorientation(work: Work) -> None:
    """Simulate the action and show its transitions, and then the plan."""
    work.show_command(reorient_recipe(work.opened.source, work.settings).line)
    result = _reoriented(work, work.settings.action)
    if work.stopped():
        return
    classes = work.opened.aspects.classes()
    wanted = [a.id for k in sorted(work.settings.pickable) for a in classes[k - 1]]
    _show_transitions(work, result, wanted, None)
    if not wanted or not result.complete:
        return
    names = [name for name in PLAN_ACTIONS if name != result.action.name]
    results = [result, *(_reoriented(work, shipped_actions().get(name)) for name in names)]
    if not work.stopped():
        _show_transitions(work, result, wanted, plan_reorientation(results, wanted))


def _reoriented(work: Work, action: NamedAction) -> ReorientResult:
    options = {**reorient_options(work.settings), 'action': action}
    result: ReorientResult = work.made(
        reorient, work.opened.part, options, f'actions of {action.name}'
    )
    return result


def _show_transitions(
    work: Work, result: ReorientResult, wanted: list[int], plan: PlanResult | None
) -> None:
    page = reorientation_page([result], wanted=wanted, plan=plan)
    items: list[Item] = [Text(note, 'note') for note in page.notes]
    if not wanted:
        items.append(Text(NO_PLAN, 'plain'))
    work.show('reorientation', items + page_items(page, backwards=True))  # the plan first


# -- Forecast: how many parts per minute a robot picks --------------------------------------------

NOTHING_PICKABLE = 'Mark at least one class as pickable in the tab Aspects.'
ON_A_TRAY = 'The forecast is that of a level tray: the surroundings have no effect on it.'


def _forecast_controls(settings: Settings, _opened: Opened) -> str:
    names = shipped_actions().names()
    return controls_html('cell', actions=names, sliders=cell_sliders(settings.cell))


def _show_forecast(work: Work) -> None:
    settings, cell = work.settings, work.settings.cell
    if not settings.pickable:
        work.show_command('')
        work.show('forecast', [Text(NOTHING_PICKABLE, 'verdict')])
        return
    work.show_command(forecast_recipe(work.opened.source, settings).line)
    options = {
        **reorient_options(settings),
        'per_aspect': PER_ASPECT,
        'surface': settings.conditions.changed(surroundings=None),
        'action': cell.action,
    }
    simulated: ReorientResult = work.made(reorient, work.opened.part, options, 'actions')
    if not simulated.complete or work.stopped():
        return
    result = forecast(
        simulated,
        pickable_classes=sorted(settings.pickable),
        robot=cell.robot,
        vibrate=cell.vibrate,
        settle=cell.settle,
        image=cell.image,
        tray=(cell.width, cell.depth),
        clearance=cell.clearance,
        parts_on_tray=cell.parts_on_tray,
    )
    work.show('forecast', _level_note(work, ON_A_TRAY) + page_items(result.page()))


def _level_note(work: Work, text: str) -> list[Item]:
    """Return the note that surroundings have no effect, if there are any."""
    return [] if work.settings.conditions.surroundings is None else [Text(text, 'note')]


# -- Track: which traps of a bowl or linear feeder pass only the wanted orientation ---------------

NO_DESIGN = 'No traps pass only the wanted row. The table shows all rows.'
ON_A_PLANE = 'The shares are those of drops on a level plane: surroundings have no effect on them.'


def _track_controls(settings: Settings, _opened: Opened) -> str:
    rail = settings.rail
    return controls_html(
        'rail', sliders=rail_sliders(rail), traps=trap_sliders(rail), kinds=TRAP_KINDS
    )


def _show_track(work: Work) -> None:
    """Design the traps, or take those of the user, and show them with the parts per minute."""
    settings, rail = work.settings, work.settings.rail
    work.show_command(track_recipe(work.opened, settings).line)
    options = {
        'want': rail.want,
        'on': track_on(work.opened.part, rail),
        'drops': settings.drops,
        'surface': settings.conditions.changed(surroundings=None),
        'tolerance': rail.tolerance,
        'seed': settings.seed,
    }
    of_drops = work.progress('drops')

    def progress(done: int, total: int) -> None:
        of_drops(done, total)
        if done == total and not rail.traps:  # what follows takes longer than the drops
            work.publish('progress', {'text': f'looking for traps that pass row {rail.want} ...'})

    function = track if rail.traps else design_track
    found: TrackResult = work.made(function, work.opened.part, options, 'drops', progress=progress)
    if work.stopped():
        return
    items = _level_note(work, ON_A_PLANE)
    if found.design is not None and not found.design.designs:
        items.append(Text(NO_DESIGN, 'verdict'))
    covered = found.drop.range_text  # below the table
    items += [Text(each, 'plain') for each in found.sentences if each != covered]
    items += page_items(found.page(), backwards=True)  # the traps first
    proposed = [] if rail.traps else [trap.document for trap in found.passage.track.traps]
    work.publish('track', {'html': controls_html('proposed', traps=proposed) + items_html(items)})


# -- Compare: two parts, or two conditions, side by side ------------------------------------------

BOTH_DIFFER = 'Not only the part but also the conditions of A and B differ.'


def _compare_controls(settings: Settings, _opened: Opened) -> str:
    """Return the part and the conditions of the second side."""
    return controls_html(
        'other',
        surfaces=shipped_surfaces().names(),
        sliders=condition_sliders(settings.other, 'other.'),
    )


def _show_comparison(work: Work) -> None:
    """Drop both sides and show how they differ."""
    work.show_command('')
    second = work.second or work.opened
    # Other drops than those of the first side: the two must be independent.
    other = {'surface': work.settings.other, 'seed': work.settings.seed + 1}
    options = {**drop_options(work.settings), **other}
    a = work.drops()
    b: DropResult = work.made(drop, second.part, options, 'drops', keep_poses=False)
    if work.stopped():
        return
    items: list[Item] = [_side('A', a), _side('B', b)]
    if second.part.part_sha256 == work.opened.part.part_sha256:
        found = compare(*(counted_by_class(counted_drops(each)) for each in (a, b)))
        rows = class_rows(a.distribution)
        names = tuple(row.name.partition(' ')[2] for row in rows)
        sides = dataclasses.replace(found.sides, what='aspect', names=names)
        items += comparison_items(rows, sides)
        items += [Text(text, 'plain') for text in found.range_texts]
        items.append(_words('compare', found.comparison.confidence))
    else:
        if work.settings.other != work.settings.conditions:
            items.append(Text(BOTH_DIFFER, 'note'))
        items += _designs(work.opened, second, a, b)
    work.show('compare', items)


def _side(name: str, result: DropResult) -> Text:
    where = conditions_text(result.run.conditions)
    drops = result.distribution.drops
    return Text(f'{name}: {result.run.part}, {drops:,} drops on {where}', 'verdict')


def _designs(first: Opened, second: Opened, a: DropResult, b: DropResult) -> Iterator[Item]:
    """Yield the comparison of two parts, whose classes are matched in one frame."""
    pictures = {id(a): list(first.pictures), id(b): list(second.pictures)}
    confidence = a.distribution.confidence
    for found in compare_designs((a, b), confidence):
        yield from pages.comparison_items(found, pictures, confidence)
    for text in dict.fromkeys([a.range_text, b.range_text]):
        yield Text(text, 'plain')
    for result in (a, b):
        rows = class_rows(result.distribution)
        tiles = [
            Tile(row.name, row.colour, picture, [])
            for row, picture in zip(rows, pictures[id(result)], strict=False)
        ]
        yield Gallery(tiles, result.run.part)


# -- Hand counts: parts that were counted by hand, against the simulation -------------------------

NOTHING_COUNTED = (
    'Drop some parts on your own surface, count how many lie in each class, and enter the '
    'numbers. The verdict appears here; the counting sheet is in the tab Outlines.'
)
SURFACE = 'hand_counts'


def _counts_controls(_settings: Settings, opened: Opened) -> str:
    """Return a picture and a number field for each class."""
    fields = zip(opened.names, opened.pictures, strict=True)
    return controls_html('counts', fields=list(enumerate(fields, start=1)), names=('counts.csv',))


def _show_counts(work: Work) -> None:
    """Compare the counts with the drops, and fit the surface if that is requested."""
    work.show_command('')
    if not any(work.settings.counts.values()):
        work.show('counts', [Text(NOTHING_COUNTED, 'plain')])
        return
    path = work.folder / 'counts.csv'
    path.write_text(counts_csv(work.settings), encoding='utf-8')
    work.show_command('resting_aspects compare distribution.json counts.csv')
    result = work.drops()
    if work.stopped():
        return
    found = compare(result, counted_by_class(read_counts(path)))
    rows = class_rows(result.distribution)
    sides = dataclasses.replace(found.sides, labels=('simulated', 'counted'))
    about = [Text(text, 'plain') for text in found.range_texts]
    words = _words('compare', found.comparison.confidence)
    html = items_html([*comparison_items(rows, sides), *about, words])
    work.publish('counts', {'html': html})
    if work.settings.fit:
        fitted = _fitted(work)
        texts = [str(fitted), fitted.surface_entry(uncertainty=False)]
        shown = ''.join(controls_html('plain', text=text) for text in texts)
        work.publish('counts', {'html': shown + html})


def _fitted(work: Work) -> CalibrationResult:
    """Return the surface that fits the counts: its restitution and friction."""
    source, conditions = work.opened.source, work.settings.conditions
    part: dict[str, Any] = {'counts': {k: n for k, n in work.settings.counts.items() if n}}
    if source.path is None:
        part['part'] = source.given
    else:
        # The result names the part as this file is named.
        mesh = source.path.with_name(work.opened.part.name + source.path.suffix)
        if not mesh.exists():
            shutil.copyfile(source.path, mesh)
        mesh.with_suffix('.yaml').write_text(json.dumps(file_values(source)), encoding='utf-8')
        part['mesh'] = str(mesh)
    for number in range(1, work.settings.classes + 1):
        part['counts'].setdefault(str(number), 0)
    counts = {
        'surface': SURFACE,
        'conditions': {'height': f'{conditions.height!r} m'},
        'parts': [part],
    }
    key = ('calibrate', work.opened.part.part_sha256, repr(counts))
    fitted: CalibrationResult = work.keep(key, lambda: calibrate(counts, **work.options('drops')))
    return fitted


# -- Export: files of the results, and the commands and the Python that give the same numbers -----


def _export_controls(_settings: Settings, _opened: Opened) -> str:
    """Return the links to all files."""
    return controls_html('files', files={name: each.title for name, each in FILES.items()})


def _show_export(work: Work) -> None:
    """Show the recipes of all tabs, and the entry of a surfaces file."""
    found = recipes(work.opened, work.settings)
    work.show_command(found['Aspects'].line)
    entry = FILES[SURFACES_FILE].make(work).decode()
    html = controls_html('recipes', recipes=found.items(), entry=entry)
    work.publish('export', {'html': html})


@dataclass(frozen=True)
class Tab:
    """A tab of the page.

    show : callable
        Publishes what the tab shows; it is called in the thread of a room.
    controls : callable
        Returns the HTML of the controls without their values, which come as a message of their
        own.
    """

    show: Callable[[Work], None]
    controls: Callable[[Settings, Opened], str] = lambda *_: ''


OUTLINE_FILES = ('counting_sheet.pdf', 'outlines.zip')
TABS = {
    'aspects': Tab(_show_aspects),  # its controls, the conditions, are those of all tabs
    'outlines': Tab(_show_outlines, lambda *_: controls_html('downloads', names=OUTLINE_FILES)),
    'reorientation': Tab(_show_reorientation, _reorientation_controls),
    'forecast': Tab(_show_forecast, _forecast_controls),
    'track': Tab(_show_track, _track_controls),
    'compare': Tab(_show_comparison, _compare_controls),
    'counts': Tab(_show_counts, _counts_controls),
    'export': Tab(_show_export, _export_controls),
}
