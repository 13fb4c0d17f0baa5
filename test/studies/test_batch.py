"""Batches of parts: what is known before the first drop."""

import pytest

import resting_aspects_ros as ra


def test_missing_parts_are_named_before_the_first_drop(tmp_path, here):
    """The first part is checked after the warnings, and before it is simulated."""
    noticed = []
    with pytest.warns(ra.RestingAspectsWarning) as caught:
        batch = ra.drop_batch(
            ['tetrahedron', 'tetrahedrn', tmp_path / 'absent.stl'],
            20,
            check=lambda _: noticed.extend(str(each.message) for each in caught),
            workers=here(),
        )
    assert len(noticed) == 2
    assert noticed[0].startswith("tetrahedrn: part 'tetrahedrn' is not known")
    assert noticed[1].endswith("absent.stl' does not exist")
    assert [bool(entry.error) for entry in batch.entries] == [False, True, True]
    assert batch.entries[0].result.distribution.drops == 20


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
