# SPDX-License-Identifier: Apache-2.0
"""ROS domains of virtual stacks: private whatever the shell says, locked as long as any process of theirs lives."""

import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tensegrity_lab.errors import StackError
from tensegrity_lab.stack import ros_domain as module
from tensegrity_lab.stack.processes import Stack
from tensegrity_lab.stack.ros_domain import (
    DRAWN,
    FIRST_PORT,
    HIGHEST,
    HIGHEST_OF_DDS,
    PORTS,
    WIDER,
    private_domain,
    robot_domain,
)
from tests.hardware_bridge.strangers import needs_root, stranger
from tests.isolated_stack import free_domain

NOBODYS = range(110, 200)
"""Locks beyond those that tests and stacks beside this one draw: nobody takes one of them between two of our steps."""


@pytest.fixture
def undisturbed(monkeypatch: pytest.MonkeyPatch, worker_id: str) -> range:
    """Domains of this process alone, drawn instead of the usual ones. They are locked here, and nobody joins them."""
    first = NOBODYS[10 * (int(worker_id.removeprefix("gw")) % 9 if worker_id != "master" else 0)]
    own = range(first, first + 4)
    monkeypatch.setattr(module, "DRAWN", own)
    monkeypatch.setattr(module, "HIGHEST", HIGHEST_OF_DDS)
    monkeypatch.setattr(module, "_inhabited", set)
    return own


@pytest.mark.parametrize("exported", [None, "", "0", "57", "lab", "-3", "9999"])
def test_it_is_private_whatever_the_shell_exports(monkeypatch: pytest.MonkeyPatch, exported: str | None) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if exported is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", exported)
    with private_domain() as own:
        assert os.environ["ROS_DOMAIN_ID"] == str(own.number) != exported
        assert own.number in DRAWN
        assert own.describe == f"export ROS_DOMAIN_ID={own.number}   # to join with ros2 and RViz"
    assert os.environ.get("ROS_DOMAIN_ID") == exported


def test_it_stays_on_this_machine_whatever_the_shell_exports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    for name in WIDER:
        monkeypatch.setenv(name, "something of the lab's")
    with private_domain():
        assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
        assert not set(WIDER) & set(os.environ)
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    assert {os.environ[name] for name in WIDER} == {"something of the lab's"}


def test_no_two_have_the_same(undisturbed: range) -> None:
    with ExitStack() as stack:
        assert {stack.enter_context(free_domain()) for _ in undisturbed} == set(undisturbed)
        first, *_, last = undisturbed
        with pytest.raises(StackError, match=f"every ROS domain from {first} to {last} is in use"), free_domain():
            pass


@pytest.mark.usefixtures("undisturbed")
def test_an_explicit_one_is_taken_if_it_is_free() -> None:
    with ExitStack() as stack:
        number = stack.enter_context(free_domain())
        with pytest.raises(StackError, match=f"ROS domain {number} belongs to another virtual stack"):
            stack.enter_context(private_domain(number))
    with private_domain(number) as own:
        assert own.number == number


def test_what_is_no_domain_is_refused() -> None:
    for wrong in (-1, HIGHEST + 1):
        with pytest.raises(StackError, match="valid is 0 to 101"), private_domain(wrong):
            pass


def test_one_where_somebody_is_already_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """DDS needs UDP ports that follow from the domain, so nobody can be there unseen."""
    with free_domain() as number, free_domain() as other, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("127.0.0.1", FIRST_PORT + PORTS * number + 10))
        monkeypatch.setattr(module, "DRAWN", (number, other))
        monkeypatch.setattr(module, "_lock", lambda _: socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        with free_domain() as drawn:
            assert drawn == other


@pytest.mark.usefixtures("undisturbed")
def test_it_is_locked_as_long_as_a_process_of_its_stack_lives(tmp_path: Path) -> None:
    with private_domain() as own:
        stack = Stack(tmp_path, *own.locks)
        stack.start("child", [sys.executable, "-c", "import signal; signal.pause()"])
    with pytest.raises(StackError, match="belongs to another"), private_domain(own.number):
        pass
    stack.stop()
    with private_domain(own.number):
        pass


def test_the_lock_of_a_killed_process_is_gone(undisturbed: range) -> None:
    code = (
        "from tensegrity_lab.stack import ros_domain as module\n"
        f"module.HIGHEST, module._inhabited = {HIGHEST_OF_DDS}, set\n"
        f"with module.private_domain({undisturbed[0]}) as own: print(own.number, flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        number = int(child.stdout.readline())
        with pytest.raises(StackError, match="belongs to another"), private_domain(number):
            pass
        child.kill()
        child.wait()
        with private_domain(number):
            pass


@needs_root
@pytest.mark.usefixtures("undisturbed")
def test_another_users_stack_has_its_domain_to_itself() -> None:
    with free_domain() as number:
        pass
    script = f"lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\nlock.bind('\\0sixstrut-domain-{number}')"
    with stranger(script), pytest.raises(StackError, match="belongs to another"), private_domain(number):
        pass


def test_a_real_robot_stays_in_the_domain_that_its_user_exports(monkeypatch: pytest.MonkeyPatch) -> None:
    with free_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        with robot_domain() as its:
            assert (its.number, its.locks) == (number, ())
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    monkeypatch.setattr(module, "_inhabited", set)
    with robot_domain() as its:
        assert its.number == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "lab")
    with pytest.raises(StackError, match="ROS_DOMAIN_ID is 'lab': valid is 0 to 232"), robot_domain():
        pass
    monkeypatch.delenv("ROS_DOMAIN_ID")
    with robot_domain() as its:
        assert its.locks, "nobody said anything: private"
