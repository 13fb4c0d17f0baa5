"""The folder into which a command writes its result."""

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path


def requested_folder(arguments: argparse.Namespace, part: str) -> tuple[str, Path | None]:
    """Return the flag that requests a folder, and the folder: None if nothing is saved."""
    if arguments.out is None and arguments.report:
        # This import is slow, and only needed for a report.
        from resting_aspects_ros.api.report_files import default_folder

        return '--report', default_folder(part)
    return '--out', arguments.out


def make_result_folder(
    arguments: argparse.Namespace,
    part: str,
    files: Iterable[str],
    check_report: Callable[[str, Path], None],
) -> Path | None:
    """Make the folder of a result with the given files, and with a page if requested.

    Returns None if nothing is saved. Raises InvalidValueError if the folder, or a file in it,
    cannot be written.
    """
    from resting_aspects_ros.api.output_files import check_output, make_folder

    flag, out = requested_folder(arguments, part)
    if out is None:
        return None
    make_folder(flag, out)
    for name in files:
        check_output(flag, out / name)
    if arguments.report:
        check_report(flag, out)
    return out
