"""Traps against closed forms; rates; designs, whose traps are checked again."""

import math
from itertools import starmap

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.tracks import support, traps
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.design import Band, design_traps
from resting_aspects_ros.tracks.orientations import mirror_images
from resting_aspects_ros.tracks.rate import Tolerance, confusion, pass_traps

LEVEL = traps.Surface(width=0.08)


def critical(trap, case, surface=LEVEL):
    part, row = case
    return trap.outcome(traps.Arrival(row, surface, part)).critical


def inclined(roll=0.0, pitch=0.0):
    return traps.Surface(width=0.08, roll=math.radians(roll), pitch=math.radians(pitch))


@pytest.mark.parametrize(
    ('trap', 'surface', 'expected'),
    [
        # The distance of the centre of mass from the wall, to which the resultant moves.
        (traps.Balcony(0.015), LEVEL, 0.010),
        (traps.Balcony(0.015), inclined(roll=15), 0.010 - 0.005 * math.tan(math.radians(15))),
        # Half of the length.
        (traps.Gap(0.01), inclined(pitch=10), 0.015 - 0.005 * math.tan(math.radians(10))),
        (traps.Slot(0.0, 0.03, 0.01), LEVEL, 0.015),  # a gap where it is wide
        (
            traps.Projection(0.002),
            traps.Surface(width=0.015),
            0.005,
        ),  # it moves the part over the edge
    ],
)
def test_critical_values_of_a_box(box, trap, surface, expected):
    assert critical(trap, box, surface) == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize(
    ('trap', 'outcome'),
    [
        (traps.Canyon(0.008, 0.021), 'reject'),
        (traps.Canyon(0.011, 0.021), 'pass'),
        (traps.Gap(0.0165), 'jam'),  # its nose dips
        (traps.Gap(0.0170), 'reject'),
        (traps.Wiper(0.0098), 'jam'),
        (traps.Wiper(0.005), 'reject'),
        (traps.HoldDown(0.005), 'jam'),
        (traps.Projection(0.01, 0.02, 0.03), 'pass'),  # above the part
        # Statics does not tell how a part drops or is lifted.
        (traps.Groove(0.008, 0.021), 'unknown'),
        (traps.Groove(0.008, 0.019), 'pass'),  # the part bridges it
        (traps.Rail(0.008, 0.021), 'unknown'),
        (traps.Riser(0.015, 0.002), 'unknown'),
        (traps.Riser(0.021, 0.002), 'pass'),
    ],
)
def test_outcomes_of_a_box(box, trap, outcome):
    part, row = box
    assert trap.outcome(traps.Arrival(row, LEVEL, part)).outcome == outcome


def test_critical_balconies_of_a_nut(part, rows_of):
    # Berretty et al. 2001: for a convex contact the distance of the centre of mass.
    nut = part('hex_nut')
    found = [1e3 * critical(traps.Balcony(0.01), (nut, row)) for row in rows_of(nut)]
    assert sorted(found) == pytest.approx([4.20, 8.50, 9.815], abs=0.01)


def test_the_support_of_a_contact_that_is_not_convex(part, rows_of):
    # A U on its side with a leg at the wall: the hull of what a narrow track carries ends at the
    # line from the end of this leg to the back.
    shape = part('u_bracket')
    rows = [row for row in rows_of(shape) if row.height < 0.021 and row.length < 0.0251]
    assert {round(1e3 * row.yaw.distance, 2) for row in rows} == {15.0}
    for row in rows:
        assert 1e3 * critical(traps.Balcony(0.02), (shape, row)) == pytest.approx(18.02, abs=0.01)


def test_a_square_rejects_what_the_circle_within_it_rejects(box):
    part, row = box
    radius = critical(traps.Scallop(0.01, 0.02), box)
    square = traps.Slot(max(0.01 - radius, 0), 0.01 + radius, 2 * radius)
    assert square.outcome(traps.Arrival(row, LEVEL, part)).outcome != 'pass'


@pytest.mark.slow
def test_finer_places_do_not_change_a_critical_value(part, rows_of, monkeypatch):
    oblique, prism = traps.CutOut(points=((0, 0), (0.01, 0), (0.004, 0.03))), part('t_prism')
    case = prism, rows_of(prism)[0]
    found = critical(oblique, case)
    monkeypatch.setattr(support, 'STEP', 5e-5)
    assert critical(oblique, case) == pytest.approx(found, abs=2e-3)


def test_the_margin_of_a_cut_out_is_a_length(box):
    # A rectangle of 10 x 30 mm: a gap of 15 mm is the critical one, 1.5 times as long.
    part, row = box
    points = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.03), (0.0, 0.03))
    found = traps.CutOut(1.0, points=points).outcome(traps.Arrival(row, LEVEL, part))
    assert found.critical == pytest.approx(1.5, abs=1e-3)
    assert found.margin == pytest.approx(0.005, abs=1e-5)


def test_an_air_jet_needs_more_than_the_friction(box):
    part, row = box
    weight = part.mass * 9.80665
    surface = traps.Surface(width=0.08, friction=0.3, roll=math.radians(5))
    limit = weight * (0.3 * math.cos(surface.roll) + math.sin(surface.roll))
    arrival = traps.Arrival(row, surface, part)
    assert traps.AirJet(0.002, 1.01 * limit).outcome(arrival).outcome == 'reject'
    assert traps.AirJet(0.002, 0.99 * limit).outcome(arrival).outcome == 'pass'
    assert traps.AirJet(0.011, 10 * limit).outcome(arrival).outcome == 'pass'


def test_rejections_of_edge_contacts_are_not_known(part, rows_of):
    shape = part('l_bracket')
    rows = [row for row in rows_of(shape) if row.aspects == (4,)]
    found = traps.outcomes(rows, traps.Gap(0.02), LEVEL, shape)
    assert {each.outcome for each in found} <= {'unknown', 'pass'}


def test_a_tolerance_makes_a_margin_a_probability():
    tolerance = Tolerance(part=0.3e-3, trap=0.4e-3)
    sigma = 0.5e-3 / 3
    assert tolerance.passing(0) == 0.5
    assert tolerance.passing(sigma) == pytest.approx(0.8413, abs=1e-4)
    assert tolerance.passing(math.inf) == 1


@pytest.mark.slow
def test_designs_pass_only_the_wanted_orientation(part, rows_of):
    shape = part('hex_nut')
    rows = rows_of(shape)
    track = Track(traps.Surface(width=0.08, roll=math.radians(5)))
    designs = design_traps(pass_traps(shape, rows, track, (1,))).designs
    assert designs
    for design in designs:
        low, high = design.passage.passing
        assert (low[0], *high[1:]) == (1, 0, 0)
        # The margin is the least one over all dimensions of all traps.
        known = design.passage.outcomes
        margins = np.array([[each.margin for each in trap] for trap in known])
        rejects = np.array([[each.outcome == 'reject' for each in trap] for trap in known])
        stops = np.where(rejects, -margins, -np.inf)[:, 1:].max(axis=0)
        assert 0 < design.margin <= min(*margins[:, 0], *stops) + 1e-5


@pytest.mark.slow
def test_simulated_bands_replace_the_critical_values_of_a_design(part, rows_of):
    shape = part('hex_nut')
    rows = rows_of(shape)
    flat = next(row for row in rows if row.height < 0.01)
    measured = []

    def band(row, trap, dimension, value, wanted):
        """A band of 2 mm above and 1 mm below the critical height; no other trap rejects."""
        measured.append((trap.kind, dimension, row.id))
        assert wanted == (row is flat)
        if wanted:
            return Band(value + 0.002, math.nan)
        return Band(math.nan, value - 0.001 if trap.kind == 'wiper' else math.inf)

    on = pass_traps(shape, rows, Track(traps.Surface(width=0.05)), (flat.id,))
    result = design_traps(on, measure=lambda asked: list(starmap(band, asked)))
    found = result.designs[0]
    (trap,) = found.passage.track.traps
    heights = sorted({round(row.height, 6) for row in rows})
    assert trap.height == pytest.approx((heights[0] + 0.002 + heights[1] - 0.001) / 2, abs=1e-5)
    assert found.margin == pytest.approx((heights[1] - heights[0] - 0.003) / 2, abs=1e-5)
    assert len(measured) == len(set(measured))
    assert {row for *_, row, _ in result.bands} == {row.id for row in rows}


@pytest.mark.slow
def test_the_traps_of_a_track_stay_and_need_no_help(part, rows_of):
    # On its side: the wiper rejects what is 25 mm and higher.
    shape = part('u_bracket')
    rows = rows_of(shape)
    row = next(row for row in rows if 0.009 < row.yaw.distance < 0.0097)
    assert row.height == pytest.approx(0.02)

    def design(*own, most=1):
        track = Track(traps.Surface(width=0.057, roll=math.radians(5)), traps=own)
        return design_traps(pass_traps(shape, rows, track, (row.id,)), most)

    best = design(traps.Wiper(0.0225)).designs[0].passage
    assert [trap.kind for trap in best.track.traps] == ['wiper', 'balcony']
    assert best.purity == (1, 1)
    with pytest.raises(InvalidValueError, match='its own traps pass; statics says reject'):
        design(traps.Wiper(0.01))
    with pytest.raises(InvalidValueError, match='number of traps 4'):
        design(most=4)


def test_an_asymmetric_cut_out_separates_mirror_images(part, rows_of, box):
    shape = part('l_bracket')
    rows = rows_of(shape)
    one, other = (row for row in rows if row.height < 0.021 and row.yaw.distance < 0.011)
    assert (one.aspects, other.aspects) == ((1,), (2,))
    triangle = traps.CutOut(0.75, points=((0.0, 0.0), (0.04, 0.0), (0.04, 0.04)))
    found = traps.outcomes([one, other], triangle, LEVEL, shape)
    assert [each.outcome == 'pass' for each in found].count(True) == 1
    # A box is its own mirror image.
    assert other.id in mirror_images(rows, 1e-4)[rows.index(one)]
    assert not any(mirror_images(rows_of(box[0]), 1e-4))


def test_mirror_images_that_no_symmetric_trap_separates_are_told_apart(rows_of):
    known = ra.known_part('l_bracket', dict.fromkeys(range(1, 6), 1.0))
    pair = [
        row for row in rows_of(known.part) if row.yaw.distance == pytest.approx(0.01387, abs=1e-5)
    ]
    assert {row.aspects for row in pair} == {(1,), (2,)}
    matrix = confusion(known, pair, 1e-4, seed=1, views=3)
    np.testing.assert_allclose(matrix.sum(axis=1), 1)
    np.testing.assert_array_equal(matrix[:, :2], np.eye(2))


def test_rate_of_one_trap(part, rows_of):
    shape = part('hex_nut')
    rows = rows_of(shape)
    track = Track(traps.Surface(width=0.03), speed=0.05, fill=0.8, traps=(traps.Wiper(0.0127),))
    flat = next(row for row in rows if row.height < 0.01)
    found = pass_traps(shape, rows, track, (flat.id,))
    length = sum(row.probability * row.length for row in rows)
    expected = 60 * 0.05 * 0.8 / length * flat.probability
    assert found.rate == pytest.approx((expected, expected))
    assert found.good == pytest.approx((flat.probability,) * 2)
    assert found.purity == (1.0, 1.0)


def test_a_sensor_keeps_what_it_takes_for_a_wanted_row(part, rows_of):
    nut = part('hex_nut')
    rows = rows_of(nut)
    sensor = traps.Sensor(0.02)
    track = Track(traps.Surface(width=0.04), speed=0.1, traps=(sensor,))
    matrix = np.array([[0.9, 0.1, 0, 0], [0.2, 0.8, 0, 0], [0, 0, 0.5, 0.5]])
    found = pass_traps(nut, rows, track, (1,), confusions={sensor: matrix})
    share = found.probability
    assert found.good == pytest.approx((0.9 * share[0],) * 2)
    good, bad = 0.9 * share[0], 0.2 * share[1]
    assert found.purity == pytest.approx((good / (good + bad),) * 2)
    # The jet needs a distance between two parts.
    assert found.arrivals == pytest.approx(60 * 0.1 / (found.mean_length + 0.02))
