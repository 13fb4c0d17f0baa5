"""Read a log of a run."""

from pathlib import Path

from resting_aspects_ros.api.drop_result import DropResult


def read_log(log: str | Path) -> DropResult:
    """Read a log of a run, and count its drops.

    Imports ROS, which the rest of the Python interface does not need.

    Parameters
    ----------
    log : str or Path
        The folder of a run, or its .mcap file.

    Returns
    -------
    DropResult
        The result; ``poses`` is None if the log does not have all drops.

    Raises
    ------
    LogError
        The log cannot be read.
    InvalidValueError
        The file is not a log of a run with its part.
    """
    from resting_aspects_ros.run_logs.logged_result import logged_result

    return logged_result(Path(log), keep_poses=True)
