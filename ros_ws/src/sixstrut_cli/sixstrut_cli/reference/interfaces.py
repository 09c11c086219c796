# SPDX-License-Identifier: Apache-2.0
"""The page of ROS interfaces: names, types and quality of service are read from the nodes' sources, fields from the definitions."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from sixstrut_cli.reference import NOTE, table

MEANINGS = {
    "roll": "roll over one edge to a neighbouring face",
    "travel": "roll to a place on the floor, one roll after another",
    "execute_struts": "move the struts along a trajectory; needs the lease",
    "arm": "arm the bridge; the planner then holds its lease",
    "disarm": "give the lease back",
    "bridge/arm": "arm: homes, and answers with the lease",
    "bridge/disarm": "end the lease",
    "stop": "hold the struts and latch FAULT; served by the process that owns the port",
    "reset": "leave FAULT, to DISARMED",
    "set_face": "say which face it stands on, and who says so",
    "log_trial": "put a trial's record into the bag; answers when it is on the disk",
    "face_graph": "gaits of a roll with their success probability, or the likeliest route",
    "rehearse": "success probability of the rolls from the face known now",
    "bridge/struts_sent": "every frame really sent to the board, with its bytes; without one, a heartbeat",
    "bridge/face": "what somebody saw, with its source",
    "bridge/state": "supervisor, link, lease, bag; also twice a second",
    "bridge/joint_states": "commanded lengths, never measured",
    "bridge/asked": "each accepted goal, as asked",
    "bridge/observed_joints": "twelve joints and the box, as the virtual prototype's observer sees them",
    "bridge/trial": "each trial's record, as logged",
    "bridge/lease": "proof of life of the lease's holder, at 2 Hz or more: a counter and its HMAC, without the lease",
    "/diagnostics": "1 Hz: link and its latencies, supervisor, frames, duty, supply, board, log, observer",
    "twin/state": "the twin, with forces and a digest of its bits",
    "twin/face": "the face that the twin predicts",
    "twin/joint_states": "length (m), speed (m/s), axial force (N)",
    "twin/joints": "twelve joints, then the box",
    "twin/pose": "the body: centre of the nodes, best-fit rotation",
    "twin/markers": "the robot for RViz and Foxglove",
    "twin/command": "lengths for a twin that is the robot (`mode:=standalone`)",
    "rehearsal": "how the next roll went on the planner's perturbed twins",
    "goal_pose": "travel there, instead of where it travels now (RViz's 2D Goal Pose); stamped now",
    "travel/path": "the way planned now",
    "travel/goal": "where that way ends",
    "trial/panel": "what a session that a person judges shows, as JSON",
    "trial/key": "keys for that session",
}

_NODES = {
    "bridge": "hardware_bridge", "twin": "twin", "traveller_node": "traveller", "planner": "gait_planner",
    "port_process": "hardware_bridge_stop", "remote_panel": "trial session",
}  # fmt: skip
_CALLS = {  # method or class -> (what, place of the type among the arguments, of the name)
    "create_publisher": ("publishes", 0, 1),
    "publisher": ("publishes", 0, 1),
    "create_subscription": ("hears", 0, 1),
    "record": ("hears", 0, 1),
    "create_service": ("serves", 0, 1),
    "create_client": ("calls", 0, 1),
    "ActionServer": ("serves", 1, 2),
    "ActionClient": ("calls", 1, 2),
}

HEAD = """\
All names are relative: namespaces and remaps work. Poses are in the frame `odom`, z up. Lengths are absolute rest lengths in m
(mid stroke 0.234), and struts are named `S1`…`S6`. What the stack's parts promise each other: [architecture](../architecture.md).
Topics marked *bag* are recorded under `/recorded/…`."""


class Use(NamedTuple):
    """A node that takes part in one name."""

    name: str
    type_name: str
    node: str
    what: str
    profile: str
    recorded: bool


def page(root: Path) -> str:
    """The page, as Markdown."""
    sources = root / "ros_ws" / "src"
    uses = _uses(sources)
    unknown, gone = {use.name for use in uses} - MEANINGS.keys(), MEANINGS.keys() - {use.name for use in uses}
    if unknown or gone:
        raise ValueError(f"interfaces.py: say in MEANINGS what {sorted(unknown)} are; not in the nodes any more: {sorted(gone)}")
    lines = ["# ROS interfaces", "", NOTE, "", HEAD]
    for title, kind, head in (
        ("Actions", "action", ("action", "type", "served by", "used by", "does")),
        ("Services", "srv", ("service", "type", "served by", "used by", "does")),
        ("Topics", "msg", ("topic", "type", "published by", "heard by", "quality of service", "tells")),
    ):
        lines += ["", f"## {title}", "", *table(head, _rows([use for use in uses if f"/{kind}/" in use.type_name], kind))]
    lines += ["", "### Quality of service", "", *table(("name", "depth", "durability", "for"), _profiles(sources))]
    lines += ["", "## Definitions"]
    for kind in ("msg", "srv", "action"):
        for file in sorted((sources / "tensegrity_interfaces" / kind).glob(f"*.{kind}")):
            text = file.read_text(encoding="utf-8").strip()
            lines += ["", f"### {file.name}", "", "```text", text, "```"]
    return "\n".join(lines) + "\n"


def _rows(uses: list[Use], kind: str) -> list[tuple[str, ...]]:
    by_name: dict[str, list[Use]] = defaultdict(list)
    for use in uses:
        by_name[use.name].append(use)
    rows = []
    for name in sorted(by_name, key=list(MEANINGS).index):
        group = by_name[name]
        types = sorted({use.type_name for use in group})
        if len(types) != 1:
            raise ValueError(f"{name} has several types in the nodes: {types}")
        giving = _who(group, ("publishes", "serves"))
        taking = _who(group, ("hears", "calls"))
        if any(use.recorded for use in group):
            taking = f"{taking}, *bag*" if taking else "*bag*"
        row = [f"`{name}`", _linked(types[0]), giving, taking]
        if kind == "msg":
            row.append(next((use.profile for use in group if use.what == "publishes" and use.profile), group[0].profile))
        rows.append((*row, MEANINGS[name]))
    return rows


def _who(uses: list[Use], what: tuple[str, ...]) -> str:
    return ", ".join(dict.fromkeys(use.node for use in uses if use.what in what and use.node))


def _linked(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"[{name}](#{name.lower()}{kind})" if package == "tensegrity_interfaces" else f"`{package}/{name}`"


def _uses(sources: Path) -> list[Use]:
    files = sorted((sources / "tensegrity_robot/tensegrity_robot").rglob("*.py"))
    files.append(sources / "tensegrity_lab/tensegrity_lab/trials/remote_panel.py")
    found = [Use("stop", "std_srvs/srv/Trigger", _NODES["port_process"], "serves", "", False)]  # named by the bridge when it starts
    for file in files:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        types = {
            (alias.asname or alias.name): f"{node.module.replace('.', '/')}/{alias.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module and node.module.endswith((".msg", ".srv", ".action"))
            for alias in node.names
        }
        texts = _texts(tree)
        owner = _NODES.get(file.stem) or _NODES.get(file.parent.name, "")
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                use = _use(node, types, texts, owner)
                if use is not None:
                    found.append(use)
    return found


def _texts(tree: ast.Module) -> dict[str, str]:
    """Names of a module that stand for texts."""
    texts = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
                for name, value in zip(names, values, strict=False):
                    if isinstance(name, ast.Name) and isinstance(value, ast.Constant) and isinstance(value.value, str):
                        texts[name.id] = value.value
    return texts


def _use(call: ast.Call, types: dict[str, str], texts: dict[str, str], owner: str) -> Use | None:
    method = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    what, at_type, at_name = _CALLS.get(method, ("", 0, 0))
    if not what or len(call.args) <= at_name or not isinstance(call.args[at_type], ast.Name):
        return None
    type_name = types.get(call.args[at_type].id)  # type: ignore[attr-defined]
    given = call.args[at_name]
    name = given.value if isinstance(given, ast.Constant) else texts.get(getattr(given, "id", ""))
    if type_name is None or not isinstance(name, str):
        return None
    profile = next((arg.attr for arg in call.args if isinstance(arg, ast.Attribute) and getattr(arg.value, "id", "") == "qos"), "")
    recorded = method in ("publisher", "record")
    return Use(name, type_name, "" if method == "record" else owner, what, profile, recorded)


def _profiles(sources: Path) -> list[tuple[str, str, str, str]]:
    from tensegrity_robot.ros import qos

    tree = ast.parse(Path(qos.__file__).read_text(encoding="utf-8"))
    rows = []
    for node, after in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(node, ast.Assign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            name = node.targets[0].id  # type: ignore[attr-defined]
            profile = getattr(qos, name)
            rows.append((name, str(profile.depth), profile.durability.name.lower(), str(after.value.value)))
    return rows
