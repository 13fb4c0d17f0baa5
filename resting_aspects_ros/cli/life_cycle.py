"""The life cycle of a command that simulates: workers, interruption, files, messages, exit code.

A command parses its flags, opens a `session`, calls a public function with the options of the
session, and saves and shows the result with `finish`, even if it is a partial one.
"""

import argparse
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from resting_aspects_ros.errors import EngineError, LogError, RestingAspectsError, analysis, warn
from resting_aspects_ros.system import Interruption, available_cores, catch

if TYPE_CHECKING:
    from resting_aspects_ros.report.table import Table

T = TypeVar('T')
DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


@contextmanager
def session(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Start the workers that --workers or --scheduler requests, and note Ctrl-C inside the `with`.

    Yields the options of the functions that simulate. The workers are stopped last, so that the
    result is written even if stopping them fails. Raises InvalidValueError.
    """
    with Interruption() as stop:
        # This import is slow because of NumPy.
        from resting_aspects_ros.simulation.workers import ClusterWorkers, LocalWorkers

        workers: ClusterWorkers | LocalWorkers
        if arguments.scheduler is not None:
            workers = ClusterWorkers(arguments.scheduler)
        else:
            count = available_cores() if arguments.workers is None else arguments.workers
            workers = LocalWorkers(count)
        try:
            yield {'workers': workers, 'progress': True, 'stopped': lambda: stop.asked}
        finally:
            workers.stop()


def partial_result(simulate: Callable[[], T]) -> tuple[T, RestingAspectsError | None]:
    """Return the result of a simulation; if it failed midway, what it has, and the error."""
    try:
        return simulate(), None
    except (EngineError, LogError) as error:
        if not error.result:
            raise
        return error.result, error


def exit_code(
    has: str, started: dict[str, Any], failure: RestingAspectsError | None = None
) -> int:
    """Return the exit code, after a message if Ctrl-C was pressed; raises the failure.

    has : how much the result has
    """
    if failure is not None:
        raise type(failure)(f'{failure}; the result has {has}')
    if not started['stopped']():
        return DONE
    print(f'interrupted; the result has {has}', file=sys.stderr)
    return INTERRUPTED


# -- Files ----------------------------------------------------------------------------------------


def result_folder(arguments: argparse.Namespace, part: str, files: Iterable[str]) -> Path | None:
    """Make the folder of a result with the given files; None if nothing is saved.

    Raises InvalidValueError if the folder, or a file in it, cannot be written.
    """
    from resting_aspects_ros.api.result import check_files

    flag, out = '--out', arguments.out
    if out is None and getattr(arguments, 'report', False):
        flag, out = '--report', Path('out') / part
    if out is not None:
        check_files(flag, out, files)
    return out


# Tables that the command has shown, for --table.
shown_tables: 'list[Table]' = []


@contextmanager
def tables_written(path: Path | None) -> Iterator[None]:
    """Write the tables that are shown during the `with` into a file; None: do nothing.

    An XLSX file has a sheet for each table. As CSV, each table after the first is a file of its
    own, whose name ends with its number: nut.csv, nut_2.csv.

    Raises InvalidValueError for another ending, or if the file cannot be written; OutputError.
    """
    shown_tables.clear()
    if path is None:
        yield
        return
    # These imports are slow, and only needed for files.
    from resting_aspects_ros.api.result import check_output, whole_file
    from resting_aspects_ros.report.table import check_ending, save_csv, save_xlsx

    check_ending('--table', path)
    check_output('--table', path)
    try:
        yield
        if not shown_tables:
            warn(f'{path} was not written: there is no table')
    finally:  # also the tables of a partial result
        if path.suffix.lower() != '.xlsx':
            for number, table in enumerate(shown_tables, start=1):
                name = path if number == 1 else path.with_stem(f'{path.stem}_{number}')
                with whole_file(name) as file:
                    save_csv(table, file)
        elif shown_tables:
            with whole_file(path) as file:
                save_xlsx(shown_tables, file)


def finish(
    arguments: argparse.Namespace,
    out: Path | None,
    document: tuple[str, Callable[[], str]],
    files: Mapping[str, Callable[[Path], object]],
    show: Callable[[], None],
    report: Callable[[Path], Path] | None = None,
    written: Sequence[Path] = (),
) -> None:
    """Save and show a result, each even if the other fails; the slow report is last.

    Parameters
    ----------
    out : folder of the result; None to save nothing
    document : name of the file of the JSON document, and what returns it; --json prints it
    files : what writes each other file
    show : prints the result without --json
    report : writes the report into the folder, and returns its path; a flag --report must be given
    written : files that are written already
    """

    def shown() -> None:
        with analysis('the tables of the result'):
            show()

    saved = []
    name, text = document
    saves = {name: lambda path: save_text(path, text()), **files}
    try:
        for path, save in [] if out is None else [(out / name, saves[name]) for name in saves]:
            with analysis(f'the file {path.name}'):
                save(path)
                saved.append(path)
    finally:
        show_result(arguments, text, shown)
    paths = [*saved, *written]
    if paths:
        say(arguments, f'Written: {", ".join(str(path) for path in paths)}')
    if report is not None and getattr(arguments, 'report', True) and out is not None:
        # Everything else is saved, so Ctrl-C may end the report at once.
        catch(signal.default_int_handler)
        with analysis('the report'):
            say(arguments, f'Report: {report(out)}')


def save_text(path: Path, text: str) -> None:
    """Write a text file as a whole; raises OutputError."""
    from resting_aspects_ros.api.result import whole_file

    with whole_file(path) as file:
        file.write_text(text, encoding='utf-8')


def show_result(
    arguments: argparse.Namespace, document: Callable[[], str], show: Callable[[], None]
) -> None:
    """Print the JSON document if --json requests it, else the tables and texts of a result."""
    if arguments.json:
        print(document(), end='')
    else:
        show()


def say(arguments: argparse.Namespace, line: str) -> None:
    """Print a line, unless the output is a JSON document."""
    if not arguments.json:
        print(line, flush=True)
