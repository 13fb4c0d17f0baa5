"""`resting_aspects compare`: how much two distributions differ."""

import argparse
from pathlib import Path

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.report.comparison import comparison_table, measures

DESCRIPTION = """Show how much two distributions over the same aspects differ, and whether
chance explains the difference. Each of A and B is a log (the folder of a run,
or its .mcap file), a JSON document of drop or request, or a CSV of counts.
A CSV has a header with the columns aspect and count, then a line for each
aspect, even if its count is 0, and optional lines for unclassified, unsettled
and failed drops. With a column class instead of aspect it has a line for each
class of aspects that look the same. Shares refer to the drops that are in an
aspect."""
EXAMPLES = """examples:
  resting_aspects compare out/nut/distribution.json manual.csv
  resting_aspects compare out/logs/my_part_20270131T235959Z_4f1c p.json
  resting_aspects compare before.json after.json --confidence 0.99 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('a', metavar='A', type=Path, help='log, JSON document or CSV')
    parser.add_argument('b', metavar='B', type=Path, help='log, JSON document or CSV')
    options.add_confidence(parser)
    options.add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> None:
    """Read, compare and show. Raises RestingAspectsError."""
    result = compare(arguments.a, arguments.b, confidence=arguments.confidence)

    def show() -> None:
        title = f'A: {result.a.title}\nB: {result.b.title}'
        show_table(comparison_table(result.sides, title))
        rows = measures(result.sides).items()
        lines = '\n'.join(f'{name:<25}{text}' for name, text in rows)
        show_texts(lines, *result.range_texts, result.verdict)

    show_result(arguments, result.to_json, show)
