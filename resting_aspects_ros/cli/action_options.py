"""The options of `resting_aspects reorient` that name an action and change its values."""

import argparse
import dataclasses

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.cli.options import add_quantities, flag_of
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.simulation.actions import (
    DEFAULT_TIME,
    KINDS,
    TIME,
    Actions,
    NamedAction,
    make_action,
)
from resting_aspects_ros.simulation.conditions import Quantity, quantities_of

DEFAULT_ACTION = 'tap'
# Values that several kinds of action have are listed with the first of them.
_PREFIX = 'action_'
_VALUES: dict[str, dict[str, Quantity]] = {}
for _kind, _action in KINDS.items():
    _known = {name for names in _VALUES.values() for name in names}
    _VALUES[_kind] = {k: q for k, q in quantities_of(_action).items() if k not in _known}


def add_action_values(parser: argparse.ArgumentParser) -> None:
    """Add a flag for each value of each kind of action; see requested_actions."""
    for kind, names in _VALUES.items():
        group = parser.add_argument_group(f'values of the action {kind}')
        add_quantities(group, names, _PREFIX)
    group = parser.add_argument_group('time of the action')
    add_quantities(group, {'time': TIME}, _PREFIX)


def _requested_values(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the values of an action that have a flag among the arguments, in SI units."""
    quantities = {k: q for names in _VALUES.values() for k, q in names.items()}
    return {
        name: parse_quantity(flag_of(name), text, quantity.unit)
        for name, quantity in {**quantities, 'time': TIME}.items()
        if (text := getattr(arguments, _PREFIX + name)) is not None
    }


def requested_actions(arguments: argparse.Namespace) -> list[NamedAction]:
    """Return the actions that the flags request; raises InvalidValueError."""
    known = shipped_actions() if arguments.actions is None else Actions.read(arguments.actions)
    values = _requested_values(arguments)
    time = values.pop('time', None)
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
