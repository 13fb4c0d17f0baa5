"""Outlines of the Python interface: what is found, and which files are written."""

import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.errors import OutputError


@pytest.fixture(scope='module')
def box(crate):
    return ra.outlines(crate)


def test_folder_is_made_and_files_are_complete(box, tmp_path):
    folder = tmp_path / 'a' / 'b'
    written = box.save(folder)
    endings = ('.svg', '.dxf', '_mask.png', '_template.png')
    drawings = {f'class_{k}{end}' for k in (1, 2, 3) for end in endings}
    assert {path.name for path in written} == {'outlines.json', 'coco.json', *drawings}
    assert set(folder.iterdir()) == set(written)
    assert (folder / 'outlines.json').read_text() == box.to_json()


@pytest.mark.parametrize('scale', [float('nan'), 1e9, 1e-9])
def test_scale_out_of_bounds_is_refused(box, tmp_path, scale):
    with pytest.raises(ra.InvalidValueError, match=r'invalid px_per_mm .*: expected 0\.05 to 136'):
        box.save(tmp_path / 'out', scale)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_sheet_is_a_pdf_or_svg_file(box, tmp_path):
    box.save_counting_sheet(tmp_path / 'sheet.PDF')
    assert (tmp_path / 'sheet.PDF').read_bytes().startswith(b'%PDF-')
    with pytest.raises(ra.InvalidValueError, match=r"sheet\.png'.*: expected .*\.pdf or \.svg"):
        box.save_counting_sheet(tmp_path / 'sheet.png')
    with pytest.raises(OutputError, match='cannot be written'):
        box.save_counting_sheet(tmp_path / 'none' / 'sheet.pdf')


def test_document_has_rings_of_the_area_with_clockwise_holes():
    found = ra.outlines('washer')
    document = json.loads(found.to_json())
    assert document['part_sha256'] == found.part.part_sha256
    for fields, outline in zip(document['outlines'], found.outlines, strict=True):
        rings = [np.array(ring) for ring in (fields['outer'], *fields['holes'])]
        assert all((ring[0] != ring[-1]).any() for ring in rings)
        outer, *holes = map(shoelace, rings)
        assert outer > 0
        assert all(hole < 0 for hole in holes)
        assert outer + sum(holes) == pytest.approx(outline.area, rel=1e-12)
        assert fields['orientation'] == pytest.approx(outline.orientation.tolist(), abs=0)


def shoelace(ring):
    """Signed area of a ring: positive if it is counter-clockwise."""
    x, y = ring.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)
