"""The model range of a run: what it covers, when there is none, and that it is reproducible."""

import dataclasses

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.result_json import document_result
from resting_aspects_ros.simulation.conditions import HeightOf, Surfaces
from resting_aspects_ros.simulation.starts import GivenStates


@pytest.fixture
def dropped(crate, workers):
    def dropped(drops=60, **values):
        return ra.drop(crate, drops, workers=workers, **values)

    return dropped


def test_range_is_that_of_the_surface_for_any_workers(dropped, crate, tmp_path):
    result = dropped()
    model = result.distribution.model
    assert model.uncertain == ('restitution', 'friction')
    other = ra.drop(crate, 60, workers=1).distribution.model
    result.save_json(tmp_path / 'result.json')
    read = document_result(tmp_path / 'result.json', None, None, None, None).distribution.model
    for each in (other, read):
        np.testing.assert_array_equal(each.by_aspect, model.by_aspect)
        np.testing.assert_array_equal(each.by_class, model.by_class)
        assert each.uncertain == model.uncertain
    # Stated friction ends the uncertainty, another height does not.
    assert dropped(height=0.1).distribution.model.uncertain == model.uncertain
    assert dropped(friction=0.3).distribution.model.uncertain == ()


def test_uncertainty_that_the_part_excludes_costs_no_drop(dropped):
    low = tuple({'height': height} for height in np.geomspace(1e-4, 1e-3, 8))
    on_mat = shipped_surfaces().get().changed(height_of=HeightOf.CENTRE_OF_MASS)
    result = dropped(surface=dataclasses.replace(on_mat, uncertainty=low))
    assert result.distribution.drops == 60
    assert result.distribution.model is None
    assert 'released' in result.no_model_range


def test_uncertain_surface_widens_the_range(dropped):
    """A height of 5 mm or 300 mm, at equal odds: the shares at both are within the range."""
    mat, heights = shipped_surfaces().get('rubber_mat'), (0.005, 0.3)
    ends = tuple({'height': height} for height in heights) * 4
    model = dropped(surface=dataclasses.replace(mat, uncertainty=ends)).distribution.model
    assert model.uncertain == ('height',)
    exact = dropped(restitution=0.641).distribution.model
    assert np.diff(model.by_class)[0] > np.diff(exact.by_class)[0]
    for height in heights:
        shares = dropped(1000, height=height, model_range=False).distribution.by_class()
        for (low, high), each in zip(model.by_class, shares.intervals(), strict=True):
            assert low < each.probability < high


@pytest.mark.slow
def test_range_of_bullet_is_about_its_own_shares(dropped):
    result = dropped(60, engine='bullet')
    for each in result.distribution.model_intervals():
        assert each.lower <= each.probability <= each.upper


def test_missing_range_has_a_reason_unless_not_requested(dropped):
    result = dropped(20, surroundings='slope')
    assert result.distribution.model is None
    assert 'level' in result.no_model_range
    assert result.document()['no_model_range'] == result.no_model_range
    states = GivenStates([[0, 0, 0.05]], [[0, 0, 0, 1]])
    assert 'states' in dropped(None, initial_states=states, replicates=3).no_model_range
    result = dropped(model_range=False)
    assert result.no_model_range == ''
    assert result.document()['aspects'][0]['model_lower'] is None


def test_recorded_conditions_are_as_uncertain_as_their_surface():
    mat = shipped_surfaces().get()
    own = Surfaces({'mine': dataclasses.replace(mat, surface='mine', uncertainty=()), 'mat': mat})
    assert own.recorded_uncertainty(own.get('mine')) == ()
    assert own.recorded_uncertainty(dataclasses.replace(mat, surface='other')) is None
    higher = dataclasses.replace(mat.changed(height=0.1), uncertainty=())
    assert shipped_surfaces().recorded_uncertainty(higher) == mat.uncertainty
