"""Plan drops of a part."""

import time
import uuid
from dataclasses import dataclass

from resting_aspects_ros.api.drop_counter import Consumer
from resting_aspects_ros.api.surroundings import aspects_in, contacts_in, scene_of
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import MAX_DROPS, DropJob, RunDescription, plan_run
from resting_aspects_ros.simulation.starts import Starts
from resting_aspects_ros.statistics.distribution import ContactCounts, Distribution, no_drops
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    check_confidence,
    check_interval_method,
    max_drops,
)


@dataclass(frozen=True)
class PlannedDrops:
    """A run that is ready to be simulated.

    ``empty`` is its distribution without drops, and ``contacts`` are its counts by contact with
    walls, None without walls.
    """

    job: DropJob
    run: RunDescription
    empty: Distribution
    contacts: ContactCounts | None = None

    @property
    def consumers(self) -> list[Consumer]:
        """What counts the poses beside the distribution."""
        return [] if self.contacts is None else [self.contacts.add]


def plan_drops(
    part: Part,
    conditions: DropConditions,
    *,
    drops: int,
    seed: int,
    first_drop: int = 0,
    precision: float = 0.0,
    stop_at: float | None = None,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    starts: Starts | None = None,
    engine: str = '',
) -> PlannedDrops:
    """Find the aspects of a part and plan a run; raises InvalidValueError.

    ``stop_at`` is the precision at which to stop, if it differs from that of the run. See
    plan_run for ``starts`` and ``engine``.
    """
    check_interval_method(interval)
    check_confidence(confidence)
    landscape = Landscape(part)
    scene = scene_of(part, conditions)
    aspects = aspects_in(scene, find_aspects(part, landscape))
    empty = no_drops(
        aspects,
        interval=interval,
        confidence=confidence,
        by_precision=precision > 0,
    )
    stop_at = precision if stop_at is None else stop_at
    count = max_drops(drops, stop_at, MAX_DROPS, len(empty.aspects), interval, confidence)
    job, run = plan_run(
        part,
        conditions,
        seed=seed,
        drops=count,
        first_drop=first_drop,
        precision=precision,
        run_id=uuid.uuid4().hex[:12],
        started=time.time_ns(),
        landscape=landscape,
        starts=starts,
        engine=engine,
    )
    return PlannedDrops(job, run, empty, contacts_in(scene, part, aspects))
