"""Text for numbers and runs in log lines and diagnostics."""

from collections.abc import Mapping, Sequence

from resting_aspects_ros.simulation.job import RunDescription

# Maximum number of entries of a mapping that diagnostics show.
MAX_LISTED = 10


def count_text(number: int, one: str, more: str) -> str:
    """Return a number with its noun: '1 run', '2 runs'."""
    return f'{number} {one if number == 1 else more}'


def progress_text(run: RunDescription, drops: int, unit: str = 'drops') -> str:
    """Return the progress of a run, such as '3000 of 20000 drops'."""
    bound = 'at most ' if run.precision else ''
    return f'{drops} of {bound}{count_text(run.drops, unit[:-1], unit)}'


def active_runs_text(runs: Sequence[tuple[RunDescription, int]]) -> str:
    """Return the progress of the first run and the number of others; empty without a run."""
    if not runs:
        return ''
    run, drops = runs[0]
    more = f', and {count_text(len(runs) - 1, "more run", "more runs")}' if runs[1:] else ''
    return f'{run.part}: {progress_text(run, drops)}{more}'


def run_values(runs: Sequence[tuple[RunDescription, int]]) -> dict[str, object]:
    """Return the number of active runs and the progress of each, for diagnostics."""
    each = {
        f'run {k}': f'{run.part}: {progress_text(run, drops)}, run {run.run_id}'
        for k, (run, drops) in enumerate(runs, 1)
    }
    return {'active runs': len(runs), **truncated(each)}


def truncated(values: Mapping[str, str]) -> dict[str, str]:
    """Return the first MAX_LISTED entries, and the number of entries left out."""
    shown = dict(list(values.items())[:MAX_LISTED])
    if len(values) > MAX_LISTED:
        shown['not shown'] = f'{len(values) - MAX_LISTED} more'
    return shown
