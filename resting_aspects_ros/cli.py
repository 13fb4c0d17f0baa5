"""The command `resting_aspects`."""

import argparse
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from resting_aspects_ros import __version__
from resting_aspects_ros.commands import demo, drop, nodes, request
from resting_aspects_ros.core.errors import RestingAspectsError

DONE, WRONG_INPUT, INTERRUPTED = 0, 2, 130

DESCRIPTION = """How a part comes to rest when it is dropped, and how probable each way is.
Start with: resting_aspects drop l_bracket"""


class _Parser(argparse.ArgumentParser):
    """One line for wrong input, not the whole usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_INPUT, f'error: {message} (see {self.prog} --help)\n')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 2 wrong input, 130 interrupted."""
    parser = _Parser(
        prog='resting_aspects',
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=__version__)
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True)
    for command in (drop, request, nodes, demo):
        command.add(subparsers)
    arguments = parser.parse_args(argv)
    # Stopped by a service manager or a closed terminal: the same orderly end as Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.default_int_handler)
    try:
        return int(arguments.run(arguments))
    except RestingAspectsError as error:
        print(f'error: {error}', file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == '__main__':
    sys.exit(main())
