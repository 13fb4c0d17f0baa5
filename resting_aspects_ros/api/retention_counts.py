"""Retention curves of a part, with their JSON document: what a report is made from."""

import dataclasses

from resting_aspects_ros.api.condition_text import surface_text
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.reorientation.retention import RetentionCurve
from resting_aspects_ros.report.document import SCHEMA_VERSION, aspect_fields
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.report.transition_document import retention_fields
from resting_aspects_ros.simulation.run_description import RunDescription


@dataclasses.dataclass(frozen=True, eq=False)
class RetentionCounts:
    """The retention curves of a part.

    Attributes
    ----------
    curves : tuple of RetentionCurve
        A curve for each aspect that was disturbed, by id.
    aspects : AspectSet
    run : RunDescription
    part : Part
    complete : bool
        Whether all disturbances are counted.
    """

    curves: tuple[RetentionCurve, ...]
    aspects: AspectSet
    run: RunDescription
    part: Part
    complete: bool

    @property
    def title(self) -> str:
        """Part, surface and seed in one line."""
        surface = surface_text(self.run.conditions)
        return f'{self.run.part}, disturbed on {surface}, seed {self.run.seed}'

    def to_json(self) -> str:
        """Return the JSON document that `resting_aspects retention --json` prints."""
        run = self.run.document()
        asked = run.pop('drops')
        del run['precision']
        return json_text(
            {
                'schema_version': SCHEMA_VERSION,
                **run,
                'mesh_sha256': self.part.mesh_sha256,
                'disturbances_asked': asked,
                'complete': self.complete,
                'aspects': [aspect_fields(each, self.part) for each in self.aspects.aspects],
                'curves': [retention_fields(curve) for curve in self.curves],
            }
        )
