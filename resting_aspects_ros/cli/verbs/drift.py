"""`resting_aspects drift`: whether counted parts still have the shares of the simulation."""

import argparse
from pathlib import Path

from resting_aspects_ros.api.compare import watch_drift
from resting_aspects_ros.api.count_files import counted_drops
from resting_aspects_ros.api.counts import CountedDrops, check_same_part
from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.errors import StoppedError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drift import drift_notes, live_table, window_table
from resting_aspects_ros.simulation.conditions import DEFAULT_SEED, QUANTITIES

DESCRIPTION = """Test whether the parts that a machine supplies still have the shares of the
simulation. COUNTS counts each newly supplied part once, by the classes of
aspects that look the same, in the order of time: a log of a feeder, a folder of
such logs, or a CSV file with the columns class and count; without count each
row is one part. A column batch or time separates batches. Count parts that lie
in no class as unclassified, and classes that a camera confuses together, as
3+4. The exit code is 0 with and without drift."""
EXAMPLES = """examples:
  resting_aspects drift l_bracket counted.csv
  resting_aspects drift hex_nut counted.csv --expected out/nut/distribution.json
  resting_aspects drift l_bracket out/logs
  resting_aspects drift l_bracket counted.csv --window 200 --level 0.05
  resting_aspects drift l_bracket counted.csv --shift 10% --json
"""
DEFAULT_DROPS = 10_000
DOCUMENT = 'drift.json'
# Flags of the simulation, which --expected replaces.
SIMULATION = (
    *('drops', 'seed', 'surface', 'surfaces', *QUANTITIES, 'height_of'),
    *('workers', 'scheduler'),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_part(parser)
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
    options.add_integer(
        parser,
        '--window',
        'number of parts in a window (as many as find the deviation of --shift in any class '
        'with a probability of 80 %%; all parts if they are fewer). A batch is not divided',
    )
    options.add_share(
        parser,
        '--shift',
        'D',
        'deviation of the share of a class that a window should find (0.05, which is 5 points)',
        default='0.05',
    )
    text = 'probability of a false alarm in each window (0.01)'
    options.add_share(parser, '--level', 'A', text, default='0.01')
    options.add_integer(
        parser,
        '--drops',
        f'number of simulated drops ({DEFAULT_DROPS}); their sampling error is taken into account',
    )
    options.add_integer(
        parser, '--seed', f'the same seed gives the same drops ({DEFAULT_SEED})', metavar='S'
    )
    options.add_confidence(parser)
    options.add_workers(parser)
    options.add_out(parser, 'write drift.json into this folder')
    options.add_output(parser, each=False)
    options.add_conditions(parser)


def run(arguments: argparse.Namespace) -> None:
    """Simulate, test and show. Raises RestingAspectsError."""
    part = options.requested_part(arguments)
    out = life_cycle.result_folder(arguments, part.name, (DOCUMENT,))
    result = watch_drift(
        _expected(arguments, part),
        arguments.counts,
        window=arguments.window,
        level=arguments.level,
        shift=arguments.shift,
        confidence=arguments.confidence,
    )

    def show() -> None:
        show_texts(result.verdict, drift_notes(result.test, result.shift, result.needed))
        print()
        show_table(window_table(result.test, result.title))
        print()
        show_table(live_table(result.test, result.live))

    life_cycle.finish(arguments, out, (DOCUMENT, result.to_json), {}, show)


def _expected(arguments: argparse.Namespace, part: Part) -> DropResult | CountedDrops:
    """Return the simulated drops in a file, or new drops."""
    if arguments.expected is not None:
        options.refuse(arguments, SIMULATION, 'without --expected, whose drops are compared')
        given = counted_drops(arguments.expected)
        check_same_part(
            (f'--expected {str(arguments.expected)!r}', given.part, given.part_sha256),
            ('the counted part', part.name, part.part_sha256),
        )
        return given
    conditions = options.requested_conditions(arguments)
    with life_cycle.session(arguments) as started:
        result = drop(
            part,
            DEFAULT_DROPS if arguments.drops is None else arguments.drops,
            surface=conditions,
            seed=DEFAULT_SEED if arguments.seed is None else arguments.seed,
            keep_poses=False,
            model_range=False,
            **started,
        )
    if not result.complete:
        raise StoppedError('interrupted')
    return result
