# SPDX-License-Identifier: Apache-2.0
"""Message classes by the names that bags and the ROS graph give."""

import importlib
from typing import Any

from tensegrity_lab.errors import StackError


def message_class(type_name: str) -> Any:
    """The class of "package/msg/Name". Raises StackError: that package is not here."""
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise StackError(f"messages of type {type_name} are not installed here") from error
