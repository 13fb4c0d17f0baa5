"""Traps against closed forms; rates; designs, whose traps are checked again."""

import math

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.tracks.description import Track, read_track
from resting_aspects_ros.tracks.design import Band, asymmetric_cut, design_traps
from resting_aspects_ros.tracks.orientations import mirror_images, orientations_on
from resting_aspects_ros.tracks.rate import Tolerance, pass_traps
from resting_aspects_ros.tracks.traps import (
    AirJet,
    Arrival,
    Balcony,
    Canyon,
    CutOut,
    Gap,
    Groove,
    HoldDown,
    Projection,
    Rail,
    Riser,
    Scallop,
    Slot,
    Surface,
    Wiper,
    outcomes,
)

LEVEL = Surface(width=0.08)


def rows_of(part, **options):
    aspects = find_aspects(part)
    return orientations_on(part, aspects, np.full(len(aspects), 1 / len(aspects)), **options)


@pytest.fixture(scope='module')
def box():
    """A box of 30 x 20 x 10 mm, flat on the track with its long side at the wall."""
    mesh = trimesh.creation.box((30, 20, 10))
    part = part_from_bytes(mesh.export(file_type='stl'), 'stl', 'box')
    row = next(r for r in rows_of(part) if (r.height < 0.011 and r.length > 0.029))
    return part, row


def critical(trap, case, surface=LEVEL):
    part, row = case
    return trap.outcome(Arrival(row, surface, part)).critical


def test_critical_balcony_is_the_distance_of_the_centre_of_mass(box):
    assert critical(Balcony(0.015), box) == pytest.approx(0.010, abs=5e-6)


@pytest.mark.parametrize('roll', [2.0, 5.0, 15.0])
def test_roll_towards_the_wall_moves_the_resultant_there(box, roll):
    surface = Surface(width=0.08, roll=math.radians(roll))
    expected = 0.010 - 0.005 * math.tan(math.radians(roll))
    assert critical(Balcony(0.015), box, surface) == pytest.approx(expected, abs=5e-6)


def test_critical_gap_of_a_box_is_half_its_length(box):
    assert critical(Gap(0.01), box) == pytest.approx(0.015, abs=5e-6)


def test_pitch_shortens_the_critical_gap(box):
    pitch = math.radians(10)
    surface = Surface(width=0.08, pitch=pitch)
    expected = 0.015 - 0.005 * math.tan(pitch)
    assert critical(Gap(0.01), box, surface) == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize(('name', 'values'), [('hex_nut', [8.50, 4.20, 9.815])])
def test_critical_balconies_of_a_nut(name, values):
    # Berretty et al. 2001: for a convex contact the distance of the centre of mass.
    part = ra.load_part(name)
    found = [critical(Balcony(0.01), (part, row)) for row in rows_of(part)]
    assert sorted(1e3 * value for value in found) == pytest.approx(sorted(values), abs=0.01)


def test_a_canyon_below_the_part_is_bridged(box):
    part, row = box
    arrival = Arrival(row, LEVEL, part)
    assert Canyon(0.008, 0.019).outcome(arrival).outcome == 'pass'
    assert Canyon(0.008, 0.021).outcome(arrival).outcome == 'reject'
    assert Canyon(0.011, 0.021).outcome(arrival).outcome == 'pass'


def test_a_slot_is_a_gap_where_it_is_wide_and_harmless_where_it_is_narrow(box):
    assert critical(Slot(0.0, 0.03, 0.01), box) == pytest.approx(0.015, abs=5e-6)
    part, row = box
    assert Slot(0.005, 0.015, 0.06).outcome(Arrival(row, LEVEL, part)).outcome == 'pass'


def test_a_scallop_is_between_its_inscribed_and_circumscribed_rectangles(box):
    part, row = box
    radius = critical(Scallop(0.01, 0.02), box)
    arrival = Arrival(row, LEVEL, part)
    # The square around the circle rejects what the circle rejects.
    side = math.sqrt(2) * radius
    assert (
        Slot(max(0.01 - radius, 0), 0.01 + radius, 2 * radius).outcome(arrival).outcome != 'pass'
    )
    assert side < 0.06


def test_a_wiper_compares_heights(box):
    part, row = box
    arrival = Arrival(row, LEVEL, part)
    assert Wiper(0.0101).outcome(arrival).outcome == 'pass'
    assert Wiper(0.0098).outcome(arrival).outcome == 'jam'
    assert Wiper(0.005).outcome(arrival).outcome == 'reject'
    assert HoldDown(0.005).outcome(arrival).outcome == 'jam'


def test_a_projection_moves_the_part_over_the_edge(box):
    part, row = box
    surface = Surface(width=0.015)
    found = Projection(0.002).outcome(Arrival(row, surface, part))
    assert found.outcome == 'pass'
    assert found.critical == pytest.approx(0.005, abs=5e-6)
    # Above the part it has no effect.
    assert Projection(0.01, 0.02, 0.03).outcome(Arrival(row, surface, part)).outcome == 'pass'


def test_an_air_jet_needs_more_than_the_friction(box):
    part, row = box
    weight = part.mass * 9.80665
    surface = Surface(width=0.08, friction=0.3, roll=math.radians(5))
    limit = weight * (0.3 * math.cos(surface.roll) + math.sin(surface.roll))
    arrival = Arrival(row, surface, part)
    assert AirJet(0.002, 1.01 * limit).outcome(arrival).outcome == 'reject'
    assert AirJet(0.002, 0.99 * limit).outcome(arrival).outcome == 'pass'
    assert AirJet(0.011, 10 * limit).outcome(arrival).outcome == 'pass'


def test_an_asymmetric_cut_out_separates_mirror_images():
    part = ra.load_part('l_bracket')
    pair = [row for row in rows_of(part) if row.height < 0.021 and row.yaw.distance < 0.011]
    assert {row.aspects for row in pair} == {(1,), (2,)}
    symmetric = [critical(Gap(0.01), (part, row)) for row in pair]
    assert symmetric[0] == pytest.approx(symmetric[1], abs=1e-5)
    triangle = CutOut(0.75, points=((0.0, 0.0), (0.04, 0.0), (0.04, 0.04)))
    found = outcomes(pair, triangle, LEVEL, part)
    assert [each.outcome == 'pass' for each in found].count(True) == 1


def test_rejections_of_edge_contacts_are_not_known():
    part = ra.load_part('l_bracket')
    rows = [row for row in rows_of(part) if row.aspects == (4,)]
    found = outcomes(rows, Gap(0.02), LEVEL, part)
    assert {each.outcome for each in found} <= {'unknown', 'pass'}


def test_rate_of_one_trap():
    part = ra.load_part('hex_nut')
    rows = rows_of(part)
    track = Track(Surface(width=0.03), speed=0.05, fill=0.8, traps=(Wiper(0.0127),))
    flat = next(row for row in rows if row.height < 0.01)
    found = pass_traps(part, rows, track, (flat.id,))
    length = sum(row.probability * row.length for row in rows)
    expected = 60 * 0.05 * 0.8 / length * flat.probability
    assert found.rate == pytest.approx((expected, expected))
    assert found.good == pytest.approx((flat.probability,) * 2)
    assert found.purity == (1.0, 1.0)


def test_a_tolerance_makes_a_margin_a_probability():
    tolerance = Tolerance(part=0.3e-3, trap=0.4e-3)
    sigma = 0.5e-3 / 3
    assert tolerance.passing(0) == 0.5
    assert tolerance.passing(sigma) == pytest.approx(0.8413, abs=1e-4)
    assert tolerance.passing(math.inf) == 1


@pytest.mark.parametrize('name', ['hex_nut', 'u_bracket', 'l_bracket'])
def test_designs_pass_only_the_wanted_orientation(name):
    part = ra.load_part(name)
    rows = rows_of(part)
    track = Track(Surface(width=0.08, roll=math.radians(5)))
    found = 0
    for row in rows[:4]:
        if row.rolls:
            continue
        result = design_traps(part, rows, track, row.id)
        assert row.id in result.alike
        for design in result.designs:
            found += 1
            low, high = design.passage.passing
            for k, other in enumerate(rows):
                if other.id in result.alike:
                    assert low[k] == 1
                else:
                    assert high[k] == 0
            for trap_outcomes in design.passage.outcomes:
                kept = [k for k, other in enumerate(rows) if other.id in result.alike]
                assert all(trap_outcomes[k].margin > 0 for k in kept)
    assert found


def test_a_track_is_read_with_units_and_written_in_si():
    track = read_track(
        {
            'width': '40mm',
            'roll': '5deg',
            'wall': {'height': '30mm', 'friction': 0.2},
            'speed': '50mm/s',
            'traps': [{'kind': 'wiper', 'height': '12.7mm'}, {'kind': 'gap', 'length': 0.012}],
        }
    )
    assert track.surface.width == pytest.approx(0.04)
    assert track.traps[0] == Wiper(0.0127)
    assert read_track(track.document) == track


@pytest.mark.parametrize(
    ('document', 'says'),
    [
        ({}, 'missing width'),
        ({'width': 40}, 'invalid width 40'),
        ({'width': '40mm', 'traps': [{'kind': 'wiper', 'height': 0}]}, 'invalid height 0'),
        ({'width': '40mm', 'traps': [{'kind': 'wipe'}]}, "invalid kind of trap 'wipe'"),
        ({'width': '40mm', 'traps': [{'kind': 'balcony', 'width': '50mm'}]}, 'at most the width'),
        ({'width': '40mm', 'trap': []}, "invalid value 'trap' of a track"),
        ({'width': '40mm', 'traps': [{'kind': 'canyon', 'start': 0.02, 'end': 0.01}]}, 'lower'),
    ],
)
def test_wrong_tracks_are_refused(document, says):
    with pytest.raises(InvalidValueError, match=says):
        read_track(document)


def test_simulated_bands_replace_the_critical_values_of_a_design():
    part = ra.load_part('hex_nut')
    rows = rows_of(part)
    track = Track(Surface(width=0.05, roll=math.radians(5)))
    flat = next(row for row in rows if row.height < 0.01)
    static = design_traps(part, rows, track, flat.id).designs[0]
    assert [trap.kind for trap in static.traps] == ['wiper']
    measured = []

    def measure(row, trap, dimension, value):
        """A band of 2 mm above and 1 mm below the critical height; no other trap rejects."""
        measured.append((trap.kind, dimension, row.id))
        return Band(value + 0.002, value - 0.001 if trap.kind == 'wiper' else math.inf)

    found = design_traps(part, rows, track, flat.id, measure=measure).designs[0]
    (trap,) = found.traps
    heights = sorted({round(row.height, 6) for row in rows})
    assert trap.height == pytest.approx((heights[0] + 0.002 + heights[1] - 0.001) / 2, abs=1e-5)
    assert found.margin == pytest.approx((heights[1] - heights[0] - 0.003) / 2, abs=1e-5)
    assert len(measured) == len(set(measured))
    assert {row for *_, row, _ in found.bands} == {row.id for row in rows}


def test_a_trap_whose_bands_never_end_is_not_proposed():
    part = ra.load_part('hex_nut')
    rows = rows_of(part)
    track = Track(Surface(width=0.05, roll=math.radians(5)))

    def measure(row, trap, dimension, value):
        return Band(math.inf, math.inf) if trap.kind == 'wiper' else Band(value, value)

    flat = next(row for row in rows if row.height < 0.01)
    found = design_traps(part, rows, track, flat.id, measure=measure)
    assert all(trap.kind != 'wiper' for trap in found.designs[0].traps)


def test_a_triangle_is_proposed_for_mirror_images():
    part = ra.load_part('l_bracket')
    rows = rows_of(part)
    one, other = (row for row in rows if row.height < 0.021 and row.yaw.distance < 0.011)
    alike = mirror_images(rows, 1e-4)
    assert other.id in alike[rows.index(one)]
    cut, margin = asymmetric_cut(part, rows, LEVEL, one.id, other.id)
    assert margin > 0.5e-3
    found = outcomes([one, other], cut, LEVEL, part)
    assert [each.outcome == 'pass' for each in found] == [True, False]


def test_a_box_is_its_own_mirror_image(box):
    part, _ = box
    assert not any(mirror_images(rows_of(part), 1e-4))


@pytest.mark.parametrize('trap', [Groove(0.008, 0.021), Rail(0.008, 0.021), Riser(0.015, 0.002)])
def test_statics_does_not_tell_how_a_part_drops_or_is_lifted(box, trap):
    part, row = box
    assert trap.outcome(Arrival(row, LEVEL, part)).outcome == 'unknown'


@pytest.mark.parametrize('trap', [Groove(0.008, 0.019), Rail(0.008, 0.019), Riser(0.021, 0.002)])
def test_what_does_not_reach_a_groove_or_riser_passes(box, trap):
    part, row = box
    assert trap.outcome(Arrival(row, LEVEL, part)).outcome == 'pass'
