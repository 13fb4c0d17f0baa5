"""The live table and the sentences of the feeder demo, and its picture."""

import numpy as np
import pytest
from PIL import Image

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.report.scene_picture import DrawnPart, save_tray_picture
from resting_aspects_ros.vision.tray_image import OutlinePlaces, TrayCamera, render_tray


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
