"""Parameters of the nodes: each is declared once, with unit, bounds and description."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros.interface import FRAME


@dataclass(frozen=True)
class Parameter:
    """A parameter of a node.

    description : includes the unit
    bounds : inclusive bounds of a number
    allowed : description of the valid values of a text parameter, which the node checks
    changeable : whether it can be set while the node runs, see `on_change`; else it is read-only
    """

    name: str
    default: Any
    description: str
    bounds: tuple[float, float] | None = None
    allowed: str = ''
    changeable: bool = False

    def __post_init__(self) -> None:
        if self.bounds is not None:
            self.check(self.default)

    def check(self, value: float) -> None:
        """Raise InvalidValueError if a number is out of bounds or NaN.

        ROS checks the bounds too, but accepts values just beyond them.
        """
        assert self.bounds is not None
        low, high = self.bounds
        if not low <= value <= high:
            raise InvalidValueError(f'invalid {self.name} {value!r}: expected {low:g} to {high:g}')


FRAME_ID = Parameter(
    'frame_id',
    FRAME,
    'frame of all poses and markers: z up, z = 0 is the surface',
    allowed='the name of a frame, without a leading slash',
)


def check_frame(name: str) -> str:
    """Return the name; raises InvalidValueError if it is not a valid frame name."""
    if not name or name.startswith('/') or not name.isprintable():
        raise InvalidValueError(f'invalid {FRAME_ID.name} {name!r}: expected {FRAME_ID.allowed}')
    return name


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters and return their values.

    Raises rclpy's InvalidParameterValueException for a value out of bounds.
    """
    declared = {p.name: p for p in parameters}

    def convert(values: Iterable[RosParameter]) -> list[RosParameter]:
        return [_as_declared(declared[p.name], p) if p.name in declared else p for p in values]

    def check_bounds(name: str, value: Any) -> None:
        if name in declared and declared[name].bounds is not None:
            declared[name].check(value)

    _reject_invalid(node, check_bounds)
    node.add_pre_set_parameters_callback(convert)
    # ROS does not call the callback for values given at the start.
    overrides = node._parameter_overrides  # noqa: SLF001
    overrides.update({p.name: p for p in convert(list(overrides.values()))})
    return {
        name: node.declare_parameter(name, p.default, _descriptor(p)).value
        for name, p in declared.items()
    }


def on_change(
    node: Node, name: str, check: Callable[[Any], object], callback: Callable[[Any], object]
) -> None:
    """Call ``callback`` with each new value of a declared parameter.

    check : raises a RestingAspectsError for an invalid value; its text is returned to the client
    """

    def post_set(parameters: Iterable[RosParameter]) -> None:
        for parameter in parameters:
            if parameter.name == name:
                callback(parameter.value)

    _reject_invalid(node, lambda other, value: check(value) if other == name else None)
    # ROS calls this after all parameters of the same request have been accepted.
    node.add_post_set_parameters_callback(post_set)


def unknown_parameters(nodes: Sequence[Node]) -> list[str]:
    """Return the names of parameters that were given at the start and that no node declares."""
    known = {name for node in nodes for name in node._parameters}  # noqa: SLF001
    given = {name for node in nodes for name in node._parameter_overrides}  # noqa: SLF001
    return sorted(name for name in given - known if not name.startswith('qos_overrides.'))


def help_text(program: str, description: str, parameters: Iterable[Parameter]) -> str:
    """Return the help text of the program of a node."""
    usage = f'usage: {program} [--ros-args -p name:=value ... -r __ns:=/namespace]'
    lines = [usage, '', description, '', 'parameters:']
    lines += [f'  {p.name:19} {_help_line(p)} (default {p.default!r})' for p in parameters]
    return '\n'.join([*lines, '', 'Ctrl-C ends it.'])


def _as_declared(parameter: Parameter, value: RosParameter) -> RosParameter:
    """Return the value with an integer converted to float if needed; ROS rejects 10 for 10.0."""
    if value.type_ == RosParameter.Type.INTEGER and isinstance(parameter.default, float):
        return RosParameter(value.name, value=float(value.value))
    return value


def _help_line(parameter: Parameter) -> str:
    """Return the description of a parameter with its valid values."""
    allowed = parameter.allowed
    if parameter.bounds is not None:
        allowed = '{:g} to {:g}'.format(*parameter.bounds)
    when = 'can be set while it runs' if parameter.changeable else ''
    return '; '.join(filter(None, (parameter.description, allowed, when)))


def _reject_invalid(node: Node, check: Callable[[str, Any], object]) -> None:
    """Reject parameter values for which the check raises, with the text of its error."""

    def validate(parameters: Iterable[RosParameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                check(parameter.name, parameter.value)
        except RestingAspectsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(validate)


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description,
        additional_constraints=parameter.allowed,
        read_only=not parameter.changeable,
    )
    if parameter.bounds is not None:
        low, high = parameter.bounds
        if isinstance(parameter.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high), step=1)
            ]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
