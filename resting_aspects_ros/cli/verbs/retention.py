"""`resting_aspects retention`: how strong a disturbance makes a part leave each aspect."""

import argparse
from functools import partial

from resting_aspects_ros.api.retention import retention
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_page
from resting_aspects_ros.errors import StoppedError

DESCRIPTION = """Disturb a part at rest in each aspect with rising energy, and show at which
energy it leaves the aspect. The energy is given as a lift height: the height by
which it would lift the centre of mass. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects retention l_bracket
  resting_aspects retention my_part.stl --per-height 1000 --out result
  resting_aspects retention l_bracket --report
  resting_aspects retention hex_nut --friction 0.4 --json
"""
DOCUMENT, PICTURE, PAGE = 'retention.json', 'retention.png', 'retention.html'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_part(parser)
    options.add_integer(
        parser,
        '--per-height',
        'number of disturbances of each energy from each aspect (400)',
        default=400,
    )
    options.add_seed(parser, 'curves')
    options.add_confidence(parser)
    options.add_engine(parser)
    options.add_workers(parser)
    options.add_out(
        parser,
        f'write {DOCUMENT} and {PICTURE} into this folder',
        f'{PAGE}, a page with the curves and all conditions',
    )
    options.add_output(parser, each=False)
    options.add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        part = options.requested_part(arguments)
        out = life_cycle.result_folder(arguments, part.name, (DOCUMENT, PICTURE))
        simulate = partial(
            retention,
            part,
            arguments.per_height,
            surface=options.requested_conditions(arguments),
            seed=arguments.seed,
            confidence=arguments.confidence,
            engine=arguments.engine,
            **started,
        )
        result, failure = life_cycle.partial_result(simulate)
        if not result.curves:
            raise failure or StoppedError('interrupted; no part was disturbed')
        document = DOCUMENT, result.to_json
        files = {} if arguments.report else {PICTURE: result.save_picture}
        life_cycle.finish(
            arguments, out, document, files, lambda: show_page(result.page()), result.report
        )
        disturbed = sum(int(curve.parts.sum()) for curve in result.curves)
        has = f'{disturbed} of {result.run.drops} disturbances'
        return life_cycle.exit_code(has, started, failure)
