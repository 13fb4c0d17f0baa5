"""`resting_aspects drift`: whether counted parts still have the shares of the simulation."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.life_cycle import DONE, finish, result_folder, session
from resting_aspects_ros.cli.options import (
    add_conditions,
    add_confidence,
    add_integer,
    add_out,
    add_output,
    add_part,
    add_share,
    add_workers,
    refuse,
    requested_conditions,
    requested_part,
)
from resting_aspects_ros.errors import StoppedError
from resting_aspects_ros.simulation.conditions import DEFAULT_SEED, QUANTITIES

if TYPE_CHECKING:
    from resting_aspects_ros.api.compare import DriftResult
    from resting_aspects_ros.api.counts import CountedDrops
    from resting_aspects_ros.api.drop import DropResult
    from resting_aspects_ros.aspects.aspect_set import AspectSet
    from resting_aspects_ros.part.part import Part

DESCRIPTION = """Test whether the parts that a machine supplies still have the shares of the
simulation. COUNTS counts each newly supplied part once, by the classes of
aspects that look the same, in the order of time. It is a log of a feeder, a
folder of such logs, or a CSV file with the columns class and count; without
count each row is one part. A column batch or time separates batches. Count
parts that lie in no class as unclassified, and classes that a camera confuses
together, as 3+4. Each window of successive parts is compared with simulated
drops by a G test. The exit code is 0 with and without drift."""
EXAMPLES = """examples:
  resting_aspects drift l_bracket counted.csv
  resting_aspects drift hex_nut counted.csv --expected out/nut/distribution.json
  resting_aspects drift l_bracket out/logs
  resting_aspects drift l_bracket counted.csv --window 200 --level 0.05
  resting_aspects drift l_bracket counted.csv --shift 10% --json
"""
DEFAULT_DROPS = 10_000
DOCUMENT, PICTURE = 'drift.json', 'drift.png'
# Flags of the simulation, which --expected replaces.
SIMULATION = (
    'drops',
    'seed',
    'surface',
    'surfaces',
    *QUANTITIES,
    'height_of',
    'workers',
    'scheduler',
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        'counts',
        metavar='COUNTS',
        type=Path,
        help='counts of parts: a CSV file, or logs of a feeder',
    )
    parser.add_argument(
        '--expected',
        metavar='FILE',
        type=Path,
        help='compare with the drops in a log, a JSON document of drop or request, or a CSV with '
        'columns class and count, instead of new drops',
    )
    add_integer(
        parser,
        '--window',
        'number of parts in a window (as many as find the deviation of --shift in any class '
        'with a probability of 80 %%; all parts if they are fewer). A batch is not divided',
    )
    add_share(
        parser,
        '--shift',
        'D',
        'deviation of the share of a class that a window should find (0.05, which is 5 points)',
    )
    add_share(parser, '--level', 'A', 'probability of a false alarm in each window (0.01)')
    add_integer(
        parser,
        '--drops',
        f'number of simulated drops ({DEFAULT_DROPS}); their sampling error is taken into account',
    )
    add_integer(
        parser, '--seed', f'the same seed gives the same drops ({DEFAULT_SEED})', metavar='S'
    )
    add_confidence(parser)
    add_workers(parser)
    add_out(parser, 'write drift.json and drift.png into this folder')
    add_output(parser, each=False)
    add_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, test and show; returns the exit code. Raises RestingAspectsError."""
    options: dict[str, Any] = {
        name: value
        for name in ('confidence', 'shift', 'level', 'window')
        if (value := getattr(arguments, name)) is not None
    }
    from resting_aspects_ros.api.compare import watch_drift
    from resting_aspects_ros.api.count_files import read_observed
    from resting_aspects_ros.aspects.find import find_aspects
    from resting_aspects_ros.statistics.drift import check_level, check_shift, check_windows
    from resting_aspects_ros.statistics.intervals import check_confidence

    part = requested_part(arguments)
    aspects = find_aspects(part)
    classes = [members[0].symmetry_class for members in aspects.classes()]
    observed = read_observed(arguments.counts, classes, part.name)
    # Before the drops, which can take time.
    check_windows(observed, options.get('window', 1))
    checks = {
        'confidence': check_confidence,
        'shift': check_shift,
        'level': check_level,
    }
    for name in checks.keys() & options.keys():
        checks[name](options[name])
    out = result_folder(arguments, part.name, (DOCUMENT, PICTURE))
    result = watch_drift(_expected(arguments, part), observed, **options)
    document = DOCUMENT, result.to_json
    show = partial(_show, result, part, aspects)
    finish(arguments, out, document, {PICTURE: result.save_picture}, show)
    return DONE


def _expected(arguments: argparse.Namespace, part: 'Part') -> 'DropResult | CountedDrops':
    """Return the simulated drops in a file, or new drops."""
    if arguments.expected is None:
        from resting_aspects_ros.api.drop import drop

        conditions = requested_conditions(arguments)
        with session(arguments) as started:
            result = drop(
                part,
                arguments.drops,
                surface=conditions,
                seed=DEFAULT_SEED if arguments.seed is None else arguments.seed,
                keep_poses=False,
                model_range=False,
                **started.options,
            )
        if not result.complete:
            raise StoppedError('interrupted')
        return result
    from resting_aspects_ros.api.count_files import counted_drops
    from resting_aspects_ros.api.counts import check_same_part

    refuse(arguments, SIMULATION, 'without --expected, whose drops are compared')
    given = counted_drops(arguments.expected)
    check_same_part(
        (f'--expected {str(arguments.expected)!r}', given.part, given.part_sha256),
        ('the counted part', part.name, part.part_sha256),
    )
    return given


def _show(result: 'DriftResult', part: 'Part', aspects: 'AspectSet') -> None:
    from resting_aspects_ros.api.forecast_result import counted_apart_texts
    from resting_aspects_ros.cli.console import show_table, show_texts
    from resting_aspects_ros.report.drift import drift_notes, live_table, window_table

    show_texts(result.verdict, drift_notes(result.test, result.shift, result.needed))
    print()
    show_table(window_table(result.test, result.title))
    print()
    show_table(live_table(result.test, result.live))
    show_texts(*counted_apart_texts(part, aspects, result.test.observed.groups))
