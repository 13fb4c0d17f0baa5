"""The result of a run of drops, with its JSON document, picture and report."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.api.conditions import conditions_text, simulated_shapes
from resting_aspects_ros.api.given_states import CountsByState
from resting_aspects_ros.api.model_range import model_range_text
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import Convergence
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import distribution_document
from resting_aspects_ros.report.drops import contact_rows
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import METHOD, Distribution, Placements
from resting_aspects_ros.statistics.poses import RestingPoses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.api.counts import CountedDrops
    from resting_aspects_ros.report.page import Page


@dataclasses.dataclass(frozen=True, eq=False)
class DropResult(Result):
    """The distribution of a run, with the run, its part and its poses.

    Attributes
    ----------
    distribution : Distribution
        Counts, probabilities and intervals over the aspects.
    run : RunDescription
        Conditions, seed, engine and versions.
    part : Part or None
        None if only its name and hash are known.
    complete : bool
        Whether all drops that were requested are counted.
    convergence : Convergence or None
        How far the distribution moves with a finer time step, if that was checked.
    mesh_file : Path or None
        The file from which the part was read, if it was given as a file.
    history : ((m,) int, (m, k) int) or None
        Numbers of drops, ascending, and the counts of the k aspects after each number.
    poses : RestingPoses or None
        The resting poses, if they were kept.
    log : Path or None
        The folder of the log of the run, if one was written.
    by_state : CountsByState or None
        Counts by initial state, if the initial states were given.
    contacts : Placements or None
        Counts by what the parts touch, if the surroundings have walls.
    no_model_range : str
        Why the distribution has no model range, if one was requested.
    """

    distribution: Distribution
    run: RunDescription
    part: Part | None
    complete: bool
    convergence: Convergence | None = None
    mesh_file: Path | None = None
    history: tuple[Counts, Counts] | None = None
    poses: RestingPoses | None = None
    log: Path | None = None
    by_state: CountsByState | None = None
    contacts: Placements | None = None
    no_model_range: str = ''

    @property
    def title(self) -> str:
        """Part, drops, surface and seed in one line."""
        return f'{self.run.part}, {self.subtitle}'

    @property
    def subtitle(self) -> str:
        """Number of drops (and how many were requested, if more), surface and seed."""
        surface = conditions_text(self.run.conditions)
        of = '' if self.complete else f' of {self.run.drops}'
        return f'{self.distribution.drops}{of} drops on {surface}, seed {self.run.seed}'

    @property
    def range_text(self) -> str:
        """What the model range covers, or why there is none; can be empty."""
        return model_range_text(self.distribution.model, self.no_model_range)

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects drop --json` prints."""
        fields: dict[str, object] = {
            **self.run.document(),
            'mesh_sha256': self.part.mesh_sha256 if self.part else None,
            'mesh_file': str(self.mesh_file.absolute()) if self.mesh_file else None,
            'unit': self.part.unit if self.part else None,
            'body': self.part.body or None if self.part else None,
            'method': METHOD,
            'complete': self.complete,
            'drops_asked': self.run.drops,
            'no_model_range': self.no_model_range or None,
            'history': self.history
            and [
                {'drops': n, 'counts': row}
                for n, row in zip(*(each.tolist() for each in self.history), strict=True)
            ],
        }
        if self.by_state is not None:
            fields['initial_states'] = {
                'columns': self.by_state.columns,
                'counts': self.by_state.counts,
            }
        if shapes := simulated_shapes(self.part, self.run.conditions):
            fields |= shapes.document()
        if self.contacts is not None:
            fields['contacts'] = contact_rows(self.contacts, self.distribution)
        if self.convergence is not None:
            fields['convergence'] = self.convergence
        return distribution_document(self.distribution, fields, self.part)

    def page(self, against: 'CountedDrops | None' = None) -> 'Page':
        """Return a page with pictures, charts and all numbers; beside other counts, if given."""
        # This import takes about a second.
        from resting_aspects_ros.api.report_files import result_page

        return result_page(self, against)

    def figure(self) -> 'Figure':
        """Return a bar for each symmetry class, with a picture of the part in it."""
        from resting_aspects_ros.report.drop_figures import distribution_figure

        return distribution_figure(self.distribution, self.part, self.title, self.range_text)
