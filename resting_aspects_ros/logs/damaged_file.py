"""What becomes of a file of which more than the end is lost: nobody deletes it."""

import os
import shutil
from itertools import count
from pathlib import Path

# It is kept under its name and this, and a number if that is taken.
DAMAGED = '.damaged'


def keep_damaged(path: Path) -> Path:
    """Give a file a second name, under which it stays; OSError if that cannot be.

    On a file system that has no second names it is a copy.
    """
    for number in count(1):
        kept = path.with_name(path.name + DAMAGED + (f'_{number}' if number > 1 else ''))
        try:
            os.link(path, kept)
        except FileExistsError:
            continue
        except OSError:
            if kept.exists():
                continue
            _copy(path, kept)
        return kept
    raise AssertionError


def _copy(path: Path, kept: Path) -> None:
    with path.open('rb') as old, kept.open('xb') as new:
        try:
            shutil.copyfileobj(old, new)
            new.flush()
            os.fsync(new.fileno())
        except OSError:
            kept.unlink()
            raise
