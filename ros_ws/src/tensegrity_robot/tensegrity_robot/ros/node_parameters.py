# SPDX-License-Identifier: Apache-2.0
"""A node's parameters as one frozen dataclass: typed, described, with ranges, read once at the start.

>>> @dataclass(frozen=True)
... class Settings:
...     rate_hz: float = parameter(20.0, "how often the state is published [Hz]", low=1.0, high=200.0)
>>> settings = declare_parameters(node, Settings)
"""

from __future__ import annotations

import math
from dataclasses import Field, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from tensegrity_robot.ros.errors import StartError, require_known

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def parameter(
    default: bool | int | float | str,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field that is a ROS parameter. Numbers need `low` and `high`; text may have `choices`."""
    return field(default=default, metadata={"description": description, "low": low, "high": high, "choices": choices})


def declare_parameters(node: Node, settings: type[T]) -> T:
    """Declare every field of `settings` on the node, read-only, and return it filled with the values given at the start.

    Raises StartError: a value of the wrong type or outside its range, naming parameter, value and what is valid; or a value for a
    parameter that the node does not have, with the nearest name.
    """
    declared = settings(**{row.name: _declare(node, row) for row in fields(settings)})
    # rclpy tells nobody what was given in vain; what it declares itself, such as use_sim_time, is not
    given = {name for name in node._parameter_overrides if not (name.startswith("qos_overrides.") or node.has_parameter(name))}
    known = [row.name for row in fields(settings)]
    require_known("parameter", given, known, f"`{node.get_name()} --help` lists all")
    return declared


def valid_of(row: Field[Any]) -> str:
    """What a parameter may be, for people."""
    low, high, choices = row.metadata["low"], row.metadata["high"], row.metadata["choices"]
    if choices:
        return " or ".join(repr(choice) for choice in choices)
    kind = {bool: "true or false", int: "a whole number", float: "a decimal number, such as 1.0", str: "text"}[type(row.default)]
    return kind if low is None else f"{kind}, from {low:g} to {high:g}"


def _declare(node: Node, row: Field[Any]) -> Any:
    low, high, choices = row.metadata["low"], row.metadata["high"], row.metadata["choices"]
    kind = type(row.default)
    descriptor = ParameterDescriptor(name=row.name, description=row.metadata["description"], read_only=True)
    valid = valid_of(row)
    if kind is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)]
    elif kind is int:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    elif choices:
        descriptor.additional_constraints = valid
    try:
        value = node.declare_parameter(row.name, row.default, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise StartError(f"parameter {row.name}: valid is {valid} ({error})") from error
    if (choices and value not in choices) or (kind is float and not math.isfinite(value)):
        raise StartError(f"parameter {row.name} is {value!r}: valid is {valid}")
    return value
