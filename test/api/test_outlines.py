"""Outlines of the Python interface: what is found, and which files are written."""

import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.errors import OutputError

ENDINGS = ('.svg', '.dxf', '_mask.png', '_template.png')
FILES = {
    'outlines.json',
    'coco.json',
    *(f'class_{k}{end}' for k in (1, 2, 3) for end in ENDINGS),
}


@pytest.fixture(scope='module')
def box():
    return ra.outlines('box_10x20x30')


def test_box_outlines_are_its_sides(box):
    sizes = [(each.length, each.width, each.height) for each in box.outlines]
    expected = [(30e-3, 20e-3, 10e-3), (30e-3, 10e-3, 20e-3), (20e-3, 10e-3, 30e-3)]
    np.testing.assert_allclose(sizes, expected, rtol=1e-6)
    assert [each.aspects for each in box.outlines] == [(1, 2), (3, 4), (5, 6)]
    assert len(box.aspects) == 6
    assert box.part.name == 'box_10x20x30'


def test_folder_is_made_and_files_are_complete(box, tmp_path):
    written = box.save(tmp_path / 'a' / 'b')
    assert {path.name for path in written} == FILES
    assert {path.name for path in (tmp_path / 'a' / 'b').iterdir()} == FILES
    assert (tmp_path / 'a' / 'b' / 'outlines.json').read_text() == box.to_json()


@pytest.mark.parametrize('scale', [0, -1, float('nan'), float('inf'), 1e9, 1e-9])
def test_scale_out_of_bounds_is_refused(box, tmp_path, scale):
    with pytest.raises(ra.InvalidValueError, match=r'invalid px_per_mm .*: expected 0\.05 to 136'):
        box.save(tmp_path / 'out', scale)
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_a_file_is_refused(box, tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(ra.InvalidValueError, match='expected a folder'):
        box.save(tmp_path / 'file')


@pytest.mark.slow
def test_sheet_is_a_pdf_or_svg_file(box, tmp_path):
    box.save_counting_sheet(str(tmp_path / 'sheet.PDF'))
    assert (tmp_path / 'sheet.PDF').read_bytes().startswith(b'%PDF-')
    with pytest.raises(ra.InvalidValueError, match=r"sheet\.png'.*: expected .*\.pdf or \.svg"):
        box.save_counting_sheet(tmp_path / 'sheet.png')
    with pytest.raises(OutputError, match='cannot be written'):
        box.save_counting_sheet(tmp_path / 'none' / 'sheet.pdf')


def test_document_holds_what_the_outlines_are(box):
    document = json.loads(box.to_json())
    assert document['part_sha256'] == box.part.part_sha256
    for fields, outline in zip(document['outlines'], box.outlines, strict=True):
        ring = np.array(fields['outer'])
        assert ring.shape[1] == 2
        assert (ring[0] != ring[-1]).any()
        assert shoelace(ring) == pytest.approx(outline.area, rel=1e-12)
        assert fields['orientation'] == pytest.approx(outline.orientation.tolist(), abs=0)


def shoelace(ring):
    """Signed area of a ring: positive if it is counter-clockwise."""
    x, y = np.asarray(ring).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@pytest.mark.slow
def test_holes_are_clockwise():
    document = json.loads(ra.outlines('washer').to_json())
    flat = max(document['outlines'], key=lambda each: each['area'])
    assert flat['yaw_symmetry'] == 0
    (hole,) = flat['holes']
    outer, inner = shoelace(flat['outer']), shoelace(hole)
    assert outer > 0 > inner
    assert outer + inner == pytest.approx(flat['area'], rel=1e-12)
