"""Read counts over aspects from a log, a JSON document or a CSV."""

import io
from pathlib import Path

import numpy as np

from resting_aspects_ros.commands.counts_csv import read_csv
from resting_aspects_ros.commands.csv_file import open_text
from resting_aspects_ros.commands.given_counts import GivenCounts, check_counts
from resting_aspects_ros.core.comparison import Tally
from resting_aspects_ros.core.errors import InvalidValueError, LogError
from resting_aspects_ros.logs.log_reader import is_log, last_message
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE

MAX_BYTES = 1 << 26
ALLOWED = (
    'a log (the folder of a run, or its .mcap file), a JSON document of drop or request, or a CSV '
    'with columns aspect (or class) and count'
)


def read_counts(path: Path) -> GivenCounts:
    """What is in a file of any of these kinds; raises InvalidValueError."""
    if is_log(path):
        given = _read_log(path)
    else:
        with open_text(path, 'counts file', MAX_BYTES) as file:
            text = file.read()
            if path.suffix == '.json' or text.lstrip().startswith('{'):
                # Only this needs the library that checks documents.
                from resting_aspects_ros.commands.result_json import counts_of, read_document

                given = counts_of(path, read_document(path, text))
            else:
                given = read_csv(path, io.StringIO(text, newline=''), ALLOWED)
    check_counts(given)
    return given


def _read_log(path: Path) -> GivenCounts:
    """The last distribution in a log."""
    try:
        data = last_message(path, DISTRIBUTION_TYPE)
    except LogError as error:
        raise InvalidValueError(str(error)) from None
    if data is None:
        raise InvalidValueError(
            f'log {str(path)!r} holds no distribution, allowed is one with a message of type '
            f'{DISTRIBUTION_TYPE}'
        )
    # A second to import, which other files do not need.
    from resting_aspects_ros.commands.logged_run import warn_if_unfinished
    from resting_aspects_ros.nodes.distribution_messages import serialized_distribution

    try:
        distribution, run, complete = serialized_distribution(data)
    except (RuntimeError, InvalidValueError) as error:  # the first is all that rclpy raises
        raise InvalidValueError(
            f'log {str(path)!r} holds a distribution that cannot be read: {error}'
        ) from None
    warn_if_unfinished(path)
    aspects = distribution.aspects.aspects
    return GivenCounts(
        path,
        tuple(aspect.id for aspect in aspects),
        Tally(
            distribution.counts,
            distribution.unclassified,
            distribution.unsettled,
            distribution.failed,
        ),
        np.array([np.full(3, np.nan) if a.rolls else a.down_in_part for a in aspects]),
        run.part,
        run.part_sha256,
        run,
        complete,
        tuple(aspect.symmetry_class for aspect in aspects),
    )
