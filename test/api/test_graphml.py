"""Transitions as GraphML, read back by networkx."""

import networkx as nx
import numpy as np
import pytest
import trimesh

from resting_aspects_ros.api.graphml import save_graphml
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import OutputError
from resting_aspects_ros.core.reorientation.markov import long_run
from resting_aspects_ros.core.reorientation.transition_matrix import (
    TransitionMatrix,
    no_actions,
)
from resting_aspects_ros.core.statistics.distribution import Distribution, no_drops


@pytest.fixture(scope='module')
def box(part):
    return part('box_10x20x30')


@pytest.fixture(scope='module')
def saved(box, tmp_path_factory):
    """Return the file of a box, with what is in it."""
    aspects = find_aspects(box)
    drops = Distribution(aspects, np.array([300, 310, 100, 90, 20, 25]), 5, 0, 0)
    counts = np.random.default_rng(1).multinomial(50, np.ones(10) / 10, size=6)
    counts[0] = [40, 0, 0, 9, 0, 0, 1, 0, 0, 0]
    counts[:, 7:9] = 0  # unsettled, failed
    matrix = TransitionMatrix(aspects, counts)
    found = long_run(matrix.transitions, matrix.left, drops.counts / drops.drops)
    path = tmp_path_factory.mktemp('graphml') / 'box.graphml'
    save_graphml(path, box, drops, matrix, found)
    return path, drops, matrix, found


def test_sums_of_the_graph_agree(saved):
    path, drops, matrix, found = saved
    graph = nx.read_graphml(path)
    aspects = [str(k) for k in range(1, 7)]
    for row, node in enumerate(aspects):
        edges = [edge for _, _, edge in graph.out_edges(node, data=True)]
        assert sum(edge['count'] for edge in edges) == matrix.actions[row]
        assert sum(edge['probability'] for edge in edges) == pytest.approx(1)
        assert all(edge['lower'] <= edge['probability'] <= edge['upper'] for edge in edges)
    total = sum(graph.nodes[node]['drop_probability'] for node in aspects)
    assert total == pytest.approx(drops.counts.sum() / drops.drops)
    shares = [graph.nodes[node]['long_run_share'] for node in aspects]
    assert shares == found.shares.tolist()
    assert sum(shares) == pytest.approx(1)


def test_the_graph_has_only_transitions_with_a_count(saved):
    path, _, matrix, _ = saved
    graph = nx.read_graphml(path)
    assert graph.is_directed()
    assert set(graph) == {'1', '2', '3', '4', '5', '6', 'unclassified', 'lost'}
    assert graph.number_of_edges() == np.count_nonzero(matrix.counts)
    assert graph.edges['1', '4']['count'] == 9
    assert graph.edges['1', 'unclassified']['probability'] == 1 / 50
    assert not graph.has_edge('1', '2')


def test_nodes_describe_their_aspects(saved, box):
    path, _, matrix, _ = saved
    graph = nx.read_graphml(path)
    for aspect in matrix.aspects.aspects:
        node = graph.nodes[str(aspect.id)]
        assert (node['id'], node['symmetry_class']) == (aspect.id, aspect.symmetry_class)
        assert (node['com_height'], node['min_barrier']) == (
            aspect.com_height,
            aspect.min_barrier,
        )
    assert graph.nodes['1']['rests_on'] == 'flat side 20 x 30 mm'
    assert graph.nodes['lost'] == {}
    assert graph.graph['part'] == box.name
    assert graph.graph['part_sha256'] == box.part_sha256
    assert graph.graph['confidence'] == 0.95


def test_the_only_aspect_has_no_barrier(solid, tmp_path):
    ball = solid(trimesh.creation.icosphere(3, radius=10))
    aspects = find_aspects(ball)
    counts = no_actions(aspects).counts
    counts[0, 0] = 10
    matrix = TransitionMatrix(aspects, counts)
    found = long_run(matrix.transitions, matrix.left, np.ones(1))
    save_graphml(tmp_path / 'g.xml', ball, no_drops(aspects), matrix, found)
    graph = nx.read_graphml(tmp_path / 'g.xml')
    assert list(graph) == ['1']
    assert 'min_barrier' not in graph.nodes['1']
    assert graph.edges['1', '1']['probability'] == 1


def test_failed_writing_is_an_error(saved, box, tmp_path):
    _, *given = saved
    with pytest.raises(OutputError, match='cannot be written'):
        save_graphml(tmp_path / 'none' / 'g.graphml', box, *given)
    assert list(tmp_path.iterdir()) == []
