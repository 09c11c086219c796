# SPDX-License-Identifier: Apache-2.0
"""Goals of `execute_struts` that are too long are known by their size, before anything is made of them.

rclpy makes a Python object of every point of a trajectory: for one of 300,000 points that takes seconds, in which the node hears
nothing. The middleware has the message as a C structure, which says how many points there are. So the conversion of goal requests
is replaced by one that looks there first. It is the conversion of one type, in the bridge's process only.
"""

import ctypes
from typing import Any

from hardware_bridge.safety.trajectory import MAX_KNOTS
from tensegrity_interfaces.action import ExecuteStruts

MOST_NAMES = 100
"""More than anybody means: the error about names is better than one about their count."""


class TooLong(ExecuteStruts.Goal):
    """Stands for a goal that was not read. Attributes: why: for people."""

    why: str


class _String(ctypes.Structure):
    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


class _Sequence(_String):
    pass


class _GoalRequest(ctypes.Structure):
    """The beginning of tensegrity_interfaces__action__ExecuteStruts_SendGoal_Request."""

    _fields_ = (
        ("goal_id", ctypes.c_uint8 * 16),
        ("sec", ctypes.c_int32),
        ("nanosec", ctypes.c_uint32),
        ("frame_id", _String),
        ("joint_names", _Sequence),
        ("points", _Sequence),
    )


_CONVERT = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_kept: list[Any] = []


def bound_goals() -> None:
    """A goal request of more than `MAX_KNOTS` points comes as a `TooLong`; to be called before the action server is made."""
    request_type = ExecuteStruts.Impl.SendGoalService.Request
    meta = type(request_type)
    if meta._CONVERT_TO_PY is None:
        meta.__import_type_support__()
    if _kept:
        return
    pointer_of = ctypes.pythonapi.PyCapsule_GetPointer
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    capsule_of = ctypes.pythonapi.PyCapsule_New
    capsule_of.restype, capsule_of.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    convert = _CONVERT(pointer_of(meta._CONVERT_TO_PY, None))

    def bounded(address: int) -> Any:
        raw = _GoalRequest.from_address(address)
        if raw.points.size <= MAX_KNOTS and raw.joint_names.size <= MOST_NAMES:
            return convert(address)
        goal = TooLong()
        goal.why = (
            f"the trajectory has {raw.points.size} points of {raw.joint_names.size} joints, valid are up to {MAX_KNOTS} points of "
            "6 joints: send fewer, straight lines need only their ends"
        )
        request = request_type(goal=goal)
        request.goal_id.uuid = list(raw.goal_id)
        return request

    callback = _CONVERT(bounded)
    address = ctypes.cast(callback, ctypes.c_void_p).value
    meta._CONVERT_TO_PY = capsule_of(address, None, None)
    _kept.append(callback)  # for as long as the process lives
