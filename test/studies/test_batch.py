"""Batches of parts: their seeds, and parts that cannot be used."""

import pytest

import resting_aspects_ros as ra


def test_bad_parts_do_not_cost_the_others(tmp_path, here):
    batch = ra.drop_batch(
        ['tetrahedron', 'tetrahedrn', tmp_path / 'absent.stl'], 20, workers=here()
    )
    first, second, third = batch.entries
    assert first.result.distribution.drops == 20
    assert second.error.startswith("part 'tetrahedrn' is not known")
    assert third.error.endswith("absent.stl' does not exist")
    assert not batch.complete


def test_parts_have_independent_reproducible_seeds(here):
    """A part has the same drops in any batch, and other initial states than other parts."""
    first = ra.drop_batch(['washer', 'hex_nut'], 20, seed=5, workers=here()).entries
    second = ra.drop_batch(['hex_nut', 'l_bracket', 'washer'], 20, seed=5, workers=here()).entries
    runs = {each.case.part.name: each.result for each in second}
    for each in first:
        other = runs[each.case.part.name]
        assert each.result.run.seed == other.run.seed
        assert each.result.distribution.counts.tolist() == other.distribution.counts.tolist()
    seeds = {each.run.seed for each in runs.values()}
    assert len(seeds) == 3
    again = ra.drop_batch(['washer'], 20, seed=6, workers=here()).entries[0]
    assert again.result.run.seed not in seeds
    # A single run with the seed of the report repeats the drops of the batch.
    alone = ra.drop('washer', 20, seed=runs['washer'].run.seed, workers=here())
    assert alone.distribution.counts.tolist() == runs['washer'].distribution.counts.tolist()


def test_wrong_seed_is_refused_before_the_first_part(here):
    with pytest.raises(ra.InvalidValueError, match='seed -1'):
        ra.drop_batch(['washer'], 20, seed=-1, workers=here())
