"""Conversions between counted parts, what follows from them, and ROS messages."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from resting_aspects_interfaces.msg import ObservedCounts as ObservedCountsMsg
from resting_aspects_interfaces.msg import Posterior
from std_msgs.msg import Header

from resting_aspects_ros.api.compare import MachineTransitions, machine_transitions
from resting_aspects_ros.api.counts import single_groups
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.report.drift import drift_sentence
from resting_aspects_ros.report.format import points_text
from resting_aspects_ros.ros.conversions import nanoseconds, run_msg
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.counted_parts import (
    CountSessions,
    LiveCounts,
    ObservedCounts,
    Totals,
)
from resting_aspects_ros.statistics.drift import DriftTest
from resting_aspects_ros.statistics.transitions import TransitionMatrix

MAX_SESSION_NAME = 200


def totals_from(msg: ObservedCountsMsg, part: str, part_sha256: str) -> Totals:
    """Return the totals in a message on observed_counts/<part>.

    Raises InvalidValueError if they are of another part, or of another version of it than
    ``part_sha256`` (empty: of any).
    """
    if msg.part != part:
        raise InvalidValueError(f'invalid part {shown(msg.part)} of counts: expected {part}')
    if msg.part_sha256 and part_sha256 not in ('', msg.part_sha256):
        raise InvalidValueError(
            f'invalid part_sha256 {shown(msg.part_sha256)} of counts of {part}: expected that of '
            f'the offered version, {part_sha256}'
        )
    if len(msg.session) > MAX_SESSION_NAME:
        raise InvalidValueError(
            f'invalid session {shown(msg.session)}: expected at most {MAX_SESSION_NAME} characters'
        )
    return Totals(
        session=msg.session,
        time=nanoseconds(msg.header.stamp),
        supplied=np.array(msg.supplied, dtype=np.uint64),
        action=msg.action,
        moved=np.array(msg.moved, dtype=np.uint64),
    )


def observed_from(
    messages: Iterable[tuple[int, ObservedCountsMsg]], source: str, ids: Sequence[int]
) -> ObservedCounts:
    """Return the parts that messages on observed_counts/<part> count.

    Each message is a batch with the parts since the last one of its session; messages that are
    not valid are left out, as aspect_classifier does.

    messages : with their time of arrival, ns
    source : name of the log, for messages
    ids : numbers of the symmetry classes of the part
    """
    sessions = CountSessions(len(ids))
    batches: list[Counts] = []
    labels: list[str] = []
    for time, msg in messages:
        try:
            totals = totals_from(msg, msg.part, '')
            new = sessions.add(totals, time)
        except InvalidValueError:
            continue
        if new.any():
            batches.append(new)
            labels.append(time_label(totals.time or time))
    rows = np.array(batches, dtype=np.int64).reshape(-1, len(ids))
    return ObservedCounts.of_rows(rows, source, single_groups(ids), labels)


def time_label(time: int) -> str:
    """Return a time, ns since 1970, as text of whole seconds in UTC."""
    text = np.datetime_as_string(np.datetime64(time // 1_000_000_000, 's'))
    return f'{str(text).replace("T", " ")} UTC'


def posterior_msg(
    part: str,
    part_sha256: str,
    live: LiveCounts,
    run: RunDescription | None,
    confidence: float,
    stamp: Time,
) -> Posterior:
    """Return the message for counted parts without a drift test; see `add_drift`.

    run : of the simulated drops; None: no drops are known, and those of ``live`` are a prior with
        equal shares
    """
    intervals = live.intervals(confidence)
    message = Posterior(
        header=Header(stamp=stamp),
        part=part,
        part_sha256=part_sha256,
        prior_weight=live.prior_weight,
        parts=live.parts,
        simulated=live.simulated.tolist() if run else [0] * len(live.ids),
        observed=live.observed.tolist(),
        concentration=live.concentration.tolist(),
        probability=[each.probability for each in intervals],
        lower=[each.lower for each in intervals],
        upper=[each.upper for each in intervals],
        confidence=confidence,
    )
    for name in ('share', 'expected', 'deviation_lower', 'deviation_upper'):
        setattr(message, name, math.nan)
    if run is not None:
        message.run = run_msg(run)
    return message


def add_drift(message: Posterior, test: DriftTest) -> None:
    """Add the tests of all windows to a message."""
    found = test.deviation
    message.message = drift_sentence(test)
    message.window_end = test.ends[1:].tolist()
    message.statistic = test.g.tolist()
    message.p_value = test.p_values.tolist()
    if found is None:
        return
    drifted = test.drifted
    message.drift = drifted.stop == len(test.windows)
    message.first_part = int(test.ends[drifted.start]) + 1
    message.last_part = int(test.ends[drifted.stop])
    message.drift_class = test.observed.groups[found.index][0]
    message.share, message.expected = found.share, found.expected
    message.deviation_lower, message.deviation_upper = found.lower, found.upper


def add_action(
    message: Posterior, action: str, counts: Counts, simulated: TransitionMatrix, run_id: str
) -> None:
    """Add the parts that were followed through an action to a message.

    Parameters
    ----------
    counts : (c, c) int
        From class to class; at least one part.
    simulated : TransitionMatrix
        Over the aspects of the part; without actions if no transitions are known.
    run_id : str
        Run of the simulated transitions; empty if they are not known.
    """
    found = machine_transitions(counts, simulated)
    message.actions.append(action)
    message.action_run_ids.append(run_id)
    message.action_messages.append(_difference_text(found) if run_id else '')
    message.moved.extend(counts.ravel().tolist())
    for name, matrix in (('moved', found.machine), ('simulated', found.simulated)):
        values = np.stack([matrix.probability, *matrix.bounds()])[:, :, : len(counts)]
        if name == 'simulated' and not run_id:
            values[:] = np.nan
        for field, each in zip(('probability', 'lower', 'upper'), values, strict=True):
            getattr(message, f'{name}_{field}').extend(each.ravel().tolist())


def _difference_text(found: MachineTransitions) -> str:
    """Return the pair of classes that differs most from the simulation, in words; or ''."""
    differing = (found.lower > 0) | (found.upper < 0)
    if not differing.any():
        return ''
    size = np.where(differing, np.abs(found.difference), 0)
    i, j = divmod(int(size.argmax()), len(size))
    measured, simulated = (each.probability[i, j] for each in (found.machine, found.simulated))
    points = points_text(found.difference[i, j], found.lower[i, j], found.upper[i, j])
    return (
        f'{100 * measured:.0f} % of class {i + 1} come to class {j + 1} instead of '
        f'{100 * simulated:.0f} %: {points} points '
        f'({100 * found.simulated.confidence:g} % interval of this pair)'
    )
