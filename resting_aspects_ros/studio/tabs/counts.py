"""Parts that were counted by hand, against the simulation."""

from typing import Any

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.api.counts import counted_by_class
from resting_aspects_ros.report.drop_page import comparison_items
from resting_aspects_ros.report.format import class_rows
from resting_aspects_ros.report.page import Item, Text, items_html
from resting_aspects_ros.studies.calibration.calibrate import calibrate
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings, counts_csv
from resting_aspects_ros.studio.work import Work, controls_html

NOTHING_COUNTED = (
    'Drop some parts on your own surface, count how many lie in each class, and enter the '
    'numbers. The verdict appears here; the counting sheet is in the tab Outlines.'
)
SURFACE = 'hand_counts'


def controls(settings: Settings, opened: Opened) -> str:
    """Return a picture and a number field for each class."""
    del settings
    fields = zip(opened.names, opened.pictures, strict=True)
    return controls_html('counts', fields=list(enumerate(fields, start=1)), names=('counts.csv',))


def show(work: Work) -> None:
    """Compare the counts with the drops, and fit the surface if that is requested."""
    work.publish('same', {'text': ''})
    if not any(work.settings.counts.values()):
        work.show('counts', [Text(NOTHING_COUNTED, 'plain')])
        return
    path = work.folder / 'counts.csv'
    path.write_text(counts_csv(work.settings), encoding='utf-8')
    work.publish('same', {'text': 'resting_aspects compare distribution.json counts.csv'})
    result = work.drops()
    if work.stopped():
        return
    found = compare(result, counted_by_class(read_counts(path)))
    items: list[Item] = list(
        comparison_items(class_rows(result.distribution), found.comparison, found.sides)
    )
    html = items_html(items)
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
        part |= {'mesh': str(source.path), 'unit': work.opened.part.unit}
    for number in range(1, work.settings.classes + 1):
        part['counts'].setdefault(str(number), 0)
    counts = {
        'surface': SURFACE,
        'conditions': {'height': f'{conditions.height!r} m'},
        'parts': [part],
    }
    key = ('calibrate', work.opened.part.part_sha256, repr(counts))
    return work.keep(key, lambda: calibrate(counts, **work.options('drops')))
