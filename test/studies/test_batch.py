"""Batches of parts, and designs of a part side by side."""

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.studies.batch import compare_cases, match_aspects
from resting_aspects_ros.studies.pages import batch_page, batch_range_texts
from resting_aspects_ros.studies.points import Case


def test_bad_files_do_not_cost_the_others(tmp_path, here):
    parts = ['tetrahedron', tmp_path / 'absent.stl']
    batch = ra.drop_batch(parts, 20, model_range=False, workers=here())
    first, second = batch.entries
    assert first.result.distribution.drops == 20
    assert second.error.endswith("absent.stl' does not exist")
    assert not batch.complete


@pytest.mark.slow
def test_parts_have_independent_reproducible_seeds(here):
    """A part has the same drops in any batch, and other initial states than other parts."""

    def batch(*parts, seed=5):
        entries = ra.drop_batch(parts, 20, seed=seed, model_range=False, workers=here()).entries
        return {each.case.part.name: each.result for each in entries}

    first, second = (
        batch('tetrahedron', 'hex_nut'),
        batch('hex_nut', 'box_10x20x30', 'tetrahedron'),
    )
    for name, each in first.items():
        assert each.run.seed == second[name].run.seed
        assert each.distribution.counts.tolist() == second[name].distribution.counts.tolist()
    seeds = {each.run.seed for each in second.values()}
    assert len(seeds) == 3
    assert batch('hex_nut', seed=6)['hex_nut'].run.seed not in seeds
    # A single run with the seed of the report repeats the drops of the batch.
    seed, counts = second['hex_nut'].run.seed, second['hex_nut'].distribution.counts
    alone = ra.drop('hex_nut', 20, seed=seed, model_range=False, workers=here())
    assert alone.distribution.counts.tolist() == counts.tolist()


def test_index_of_a_batch_states_what_the_model_ranges_cover_once(here):
    batch = ra.drop_batch(['tetrahedron', 'l_bracket'], 50, workers=here())
    (text,) = batch_range_texts(batch)
    assert 'restitution and friction' in text
    assert batch_page(batch, 'index.html', compare=False).sections[0].items[0] == text


def test_one_part_needs_no_list(here):
    batch = ra.drop_batch('tetrahedron', 5, model_range=False, workers=here())
    assert [each.source for each in batch.entries] == ['tetrahedron']
    assert batch.complete


def test_wrong_seed_is_refused_before_the_first_part(here):
    with pytest.raises(ra.InvalidValueError, match='seed -1'):
        ra.drop_batch(['washer'], 20, seed=-1, workers=here())


def test_unknown_name_is_refused_before_the_first_part(here):
    workers = here()
    with pytest.raises(ra.UnknownPartError, match="'300'"):
        ra.drop_batch(['washer', '300'], 20, workers=workers)
    assert not workers.submitted


@pytest.fixture(scope='module')
def bracket():
    part = ra.load_part('l_bracket')
    return part, ra.find_aspects(part)


def design(part, transform):
    mesh = trimesh.Trimesh(1000 * part.vertices, part.faces)
    mesh.apply_transform(transform)
    changed = part_from_bytes(mesh.export(file_type='stl'), 'stl', 'changed')
    return changed, ra.find_aspects(changed)


def test_design_in_the_same_frame_is_matched(bracket):
    longer = design(bracket[0], np.diag([1.1, 1, 1, 1]))
    pairs, apart = match_aspects(*bracket, *longer)
    assert pairs == tuple((k, k) for k in range(1, 6))
    assert 0 < apart < 0.1


@pytest.mark.slow
def test_other_part_shares_no_aspects(bracket):
    rod = trimesh.creation.box((200, 3, 3))
    other = part_from_bytes(rod.export(file_type='stl'), 'stl', 'rod')
    assert match_aspects(*bracket, other, ra.find_aspects(other))[0] == ()


def test_difference_of_shared_aspects_is_within_its_interval(bracket):
    points, drops = 50, 1000
    generator = np.random.default_rng(1)
    shares = np.array([[0.3, 0.3, 0.2, 0.1, 0.1], [0.25, 0.3, 0.2, 0.1, 0.15]])
    other = np.zeros((points, 5), dtype=int)
    longer = design(bracket[0], np.diag([1.1, 1, 1, 1]))
    cases = [
        Case(*each, generator.multinomial(drops, p, size=points), other)
        for each, p in zip((bracket, longer), shares, strict=True)
    ]
    (found,) = compare_cases(cases, 0.999)
    assert len(found.shared) == 5
    for pair, truth in zip(found.shared, shares[1] - shares[0], strict=True):
        assert pair.lower < truth < pair.upper
        # The standard error of the mean of differences of two binomial shares.
        assert pair.upper - pair.lower < 7 * np.sqrt(2 * 0.25 / drops / points)
