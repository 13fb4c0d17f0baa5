"""A request that names no surface: simulator and classifier mean the same by it, always."""

import pytest
from resting_aspects_interfaces.msg import DropConditions, Status

from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.nodes.interface import DEFAULT_CONDITIONS, LATCHED


@pytest.fixture
def simulator(suite, parameters_of):
    """The parameters of the simulator; its surface is the default again after the test."""
    found = parameters_of(suite.client, 'drop_simulator')
    yield found
    assert found.set(surface='rubber_mat') == []
    classifier = parameters_of(suite.client, 'aspect_classifier')
    suite.client.wait(lambda: classifier.get('surface') == 'rubber_mat', 'surface as before')


@pytest.fixture
def classifier(suite, parameters_of):
    return parameters_of(suite.client, 'aspect_classifier')


@pytest.fixture
def surfaces_meant(suite):
    """The surfaces that drop_part and get_distribution mean by none."""

    def surfaces_meant(seed):
        heard = suite.client.poses()
        run_id = suite.client.drop(drops=3, seed=seed).result.run_id
        suite.client.wait(lambda: any(b.run.run_id == run_id for b in heard), 'poses')
        (dropped,) = {b.run.conditions.surface for b in heard if b.run.run_id == run_id}
        answer = suite.client.ask(drops=3, seed=[seed])
        assert answer.distribution.run.run_id == run_id, 'the same conditions: it is known'
        return dropped, answer.distribution.run.conditions.surface

    return surfaces_meant


def test_without_a_surface_all_mean_the_simulator_s(suite, simulator, classifier, surfaces_meant):
    assert surfaces_meant(seed=101) == ('rubber_mat', 'rubber_mat')
    assert simulator.set(surface='steel') == []
    suite.client.wait(lambda: classifier.get('surface') == 'steel', 'surface of the classifier')
    assert surfaces_meant(seed=101) == ('steel', 'steel')
    # What names a surface is not touched.
    named = suite.client.ask(drops=3, seed=[101], surface='rubber_mat').distribution
    assert named.run.conditions.surface == 'rubber_mat'


def test_conditions_that_are_given_are_not_touched(suite, simulator):
    assert simulator.set(surface='steel') == []
    conditions = suite.client.ask(drops=2, surface='thrown').distribution.run.conditions
    conditions.friction = 0.7
    answer = suite.client.ask(drops=2, conditions=[conditions])
    assert answer.distribution.run.conditions.friction == 0.7
    assert answer.distribution.run.conditions.spin == conditions.spin > 0


def test_the_default_is_published_whole(suite, simulator, surfaces):
    heard = suite.client.listen(DropConditions, DEFAULT_CONDITIONS, LATCHED)
    suite.client.wait(lambda: heard, 'default conditions')
    simulator.set(surface='thrown')
    suite.client.wait(lambda: heard[-1].surface == 'thrown', 'new default conditions')
    assert heard[-1].spin == surfaces.get('thrown').spin
    assert heard[-1].friction == surfaces.get('thrown').friction


def test_the_classifier_s_is_not_set_apart_from_a_simulator_that_is_there(classifier):
    assert classifier.set(surface='rubber_mat') == []  # what it is
    (words,) = classifier.set(surface='steel')
    assert words == (
        "surface is 'steel', allowed is 'rubber_mat' while drop_simulator is there, which says "
        'so: set it there'
    )
    assert classifier.get('surface') == 'rubber_mat'


def test_whoever_comes_last_they_agree(fresh_suite, parameters_of):
    suite = fresh_suite(workers=1, surface='steel')
    classifier = parameters_of(suite.client, 'aspect_classifier')
    simulator = parameters_of(suite.client, 'drop_simulator')
    suite.client.wait(lambda: classifier.get('surface') == 'steel', 'what the simulator says')
    assert "surface is 'steel', as the simulator says; it was 'rubber_mat'" in (
        suite.processes['aspect_classifier'].said
    )
    assert simulator.set(surface='thrown') == []
    suite.client.wait(lambda: classifier.get('surface') == 'thrown', 'what was set')

    # A classifier that comes later hears it before it answers for a part.
    suite.processes['aspect_classifier'].end()
    suite.start_again('aspect_classifier')
    asked = suite.client.ask(drops=2).distribution
    assert asked.run.conditions.surface == 'thrown'

    # Without a simulator it may be set; what is known stays known.
    suite.processes['drop_simulator'].end()
    suite.client.wait(
        lambda: not suite.client.node.count_publishers(f'{suite.namespace}/{DEFAULT_CONDITIONS}'),
        'end of the simulator',
    )
    suite.client.wait(lambda: classifier.set(surface='rubber_mat') == [], 'rubber_mat')
    known = suite.client.ask(drops=2, only_known=True)
    assert known.status.code == Status.NOT_AVAILABLE
    assert classifier.set(surface='thrown') == []
    assert suite.client.ask(drops=2, only_known=True).distribution.run == asked.run

    # One that is started again says what it was started with.
    suite.start_again('drop_simulator')
    suite.client.wait(lambda: classifier.get('surface') == 'steel', 'steel again')
    assert suite.client.ask(drops=2).distribution.run.conditions.surface == 'steel'


def test_a_surface_that_only_the_simulator_knows_is_meant_nevertheless(
    fresh_suite, parameters_of, tmp_path
):
    text = surfaces_file().read_text(encoding='utf-8')
    own = text.replace('steel:', 'granite:').replace('friction: 0.15', 'friction: 0.17')
    (tmp_path / 'own.yaml').write_text(own, encoding='utf-8')
    suite = fresh_suite(workers=1, surface='granite', surfaces_file=tmp_path / 'own.yaml')
    conditions = suite.client.ask(drops=2).distribution.run.conditions
    assert (conditions.surface, conditions.friction) == ('granite', 0.17)
    assert parameters_of(suite.client, 'aspect_classifier').get('surface') == 'granite'
    refused = suite.client.ask(drops=2, surface='granite').status
    assert (
        refused.message == "surface 'granite' is not known, allowed is rubber_mat, steel, thrown"
    )
