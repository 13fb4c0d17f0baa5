"""The command `resting_aspects`: parses its words, runs a subcommand, reports errors in a line."""

import argparse
import errno
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NoReturn

from resting_aspects_ros import __version__, errors
from resting_aspects_ros.cli.life_cycle import (
    DONE,
    FAILED,
    INTERRUPTED,
    WRONG_INPUT,
    tables_written,
)
from resting_aspects_ros.cli.verbs import COMMANDS, GROUPS
from resting_aspects_ros.system import SIGNALS, catch

MAX_LINE = 2000
# Modules of ROS and of the messages of the suite.
ROS = re.compile(r'[^.]*(rclpy|_interfaces|_msgs|_srvs)\b')
# Errors of input: the exit code is 2.
WRONG = errors.PartError, errors.UnknownPartError, errors.InvalidValueError, errors.NoLogError
INSTALL_ROS = 'run `make setup` in a clone of the suite, or use an installed ROS 2 Jazzy'

DESCRIPTION = """How a part comes to rest when it is dropped, and how probable each way is.
Start with: resting_aspects drop l_bracket"""
EXIT_CODES = """exit codes:
  0    done
  1    failure during the work; partial results are saved
  2    wrong input: one line names the value and what was expected
  130  interrupted; partial results are saved
"""


class _Parser(argparse.ArgumentParser):
    """Parser that prints one line for wrong input, and accepts no abbreviated flags."""

    # The command whose help lists the flags: unknown flags are reported by the main parser.
    helpful = ''
    flags: Sequence[str] = ()

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        if re.fullmatch(r'unrecognized arguments:[ \d,]+', message):
            message += '; several numbers are separated by commas without spaces, such as 1,3'
        elif unknown := re.match(r'unrecognized arguments: (--[a-z-]+)', message):
            message += errors.did_you_mean(unknown[1], self.flags)
        text = f'{errors.one_line(message, MAX_LINE)} (see {self.helpful or self.prog} --help)'
        self.exit(WRONG_INPUT, f'error: {text}\n')


def make_parser(argv: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser of all subcommands, with the flags of the one that `argv` requests."""
    parser = _Parser(
        prog='resting_aspects',
        usage='resting_aspects COMMAND ...',
        description=DESCRIPTION,
        epilog=f'{_listed_commands()}\n{EXIT_CODES}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'%(prog)s {__version__}')
    subparsers = parser.add_subparsers(
        prog='resting_aspects', metavar='COMMAND', required=True, help=argparse.SUPPRESS
    )
    requested = next((word for word in argv if not word.startswith('-')), '')
    if argv and requested == argv[0] and requested not in COMMANDS:
        parser.error(
            f'invalid command {errors.shown(requested)}: expected one of {", ".join(COMMANDS)}'
            f'{errors.did_you_mean(requested, COMMANDS)}'
        )
    for command in COMMANDS:
        if command == requested:
            module = import_module(f'resting_aspects_ros.cli.verbs.{command}')
            subparser = subparsers.add_parser(
                command,
                description=module.DESCRIPTION,
                epilog=module.EXAMPLES,
                formatter_class=argparse.RawDescriptionHelpFormatter,
            )
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run)
            parser.helpful = subparser.prog
            parser.flags = re.findall(r'--[a-z][a-z-]+', subparser.format_usage())
        else:
            subparsers.add_parser(command)
    return parser


def _listed_commands() -> str:
    """Return the commands by group, a line each."""
    width = max(map(len, COMMANDS))
    return '\n'.join(
        f'{title}:\n' + ''.join(f'  {name:<{width}}  {text}\n' for name, text in group.items())
        for title, group in GROUPS.items()
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    if isinstance(sys.stdout, TextIOWrapper):
        # Output contains file names, which the terminal's encoding may not represent.
        sys.stdout.reconfigure(errors='backslashreplace')
    # Before NumPy is imported: all cores are used by worker processes, and threads of small matrix
    # products would only wait for each other.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    words = _joined(sys.argv[1:] if argv is None else argv)
    try:
        # SIGTERM and SIGHUP end the command in the same orderly way as Ctrl-C.
        catch(signal.default_int_handler)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('always', errors.RestingAspectsWarning)
                warnings.showwarning = partial(_print_warning, warnings.showwarning)
                arguments = make_parser(words).parse_args(words)
                with tables_written(getattr(arguments, 'table', None)):
                    code: int = arguments.run(arguments) or DONE
        finally:
            print(end='', flush=True)  # standard output may be closed
    except BrokenPipeError:  # the reader of the pipe closed it
        _discard_output()
        return FAILED
    except KeyboardInterrupt:
        # Block further signals: the interpreter removes its handlers as it ends, and the exit code
        # would become that of the signal. Threads that libraries started are not blocked.
        if hasattr(signal, 'pthread_sigmask'):
            signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        return _end(INTERRUPTED, 'interrupted')
    except errors.StoppedError as error:
        return _end(INTERRUPTED, str(error))
    except Exception as error:  # noqa: BLE001 an unknown error is raised again
        return _end(*_outcome(error))
    return code


def _print_warning(
    show: Callable[..., object], message: Warning | str, category: type[Warning], *where: Any
) -> None:
    """Print a warning of the suite as one line, and show any other one."""
    if issubclass(category, errors.RestingAspectsWarning):
        print(f'warning: {message}', file=sys.stderr)
    else:
        show(message, category, *where)


def _discard_output() -> None:
    """Keep the interpreter from writing the rest of the output again as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _outcome(error: Exception) -> tuple[int, str]:
    """Return exit code and message of an error; raises an unexpected error again."""
    code, text = FAILED, str(error)
    if isinstance(error, WRONG):
        code = WRONG_INPUT
    elif isinstance(error, MemoryError):
        text = 'there is not enough memory'
    elif isinstance(error, ModuleNotFoundError) and ROS.match(error.name or ''):
        text = f'this needs {error.name}: {INSTALL_ROS}'
    elif isinstance(error, OSError):
        place = f'{error.filename!r}: ' if error.filename else ''
        if not place and error.errno == errno.ENOSPC:  # errors of other files have a path
            _discard_output()
            place = 'standard output: '
        text = f'{place}{error.strerror or error}'
    elif not isinstance(error, errors.RestingAspectsError):
        raise error
    return code, f'error: {text}'


def _joined(argv: Sequence[str]) -> list[str]:
    """Join a flag and its negative value into one word: argparse takes -3mm for a flag."""
    joined: list[str] = []
    for k, word in enumerate(argv):
        if word in ('--', '--ros-args'):
            return [*joined, *argv[k:]]
        if joined and re.fullmatch('--[a-z-]+', joined[-1]) and re.match(r'-\.?\d', word):
            joined[-1] += f'={word}'
        else:
            joined.append(word)
    return joined


def _end(code: int, message: str) -> int:
    with suppress(OSError):  # the terminal is closed
        print(errors.one_line(message, MAX_LINE), file=sys.stderr)
    return code
