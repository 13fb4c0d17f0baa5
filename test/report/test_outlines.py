"""Files of outlines, read by other programs: areas, places and sizes are those of the outline."""

import io
import xml.etree.ElementTree as ET

import ezdxf
import numpy as np
import pytest
from PIL import Image
from shapely import Polygon, intersects_xy

from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.report.outlines import (
    coco_document,
    confused_class_texts,
    described_image,
    dxf_drawing,
    outline_image,
    png_file,
    svg_drawing,
)
from resting_aspects_ros.report.sheet import _pages, drawing_scale
from resting_aspects_ros.vision.outline import covered_share

SCALE = 10.0  # px/mm
SVG = '{http://www.w3.org/2000/svg}'


@pytest.fixture(scope='module', params=['l_bracket', 'washer'])
def result(request, part):
    return outlines(part(request.param))


def area(corners):
    """Area of a ring without a sign."""
    x, y = np.asarray(corners, dtype=float).T
    return abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2


def test_dxf_has_the_areas_of_the_outline_in_mm(result):
    for outline in result.outlines:
        drawing = ezdxf.read(io.StringIO(dxf_drawing(outline.polygon)))
        assert drawing.header['$INSUNITS'] == 4  # mm
        assert drawing.audit().errors == []
        lines = list(drawing.modelspace())
        assert {line.dxftype() for line in lines} == {'LWPOLYLINE'}
        assert all(line.closed for line in lines)
        rings = {'outer': [], 'holes': []}
        for line in lines:
            rings[line.dxf.layer].append(list(line.vertices()))
        (outer,) = rings['outer']
        assert len(rings['holes']) == len(outline.polygon.interiors)
        holes = sum(map(area, rings['holes']))
        assert area(outer) - holes == pytest.approx(1e6 * outline.area, rel=1e-9)
        corner = 1e3 * np.array(outline.polygon.bounds[:2])
        assert np.min(outer, axis=0) == pytest.approx(corner, abs=1e-6)


def test_svg_is_at_true_size_with_y_down(result):
    for outline in result.outlines:
        root = ET.fromstring(svg_drawing(outline.polygon, 'a <part> & more'))
        assert root.find(f'{SVG}title').text == 'a <part> & more'
        left, top, width, height = map(float, root.get('viewBox').split())
        assert (root.get('width'), root.get('height')) == (f'{width:.12g}mm', f'{height:.12g}mm')
        (path,) = root.findall(f'{SVG}path')
        outer, *holes = (
            np.array(ring.replace('Z', '').replace('L', '').split(), dtype=float).reshape(-1, 2)
            for ring in path.get('d').split('M')[1:]
        )
        assert area(outer) - sum(map(area, holes)) == pytest.approx(1e6 * outline.area, rel=1e-6)
        expected = 1e3 * np.asarray(outline.polygon.exterior.coords)[:-1] * [1, -1]
        np.testing.assert_allclose(outer, expected, atol=1e-8)
        assert (outer > [left, top]).all()
        assert (outer < [left + width, top + height]).all()


def read(data):
    with Image.open(io.BytesIO(data)) as image:
        assert (image.format, image.mode) == ('PNG', 'L')
        return np.asarray(image).astype(int)


def test_images_have_the_area_of_the_outline_and_its_place(result):
    for outline in result.outlines:
        image = outline_image(outline, SCALE)
        expected = outline.area * (1e3 * SCALE) ** 2
        border = outline.polygon.length * 1e3 * SCALE
        mask, template = (read(png_file(each)) for each in (image.mask, image.template))
        assert set(np.unique(mask)) == {0, 255}
        assert abs((mask > 0).sum() - expected) < 0.1 * border
        assert (255 - template).sum() / 255 == pytest.approx(expected, abs=0.02 * border)
        for share in (0, 1):
            rows, columns = np.nonzero(image.covered == share)
            x = (columns + 0.5 - image.origin[0]) / image.scale
            y = (image.origin[1] - rows - 0.5) / image.scale
            assert (intersects_xy(outline.polygon, x, y) == share).all()


def test_coco_segmentations_have_the_stated_area(result):
    images = [outline_image(outline, SCALE) for outline in result.outlines]
    document = coco_document(result.part, [described_image(image) for image in images])
    for outline, image, entry, note in zip(
        result.outlines, images, document['images'], document['annotations'], strict=True
    ):
        assert entry['id'] == note['id'] == outline.symmetry_class
        assert (entry['height'], entry['width']) == image.mask.shape
        shape = note['segmentation']
        if outline.polygon.interiors:
            np.testing.assert_array_equal(decoded(shape), image.mask > 0)
            assert note['area'] == decoded(shape).sum()
        else:
            (ring,) = shape
            corners = np.reshape(ring, (-1, 2))
            assert note['area'] == pytest.approx(area(corners), rel=1e-9)
            assert note['bbox'] == pytest.approx([*corners.min(axis=0), *np.ptp(corners, axis=0)])


def decoded(rle):
    """The mask of a COCO run-length encoding: columns one after the other, zeros first."""
    height, width = rle['size']
    values = np.arange(len(rle['counts'])) % 2
    return np.repeat(values, rle['counts']).reshape(width, height).T


def test_covered_share_of_a_box_is_exact():
    share = covered_share(Polygon([(1.25, 1), (3, 1), (3, 2.5), (1.25, 2.5)]), 5, 4)
    expected = np.zeros((4, 5))
    expected[1, 1:3] = 0.75, 1
    expected[2, 1:3] = 0.375, 0.5
    np.testing.assert_allclose(share, expected, atol=1e-12)


def test_what_distinguishes_classes_is_said(part):
    found = outlines(part('u_bracket'))
    first, *_ = confused_class_texts(found.outlines, found.look_alikes)
    assert first.startswith('Classes 1 and 4 have the same outline.')


@pytest.mark.parametrize('count', [0, 5, 6, 40])
def test_every_class_is_on_one_page_of_the_sheet(count):
    pages = list(_pages(list(range(count))))
    assert [row for page in pages for row in page] == list(range(count))
    assert all(1 <= len(page) <= 5 for page in pages) or count == 0
    assert len(pages) == max(-(-count // 5), 1)


@pytest.mark.parametrize(
    ('side', 'scale'), [(36, 1), (9, 1), (8.9, 2), (72.1, 0.2), (0.035, 1000)]
)
def test_drawings_fit_at_a_simple_scale(side, scale):
    assert drawing_scale(side) == pytest.approx(scale)
    assert drawing_scale(side) * side <= 36
