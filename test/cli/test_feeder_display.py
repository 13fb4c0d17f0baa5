"""The live table and the sentences of the feeder demo."""

import io

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.cli.feeder_display import (
    FeederView,
    feeder_line,
    feeder_sentence,
    feeder_table,
)
from resting_aspects_ros.report.scene_picture import DrawnPart, save_tray_picture
from resting_aspects_ros.vision.tray_image import OutlinePlaces, TrayCamera, render_tray


def view(**changed):
    fields = {
        'minutes': 10.05,
        'total': 10.0,
        'on_tray': 12,
        'picks': 270,
        'missed': 0,
        'images': 150,
        'flips': 149,
        'supplied': 282,
        'reason': 'Pick 2 parts; a flip is expected to bring 1.4 more picks.',
        'rate': 26.87,
        'forecast': 26.0,
        'lower': 24.0,
        'upper': 28.0,
    }
    return FeederView(**{**fields, **changed})


def test_table_shows_the_run_beside_its_forecast():
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(feeder_table(view(missed=3)))
    text = console.export_text()
    for words in ('10:03 of 10 min', '270 (3 missed)', '26.9', '26.0 (24.0 to 28.0)', 'Pick 2'):
        assert words in text
    assert max(map(len, text.splitlines())) <= 80
    assert '270 picks, 26.9 per minute (forecast 26.0' in feeder_line(view())


@pytest.mark.parametrize(
    ('changed', 'end'),
    [
        ({}, 'this run lies within that interval.'),
        ({'rate': 28.4}, 'this run lies outside that interval.'),
        ({'minutes': 2.0}, 'this run was shorter.'),
    ],
)
def test_sentence_compares_the_run_with_the_interval(changed, end):
    text = feeder_sentence(view(**changed), 61.3)
    assert text.splitlines()[0].endswith(end)
    assert 'which took 61 s' in text


def test_picture_shows_outlines_and_is_small(part, tmp_path):
    known, generator = known_part(part('l_bracket')), np.random.default_rng(1)
    camera = TrayCamera((0.2, 0.2), 5.0)
    places = OutlinePlaces(known.outlines, (0.2, 0.2), generator)
    places.shake(np.arange(5))
    image = render_tray(places.polygons, camera, generator, blur=0.7, noise=4.0)
    parts = [
        DrawnPart(k + 1, *pose, rank=int(k == 0)) for k, pose in enumerate(places.poses.tolist())
    ]
    parts.append(DrawnPart(0, 0.0, 0.0, 0.0))
    path = tmp_path / 'tray.png'
    save_tray_picture(path, image, camera, parts, known.outlines, 'Pick', 'Because.', [1])
    with Image.open(path) as picture:
        assert picture.width == pytest.approx(806, abs=2)
        colours = {c for _, c in picture.convert('RGB').getcolors(1 << 24)}
    assert {(0, 0x72, 0xB2), (0xE6, 0x9F, 0)} <= colours  # classes 1 and 2
    assert path.stat().st_size < 150_000
