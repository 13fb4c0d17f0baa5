"""The nodes' parameters: each declared once, with unit, bounds and description."""

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

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros.interface import FRAME


@dataclass(frozen=True)
class Parameter:
    """A parameter of a node.

    description : with the unit
    bounds : inclusive, of a number
    allowed : in words, of a text that cannot be just any; the node checks it
    changeable : it can be set while the node runs, see `on_change`; else it is read-only
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
        """Raise InvalidValueError if a number is out of bounds, or NaN.

        ROS checks the same, but lets pass what is just beyond a bound.
        """
        assert self.bounds is not None
        low, high = self.bounds
        if not low <= value <= high:
            raise InvalidValueError(f'{self.name} is {value!r}, allowed is {low:g} to {high:g}')


FRAME_ID = Parameter(
    'frame_id',
    FRAME,
    'frame of all poses and markers: z up, z = 0 is the surface',
    allowed='the name of a frame, without a slash at the front',
)


def check_frame(name: str) -> str:
    """Return the name; raises InvalidValueError if no frame can have it."""
    if not name or name.startswith('/') or not name.isprintable():
        raise InvalidValueError(f'invalid {FRAME_ID.name} {name!r}: expected {FRAME_ID.allowed}')
    return name


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters and return their values.

    Raises rclpy's InvalidParameterValueException for a value out of bounds.
    """
    declared = {p.name: p for p in parameters}

    def as_declared(given: Iterable[RosParameter]) -> list[RosParameter]:
        return [_as_declared(declared[p.name], p) if p.name in declared else p for p in given]

    def within_bounds(name: str, value: Any) -> None:
        if name in declared and declared[name].bounds is not None:
            declared[name].check(value)

    _refuse(node, within_bounds)
    node.add_pre_set_parameters_callback(as_declared)
    # Those that are given at the start do not come by there.
    overrides = node._parameter_overrides  # noqa: SLF001
    overrides.update({p.name: p for p in as_declared(list(overrides.values()))})
    return {
        name: node.declare_parameter(name, p.default, _descriptor(p)).value
        for name, p in declared.items()
    }


def on_change(
    node: Node, name: str, check: Callable[[Any], object], then: Callable[[Any], object]
) -> None:
    """Follow a declared parameter that can be set while the node runs.

    check : raises a RestingAspectsError, whose words are the answer, for a value that is not
        allowed
    then : called with each new value
    """

    def changed(parameters: Iterable[RosParameter]) -> None:
        for parameter in parameters:
            if parameter.name == name:
                then(parameter.value)

    _refuse(node, lambda other, value: check(value) if other == name else None)
    # Not before all parameters that are set with it are found to be allowed.
    node.add_post_set_parameters_callback(changed)


def unknown_parameters(nodes: Sequence[Node]) -> list[str]:
    """Names that were given when the nodes were started and that none of them has."""
    known = {name for node in nodes for name in node._parameters}  # noqa: SLF001
    given = {name for node in nodes for name in node._parameter_overrides}  # noqa: SLF001
    return sorted(name for name in given - known if not name.startswith('qos_overrides.'))


def help_text(program: str, does: str, parameters: Iterable[Parameter]) -> str:
    """What a node's program says of itself; does : what the node does, in a line or more."""
    usage = f'usage: {program} [--ros-args -p name:=value ... -r __ns:=/namespace]'
    lines = [usage, '', does, '', 'parameters:']
    lines += [f'  {p.name:19} {_words(p)} (default {p.default!r})' for p in parameters]
    return '\n'.join([*lines, '', 'Ctrl-C ends it.'])


def _as_declared(parameter: Parameter, given: RosParameter) -> RosParameter:
    """ROS takes no 10 for 10.0, which is easily written, and clear."""
    if given.type_ == RosParameter.Type.INTEGER and isinstance(parameter.default, float):
        return RosParameter(given.name, value=float(given.value))
    return given


def _words(parameter: Parameter) -> str:
    """The description, with what is allowed, and when."""
    allowed = parameter.allowed
    if parameter.bounds is not None:
        allowed = '{:g} to {:g}'.format(*parameter.bounds)
    when = 'can be set while it runs' if parameter.changeable else ''
    return '; '.join(filter(None, (parameter.description, allowed, when)))


def _refuse(node: Node, check: Callable[[str, Any], object]) -> None:
    """Refuse to set what the check raises for, in its words."""

    def answer(parameters: Iterable[RosParameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                check(parameter.name, parameter.value)
        except RestingAspectsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(answer)


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
