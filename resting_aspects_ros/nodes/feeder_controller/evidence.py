"""What is known of the part of a controller: its drops, its flips, and which of them fit it."""

from rclpy.node import Node
from resting_aspects_interfaces.msg import AspectDistribution
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.feeder_controller.model import (
    Evidence,
    FedPart,
    drops_in,
    flips_in,
    ids_of_classes,
)
from resting_aspects_ros.nodes.feeder_controller.settings import Settings
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import TransitionMatrix

# While a run is in progress, evidence is new when there are more drops by this factor.
GROWTH = 1.2


class PartEvidence:
    """The evidence of the part in a feeder, from the newest messages about it.

    fed : FedPart or None
        The part, once it has been read.
    ignored : list of str
        Why messages are not used.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        self._logger = node.get_logger()
        self._settings = settings
        self._ids: tuple[int, ...] = ()  # of the pickable aspects
        self._drops: AspectDistribution | None = None
        self._flips: TransitionMatrixMsg | None = None
        self._used: tuple[int, int] | None = None  # drops and flips of the model
        self._ignored = {'drops': '', 'flips': ''}
        self.fed: FedPart | None = None
        self._counted: Distribution | None = None
        self._transitions: TransitionMatrix | None = None

    @property
    def ignored(self) -> list[str]:
        """Why messages are not used."""
        return [text for text in self._ignored.values() if text]

    @property
    def current(self) -> Evidence | None:
        """The evidence; None while no drop is known that came to rest in an aspect."""
        if self._counted is None or not self._counted.counts.any():
            return None
        return Evidence(self._counted, self._transitions)

    @property
    def lacks_drops(self) -> bool:
        """Whether the part has been read, and no drops of it are known."""
        return self.fed is not None and self._counted is None

    @property
    def is_complete(self) -> bool:
        """Whether the newest drops and the newest flips are those of complete runs."""
        newest = self._drops, self._flips
        return all(message is not None and message.complete for message in newest)

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops and of flips in the evidence; 0 without evidence."""
        found = self.current
        return (found.drop_count, found.flip_count) if found is not None else (0, 0)

    def set_part(self, fed: FedPart) -> None:
        """Begin again with a part, and what is known of it.

        Raises InvalidValueError if it does not have the pickable classes.
        """
        self._ids = ids_of_classes(fed.known, self._settings)
        self.fed, self._used = fed, None
        self._counted = self._transitions = None
        self._use_drops()
        self._use_flips()

    def forget_part(self) -> None:
        """Forget a part that cannot be used."""
        self.fed = self._counted = self._transitions = None

    def add_drops(self, message: AspectDistribution) -> bool:
        """Take a distribution; return whether it changes the evidence enough for a new model."""
        old = self._drops
        if message.drops == 0 or (old is not None and _has_fewer_drops(message, old)):
            return False
        self._drops = message
        if old is not None and old.run.conditions != message.run.conditions:
            self._used = None
            self._logger.warning(
                f'the conditions of run {message.run.run_id} ({_surface(message)}) differ from '
                f'those of the previous run ({_surface(old)})'
            )
        return self._use_drops() and self._is_new(message.complete)

    def add_flips(self, message: TransitionMatrixMsg) -> bool:
        """Take a transition matrix; return whether it changes the evidence enough."""
        if not any(message.actions):
            return False
        self._flips = message
        return self._use_flips() and self._is_new(message.complete)

    def use(self) -> Evidence:
        """Return the evidence for a model."""
        found = self.current
        assert found is not None
        self._used = self.counts
        return found

    def share(self, evidence: Evidence) -> Interval:
        """Return the probability that a supplied part is pickable."""
        return evidence.drops.combined_interval(self._ids)

    def _use_drops(self) -> bool:
        """Take the newest distribution as evidence; return whether it is valid."""
        if self.fed is None or self._drops is None:
            return False
        try:
            self._counted = drops_in(self._drops, self.fed.known)
        except InvalidValueError as error:
            self._ignore('drops', f'ignored a distribution: {error}')
            return False
        self._ignored['drops'] = ''
        return True

    def _use_flips(self) -> bool:
        """Take the newest transition matrix as evidence; return whether it is valid."""
        if self.fed is None or self._flips is None:
            return False
        name = self._flips.action.name or self._flips.action.kind
        try:
            if name != self._settings.action:
                raise InvalidValueError(
                    f'invalid action {name}: expected {self._settings.action}, as the parameter '
                    'action states'
                )
            self._transitions = flips_in(self._flips, self.fed.known)
        except InvalidValueError as error:
            self._ignore('flips', f'ignored a transition matrix: {error}')
            return False
        self._ignored['flips'] = ''
        return True

    def _ignore(self, kind: str, text: str) -> None:
        if self._ignored[kind] != text:
            self._logger.warning(text)
        self._ignored[kind] = text

    def _is_new(self, complete: bool) -> bool:
        """Return whether the evidence differs enough from that of the model."""
        if self.current is None:
            return False
        now = self.counts
        if self._used is None or complete:
            return now != self._used
        return any(b >= GROWTH * a and b > a for a, b in zip(self._used, now, strict=True))


def _has_fewer_drops(message: AspectDistribution, known: AspectDistribution) -> bool:
    """Return whether ``known`` has more drops of the same part under the same conditions.

    This happens when two runs overlap, or when a new run starts.
    """
    new, old = message.run, known.run
    same = (new.part_sha256, new.conditions) == (old.part_sha256, old.conditions)
    return bool(same and message.drops < known.drops)


def _surface(message: AspectDistribution) -> str:
    return message.run.conditions.surface or 'own conditions'
