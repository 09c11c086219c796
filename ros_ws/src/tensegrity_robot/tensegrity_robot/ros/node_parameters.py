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

from tensegrity_robot.ros.errors import StartError

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

    Raises StartError: a value of the wrong type or outside its range, naming parameter, value and what is valid.
    """
    return settings(**{row.name: _declare(node, row) for row in fields(settings)})


def _declare(node: Node, row: Field[Any]) -> Any:
    low, high, choices = row.metadata["low"], row.metadata["high"], row.metadata["choices"]
    kind = type(row.default)
    descriptor = ParameterDescriptor(name=row.name, description=row.metadata["description"], read_only=True)
    valid = {bool: "true or false", int: "a whole number", float: "a decimal number, such as 1.0", str: "text"}[kind]
    if kind is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)]
        valid += f", from {low:g} to {high:g}"
    elif kind is int:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        valid += f", from {low:g} to {high:g}"
    elif choices:
        valid = " or ".join(repr(choice) for choice in choices)
        descriptor.additional_constraints = valid
    try:
        value = node.declare_parameter(row.name, row.default, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise StartError(f"parameter {row.name}: valid is {valid} ({error})") from error
    if (choices and value not in choices) or (kind is float and not math.isfinite(value)):
        raise StartError(f"parameter {row.name} is {value!r}: valid is {valid}")
    return value
