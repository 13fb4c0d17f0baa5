"""The live table, the sentences and the picture of the feeder demo."""

import io
from types import SimpleNamespace

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

COUNTED = {'minutes': 10.05, 'on_tray': 12, 'picks': 270, 'missed': 3, 'images': 150}
COUNTED |= {'choices': {'flip': 149}, 'rate': 26.87, 'advice': SimpleNamespace(reason='Pick 2')}
FORECAST = SimpleNamespace(rate=26.0, prediction=(24.0, 28.0))


def view(**changed):
    return FeederView(SimpleNamespace(**{**COUNTED, **changed}), FORECAST, 10.0)


def test_table_shows_the_run_beside_its_forecast():
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(feeder_table(view()))
    text = console.export_text()
    for words in ('10:03 of 10 min', '270 (3 missed)', '26.9', '26.0 (24.0 to 28.0)', 'Pick 2'):
        assert words in text
    assert max(map(len, text.splitlines())) <= 80
    assert '270 picks, 26.9 per minute (forecast 26.0' in feeder_line(view())


@pytest.mark.parametrize(
    ('changed', 'said'),
    [({}, 'within'), ({'rate': 28.4}, 'outside'), ({'minutes': 2.0}, 'shorter')],
)
def test_sentence_compares_the_run_with_the_interval(changed, said):
    text = feeder_sentence(view(**changed), 61.3)
    assert said in text.splitlines()[0].rpartition(';')[2]
    assert '61 s' in text


@pytest.mark.slow
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
