# SPDX-License-Identifier: Apache-2.0
"""The page of ROS interfaces: topics from their table, who uses what from the nodes' sources, fields from the definitions."""

import re
from pathlib import Path
from typing import NamedTuple

from docs.from_code import NOTE, table

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
}

_NODES = {
    "bridge": "hardware_bridge", "twin": "twin", "traveller_node": "traveller", "planner": "gait_planner",
    "port_process": "hardware_bridge_stop", "remote_panel": "trial session",
    "imu_driver_node": "imu_driver", "face_estimator_node": "face_estimator",
}  # fmt: skip
_CALL = re.compile(
    r"(?P<action>ActionServer|ActionClient)\(\s*(?:self|node),\s*(?P<type>\w+),\s*\"(?P<name>\w+)\""
    r"|(?P<service>_serve|create_service|create_client)\((?P<kind>\w+), \"(?P<called>[\w/]+)\""
    r"|(?P<topic>[A-Z_]{4,})\.(?P<how>publisher|subscribe)\("
    r"|publish\((?P<recorded>[A-Z_]{4,}), "
)
"""Every way in which a node's source offers or takes a name."""

HEAD = """\
All names are relative: namespaces and remaps work. Poses are in the frame `odom`, z up. Lengths are absolute rest lengths in m
(mid stroke 0.234), and struts are named `S1`…`S6`. What the stack's parts promise each other: [architecture](../architecture.md).
Topics marked *bag* are recorded under `/recorded/…`. The tables name nodes only; console, Foxglove server and commands use these
names, too."""


class Use(NamedTuple):
    """A node that takes part in one name; `gives`: it publishes or serves it."""

    name: str
    type_name: str
    node: str
    gives: bool


def page(root: Path) -> str:
    """The page, as Markdown."""
    sources = root / "ros_ws" / "src"
    uses = _uses(sources)
    calls = [use for use in uses if "/msg/" not in use.type_name]
    unknown, gone = {use.name for use in calls} - MEANINGS.keys(), MEANINGS.keys() - {use.name for use in calls}
    if unknown or gone:
        raise ValueError(f"interfaces.py: say in MEANINGS what {sorted(unknown)} are; not in the nodes any more: {sorted(gone)}")
    lines = ["# ROS interfaces", "", NOTE, "", HEAD]
    for title, kind, head in (("Actions", "action", "action"), ("Services", "srv", "service")):
        types = {use.name: use.type_name for use in calls if f"/{kind}/" in use.type_name}
        rows = [
            (f"`{name}`", _linked(types[name]), _who(calls, name, gives=True), _who(calls, name, gives=False), does)
            for name, does in MEANINGS.items()
            if name in types
        ]
        lines += ["", f"## {title}", "", *table((head, "type", "served by", "used by", "does"), rows)]
    told = ("topic", "type", "published by", "heard by", "quality of service", "tells")
    lines += ["", "## Topics", "", *table(told, _topics(uses))]
    lines += ["", "### Quality of service", "", *table(("name", "depth", "durability", "reliability", "for"), _profiles())]
    lines += ["", "## Definitions"]
    for kind in ("msg", "srv", "action"):
        for file in sorted((sources / "tensegrity_interfaces" / kind).glob(f"*.{kind}")):
            text = file.read_text(encoding="utf-8").strip()
            lines += ["", f"### {file.name}", "", "```text", text, "```"]
    return "\n".join(lines) + "\n"


def _topics(uses: list[Use]) -> list[tuple[str, ...]]:
    from tensegrity_robot.ros import qos
    from tensegrity_robot.ros.topics import TOPICS

    profiles = {id(getattr(qos, name)): name for name in dir(qos) if name.isupper()}
    rows: list[tuple[str, ...]] = []
    for topic in TOPICS:
        heard = ", ".join(filter(None, (_who(uses, topic.name, gives=False), "*bag*" if topic.told_by else "")))
        given = _who(uses, topic.name, gives=True)
        rows.append((f"`{topic.name}`", _linked(topic.type_name), given, heard, profiles[id(topic.profile)], topic.about))
    return rows


def _who(uses: list[Use], name: str, *, gives: bool) -> str:
    return ", ".join(dict.fromkeys(use.node for use in uses if use.name == name and use.gives == gives and use.node))


def _linked(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"[{name}](#{name.lower()}{kind})" if package == "tensegrity_interfaces" else f"`{package}/{name}`"


def _uses(sources: Path) -> list[Use]:
    from tensegrity_robot.ros import topics

    files = sorted((sources / "tensegrity_robot/tensegrity_robot").rglob("*.py"))
    files.append(sources / "tensegrity_lab/tensegrity_lab/trials/remote_panel.py")
    found = [Use("stop", "std_srvs/srv/Trigger", _NODES["port_process"], gives=True)]  # named by the bridge when it starts
    for file in files:
        text = file.read_text(encoding="utf-8")
        owner = _NODES.get(file.stem) or _NODES.get(file.parent.name, "")
        types = {
            name: f"{kind.replace('.', '/')}/{name}"
            for kind, names in re.findall(r"^from (\w+\.(?:srv|action)) import ([\w, ]+)$", text, re.MULTILINE)
            for name in names.split(", ")
        }
        for call in _CALL.finditer(text):
            topic = call["topic"] or call["recorded"]
            if topic is not None and hasattr(topics, topic):
                told = getattr(topics, topic)
                found.append(Use(told.name, told.type_name, owner, call["how"] != "subscribe"))
            elif (call["type"] or call["kind"]) in types:
                how, type_name = call["action"] or call["service"], types[call["type"] or call["kind"]]
                found.append(
                    Use(call["name"] or call["called"], type_name, owner, how in ("_serve", "create_service", "ActionServer"))
                )
    return found


def _profiles() -> list[tuple[str, str, str, str, str]]:
    from tensegrity_robot.ros import qos

    text = Path(qos.__file__).read_text(encoding="utf-8")
    told = re.findall(r'^([A-Z_]+) = [^"]*\n"""(.*?)"""$', text, re.MULTILINE | re.DOTALL)
    profiles = [(name, getattr(qos, name), about) for name, about in told]
    return [
        (name, str(one.depth), one.durability.name.lower(), one.reliability.name.lower(), about) for name, one, about in profiles
    ]
