"""The nodes' parameters: each declared once, with unit, bounds and description."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.node import Node


@dataclass(frozen=True)
class Parameter:
    """A read-only parameter of a node. ``bounds`` are inclusive and for integers."""

    name: str
    default: Any
    description: str
    bounds: tuple[int, int] | None = None


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters and return their values.

    Raises rclpy's InvalidParameterValueException for a value out of bounds.
    """
    return {
        p.name: node.declare_parameter(p.name, p.default, _descriptor(p)).value for p in parameters
    }


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=parameter.description, read_only=True)
    if parameter.bounds is not None:
        low, high = parameter.bounds
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor
