"""What is said of a log that was broken off, or is being written, before it is used."""

import sys
from pathlib import Path

from resting_aspects_ros.logs.log_reader import unfinished


def warn_if_unfinished(log: Path) -> None:
    """Say on standard error if a log has no end; LogError if it cannot be read."""
    if words := unfinished(log):
        print(f'warning: {words}', file=sys.stderr)
