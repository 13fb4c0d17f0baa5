"""The nodes' parameters: each declared once, with unit, bounds and description."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node


@dataclass(frozen=True)
class Parameter:
    """A read-only parameter of a node. ``bounds`` are inclusive, and for numbers."""

    name: str
    default: Any
    description: str
    bounds: tuple[float, float] | None = None


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters and return their values.

    Raises rclpy's InvalidParameterValueException for a value out of bounds.
    """
    return {
        p.name: node.declare_parameter(p.name, p.default, _descriptor(p)).value for p in parameters
    }


def unknown_parameters(nodes: Sequence[Node]) -> list[str]:
    """Names that were given when the nodes were started and that none of them has."""
    known = {name for node in nodes for name in node._parameters}  # noqa: SLF001
    given = {name for node in nodes for name in node._parameter_overrides}  # noqa: SLF001
    return sorted(name for name in given - known if not name.startswith('qos_overrides.'))


def help_text(program: str, parameters: Iterable[Parameter]) -> str:
    """What a node's program says of itself."""
    lines = [f'usage: {program} [--ros-args -p name:=value ... -r __ns:=/namespace]', '']
    lines += [f'  {p.name:19} {p.description} (default {p.default!r})' for p in parameters]
    return '\n'.join([*lines, '', 'Ctrl-C ends it.'])


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=parameter.description, read_only=True)
    if parameter.bounds is not None:
        low, high = parameter.bounds
        if isinstance(parameter.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            whole = IntegerRange(from_value=int(low), to_value=int(high), step=1)
            descriptor.integer_range = [whole]
    return descriptor
