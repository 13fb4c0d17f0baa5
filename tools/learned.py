"""Drops random solids, fits the learned estimator to the drops, and judges all methods on them.

    learned.py [--solids N] [--test-drops N] [--scheduler ADDRESS] [--no-drops]

The drops are kept in out/learned, so that a run that was broken off continues. Writes the
coefficients of the estimator, and the section on random solids of docs/explanation/estimators.md.
With its default numbers it takes about an hour on two cores; with the address of a Dask scheduler,
the drops are simulated on its cluster.
"""

import argparse
import json
import warnings
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from learned_drops import (
    BOUNDS,
    ROOT,
    Case,
    counted,
    held_out_cases,
    job_of,
    line,
    read_lines,
    shape_of,
    training_cases,
)
from learned_fit import Drops, drops_of, fit, fit_weight, predictions
from learned_judge import KindModel, judged
from learned_page import write_section
from learned_solids import KINDS
from rich.progress import track

from resting_aspects_ros.cli.start_workers import start_workers
from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.core.estimators.aspect_features import AspectFeatures, aspect_features
from resting_aspects_ros.core.estimators.estimate import LEARNED, METHODS, estimate_each
from resting_aspects_ros.core.estimators.learned import FILE, LearnedModel
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.local_workers import default_workers

FOLDER = ROOT / 'out' / 'learned'
# Two cases of 125 drops each: 0.9 million drops.
SOLIDS = 3600
TEST_DROPS = 20_000
SEED = 1
# Solids with fewer aspects need no estimate; those with more have few drops of each.
MIN_ASPECTS, MAX_ASPECTS = 2, 60
DIGITS = 5


def main() -> None:
    """Simulate what is missing, fit, judge, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--solids', type=int, default=SOLIDS)
    parser.add_argument('--test-drops', type=int, default=TEST_DROPS)
    parser.add_argument('--no-drops', action='store_true', help='use the drops that are known')
    parser.add_argument('--workers', type=int)
    parser.add_argument('--scheduler')
    arguments = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    training, test = FOLDER / 'training.jsonl', FOLDER / 'test.jsonl'
    if not arguments.no_drops:
        with ExitStack() as stack:
            workers = start_workers(arguments, stack)
            wanted = (c for k in range(arguments.solids) for c in training_cases(k))
            simulate(track(list(wanted), 'training'), training, workers)
            simulate(track(held_out_cases(arguments.test_drops), 'test'), test, workers)
    fitted = known_cases(training)
    tested = known_cases(test)
    solids = {case.solid for case, _ in [*fitted, *tested]}
    features = features_of(solids, arguments.workers or default_workers())
    fitted = [each for each in fitted if each[0].solid in features]
    tested = [each for each in tested if each[0].solid in features]
    model, by_kind = fit_all(fitted, features)
    FILE.write_text(document_of(model) + '\n', encoding='utf-8')
    print(f'Written: {FILE}')
    write_section(judged(fitted, tested, features, by_kind))


def simulate(cases: Iterable[Case], path: Path, workers: Workers) -> None:
    """Append the counts of the cases that a file does not have yet."""
    known = {case.key: case.drops for case, _ in read_lines(path)}
    pending: deque[tuple[Case, Any, list[Future[Any]]]] = deque()
    with path.open('a', encoding='utf-8') as file:

        def finish() -> None:
            case, shape, futures = pending.popleft()
            counts = [counted(shape.aspects, workers.result(each)) for each in futures]
            file.write(line(case, [sum(column) for column in zip(*counts, strict=True)]) + '\n')
            file.flush()

        shape, solid = None, None
        for case in cases:
            if known.get(case.key, 0) >= case.drops:
                continue
            if case.solid != solid:
                solid, shape = case.solid, _shape(case)
            if shape is None:
                continue
            job = job_of(case, shape)
            ends = [*range(CHUNK, case.drops, CHUNK), case.drops]
            starts = [0, *ends[:-1]]
            futures = [workers.submit(job, *pair) for pair in zip(starts, ends, strict=True)]
            pending.append((case, shape, futures))
            while len(pending) > max(1, workers.lookahead()):
                finish()
        while pending:
            finish()


def _shape(case: Case) -> Any:
    """Return the solid of a case; None if it is not used."""
    try:
        shape = shape_of(*case.solid)
    except RestingAspectsError as error:
        warnings.warn(f'solid {case.index}: {error}', stacklevel=2)
        return None
    return shape if MIN_ASPECTS <= len(shape.aspects) <= MAX_ASPECTS else None


def known_cases(path: Path) -> list[tuple[Case, list[int]]]:
    """Return the cases of a file; of a repeated case the last."""
    return list({case.key: (case, counts) for case, counts in read_lines(path)}.values())


SolidFeatures = tuple[AspectFeatures, dict[str, Array]]


def features_of(
    solids: set[tuple[int, int]], workers: int
) -> dict[tuple[int, int], SolidFeatures]:
    """Return the features of solids, and the probabilities by each analytic method."""
    order = sorted(solids)
    with ProcessPoolExecutor(workers) as pool:
        found = pool.map(_features, order, chunksize=8)
        return dict(zip(order, track(found, 'features', total=len(order)), strict=True))


def _features(solid: tuple[int, int]) -> SolidFeatures:
    shape = shape_of(*solid)
    analytic = [name for name in METHODS if name != LEARNED]
    found, _ = estimate_each(shape, analytic)
    return aspect_features(shape), {name: each.probabilities for name, each in found.items()}


def fit_all(
    fitted: list[tuple[Case, list[int]]], features: dict[tuple[int, int], SolidFeatures]
) -> tuple[LearnedModel, dict[str, KindModel]]:
    """Return the model, and models that were fitted without each kind."""
    cases, counts = [c for c, _ in fitted], [n for _, n in fitted]
    drops = drops_of([features[c.solid][0] for c in cases], cases, counts)
    kind = np.array([c.kind for c in cases])
    unseen = np.zeros(len(drops.case))
    models: dict[str, LearnedModel] = {}
    for each in track(list(KINDS), 'without a kind'):
        if not (kind == each).any():
            continue
        models[each] = fit(drops.select(kind != each), BOUNDS, SEED)
        rows = (kind == each)[drops.case]
        unseen[rows] = predictions(models[each], drops.select(kind == each))
    model = fit(drops, BOUNDS, SEED)
    everything = _weight(model, drops, unseen, np.ones(len(cases), dtype=bool))
    weights = {
        each: KindModel(models[each], _weight(model, drops, unseen, kind != each))
        for each in models
    }
    return model.weighing(everything), weights


def _weight(model: LearnedModel, drops: Drops, unseen: Array, cases: Any) -> Array:
    part, conditions = (
        model.of_part.scaled(drops.part),
        model.of_conditions.scaled(drops.conditions),
    )
    return fit_weight(
        part[cases], conditions[cases], drops.select(cases), unseen[cases[drops.case]]
    )


def document_of(model: LearnedModel) -> str:
    """Return the coefficients as JSON."""

    def rounded(values: Array) -> Any:
        if values.ndim > 1:
            return [rounded(each) for each in values]
        return [float(f'{value:.{DIGITS}g}') for value in values.tolist()]

    scalings = {
        'aspects': model.of_aspects,
        'part': model.of_part,
        'conditions': model.of_conditions,
    }
    return json.dumps(
        {
            'recipe': 'make learned',
            'bounds': {name: list(pair) for name, pair in vars(model.bounds).items()},
            'scaling': {
                name: {'mean': rounded(each.mean), 'deviation': rounded(each.deviation)}
                for name, each in scalings.items()
            },
            'weight': rounded(model.weight),
            'members': [
                {name: rounded(values) for name, values in vars(member).items()}
                for member in model.members
            ],
        },
        separators=(',', ':'),
    )


if __name__ == '__main__':
    main()
