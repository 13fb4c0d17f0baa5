"""Runs: validation of requests, and complete descriptions."""

import dataclasses

import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.conditions import MAX_DROPS, MAX_SEED
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.surroundings import named_surroundings


@pytest.fixture
def plan(part, surfaces):
    """Plan a run of the L bracket that differs in some values from a plain one."""

    def make(conditions=None, **changes):
        asked = {'seed': 1, 'drops': 100, 'run_id': 'r', 'started': 5} | changes
        return plan_run(part('l_bracket'), conditions or surfaces.get(), **asked)

    return make


@pytest.mark.parametrize(
    ('asked', 'expected'),
    [
        ({'drops': MAX_DROPS + 1}, f'invalid drops 2000001: .* 1 to {MAX_DROPS}'),
        ({'seed': 2**64}, f'invalid seed {2**64}: .* 0 to {MAX_SEED}'),
        ({'first_drop': -1}, f'invalid first_drop -1: .* 0 to {MAX_SEED - 100}'),
        ({'engine': 'odd'}, "invalid engine 'odd': expected kernel, cuda or bullet"),
    ],
)
def test_invalid_values_are_rejected(plan, asked, expected):
    with pytest.raises(InvalidValueError, match=expected):
        plan(**asked)


def test_sequence_is_equal_for_the_same_drops_only(plan, surfaces):
    _, run = plan()
    renamed = dataclasses.replace(surfaces.get(), surface='')
    _, same = plan(renamed, drops=5, first_drop=50, run_id='other', started=9)
    assert same.sequence() == run.sequence()
    others = [
        plan(seed=2)[1],
        plan(surfaces.get().changed(friction=0.3))[1],
        plan(engine='bullet')[1],
        *(dataclasses.replace(run, **{name: '9'}) for name in ('engine_version', 'suite_version')),
        dataclasses.replace(run, time_step=1.0),
    ]
    assert run.sequence() not in [each.sequence() for each in others]


@pytest.mark.parametrize(
    ('kind', 'engine'),
    [('plane', 'kernel'), ('chute', 'kernel'), ('bowl_track', 'bullet'), ('pocket', 'bullet')],
)
def test_bullet_simulates_only_what_the_kernel_cannot(plan, surfaces, kind, engine):
    conditions = dataclasses.replace(surfaces.get(), surroundings=named_surroundings(kind))
    assert plan(conditions)[1].engine == engine
    assert plan(conditions, engine='bullet')[1].engine == 'bullet'
    if engine == 'bullet':
        with pytest.raises(InvalidValueError, match='invalid engine kernel: expected bullet'):
            plan(conditions, engine='kernel')
