"""The aspect_classifier node: counts resting poses by aspect and answers requests."""

import sys
from pathlib import Path
from typing import Any

from rclpy.node import Node
from resting_aspects_interfaces.msg import PartDescription
from resting_aspects_interfaces.srv import ClassifyPose, GetTransitions

from resting_aspects_ros.nodes.aspect_classifier.counting import (
    DropCounter,
    ModelRanges,
    Tallies,
    Tally,
)
from resting_aspects_ros.nodes.aspect_classifier.known import (
    LogLoader,
    PartRegistry,
    TransitionStore,
)
from resting_aspects_ros.nodes.aspect_classifier.live import LIVE_PARAMETERS, LiveMonitor
from resting_aspects_ros.nodes.aspect_classifier.outlines import (
    IdentificationService,
    OutlineStore,
)
from resting_aspects_ros.nodes.aspect_classifier.publishers import (
    PUBLISH_PERIOD,
    DistributionPublisher,
)
from resting_aspects_ros.nodes.aspect_classifier.services import (
    DistributionService,
    ForecastService,
    answer_pose,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import start_task, steady_timer
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient
from resting_aspects_ros.ros.health import (
    Diagnosis,
    DuplicateNodeDetector,
    TopicDiscovery,
    publish_diagnostics,
)
from resting_aspects_ros.ros.interface import (
    ASPECT_CLASSIFIER,
    CLASSIFY_POSE,
    GET_TRANSITIONS,
    PARTS,
)
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, declare, run_node
from resting_aspects_ros.ros.requests import (
    SURROUNDINGS_FOLDER,
    DefaultConditionsSubscriber,
    NotAvailableError,
    RequestedSurroundings,
    serve,
)
from resting_aspects_ros.simulation.conditions import all_surfaces
from resting_aspects_ros.statistics.distribution import Distribution

PARAMETERS = (
    Parameter('surfaces_file', '', 'YAML file of surfaces beside those of the suite'),
    SURROUNDINGS_FOLDER,
    FRAME_ID,
    PUBLISH_PERIOD,
    Parameter(
        'log_folder',
        'out/logs',
        'folder of logs, from which earlier runs are read at the start; empty: none',
    ),
    *LIVE_PARAMETERS,
)
# A forecast for a part with very many triangles needs more time than a file, s.
MAX_SECONDS = 120.0


class AspectClassifier(Node):
    """Subscribes to resting_poses, transitions/*, parts/*, observed_counts/*, default_conditions.

    Publishes aspect_distributions/<part>, outlines/<part>, posterior/<part>, markers,
    surroundings_markers and current_poses, and known transitions/<part>. Serves
    get_distribution, get_transitions, classify_pose, identify_part and forecast.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(ASPECT_CLASSIFIER, **options)
        values = declare(self, PARAMETERS)
        surfaces = all_surfaces(values['surfaces_file'])
        self._files = FileWorker(self)
        self._worker = FileWorker(self, MAX_SECONDS)  # of model ranges, drift tests and forecasts
        self._client = DropClient(self)
        self._parts = PartRegistry(
            self, self._files, self._on_part_read, self._client.is_ready, self._check_ready
        )
        self._known = Tallies(self._parts.aspects)
        folder = Path(values['log_folder']) if values['log_folder'] else None
        self._transitions = TransitionStore(self, self._parts)
        self._logs = LogLoader(self, folder, self._files, self._known, self._transitions)
        self._outputs = DistributionPublisher(self, self._parts, self._files)
        self._ranges = ModelRanges(self, self._parts, surfaces, self._worker)
        self._counter = DropCounter(
            self, self._parts, self._known, self._outputs, self._client, self._ranges
        )
        DistributionService(
            self,
            surfaces,
            RequestedSurroundings(self, values[SURROUNDINGS_FOLDER.name], self._files),
            DefaultConditionsSubscriber(self),
            self._known,
            self._client,
            self._parts,
            self._ranges,
        )
        self._outlines = OutlineStore(self, self._files, self._parts, self._newest)
        self._vision = IdentificationService(self, self._parts, self._outlines)
        self._monitor = LiveMonitor(
            self, self._parts, self._known, self._transitions, self._worker
        )
        ForecastService(self, self._parts, self._transitions, self._monitor, self._worker)
        self._discovery = TopicDiscovery(
            self, PARTS, PartDescription, self._on_description, gone=self._parts.remove, raw=True
        )
        serve(self, GetTransitions, GET_TRANSITIONS, self._get_transitions)
        serve(self, ClassifyPose, CLASSIFY_POSE, self._classify_pose)
        self._start = steady_timer(self, 0.0, self._load_logs)

    def close(self) -> None:
        """Destroy the action clients and end the processes that read files."""
        self._files.stop()
        self._worker.stop()
        self._vision.stop()
        self._client.destroy()

    # Start

    def _load_logs(self) -> None:
        self.destroy_timer(self._start)
        failure = 'the results of earlier runs are not published'
        start_task(self, failure, self._logs.load, self._on_logs_read)

    def _on_logs_read(self) -> None:
        """Publish known results and diagnostics, and log that the node is ready."""
        for part in self._parts.offered().values():
            self._publish_known(part)
        publish_diagnostics(self, self._diagnose, DuplicateNodeDetector(self, ASPECT_CLASSIFIER))
        self.get_logger().info('ready')

    def _check_ready(self) -> None:
        """Raise NotAvailableError while logs are being read, which may contain the answer."""
        if not self._logs.ready:
            raise NotAvailableError(self._logs.state)

    # Topics

    def _on_description(self, name: str, data: bytes) -> None:
        failure = f'ignored a description of {name}'
        start_task(self, failure, self._parts.describe, name, data)

    def _on_part_read(self, part: Part) -> None:
        for run in self._known.remove_inconsistent(part.part_sha256):
            self.get_logger().warning(
                f'ignored the log of run {run.run_id}: its aspects are not those of {part.name}'
            )
        self._outputs.topics.offer(part.name)  # before the first run, so that no message is missed
        self._publish_known(part)
        self._counter.part_changed(part.part_sha256)

    def _publish_known(self, part: Part) -> None:
        """Publish the results of earlier runs, unless newer ones are published, and outlines."""
        if not self._logs.ready:
            return
        self._outlines.update(part)
        if (known := self._known.newest(part.part_sha256)) is not None:
            start_task(self, 'an earlier distribution is not published', self._restore, known)
        self._transitions.publish(part.name)

    async def _restore(self, known: Tally) -> None:
        await self._ranges.add(known)
        self._outputs.restore(known)

    def _diagnose(self) -> Diagnosis:
        found = self._counter.diagnose()
        values = {**found.values, 'parts counted': self._monitor.counted}
        return Diagnosis(found.state, values, [*found.warnings, *self._monitor.warnings()])

    def _newest(self, part_sha256: str) -> Distribution | None:
        """Return the distribution of a part that is published."""
        newest = self._known.newest(part_sha256)
        return None if newest is None else newest.distribution

    # Services

    async def _get_transitions(
        self, request: GetTransitions.Request, response: GetTransitions.Response
    ) -> None:
        response.transitions = await self._transitions.newest(request.part, request.action)

    async def _classify_pose(
        self, request: ClassifyPose.Request, response: ClassifyPose.Response
    ) -> None:
        sha = (await self._parts.requested(request.part)).part_sha256
        answer_pose(request, response, self._parts.version(sha)[1], self._newest(sha))


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(AspectClassifier, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
