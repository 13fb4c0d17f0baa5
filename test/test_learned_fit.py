"""The recipe of the learned estimator, and its fit to counts whose truth is known."""

import numpy as np
import pytest
from learned_drops import (
    BOUNDS,
    conditions_of,
    counted,
    design,
    held_out_cases,
    in_band,
    line,
    read_lines,
    training_cases,
)
from learned_fit import Drops, fit, fit_weight, predictions
from learned_solids import KINDS, solid

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.plan import make_job


@pytest.mark.parametrize('index', range(len(KINDS)))
def test_solid_depends_on_its_index_only(index):
    one, again, other = solid(1, index), solid(1, index), solid(2, index)
    assert one.mesh_sha256 == again.mesh_sha256 != other.mesh_sha256
    assert one.name.startswith(tuple(KINDS)[index])


def test_conditions_of_the_recipe_are_within_the_bounds():
    for case in [c for k in range(0, 600, 7) for c in training_cases(k)]:
        assert BOUNDS.outside(case.release) == '', case
    assert len({design(k).height for k in range(2000)}) == 2000
    assert in_band(1, 3, 'frictionless').friction == 0
    kinds = {(case.kind, case.band) for case in held_out_cases(10)}
    assert len(kinds) == 5 * len(KINDS)


def test_lines_are_read_back_and_a_broken_one_is_ignored(tmp_path):
    case = training_cases(8, 10)[0]
    path = tmp_path / 'drops.jsonl'
    path.write_text(line(case, [4, 5, 1]) + '\n' + line(case, [1, 1, 1])[:30])
    ((found, counts),) = read_lines(path)
    assert (found.key, found.drops, counts) == (case.key, 10, [4, 5, 1])
    assert found.release.height == pytest.approx(case.release.height, rel=1e-8)


def test_fit_finds_the_shares_of_simulated_counts():
    """True scores are a feature times a condition; 400 cases of 125 drops over 4 aspects."""
    rng = np.random.default_rng(3)
    cases, size = 400, 4
    aspects, conditions = rng.standard_normal((cases * size, 3)), rng.standard_normal((cases, 2))
    case = np.repeat(np.arange(cases), size)
    scores = aspects[:, 0] * (0.8 + 0.4 * conditions[case, 0])
    weights = np.exp(scores).reshape(cases, size)
    truth = weights / weights.sum(axis=1, keepdims=True)
    counts = np.array([rng.multinomial(125, each) for each in truth]).ravel().astype(float)
    drops = Drops(aspects, rng.standard_normal((cases, 1)), conditions, case, counts)
    fitted, new = np.arange(cases) < 300, np.arange(cases) >= 300
    model = fit(drops.select(fitted), BOUNDS, 1, members=1)
    unseen = drops.select(new)
    off = np.abs(predictions(model, unseen) - truth[new].ravel())
    # The counts of these cases deviate from the truth by 0.027 on average.
    assert off.mean() < 0.02
    weight = fit_weight(unseen.part, unseen.conditions, unseen, predictions(model, unseen))
    # Nearly exact predictions are worth more drops than there are in a case.
    assert np.exp(weight[0]) > 125


def test_counts_end_with_the_drops_in_no_aspect(part):
    aspects = find_aspects(part('l_bracket'))
    job = make_job(part('l_bracket'), conditions_of(design(0), part('l_bracket').hull_radius), 1)
    counts = counted(aspects, drop_range(job, 0, 8))
    assert (len(counts), sum(counts)) == (len(aspects) + 1, 8)
