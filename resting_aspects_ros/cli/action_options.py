"""The options of `resting_aspects reorient` that name an action and change its values."""

import argparse
import dataclasses
import textwrap

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.cli.options import add_quantities, flag_of
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.actions import (
    DEFAULT_TIME,
    KINDS,
    TIME,
    Actions,
    NamedAction,
    make_action,
)
from resting_aspects_ros.simulation.conditions import quantities_of

DEFAULT_ACTION = 'tap'
_PREFIX = 'action_'


def add_action_values(parser: argparse.ArgumentParser) -> None:
    """Add a flag for each value of each kind of action; see requested_actions.

    The flag of a value that several kinds have is in the group of the first of them. The groups of
    the others describe it.
    """
    known: set[str] = set()
    for kind, action in KINDS.items():
        values = quantities_of(action)
        shared = [f'{flag_of(k)}: {q.text}' for k, q in values.items() if k in known]
        text = textwrap.fill('; '.join(shared), 76) or None
        group = parser.add_argument_group(f'values of the action {kind}', text)
        add_quantities(group, {k: q for k, q in values.items() if k not in known}, _PREFIX)
        known |= values.keys()
    group = parser.add_argument_group('time of the action')
    add_quantities(group, {'time': TIME}, _PREFIX)


def known_actions(arguments: argparse.Namespace) -> Actions:
    """Return the actions of the file that --actions names, or those of the suite."""
    return shipped_actions() if arguments.actions is None else Actions(arguments.actions)


def requested_actions(arguments: argparse.Namespace) -> list[NamedAction]:
    """Return the actions that the flags request; raises InvalidValueError."""
    known = known_actions(arguments)
    values = {
        name: value
        for name in {name for kind in KINDS.values() for name in quantities_of(kind)}
        if (value := getattr(arguments, _PREFIX + name)) is not None
    }
    time = arguments.action_time
    text = arguments.action
    if text is None:
        text = DEFAULT_ACTION if arguments.actions is None else ','.join(known.names())
    names = [name.strip() for name in text.split(',')]
    if len(names) != len(set(names)):
        raise InvalidValueError(f'invalid --action {text!r}: expected different names')
    if (values or time is not None) and len(names) > 1:
        raise InvalidValueError(
            f'invalid --action {text!r}: expected a single action with values, such as --speed'
        )
    return [_named_action(name, known, values, time) for name in names]


def _named_action(
    name: str, known: Actions, values: dict[str, float], time: float | None
) -> NamedAction:
    if name in KINDS and name not in known.names():
        action = make_action(name, values)
        return NamedAction(name, action, DEFAULT_TIME if time is None else time)
    base = known.get(name)
    if time is not None:
        base = dataclasses.replace(base, time=time)
    if not values:
        return base
    changed = make_action(base.action.kind, {**base.action.numbers, **values})
    return NamedAction(f'{name}_changed', changed, base.time)
