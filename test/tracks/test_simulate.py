"""Parts that run over traps in Bullet: what is certain by mechanics, and the counts of a track."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.orientations import orientations_on
from resting_aspects_ros.tracks.rate import pass_traps
from resting_aspects_ros.tracks.simulate import (
    OUTCOMES,
    TrackRuns,
    measured_band,
    run_over,
    run_track,
)
from resting_aspects_ros.tracks.traps import (
    AirJet,
    Balcony,
    Canyon,
    Gap,
    Groove,
    HoldDown,
    Projection,
    Rail,
    Riser,
    Wiper,
)

CONDITIONS = shipped_surfaces().get()


@pytest.fixture(scope='module')
def box():
    """A box of 30 x 20 x 10 mm and its rows: flat, and standing on its smallest side."""
    mesh = trimesh.creation.box((30, 20, 10))
    part = part_from_bytes(mesh.export(file_type='stl'), 'stl', 'box')
    aspects = find_aspects(part)
    rows = orientations_on(part, aspects, [1 / len(aspects)] * len(aspects))
    flat = next(row for row in rows if row.height < 0.011 and row.length > 0.029)
    tall = next(row for row in rows if row.height > 0.029)
    return part, rows, flat, tall


def on(speed=0.2, **values):
    return read_track({'width': 0.04, 'roll': '5deg', 'speed': speed, **values})


def most(box, trap, track=None, row=None, parts=4):
    """What becomes of most parts of the flat row."""
    part, _, flat, _ = box
    counts = run_over(part, row or flat, trap, track or on(), CONDITIONS, parts, (1,))
    assert counts.sum() == parts
    return OUTCOMES[int(counts.argmax())]


def test_a_short_gap_is_bridged_and_a_gap_longer_than_the_part_is_not(box):
    assert most(box, Gap(0.01)) == 'pass'
    assert most(box, Gap(0.035)) == 'reject'


def test_a_fast_part_flies_over_a_gap_that_a_slow_one_falls_into(box):
    values = {'friction': 0.0, 'roll': 0.0, 'wall': {'friction': 0.0}}
    assert most(box, Gap(0.017), on(0.4, **values)) == 'pass'
    assert most(box, Gap(0.017), on(0.1, **values)) == 'reject'


def test_a_narrow_track_lets_fall_what_has_its_centre_beyond_the_edge(box):
    assert most(box, Balcony(0.013)) == 'pass'
    assert most(box, Balcony(0.007)) == 'reject'
    assert most(box, Canyon(0.003, 0.039)) == 'reject'


def test_a_blade_lets_pass_what_is_lower_and_pushes_off_what_is_higher(box):
    _, _, _, tall = box
    assert most(box, Wiper(0.012)) == 'pass'
    assert most(box, Wiper(0.015), row=tall) in ('reject', 'turn')


def test_a_cover_holds_what_is_higher(box):
    assert most(box, HoldDown(0.012)) == 'pass'
    assert most(box, HoldDown(0.006)) == 'jam'


def test_a_projection_pushes_parts_over_the_edge(box):
    narrow = on(width=0.015)
    assert most(box, Projection(0.002), narrow) == 'pass'
    assert most(box, Projection(0.009), narrow) == 'reject'
    # Above the part it has no effect.
    assert most(box, Projection(0.009, 0.02, 0.03), narrow) == 'pass'


def test_parts_drop_into_a_groove_that_is_wider_than_they_are(box):
    assert most(box, Groove(0.002, 0.030, 0.006)) == 'turn'
    assert most(box, Groove(0.005, 0.015, 0.006)) == 'pass'


def test_parts_fall_between_rails_that_are_farther_apart_than_the_part(box):
    assert most(box, Rail(0.001, 0.039)) == 'reject'


def test_a_riser_lifts_what_reaches_it(box):
    assert most(box, Riser(0.025, 0.006)) == 'pass'
    assert most(box, Riser(0.012, 0.006)) != 'pass'


def test_more_parts_repeat_the_first_ones(box):
    part, _, flat, _ = box
    found = [
        run_over(part, flat, Gap(0.0162), on(0.1), CONDITIONS, count, (1,)) for count in (2, 3, 6)
    ]
    for fewer, more in pairwise(found):
        assert (more >= fewer).all()


def test_parts_of_a_trap_are_those_that_passed_the_one_before(box):
    part, rows, flat, _ = box
    traps = [
        {'kind': 'wiper', 'height': '12mm'},
        {'kind': 'air_jet', 'height': '2mm', 'force': 100},
        {'kind': 'gap', 'length': '10mm'},
    ]
    passage = pass_traps(part, rows, on(traps=traps), (flat.id,))
    runs = run_track(passage, CONDITIONS, 3, seed=1)
    for row in range(len(rows)):
        assert runs.counts[0, row].sum() == 3
        for trap in (1, 2):
            assert runs.counts[trap, row].sum() == runs.counts[trap - 1, row, 0]
    assert runs.simulated == (True, False, True)
    assert isinstance(passage.track.traps[1], AirJet)
    k = rows.index(flat)
    assert runs.share(2, k) is None
    assert runs.agrees(2, k, 'pass') is None
    assert runs.agrees(1, k, 'reject') is None


def test_statics_agrees_only_with_an_interval_on_its_side():
    runs = TrackRuns(np.array([[[9, 0, 1, 0], [5, 0, 5, 0], [0, 0, 10, 0]]]), 10, (True,))
    assert [runs.agrees(0, k, 'pass') for k in range(3)] == [True, None, False]
    assert [runs.agrees(0, k, 'reject') for k in range(3)] == [False, None, True]
    assert runs.agrees(0, 0, 'unknown') is None
    assert [round(each.probability, 1) for each in runs.shares] == [0.9, 0.5, 0.0]


def test_the_grey_band_contains_the_critical_width(box):
    part, _, flat, _ = box
    critical = 0.010 - 0.005 * np.tan(np.radians(5))
    band = measured_band(part, flat, Balcony(0.03), 'width', critical, on(0.3), CONDITIONS, seed=1)
    assert critical < band.passes < critical + 0.003
    assert critical - 0.003 < band.rejects < critical
