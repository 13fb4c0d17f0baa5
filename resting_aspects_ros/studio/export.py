"""What can be taken from the page: files, and the command and the Python of each tab."""

import shlex
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.conditions import shipped_surfaces, surface_entry, surface_text
from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.api.reorient import DEFAULT_PER_ASPECT
from resting_aspects_ros.api.track import default_track
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drops import distribution_table
from resting_aspects_ros.report.table import Table, save_csv, save_xlsx
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_DROPS,
    DEFAULT_SURFACE,
    QUANTITIES,
    DropConditions,
    quantities_of,
)
from resting_aspects_ros.simulation.surroundings import named_surroundings
from resting_aspects_ros.studio.rows import Opened, Source
from resting_aspects_ros.studio.settings import Rail, Settings, counts_csv, dimensions
from resting_aspects_ros.studio.work import Work

# The file that the tab Export offers, and the surface in it.
SURFACES_FILE, OWN_SURFACE = 'surfaces.yaml', 'studio'


@dataclass(frozen=True)
class Recipe:
    """The same work on the command line, as a line, and in Python, as a program."""

    line: str
    python: str


def recipes(opened: Opened, settings: Settings) -> dict[str, Recipe]:
    """Return the recipe of each tab that has one, by its title."""
    source = opened.source
    found = {
        'Aspects': drop_recipe(source, settings),
        'Outlines': outlines_recipe(source),
        'Reorientation': reorient_recipe(source, settings),
        'Track': track_recipe(opened, settings),
    }
    if settings.pickable:
        found['Forecast'] = forecast_recipe(source, settings)
    return found


def drop_recipe(source: Source, settings: Settings) -> Recipe:
    """Return how the drops of the tab Aspects are made."""
    number = {'precision': settings.precision} if settings.precision else {'drops': settings.drops}
    values: dict[str, Any] = {**number, 'seed': settings.seed}
    surface = _Surface(settings.conditions)
    words = [*_flags(values), *surface.flags]
    return _recipe('drop', source, words, '', {**values, **surface.values}, settings)


def reorient_recipe(source: Source, settings: Settings) -> Recipe:
    """Return how the action of the tab Reorientation is simulated."""
    action = settings.action
    name = action.name.removesuffix('_changed')
    values = {'seed': settings.seed}
    surface = _Surface(settings.conditions)
    words = ['--action', name]
    argument = repr(name)
    if name != action.name:
        words += _flags(action.action.numbers)
        kind = f'ra.{type(action.action).__name__}({_arguments(action.action.numbers)})'
        argument = f'ra.NamedAction({action.name!r}, {kind}, time={action.time!r})'
    words += [*_flags(values), *surface.contact_flags]
    return _recipe('reorient', source, words, argument, {**values, **surface.values}, settings)


def forecast_recipe(source: Source, settings: Settings) -> Recipe:
    """Return how the tab Forecast is computed; the tray is level."""
    cell = settings.cell
    times = {name: getattr(cell, name) for name in ('robot', 'vibrate', 'settle', 'image')}
    values: dict[str, Any] = {k: v for k, v in times.items() if v is not None}
    values['clearance'] = cell.clearance
    if cell.parts_on_tray is not None:
        values['parts_on_tray'] = cell.parts_on_tray
    classes = sorted(settings.pickable)
    surface = _Surface(settings.conditions)
    words = [
        '--pickable-classes',
        ','.join(map(str, classes)),
        *_flags({**values, 'seed': settings.seed, 'action': cell.action}),
        '--tray',
        f'{cell.width!r}mx{cell.depth!r}m',
        *surface.contact_flags,
    ]
    named = {
        'pickable_classes': classes,
        **values,
        'tray': (cell.width, cell.depth),
        'action': cell.action,
        'seed': settings.seed,
        **surface.values,
    }
    return _recipe('forecast', source, words, '', named)


def track_on(part: Part, rail: Rail) -> dict[str, Any]:
    """Return the track of the tab Track, as `ra.track` and `ra.design_track` accept it."""
    changes = _rail_changes(rail)
    wall = {'friction': changes.pop('wall_friction')} if 'wall_friction' in changes else {}
    track = default_track(part).document
    traps = [trap.document for trap in rail.traps or ()]
    return {**track, **changes, 'wall': {**track['wall'], **wall}, 'traps': traps}


def track_recipe(opened: Opened, settings: Settings) -> Recipe:
    """Return how the result of the tab Track is made; drops are on a level plane."""
    rail, surface = settings.rail, _Surface(settings.conditions)
    values = {'drops': settings.drops, 'tolerance': rail.tolerance, 'seed': settings.seed}
    traps = [] if rail.traps else ['--design']
    for each in rail.traps or ():
        numbers = ','.join(f'{name}={getattr(each, name)!r}' for name in quantities_of(each))
        traps += ['--trap', f'{each.kind}:{numbers}']
    words = [
        *traps,
        *_flags({'want': rail.want, **_rail_changes(rail), **values}),
        *surface.flags,
    ]
    first = f'{track_on(opened.part, rail)!r}, want={rail.want}'
    named = {**values, **surface.values}
    function = 'track' if rail.traps else 'design_track'
    first = first if rail.traps else f'on={first}'
    return _recipe('track', opened.source, words, first, named, function=function)


def _rail_changes(rail: Rail) -> dict[str, Any]:
    """Return the values of the track that differ from the defaults."""
    default = Rail()
    return {
        name: getattr(rail, name)
        for name in ('width', 'roll', 'wall_friction', 'speed', 'fill')
        if getattr(rail, name) != getattr(default, name)
    }


def outlines_recipe(source: Source) -> Recipe:
    """Return how the outlines are found."""
    return _recipe('outlines', source, [], '', {})


def reorient_options(settings: Settings) -> dict[str, Any]:
    """Return the options of `reorient` that the settings request."""
    return {
        'per_aspect': DEFAULT_PER_ASPECT,
        'surface': settings.conditions,
        'drops': DEFAULT_DROPS,
        'seed': settings.seed,
    }


class _Surface:
    """The named surface of conditions, and the values that differ from it."""

    def __init__(self, conditions: DropConditions) -> None:
        known = shipped_surfaces()
        names = known.names()
        name = conditions.surface
        if name not in names:
            name = min(
                names,
                key=lambda each: (
                    len(_differences(known.get(each), conditions)),
                    each != DEFAULT_SURFACE,
                ),
            )
        self.name = name
        self.changes = _differences(known.get(name), conditions)

    @property
    def values(self) -> dict[str, Any]:
        """The arguments in Python."""
        return {'surface': self.name, **self.changes}

    @property
    def flags(self) -> list[str]:
        """The flags of the surface and of the changed values."""
        return ['--surface', self.name, *_flags(self.changes)]

    @property
    def contact_flags(self) -> list[str]:
        """The flags for a command without flags for the release.

        If a value of the release is changed, they name the surface in the file of the tab Export.
        """
        if any(QUANTITIES[name].at_release for name in self.changes):
            return ['--surfaces', SURFACES_FILE, '--surface', OWN_SURFACE]
        return self.flags


def _differences(known: DropConditions, conditions: DropConditions) -> dict[str, float]:
    return {
        name: getattr(conditions, name)
        for name in QUANTITIES
        if getattr(conditions, name) != getattr(known, name)
    }


def _recipe(
    verb: str,
    source: Source,
    words: Sequence[str],
    first: str,
    values: Mapping[str, Any],
    settings: Settings | None = None,
    function: str = '',
) -> Recipe:
    """Return the recipe of a public function, which usually has the name of its command.

    ``settings`` are given if their surroundings matter.
    """
    given = f'./{source.given}' if source.given.startswith('-') else source.given
    words = ['resting_aspects', verb, given, *_flags(file_values(source)), *words]
    arguments = ['part', *([first] if first else []), *([_arguments(values)] if values else [])]
    around = None if settings is None else settings.conditions.surroundings
    if around is not None and settings is not None:
        shipped = dimensions(named_surroundings(settings.surroundings))
        changes = {k: v for k, v in dimensions(around).items() if v != shipped[k]}
        words += ['--surroundings', settings.surroundings]
        for name, value in changes.items():
            words += ['--set', f'{name}={value!r}']
        inner = ''.join(f', {name}={value!r}' for name, value in changes.items())
        arguments.append(f'surroundings=ra.surroundings({settings.surroundings!r}{inner})')
    more = ''.join(f', {name}={value!r}' for name, value in file_values(source).items())
    python = (
        'import resting_aspects_ros as ra\n\n'
        f'part = ra.load_part({source.given!r}{more})\n'
        f'result = ra.{function or verb}({", ".join(arguments)})\n'
        'print(result.to_json())\n'
    )
    return Recipe(shlex.join(words), python)


def file_values(source: Source) -> dict[str, Any]:
    """Return the unit and the body of a file, if they were chosen."""
    values = {'unit': source.unit, 'body': source.body} if source.path else {}
    return {name: value for name, value in values.items() if value}


def _flags(values: Mapping[str, Any]) -> list[str]:
    words: list[str] = []
    for name, value in values.items():
        text = value if isinstance(value, str) else repr(value)
        words += [f'--{name.replace("_", "-")}', text]
    return words


def _arguments(values: Mapping[str, Any]) -> str:
    return ', '.join(f'{name}={value!r}' for name, value in values.items())


# -- Files ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class File:
    """A file that is made when it is downloaded, its media type, and what writes it."""

    name: str
    title: str
    media_type: str
    save: Callable[[Work, Path], object]

    def make(self, work: Work) -> bytes:
        """Return the content of the file."""
        with tempfile.TemporaryDirectory(dir=work.folder) as folder:
            path = Path(folder) / self.name
            self.save(work, path)
            return path.read_bytes()


def _table(work: Work) -> Table:
    drops = work.drops()
    return distribution_table(drops.distribution, drops.title, drops.part)


def _save_surfaces(work: Work, path: Path) -> None:
    conditions = work.settings.conditions
    source = f'Chosen in resting_aspects studio: {surface_text(conditions)}. Not measured.'
    _save_text(path, surface_entry(OWN_SURFACE, conditions, source))


def _save_drawings(work: Work, path: Path) -> None:
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for drawing in outlines(work.opened.part).save(path.parent / 'outlines'):
            archive.write(drawing, drawing.name)


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding='utf-8')


_XLSX = 'application/vnd.openxmlformats-officedocument.spreadsheetml.sheet'
FILES = {
    file.name: file
    for file in (
        File(
            'report.html',
            'the report, one page that needs no network',
            'text/html',
            lambda work, path: _save_text(path, work.drops().page().html()),
        ),
        File(
            'distribution.json',
            'all numbers as JSON',
            'application/json',
            lambda work, path: work.drops().save_json(path),
        ),
        File(
            'aspects.csv',
            'the table of the aspects as CSV',
            'text/csv',
            lambda work, path: save_csv(_table(work), path),
        ),
        File(
            'aspects.xlsx',
            'the same as a workbook',
            _XLSX,
            lambda work, path: save_xlsx([_table(work)], path),
        ),
        File(
            'distribution.png',
            'the bars as a picture',
            'image/png',
            lambda work, path: work.drops().save_picture(path),
        ),
        File(
            SURFACES_FILE, 'the conditions as a surfaces file', 'application/yaml', _save_surfaces
        ),
        File(
            'counting_sheet.pdf',
            'a sheet for counting by hand, A4',
            'application/pdf',
            lambda work, path: outlines(work.opened.part).save_counting_sheet(path),
        ),
        File(
            'outlines.zip',
            'outlines as SVG and DXF at true size, templates and masks',
            'application/zip',
            _save_drawings,
        ),
        File(
            'counts.csv',
            'the counts by hand as CSV',
            'text/csv',
            lambda work, path: _save_text(path, counts_csv(work.settings)),
        ),
    )
}
