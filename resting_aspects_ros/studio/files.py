"""The files that the page offers, each made when it is downloaded, by the public functions."""

import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.api.conditions import surface_entry, surface_text
from resting_aspects_ros.api.drop import drop
from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.api.result import poses_file
from resting_aspects_ros.report.drops import distribution_table
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.report.table_files import save_csv, save_xlsx
from resting_aspects_ros.studio.recipe import OWN_SURFACE, SURFACES_FILE
from resting_aspects_ros.studio.settings import counts_csv
from resting_aspects_ros.studio.work import Work, drop_options


@dataclass(frozen=True)
class File:
    """A file: what it is, its media type, and what makes it."""

    title: str
    media_type: str
    make: Callable[[Work], bytes]


def _report(work: Work) -> bytes:
    return work.drops().page().html().encode()


def _document(work: Work) -> bytes:
    return work.drops().to_json().encode()


def _table(work: Work) -> Table:
    drops = work.drops()
    return distribution_table(drops.distribution, drops.title, drops.part)


def _csv(work: Work) -> bytes:
    path = work.folder / 'aspects.csv'
    save_csv(_table(work), path)
    return path.read_bytes()


def _workbook(work: Work) -> bytes:
    path = work.folder / 'aspects.xlsx'
    save_xlsx([_table(work)], path)
    return path.read_bytes()


def _poses(work: Work) -> bytes:
    path = work.folder / 'poses.csv'
    with poses_file('poses', path) as write:
        options = {**drop_options(work.settings), 'workers': work.workers}
        drop(work.opened.part, keep_poses=False, consumers=[write], **options)
    return path.read_bytes()


def _picture(work: Work) -> bytes:
    path = work.folder / 'distribution.png'
    work.drops().save_picture(path)
    return path.read_bytes()


def _surfaces(work: Work) -> bytes:
    conditions = work.settings.conditions
    source = f'Chosen in resting_aspects studio: {surface_text(conditions)}. Not measured.'
    return surface_entry(OWN_SURFACE, conditions, source).encode()


def _sheet(work: Work) -> bytes:
    path = work.folder / 'counting_sheet.pdf'
    outlines(work.opened.part).save_counting_sheet(path)
    return path.read_bytes()


def _drawings(work: Work) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, 'w', zipfile.ZIP_DEFLATED) as archive:
        for path in outlines(work.opened.part).save(Path(work.folder) / 'outlines'):
            archive.write(path, path.name)
    return data.getvalue()


def _counts(work: Work) -> bytes:
    return counts_csv(work.settings).encode()


FILES = {
    'report.html': File('the report, one page that needs no network', 'text/html', _report),
    'distribution.json': File('all numbers as JSON', 'application/json', _document),
    'aspects.csv': File('the table of the aspects as CSV', 'text/csv', _csv),
    'aspects.xlsx': File(
        'the same as a workbook',
        'application/vnd.openxmlformats-officedocument.spreadsheetml.sheet',
        _workbook,
    ),
    'poses.csv': File('the resting pose of each drop as CSV', 'text/csv', _poses),
    'distribution.png': File('the bars as a picture', 'image/png', _picture),
    SURFACES_FILE: File('the conditions as a surfaces file', 'application/yaml', _surfaces),
    'counting_sheet.pdf': File('a sheet for counting by hand, A4', 'application/pdf', _sheet),
    'outlines.zip': File(
        'outlines as SVG and DXF at true size, templates and masks', 'application/zip', _drawings
    ),
    'counts.csv': File('the counts by hand as CSV', 'text/csv', _counts),
}
