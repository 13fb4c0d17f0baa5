"""Content of a log of a feeder: what was seen, advised, picked and counted."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    DetectionArray,
    FeederAdvice,
    ObservedCounts,
    PickResult,
    Posterior,
)

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import is_folder, named
from resting_aspects_ros.logs.reader import open_log
from resting_aspects_ros.ros.count_conversions import observed_from, time_label
from resting_aspects_ros.ros.feeder_names import CHOICES, RESULTS
from resting_aspects_ros.run_logs.contents import parsed
from resting_aspects_ros.statistics.counted_parts import ObservedCounts as CountedParts

FOLDERS = 'feeder-*'  # the folders of such logs
KINDS = {
    f'resting_aspects_interfaces/msg/{kind.__name__}': kind
    for kind in (DetectionArray, PickResult, FeederAdvice, ObservedCounts, Posterior)
}
COUNTS_TYPE = 'resting_aspects_interfaces/msg/ObservedCounts'


@dataclass
class FeederLog:
    """What the messages in a log of a feeder state together.

    start, end : time of the first and of the last message, ns since 1970
    images, detections : number of images, and of parts in them
    results : number of pick results by what was done
    advice : number of messages on feeder_advice/<part> by choice, by part
    posteriors : the last message on posterior/<part>, by part
    counts : number of messages on observed_counts/<part>, by part
    """

    start: int = 0
    end: int = 0
    images: int = 0
    detections: int = 0
    results: Counter[str] = field(default_factory=Counter)
    advice: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    posteriors: dict[str, Posterior] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, message: Any, time: int) -> None:
        """Count a message."""
        self.start, self.end = self.start or time, time
        if isinstance(message, DetectionArray):
            self.images += 1
            self.detections += len(message.detections)
        elif isinstance(message, PickResult):
            self.results[RESULTS.get(message.result, 'unknown')] += 1
        elif isinstance(message, FeederAdvice):
            self.advice[message.part][CHOICES.get(message.choice, 'unknown')] += 1
        elif isinstance(message, Posterior):
            self.posteriors[message.part] = message
        else:
            self.counts[message.part] += 1

    def document(self) -> dict[str, object]:
        """Return the content as plain JSON types."""
        return {
            'start': self.start,
            'end': self.end,
            'images': self.images,
            'detections': self.detections,
            'pick_results': dict(self.results),
            'advice': {part: dict(choices) for part, choices in self.advice.items()},
            'observed_counts': dict(self.counts),
            'counted_parts': {k: list(each.observed) for k, each in self.posteriors.items()},
        }

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield label and text of each fact."""
        yield 'feeder', f'{time_label(self.start)} to {time_label(self.end)}'
        yield 'seen', f'{self.detections} detections in {self.images} images'
        yield 'done', _listed(self.results) or 'no pick results'
        for part, choices in self.advice.items():
            yield 'advised', f'{part}: {_listed(choices)}'
        for part, number in self.counts.items():
            yield 'counted', f'{part}: {number} messages'
        for part, last in self.posteriors.items():
            classes = ', '.join(f'class {k}: {n}' for k, n in enumerate(last.observed, 1))
            drift = f'. {last.message}' if last.message else ''
            yield 'parts', f'{part}: {last.parts} counted, {classes}{drift}'


def read_feeder_log(log: Path) -> FeederLog | None:
    """Return the content of a log; None if it has no message of a feeder. Raises LogError."""
    found = FeederLog()
    with open_log(log) as file:
        for each in file.of_types(KINDS):
            found.add(_read(log, KINDS[each.type], each.data), each.time)
    return found if found.end else None


def observed_in_logs(path: Path, part: str, ids: Sequence[int]) -> CountedParts:
    """Return the parts that the messages on observed_counts/<part> in a log count.

    Parameters
    ----------
    path : Path
        A log of a feeder, or a folder of such logs, which are read in their order.
    part : str
        Empty: the only part in the logs.
    ids : sequence of int
        Numbers of its symmetry classes.

    Raises
    ------
    InvalidValueError
        The logs have no counts of the part, or of several parts without ``part``.
    LogError
        A log cannot be read.
    """
    nested = sorted(path.glob(f'{FOLDERS}/')) if is_folder(path) else []
    counted: list[tuple[int, bytes]] = []
    parts = set()
    for log in nested or [path]:
        with open_log(log) as file:
            for each in file.of_types([COUNTS_TYPE]):
                name = _read(log, ObservedCounts, each.data).part
                parts.add(name)
                if part in ('', name):
                    counted.append((each.time, each.data))
    if not counted or (not part and len(parts) > 1):
        raise InvalidValueError(
            f'invalid counts in {named("log", path)}: expected observed_counts of '
            f'{part or "one part"}, found {shown(", ".join(sorted(parts))) if parts else "none"}'
        )
    return observed_from(counted, str(path), ids)[0]


def _read(log: Path, kind: Any, data: bytes) -> Any:
    return parsed(log, partial(deserialize_message, message_type=kind), data)


def _listed(counts: Counter[str]) -> str:
    return ', '.join(f'{number} {name}' for name, number in counts.items())
