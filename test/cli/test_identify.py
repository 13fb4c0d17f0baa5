"""The command `identify` with the position of the camera."""

import json

import numpy as np
import pytest
import shapely


@pytest.mark.slow
def test_position_of_the_camera_gives_the_place_of_a_high_part(run, tmp_path):
    # A box 30 mm high, 20 x 10 mm, at (0.1, 0.05) m, seen from the height 0.5 m above the origin.
    base = np.array([[0.09, 0.045], [0.11, 0.045], [0.11, 0.055], [0.09, 0.055]])
    seen = shapely.MultiPoint(np.vstack([base, base * 0.5 / 0.47])).convex_hull
    outline = {'outer': np.asarray(seen.exterior.coords).tolist()}
    (tmp_path / 'seen.json').write_text(json.dumps(outline))
    words = ('identify', 'box_10x20x30', '--polygon', 'seen.json')
    ended = run(*words, '--camera', '0mm,0mm,0.5m', '--json')
    found = json.loads(ended.stdout)['candidates'][0]
    assert found['symmetry_class'] == 3
    assert (found['x'], found['y'], found['posterior']) == pytest.approx((0.1, 0.05, 1), abs=1e-3)
    assert '--camera' in run(*words).stdout
    # The camera would be inside the box.
    ended = run(*words, '--camera', '0mm,0mm,20mm')
    assert ended.returncode == 2
    assert all(word in ended.stderr for word in ('0.02 m', '0.03 m', 'box_10x20x30'))
