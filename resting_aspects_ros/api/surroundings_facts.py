"""The surroundings of a run in words, for the report page."""

from collections.abc import Iterator

from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.quantity import quantities_of
from resting_aspects_ros.simulation.surroundings.description import (
    BODY_VALUES,
    RELEASE_VALUES,
    Surroundings,
)
from resting_aspects_ros.simulation.surroundings.texts import value_text


def surroundings_facts(
    surroundings: Surroundings, conditions: DropConditions
) -> Iterator[tuple[str, str]]:
    """Yield label and value: the kind, its dimensions, each body, and the release.

    The friction and the other values of a body are those of the conditions unless it has its own.
    """
    shape = surroundings.shape
    yield 'kind', shape.kind.replace('_', ' ')
    for name, quantity in quantities_of(shape).items():
        yield quantity.label, value_text(getattr(shape, name), quantity.unit)
    for name, text in getattr(shape, 'texts', {}).items():
        yield name.replace('_', ' '), text
    for body in shape.body_names:
        own = surroundings.bodies.get(body, {})
        values = {
            key: own.get(key, 0.0 if key == 'speed' else getattr(conditions, key))
            for key in BODY_VALUES
        }
        if not values['speed']:
            del values['speed']
        yield (
            body.replace('_', ' '),
            ', '.join(
                f'{BODY_VALUES[key].label} {value_text(value, BODY_VALUES[key].unit)}'
                for key, value in values.items()
            ),
        )
    for name, value in surroundings.release.items():
        yield RELEASE_VALUES[name].text, value_text(value, 'm')
    if surroundings.orientation is not None:
        x, y, z, w = surroundings.orientation
        yield 'orientation at release', f'x {x:.4g}, y {y:.4g}, z {z:.4g}, w {w:.4g}'
