"""`resting_aspects study`: drops over ranges of conditions, and what the shares depend on."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.conditions import requested_surroundings
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_texts
from resting_aspects_ros.errors import InvalidValueError, analysis, shown
from resting_aspects_ros.simulation.conditions import QUANTITIES, all_surfaces
from resting_aspects_ros.studies import study
from resting_aspects_ros.studies.batch import load_parts
from resting_aspects_ros.studies.design import parse_ranges

# Flags of what a study.yaml defines.
_OF_A_STUDY = ('vary', 'action', 'surface', *QUANTITIES, 'height_of', 'surroundings', 'set')
DESCRIPTION = """Drop parts at many points of some conditions, and show how much the
probability of each aspect depends on each condition, and whether it is worth
while to measure it. A study that was interrupted, or that is given more points,
continues where it ended."""
EXAMPLES = """examples:
  resting_aspects study l_bracket --vary friction=.1:.5 --vary height=2cm:20cm
  resting_aspects study old.stl new.stl --vary friction=0.1:0.6 --points 32
  resting_aspects study a.stl --surroundings slope --vary surroundings.angle=0:1
  resting_aspects study l_bracket --action tap --vary action.speed=0.1:0.5
  resting_aspects study out/study_l_bracket/study.yaml --points 32
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'parts',
        metavar='PART_OR_STUDY',
        nargs='+',
        help='names of parts, mesh files and folders of mesh files; or one study.yaml, which '
        'describes a study',
    )
    group = parser.add_argument_group('design of the study')
    group.add_argument(
        '--vary',
        metavar='NAME=LOW:HIGH[:LEVELS][:log]',
        action='append',
        default=[],
        help='vary a condition, a value of the surroundings (surroundings.angle) or of the action '
        '(action.speed) between two values; can be repeated',
    )
    group.add_argument(
        '--design',
        metavar='NAME',
        choices=('curves', 'factorial'),
        help='a curve over each factor from each base point, with 7 levels if none are given '
        '(curves), or all combinations of the levels, 3 if none are given (factorial)',
    )
    options.add_integer(group, '--points', 'number of base points (16)', metavar='M')
    options.add_integer(
        group,
        '--drops',
        'number of drops at each point (400 to 10000: the fewer, the more points there are); '
        'with --action, of actions from each aspect (a fifth of this)',
    )
    options.add_integer(group, '--seed', 'seed of the design and the drops (1)', metavar='S')
    group.add_argument(
        '--action',
        metavar='NAME',
        help='do this named action to parts at rest in each aspect, instead of dropping them',
    )
    options.add_share(
        parser,
        '--tolerance',
        'P',
        'change of a probability that matters to you, such as 0.05 or 5%%: decides whether '
        'measuring a condition is worth while (0.05)',
    )
    options.add_share(
        parser,
        '--confidence',
        'C',
        'confidence of the intervals: more than 0.5 and less than 1 (0.95)',
    )
    options.add_out(
        parser,
        'folder of study.yaml, points.jsonl, results.csv and page.html; a study in it is '
        'continued (out/study_ and the parts, or the folder of study.yaml)',
    )
    options.add_workers(parser)
    options.add_conditions(parser)
    options.add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make the study and show it; returns the exit code. RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        numbers = {
            name: value
            for name in ('design', 'points', 'drops', 'seed', 'tolerance', 'confidence')
            if (value := getattr(arguments, name)) is not None
        }
        first = Path(arguments.parts[0])
        if first.is_dir() and (first / study.SPEC).exists():
            first /= study.SPEC
        if first.suffix.lower() in {'.yaml', '.yml'}:
            return _show(*_of_file(first, arguments, numbers, started))
        return _show(*_of_flags(arguments, numbers, started))


def _of_file(
    path: Path, arguments: argparse.Namespace, numbers: dict[str, Any], started: dict[str, Any]
) -> tuple[study.StudyResult, Path]:
    """Make the study that a file describes; returns it and its folder."""
    if len(arguments.parts) > 1:
        raise InvalidValueError(
            f'invalid part {shown(arguments.parts[1])}: expected no parts beside '
            f'{str(path)!r}, which defines them'
        )
    options.refuse(arguments, _OF_A_STUDY, f'without {str(path)!r}, which defines it')
    own = path.parent if path.name == study.SPEC else Path('out') / path.stem
    folder = arguments.out or own
    spec = study.read_spec(path, numbers, all_surfaces(arguments.surfaces))
    return study.run_study(spec, folder, **started), folder


def _of_flags(
    arguments: argparse.Namespace, numbers: dict[str, Any], started: dict[str, Any]
) -> tuple[study.StudyResult, Path]:
    """Make the study that the flags describe; returns it and its folder."""
    if not arguments.vary:
        raise InvalidValueError(
            'missing --vary: expected at least one, such as --vary restitution=0.3:0.7'
        )
    parts = load_parts(arguments.parts)
    name = '_'.join(part.name for part in parts[:3])
    folder = arguments.out or Path('out') / f'study_{name}'
    result = study.study(
        parts,
        parse_ranges(arguments.vary),
        surface=options.requested_surface(arguments),
        surroundings=requested_surroundings(arguments.surroundings, arguments.set),
        action=arguments.action,
        out=folder,
        **numbers,
        **started,
    )
    return result, folder


def _show(result: study.StudyResult, folder: Path) -> int:
    """Write the tables and the page, and print the findings; returns the exit code."""
    for case in result.cases:
        if case.skipped:
            k, reason = min(case.skipped.items())
            print(
                f'{case.name}: {len(case.skipped)} of {len(result.design.points)} points are '
                f'impossible and were skipped; point {k}: {reason}'
            )
    if not any(case.drops.any() for case in result.cases):
        print('No point has drops.')
    else:
        with analysis('the tables of the results'):
            result.save_tables(folder)
        with analysis('the findings'):
            _show_findings(result)
        with analysis('the report'):
            print(f'Report: {result.report(folder)}')
    if not result.complete:
        drops = sum(int(case.drops.sum()) for case in result.cases)
        print(f'interrupted after {drops} drops; the same command continues the study')
        return life_cycle.INTERRUPTED
    return 0


def _show_findings(result: study.StudyResult) -> None:
    """Print the findings of each case, and the range of the base."""
    for case in result.cases:
        print(f'{case.name}: {len(result.design.points)} points, {int(case.drops.sum())} drops')
        for finding in result.findings:
            if finding.case == case.name:
                show_texts(f'* {finding.sentence} {finding.details}'.rstrip())
    show_texts(result.spec.base.range_text)
