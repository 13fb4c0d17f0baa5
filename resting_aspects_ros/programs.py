"""The programs that are installed: a signal is heeded from the first import on."""

from importlib import import_module

from resting_aspects_ros.signals import catch, end_at_once, ending_at_once


def drop_simulator() -> int:
    """Run the node alone in this process, as all here do; returns the exit code."""
    return _run('drop_simulator')


def aspect_classifier() -> int:
    """See drop_simulator."""
    return _run('aspect_classifier')


def drop_recorder() -> int:
    """See drop_simulator."""
    return _run('drop_recorder')


def feeder_example() -> int:
    """See drop_simulator."""
    return _run('feeder_example')


def log_replayer() -> int:
    """See drop_simulator."""
    return _run('log_replayer')


def resting_aspects() -> int:
    """Run the command; returns the exit code."""
    catch(end_at_once)
    from resting_aspects_ros.cli import main

    return main()


def _run(node: str) -> int:
    with ending_at_once():
        main = import_module(f'resting_aspects_ros.nodes.{node}').main
    # How it ends from here on is its own matter.
    return int(main())
