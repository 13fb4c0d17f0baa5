"""Write the transitions of an action as a graph in GraphML."""

from pathlib import Path

import networkx as nx
import numpy as np

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.aspects.support import resting_on
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.reorientation.markov import LongRun
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES, TransitionMatrix
from resting_aspects_ros.core.statistics.distribution import Distribution


def save_graphml(
    path: Path,
    part: Part,
    distribution: Distribution,
    matrix: TransitionMatrix,
    long_run: LongRun,
) -> None:
    """Write a directed graph whose nodes are the aspects and whose edges are the transitions.

    Attributes of an aspect are ``id``, ``symmetry_class``, ``rests_on`` (text), ``com_height`` m,
    ``min_barrier`` m (left out for the only aspect, which has none), ``drop_probability`` and
    ``long_run_share``. There is an edge for each pair with a count; its attributes are ``count``,
    ``probability``, ``lower`` and ``upper``. Edges to the nodes ``unclassified``, ``unsettled``,
    ``failed`` and ``lost``, which exist if they have a count, are the other ends of actions, so
    the probabilities of the edges that leave a node add up to 1. Attributes of the graph are
    ``part``, ``part_sha256`` and ``confidence``.

    Parameters
    ----------
    path : Path
    part : Part
    distribution : Distribution
        Drops of the part.
    matrix : TransitionMatrix
        Transitions by aspect; counts (k, k + 4).
    long_run : LongRun
        Long-run shares by aspect.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    graph = nx.DiGraph(
        part=part.name, part_sha256=part.part_sha256, confidence=float(matrix.confidence)
    )
    aspects = matrix.aspects.aspects
    shares = [float(share) for share in long_run.shares]
    for aspect, drop, share in zip(aspects, distribution.intervals(), shares, strict=True):
        barrier = float(aspect.min_barrier)
        graph.add_node(
            str(aspect.id),
            id=aspect.id,
            symmetry_class=aspect.symmetry_class,
            rests_on=resting_on(part, aspect),
            com_height=float(aspect.com_height),
            **({'min_barrier': barrier} if np.isfinite(barrier) else {}),
            drop_probability=drop.probability,
            long_run_share=share,
        )
    names = [*(str(aspect.id) for aspect in aspects), *OUTCOMES]
    probability, (lower, upper) = matrix.probability, matrix.bounds()
    for row, column in np.argwhere(matrix.counts).tolist():
        graph.add_edge(
            names[row],
            names[column],
            count=int(matrix.counts[row, column]),
            probability=float(probability[row, column]),
            lower=float(lower[row, column]),
            upper=float(upper[row, column]),
        )
    with whole_file(path) as temporary, temporary.open('wb') as file:
        # The writer with Python's XML, because the other one depends on whether lxml is installed.
        nx.write_graphml_xml(graph, file)
