"""Merging of runs, compared with a set of (sequence, index)."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.merge_runs import merge_drops
from resting_aspects_ros.simulation.run_description import RunDescription

CONDITIONS = DropConditions(
    height=0.06,
    restitution=0.64,
    friction=0.25,
    rolling_friction=0.003,
    spinning_friction=0.001,
    gravity=9.81,
    speed_horizontal=0.1,
    speed_vertical=0.2,
    spin=0.3,
    surface='mat',
)
RUN = RunDescription(
    run_id='a',
    part='bolt',
    part_sha256='ab12',
    conditions=CONDITIONS,
    seed=1,
    first_drop=0,
    drops=100,
    precision=0.0,
    engine='bullet',
    engine_version='3.2.7',
    suite_version='1',
    time_step=0.001,
    started=5,
)


def run(**changes):
    return dataclasses.replace(RUN, **changes)


def poses(first, end, seed=1):
    """Poses in which every value tells which drop, of which seed, it is of; some failed."""
    index = np.arange(end - first) + float(first % 2**32) + seed / 8
    status = (np.arange(first % 6, first % 6 + end - first) % 3).astype(np.uint8)
    return RestingPoses(
        first_drop=first,
        position=index[:, None] + [0.0, 0.25, 0.5],
        orientation=np.sin(index[:, None] + [0.0, 1.0, 2.0, 3.0]),
        status=status,
        decided_by=status % 2,
        time_to_rest=np.where(status == 2, math.nan, index),
        energy_growth=index / 100,
    )


def ranges(merged):
    return [(each.first_drop, each.end) for each in merged.poses]


def refusal(pieces, **options):
    with pytest.raises(InvalidValueError) as caught:
        merge_drops(pieces, **options)
    return str(caught.value)


spans = st.tuples(st.integers(0, 40), st.integers(0, 12)).map(lambda s: (s[0], s[0] + s[1]))


@given(st.lists(st.tuples(st.sampled_from([1, 2, 7]), spans), max_size=12))
def test_merged_drops_have_no_duplicates(assert_same_poses, given_spans):
    pieces = [(run(seed=seed), poses(*span, seed)) for seed, span in given_spans]
    merged = merge_drops(pieces)
    expected = {(seed, i) for seed, span in given_spans for i in range(*span)}
    found = [(each.run.seed, i) for each in merged for span in ranges(each) for i in range(*span)]
    assert len(found) == len(set(found))
    assert set(found) == expected
    assert sum(len(each) for each in merged) == len(expected)
    for each in merged:
        for piece in each.poses:
            assert len(piece) > 0
            assert_same_poses(piece, poses(piece.first_drop, piece.end, each.run.seed))
        # As few pieces as can be: drops are missing between them.
        assert all(a[1] < b[0] for a, b in pairwise(ranges(each)))
    # In the order in which the sequences were given.
    assert [each.run.seed for each in merged] == list(dict.fromkeys(s for s, _ in given_spans))


@given(st.permutations([(0, 10), (5, 8), (5, 30), (10, 20), (29, 40), (50, 60), (0, 10)]))
def test_batch_order_does_not_matter(assert_same_poses, order):
    (merged,) = merge_drops([(RUN, poses(*span)) for span in order])
    assert ranges(merged) == [(0, 40), (50, 60)]
    assert_same_poses(merged.poses[0], poses(0, 40))


def test_merge_of_nothing_is_empty():
    assert merge_drops([]) == []
    (merged,) = merge_drops([(RUN, poses(3, 3))])
    assert (len(merged), merged.poses, merged.run) == (0, (), RUN)


def test_runs_of_one_sequence_are_merged():
    surface = dataclasses.replace(CONDITIONS, surface='')
    other = run(run_id='b', started=9, drops=7, part='screw')
    same = run(run_id='c', conditions=surface)
    pieces = [(r, poses(*s)) for r, s in ((other, (0, 5)), (RUN, (3, 9)), (same, (0, 9)))]
    (merged,) = merge_drops([*pieces, (other, poses(5, 6))])
    assert merged.run is other
    assert merged.run_ids == ('b', 'a', 'c')
    assert ranges(merged) == [(0, 9)]


def test_maximum_drop_indices_are_merged():
    end = 2**64
    (merged,) = merge_drops([(RUN, poses(end - 10, end)), (RUN, poses(end - 10, end))])
    assert ranges(merged) == [(end - 10, end)]


def test_other_part_is_rejected():
    pieces = [(RUN, poses(0, 5)), (run(run_id='b', part_sha256='cd34', seed=2), poses(0, 5))]
    assert refusal(pieces) == ('invalid part_sha256 cd34 of run b: expected ab12, as in run a')


@pytest.mark.parametrize('name', sorted(QUANTITIES))
def test_other_conditions_are_rejected(name):
    value = getattr(CONDITIONS, name)
    other = run(run_id='b', seed=2, conditions=CONDITIONS.changed(**{name: value / 2}))
    assert refusal([(RUN, poses(0, 5)), (other, poses(0, 5))]) == (
        f'invalid {name} {value / 2} of run b: expected {value}, as in run a'
    )


def test_other_surroundings_are_rejected():
    conditions = dataclasses.replace(CONDITIONS, surroundings='{"kind":"wall"}')
    pieces = [(RUN, poses(0, 5)), (run(run_id='b', seed=2, conditions=conditions), poses(0, 5))]
    assert refusal(pieces) == (
        'invalid surroundings \'{"kind":"wall"}\' of run b: expected \'\', as in run a'
    )


def test_other_height_of_is_rejected():
    conditions = CONDITIONS.changed(height_of=HeightOf.CENTRE_OF_MASS)
    pieces = [(RUN, poses(0, 5)), (run(run_id='b', seed=2, conditions=conditions), poses(0, 5))]
    assert refusal(pieces) == (
        'invalid height_of CENTRE_OF_MASS of run b: expected LOWEST_POINT, as in run a'
    )


@pytest.mark.parametrize(
    ('changes', 'engine'),
    [
        ({'engine_version': '3.2.8'}, 'bullet 3.2.8 in steps of 0.001 s'),
        ({'engine': 'drake'}, 'drake 3.2.7 in steps of 0.001 s'),
        ({'time_step': 0.0005}, 'bullet 3.2.7 in steps of 0.0005 s'),
    ],
)
def test_other_engine_is_rejected_unless_allowed(changes, engine):
    other = run(run_id='b', seed=2, **changes)
    pieces = [(RUN, poses(0, 5)), (other, poses(2, 9, seed=2))]
    assert refusal(pieces) == (
        f'invalid engine {engine} of run b: expected bullet 3.2.7 in steps of 0.001 s, as in run a'
    )
    merged = merge_drops(pieces, any_engine=True)
    assert [(each.run.run_id, ranges(each)) for each in merged] == [
        ('a', [(0, 5)]),
        ('b', [(2, 9)]),
    ]


def test_equal_initial_states_of_two_engines_are_rejected():
    other = run(run_id='b', engine_version='3.2.8')
    assert refusal([(RUN, poses(0, 5)), (other, poses(3, 9))], any_engine=True) == (
        'drop 3 of seed 1 is in run a and in run b, which differ in engine, version or timestep: '
        'expected different seeds or drops, because drops with the same initial state are not '
        'independent'
    )
    after = merge_drops([(RUN, poses(0, 5)), (other, poses(5, 9))], any_engine=True)
    assert [len(each) for each in after] == [5, 4]


def test_any_engine_does_not_allow_another_part():
    pieces = [(RUN, poses(0, 5)), (run(run_id='b', part_sha256='cd34', seed=2), poses(0, 5))]
    assert 'part_sha256' in refusal(pieces, any_engine=True)


def changed(piece, drop, name, change):
    """The same poses, but for one value of one drop."""
    values = getattr(piece, name).copy()
    at = drop - piece.first_drop
    values[at] = change(values[at])
    return dataclasses.replace(piece, **{name: values})


@pytest.mark.parametrize(
    ('name', 'change'),
    [
        ('position', lambda v: np.nextafter(v, 9.0)),
        ('orientation', lambda v: np.nextafter(v, 9.0)),
        ('orientation', lambda v: -v),
        ('status', lambda v: (v + 1) % 3),
        ('decided_by', lambda v: 1 - v),
        ('time_to_rest', lambda v: math.nan),
        ('time_to_rest', lambda v: np.nextafter(v, 9.0)),
        ('energy_growth', lambda v: np.nextafter(v, 9.0)),
    ],
)
@pytest.mark.parametrize('span', [(4, 12), (6, 8), (7, 8), (0, 40)])
def test_different_results_of_a_drop_are_rejected(name, change, span):
    wrong = changed(poses(*span), 7, name, change)
    pieces = [(RUN, poses(0, 6)), (RUN, poses(6, 20)), (run(run_id='b'), wrong)]
    for order in (pieces, pieces[::-1]):
        message = refusal(order)
        assert message in {
            f'drop 7 of seed 1 has different results in run {one} and in run {other}: expected '
            'identical bits; one of the runs was simulated on another platform, or its log is '
            'damaged'
            for one, other in ('ab', 'ba')
        }


def test_signed_zeros_differ_and_all_nans_are_equal():
    zero = changed(poses(0, 5), 3, 'position', lambda v: v * 0.0)
    minus = changed(zero, 3, 'position', lambda v: -v)
    assert 'drop 3 of seed 1' in refusal([(RUN, zero), (RUN, minus)])
    failed = poses(0, 3)
    assert math.isnan(failed.time_to_rest[2])
    bits = failed.time_to_rest.copy().view(np.uint64)
    bits[2] ^= np.uint64(1)
    other = dataclasses.replace(failed, time_to_rest=bits.view(np.float64))
    assert len(merge_drops([(RUN, failed), (RUN, other)])[0]) == 3


def test_table_columns_compare_like_arrays(assert_same_poses):
    whole = poses(0, 9)
    table = np.hstack([whole.position, whole.orientation, whole.time_to_rest[:, None]])
    columns = dataclasses.replace(
        whole, position=table[:, :3], orientation=table[:, 3:7], time_to_rest=table[:, 7]
    )
    (merged,) = merge_drops([(RUN, whole), (RUN, columns)])
    assert_same_poses(merged.poses[0], whole)


def test_merge_does_not_modify_its_input(assert_same_poses):
    piece = poses(0, 9)
    merge_drops([(RUN, piece), (RUN, piece), (RUN, poses(4, 12))])
    assert_same_poses(piece, poses(0, 9))
