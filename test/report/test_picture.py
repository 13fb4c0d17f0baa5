"""The picture shows the distribution, and the part as it lies."""

import io
import itertools

import numpy as np
import pytest
import trimesh
from PIL import Image

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.drop_figures import MAX_SHOWN, _rows, distribution_figure
from resting_aspects_ros.report.figure import png_bytes
from resting_aspects_ros.report.format import COLOURS, GREY, class_rows, interval_text
from resting_aspects_ros.report.picture import FROM_ABOVE, OBLIQUE, draw_parts, pose_parts
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.statistics.model_range import with_model_range

PIXELS = 160
BLUE = (0.0, 0.45, 0.7)


def rgb(colour):
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


@pytest.fixture(scope='module')
def bracket(part):
    return part('l_bracket')


@pytest.fixture(scope='module')
def distribution(bracket):
    return Distribution(find_aspects(bracket), np.array([400, 200, 150, 100, 0]), 120, 30, 0)


def test_picture_has_both_widths_and_says_what_they_cover(distribution, texts):
    ranged = with_model_range(distribution)
    figure = distribution_figure(ranged, None, 'title', 'Model range: all of it.')
    words = texts(figure)
    assert 'Model range: all of it.' in words
    bars = figure.axes[1].patches
    ends = {(round(b.get_x(), 6), round(b.get_x() + b.get_width(), 6)) for b in bars}
    lengths = {round(b.get_width(), 6) for b in bars}
    for row in class_rows(ranged):
        assert round(row.interval.probability, 6) in lengths
        shown = f'{interval_text(row.interval)}\nmodel range {interval_text(row.model)}'
        assert shown in words
        assert (round(row.model.lower, 6), round(row.model.upper, 6)) in ends


@pytest.mark.filterwarnings('error')
def test_picture_without_drops_or_aspects(distribution, bracket):
    for aspects in (distribution.aspects, AspectSet(bracket.part_sha256, ())):
        data = png_bytes(distribution_figure(no_drops(aspects), bracket, 'none'))
        with Image.open(io.BytesIO(data)) as image:
            assert image.width == 1240


def test_most_probable_classes_are_shown_and_others_summed(many_sided):
    aspects = find_aspects(many_sided)
    counts = np.arange(len(aspects))[::-1] % 50
    rows = _rows(Distribution(aspects, counts, 0, 7, 0))
    shown = [row.aspects[0].id for row in rows if row.aspects]
    assert shown == sorted(shown)
    assert len(shown) == MAX_SHOWN
    others = np.delete(counts, np.array(shown) - 1)
    assert counts[np.array(shown) - 1].min() >= others.max()
    assert [row.name for row in rows[MAX_SHOWN:]] == [
        f'{len(aspects) - MAX_SHOWN} other aspects',
        'unsettled',
    ]
    assert rows[MAX_SHOWN].interval.probability == pytest.approx(
        others.sum() / (counts.sum() + 7), rel=1e-12
    )


def test_colours_are_distinguishable_for_colour_blind_viewers():
    assert len(set(COLOURS)) == len(COLOURS)
    # Machado, Oliveira and Fernandes 2009, severity 1: no red, no green.
    sights = [
        np.eye(3),
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
    ]
    colours = np.array([rgb(colour) for colour in (*COLOURS, GREY)]) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    for sight in sights:
        lab = cielab(np.clip(linear @ np.transpose(sight), 0, 1))
        assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(lab, 2)) > 10


def cielab(linear):
    xyz = (
        linear
        @ np.array([[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]])
        / [0.9505, 1.0, 1.089]
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    x, y, z = f.T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def silhouette(image):
    return image[..., 3] > 0.95


@pytest.mark.parametrize('view', [OBLIQUE, FROM_ABOVE], ids=['oblique', 'above'])
def test_parts_have_the_sizes_of_their_projections(bracket, view):
    """One scale for all: extents in pixels are in the ratio of extents in metres."""
    solids = pose_parts(bracket, find_aspects(bracket).aspects)
    images = draw_parts(solids, [BLUE] * len(solids), PIXELS, view)
    scale = extent(images[0])[0] / np.ptp(solids[0].points @ view[0])
    for image, solid in zip(images, solids, strict=True):
        expected = np.ptp(solid.points @ view[:2].T, axis=0) * scale
        assert extent(image) == pytest.approx(expected, abs=3)


def extent(image):
    """Width and height of the part, pixels."""
    rows, columns = np.nonzero(silhouette(image))
    return np.array([np.ptp(columns), np.ptp(rows)]) + 1.0


def test_inside_of_an_open_mesh_is_visible(solid):
    box = trimesh.creation.box([20, 30, 40])
    whole = solid(box)
    given = {
        'mass': whole.mass,
        'centre_of_mass': [0, 0, 0],
        'inertia': whole.inertia[np.triu_indices(3)],
    }
    box.update_faces(box.face_normals[:, 2] < 0.5)
    lidless = solid(box, **given)
    assert np.isnan(lidless.volume)
    aspects = find_aspects(whole).aspects
    for a, b in zip(
        draw_parts(pose_parts(whole, aspects), [BLUE] * 6, PIXELS),
        draw_parts(pose_parts(lidless, aspects), [BLUE] * 6, PIXELS),
        strict=True,
    ):
        # One looks through the opening at the inner sides of the walls, which fill the outline.
        assert extent(a) == pytest.approx(extent(b), abs=1)
        assert (silhouette(a) ^ silhouette(b)).sum() < 0.01 * silhouette(a).sum()
