"""Numbers and runs in words, as logs and diagnostics have them."""

from collections.abc import Mapping, Sequence

from resting_aspects_ros.simulation.run_description import RunDescription

# Of a list that can be long so many are named.
MAX_LISTED = 10


def counted(number: int, one: str, more: str) -> str:
    """'1 run', '2 runs'."""
    return f'{number} {one if number == 1 else more}'


def of_run(run: RunDescription, drops: int) -> str:
    """'3000 of 20000 drops', as far as a run is."""
    most = 'at most ' if run.precision else ''
    return f'{drops} of {most}{counted(run.drops, "drop", "drops")}'


def under_way(runs: Sequence[tuple[RunDescription, int]]) -> str:
    """What is dropped, and how far that is; empty if there is no run. Of several the first."""
    if not runs:
        return ''
    run, drops = runs[0]
    more = f', and {counted(len(runs) - 1, "more run", "more runs")}' if runs[1:] else ''
    return f'{run.part}: {of_run(run, drops)}{more}'


def run_values(runs: Sequence[tuple[RunDescription, int]]) -> dict[str, object]:
    """How many runs are under way, and how far each is, by name."""
    each = {
        f'run {k}': f'{run.part}: {of_run(run, drops)}, run {run.run_id}'
        for k, (run, drops) in enumerate(runs, 1)
    }
    return {'runs under way': len(runs), **listed(each)}


def listed(values: Mapping[str, str]) -> dict[str, str]:
    """The first of them, and how many more there are."""
    shown = dict(list(values.items())[:MAX_LISTED])
    if len(values) > MAX_LISTED:
        shown['not shown'] = f'{len(values) - MAX_LISTED} more'
    return shown
