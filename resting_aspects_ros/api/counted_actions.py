"""The counts of an action on a part: transition matrix, long-run shares, wanted aspects."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import TypeVar, cast

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.api.transition_counter import MatrixConvergence
from resting_aspects_ros.core.errors import InvalidValueError, analysis
from resting_aspects_ros.core.geometry.decomposition import ConvexPieces
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.reorientation.markov import (
    LongRun,
    long_run,
    long_run_bounds,
    reach,
    with_replacement,
)
from resting_aspects_ros.core.reorientation.transition_matrix import TransitionMatrix
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.statistics.distribution import OUTSIDE, Distribution
from resting_aspects_ros.report.document import SCHEMA_VERSION, aspect_fields, plain, share_fields
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.report.transition_document import long_run_fields, matrix_fields
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.run_description import RunDescription

T = TypeVar('T', bound='CountedActions')


@dataclasses.dataclass(frozen=True, eq=False)
class CountedActions:
    """The transitions that an action causes, with the drops that replace parts that left.

    Attributes
    ----------
    matrix : TransitionMatrix
        Counts, probabilities and intervals from each aspect.
    action : NamedAction
    run : RunDescription
        Conditions, seed, engine and versions; ``drops`` is the number of requested actions.
    part : Part
    drop : Distribution
        Where parts come to rest that are dropped under the same conditions.
    complete : bool
        Whether all actions that were requested are counted.
    convergence : MatrixConvergence or None
        How far the matrix moves with a finer time step, if that was checked.
    pieces : ConvexPieces or None
        The convex pieces of the part that meet an edge, and their difference from it; None for
        actions without an edge, and in a result that was read from a log.
    """

    matrix: TransitionMatrix
    action: NamedAction
    run: RunDescription
    part: Part
    drop: Distribution
    complete: bool
    convergence: MatrixConvergence | None = None
    pieces: ConvexPieces | None = None

    @property
    def title(self) -> str:
        """Part, action, surface and seed in one line."""
        return (
            f'{self.run.part}, {self.action.name} on {conditions_text(self.run.conditions)}, '
            f'seed {self.run.seed}'
        )

    def by_class(self: T) -> T:  # noqa: PYI019 (Python 3.10 has no Self)
        """Return the result over symmetry classes; their numbers replace the ids of aspects."""
        return cast(T, self._by_class)

    @cached_property
    def _by_class(self) -> 'CountedActions':
        return dataclasses.replace(self, matrix=self.matrix.by_class(), drop=self.drop.by_class())

    @property
    def drop_shares(self) -> Array:
        """(k,) share of each aspect in the drops."""
        return np.asarray(self.drop.counts / max(self.drop.drops, 1))

    @cached_property
    def long_run(self) -> LongRun | None:
        """The mix that repeated actions lead to; None if actions or drops are missing for it."""
        if not (self.matrix.actions > 0).all() or not self.drop.counts.any():
            return None
        found: LongRun | None = None
        with analysis(f'the long-run shares of {self.action.name}'):
            found = long_run(self.matrix.transitions, self.matrix.left, self.drop_shares)
        return found  # noqa: RET504 the analysis can fail

    @cached_property
    def long_run_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,) of the long-run shares."""
        generator = np.random.default_rng(self.run.seed)
        m = self.matrix
        return long_run_bounds(m.counts, self.drop_shares, m.confidence, generator)

    @property
    def chain(self) -> Array:
        """(k, k) transitions in which parts that left the aspects are replaced by dropped parts.

        Raises InvalidValueError if actions or drops are missing for it.
        """
        if self.long_run is None:
            raise InvalidValueError(
                f'invalid result of {self.action.name}: expected actions from each aspect, and '
                'drops that come to rest in an aspect'
            )
        return with_replacement(self.matrix.transitions, self.matrix.left, self.drop_shares)

    def reach(self, wanted: Sequence[int]) -> tuple[Array, Array]:
        """Return how likely repeated actions lead to wanted aspects, and after how many.

        Parameters
        ----------
        wanted : sequence of int
            Ids of aspects.

        Returns
        -------
        probability, actions : (k,) float
            For each aspect the probability to reach a wanted aspect before leaving the aspects,
            and the expected number of actions if it is reached; NaN if it never is.

        Raises
        ------
        InvalidValueError
            If an id is not known, or if actions are missing.
        """
        mask = wanted_mask(wanted, len(self.matrix.counts))
        if not (self.matrix.actions > 0).all():
            raise InvalidValueError('invalid result: expected actions from each aspect')
        return reach(self.matrix.transitions, mask)

    def document(self, wanted: Sequence[int] = ()) -> dict[str, object]:
        """Return the document that `resting_aspects reorient --json` prints."""
        run = self.run.document()
        actions, by_precision = run.pop('drops'), run.pop('precision')
        rows = zip(self.drop.aspects.aspects, self.drop.counts, self.drop.intervals(), strict=True)
        document: dict[str, object] = {
            'schema_version': SCHEMA_VERSION,
            **run,
            'mesh_sha256': self.part.mesh_sha256,
            'precision': by_precision,
            'action': plain(self.action.values),
            'actions_asked': actions,
            'complete': self.complete,
            'energy_growth': self.matrix.energy_growth,
            'confidence': self.matrix.confidence,
            'interval': self.matrix.interval,
            'aspects': [
                aspect_fields(aspect, self.part) | share_fields(int(count), interval)
                for aspect, count, interval in rows
            ],
            'drop': {
                'drops': self.drop.drops,
                'counts': plain(self.drop.counts),
                **{name: getattr(self.drop, name) for name in OUTSIDE},
            },
            **matrix_fields(self.matrix),
            'long_run': None,
        }
        if self.run.conditions.surroundings is not None:
            document['sliding'] = self.matrix.sliding
        view = self.by_class()
        if self.long_run is not None and view.long_run is not None:
            with analysis('the bounds of the long-run shares'):
                aspects = self.matrix.aspects
                document |= long_run_fields(self.long_run, *self.long_run_bounds, aspects)
                lower, upper = view.long_run_bounds
                document['classes'] = {
                    **matrix_fields(self.matrix)['classes'],
                    'long_run': plain(view.long_run.shares),
                    'long_run_lower': plain(lower),
                    'long_run_upper': plain(upper),
                }
        if wanted and (self.matrix.actions > 0).all():
            probability, number = self.reach(wanted)
            document['wanted'] = {
                'aspects': sorted(set(wanted)),
                'probability': plain(probability),
                'actions': plain(number),
            }
        if self.convergence is not None:
            document['convergence'] = plain(self.convergence)
        if self.pieces is not None:
            document['convex_pieces'] = self.pieces.summary()
        return document

    def to_json(self, wanted: Sequence[int] = ()) -> str:
        """Return the document as text."""
        return json_text(self.document(wanted))


def wanted_mask(
    wanted: Sequence[int], aspects: int, what: str = 'aspect'
) -> npt.NDArray[np.bool_]:
    """Return a mask (k,) of wanted aspects; raises InvalidValueError if an id is not known."""
    if not wanted:
        raise InvalidValueError(f'invalid wanted {what}: expected at least one')
    for k in wanted:
        if not isinstance(k, int) or not 1 <= k <= aspects:
            raise InvalidValueError(f'invalid wanted {what} {k!r}: expected 1 to {aspects}')
    return np.isin(np.arange(1, aspects + 1), list(wanted))
