# SPDX-License-Identifier: Apache-2.0
"""The ROS domain of a stack on a virtual prototype: its own and locked, on this machine only, whatever the shell says.

A virtual stack arms and rolls without asking anybody. It must never meet a robot that is real: not by a domain that somebody
exported for the lab, nor by settings that take it onto the network.
"""

import os
import random
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

from tensegrity_lab.errors import StackError

HIGHEST = 101
"""A domain's UDP ports begin at 7400 + 250 times its number; from here on, Linux gives them to anybody."""
HIGHEST_OF_DDS = 232
DRAWN = range(1, 101)
"""Not 0, where everything is that says nothing."""
VARIABLE = "ROS_DOMAIN_ID"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
WIDER = (
    "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT", "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_ENVIRONMENT_FILE", "CYCLONEDDS_URI",
)  # fmt: skip
"""What could take a stack onto the network, or hide it from its own operator."""
FIRST_PORT, PORTS = 7400, 250
LOOK_S = 3.0
"""How long a living bridge may take to be found."""


class Domain(NamedTuple):
    """A domain. `locks`: descriptors, if it is locked: it is ours as long as any process has them open."""

    number: int
    locks: tuple[int, ...]

    @property
    def describe(self) -> str:
        """For people: how to look on."""
        return f"export {VARIABLE}={self.number}   # to join with ros2 and RViz"


@contextmanager
def private_domain(wanted: int | None = None) -> Iterator[Domain]:
    """A domain of our own for this process and its children, while the block lasts; and no discovery beyond this machine.

    The lock is a name in the kernel (an abstract Unix socket): the same for all users who share a loopback interface, gone with
    the last process that holds it, and nobody can put a link there.

    Args:
        wanted: this one, 0 to `HIGHEST`; None: one that nobody uses.

    Raises:
        StackError: it is in use, or every one is, or there is no such domain.
    """
    if wanted is not None and not 0 <= wanted <= HIGHEST:
        raise StackError(f"ROS domain {wanted}: valid is 0 to {HIGHEST}")
    with _environment():
        for name in WIDER:
            os.environ.pop(name, None)
        os.environ[RANGE] = "LOCALHOST"
        lock, number = free_lock() if wanted is None else (_wanted(wanted), wanted)
        os.environ[VARIABLE] = str(number)
        with closing(lock):
            yield Domain(number, (lock.fileno(),))


@contextmanager
def robot_domain(wanted: int | None = None) -> Iterator[Domain]:
    """The domain of a real robot, for this process and its children: `wanted`, or the shell's; without either, a private one.

    Raises StackError: a bridge runs there, or it is no domain.
    """
    number = _exported(os.environ) if wanted is None else wanted
    if number is None:
        with private_domain() as own:
            yield own
        return
    require_no_bridge(number)
    with _environment():
        os.environ[VARIABLE] = str(number)
        yield Domain(number, ())


def _exported(environ: Mapping[str, str]) -> int | None:
    """The domain that the shell says; None: it says nothing. Raises StackError: it is no domain."""
    text = environ.get(VARIABLE)
    if text is None:
        return None
    if text.strip() == "":
        return 0
    if not text.strip().isdecimal() or int(text) > HIGHEST_OF_DDS:
        raise StackError(f"{VARIABLE} is {text!r}: valid is 0 to {HIGHEST_OF_DDS}")
    return int(text)


def require_no_bridge(number: int) -> None:
    """Raises StackError if a bridge answers in a domain; takes `LOOK_S` if anybody is there at all."""
    if number in _inhabited() and (names := _bridges(number)):
        raise StackError(f"a hardware bridge runs in ROS domain {number} ({names[0]}): end it, or give another domain")


@contextmanager
def _environment() -> Iterator[None]:
    """The environment is as before when the block is over."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in (VARIABLE, RANGE, *WIDER):
            os.environ.pop(name, None)
            if name in before:
                os.environ[name] = before[name]


def free_lock() -> tuple[socket.socket, int]:
    """The lock of a domain that nobody else uses, and its number. Raises StackError: there is none."""
    inhabited = _inhabited()
    for number in random.SystemRandom().sample(DRAWN, len(DRAWN)):
        if number not in inhabited and (lock := _lock(number)) is not None:
            return lock, number
    raise StackError(f"every ROS domain from {DRAWN[0]} to {DRAWN[-1]} is in use on this machine")


def _wanted(number: int) -> socket.socket:
    lock = _lock(number)
    if lock is None:
        raise StackError(f"ROS domain {number} belongs to another virtual stack: give another --domain, or none")
    try:
        require_no_bridge(number)
    except StackError:
        lock.close()
        raise
    return lock


def _lock(number: int) -> socket.socket | None:
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f"\0sixstrut-domain-{number}")
    except OSError:
        lock.close()
        return None
    return lock


def _inhabited() -> set[int]:
    """Domains of which somebody has a UDP port, whoever that is: DDS computes its ports from the domain."""
    ports = [
        int(line.split()[1].rpartition(":")[2], 16)
        for table in (Path("/proc/net/udp"), Path("/proc/net/udp6"))
        if table.exists()
        for line in table.read_text(encoding="ascii").splitlines()[1:]
    ]
    return {(port - FIRST_PORT) // PORTS for port in ports if port >= FIRST_PORT}


def _bridges(number: int) -> list[str]:
    """Names of topics that a bridge in a domain offers."""
    from rclpy.node import Node

    from tensegrity_robot.ros.node_process import own_context

    context = own_context(number)
    node = Node("sixstrut_looks", context=context)
    until, found = time.monotonic() + LOOK_S, list[str]()
    try:
        while not found and time.monotonic() < until:
            time.sleep(0.02)
            names = (name for name, _ in node.get_topic_names_and_types() if name.endswith("/bridge/struts_sent"))
            found = [name for name in names if node.count_publishers(name)]
    finally:
        node.destroy_node()
        context.try_shutdown()
    return found
