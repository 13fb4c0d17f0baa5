"""Batches of parts, and designs of a part side by side."""

import dataclasses

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.studies.batch import compare_designs, match_aspects


def test_bad_files_do_not_cost_the_others(tmp_path, here):
    parts = ['tetrahedron', tmp_path / 'absent.stl']
    batch = ra.drop_batch(parts, 20, model_range=False, workers=here())
    first, second = batch.entries
    assert (first.source, first.result.distribution.drops) == ('tetrahedron', 20)
    assert second.error.endswith("absent.stl' does not exist")
    assert not batch.complete
    workers = here()
    with pytest.raises(ra.UnknownPartError, match="'300'"):  # before the first part
        ra.drop_batch(['washer', '300'], 20, workers=workers)
    assert not workers.submitted


@pytest.mark.slow
def test_parts_have_independent_reproducible_seeds(here):
    """A part has the same drops in any batch, and other initial states than other parts."""

    options = {'model_range': False, 'workers': here()}

    def runs(*parts):
        found = ra.drop_batch(parts, 20, seed=5, **options).results
        return [(result.run.seed, result.distribution.counts.tolist()) for result in found]

    (first,), (box, second) = runs('tetrahedron'), runs('box_10x20x30', 'tetrahedron')
    assert first == second
    assert box[0] != first[0]
    # A single run with the seed of the report repeats the drops of the batch.
    alone = ra.drop('box_10x20x30', 20, seed=box[0], **options)
    assert alone.distribution.counts.tolist() == box[1]


def test_index_has_the_parts_that_are_done_if_the_engine_fails(tmp_path, here):
    workers = here(failing=(1,))
    with pytest.raises(EngineError):
        ra.drop_batch(
            ['tetrahedron', 't_prism'], 20, model_range=False, out=tmp_path, workers=workers
        )
    index = (tmp_path / 'index.html').read_text(encoding='utf-8')
    assert 'tetrahedron/' in index
    assert 't_prism' not in index


@pytest.fixture(scope='module')
def bracket():
    part = ra.load_part('l_bracket')
    return part, ra.find_aspects(part)


@pytest.fixture(scope='module')
def longer(bracket, solid):
    part = solid(trimesh.Trimesh([1100, 1000, 1000] * bracket[0].vertices, bracket[0].faces))
    return part, ra.find_aspects(part)


def test_design_in_the_same_frame_is_matched(bracket, longer, solid, solids):
    pairs, apart = match_aspects(*bracket, *longer)
    assert pairs == tuple((k, k) for k in range(1, 6))
    assert 0 < apart < 0.1
    plate = solid(solids.box(60, 60, 3))
    assert match_aspects(*bracket, plate, ra.find_aspects(plate))[0] == ()


def test_difference_of_shared_aspects_is_within_its_interval(bracket, longer, here):
    drops, generator = 50_000, np.random.default_rng(1)
    shares = np.array([[0.3, 0.3, 0.2, 0.1, 0.1], [0.25, 0.3, 0.2, 0.1, 0.15]])
    made = ra.drop('l_bracket', 10, model_range=False, workers=here())
    results = []
    for (part, aspects), p in zip((bracket, longer), shares, strict=True):
        # One class for each aspect, in the same order.
        distribution = Distribution(aspects, generator.multinomial(drops, p), 0, 0, 0)
        results.append(dataclasses.replace(made, part=part, distribution=distribution))
    (found,) = compare_designs(results, 0.999)
    assert len(found.shared) == 5
    for pair, truth in zip(found.shared, shares[1] - shares[0], strict=True):
        assert pair.lower < truth < pair.upper
        # The standard error of the difference of two binomial shares.
        assert pair.upper - pair.lower < 7 * np.sqrt(2 * 0.25 / drops)
