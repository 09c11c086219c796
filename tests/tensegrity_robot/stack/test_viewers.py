# SPDX-License-Identifier: Apache-2.0
"""What RViz, Foxglove and PlotJuggler are shown: stamps, frames, names; and layouts that name what is there."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader

from tensegrity_robot.ros.topics import ROBOT_DESCRIPTION, TOPICS

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "ros_ws" / "src" / "tensegrity_robot"
BAG = ROOT / "bags" / "example"
SPATIAL = ("geometry_msgs/msg/PoseArray", "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Path")
PREFIX = "/recorded"
ARRAY_INDEX = re.compile(r"\[\d+\]")


def layout(name: str) -> dict[str, Any]:
    return json.loads((PACKAGE / "foxglove" / f"{name}.json").read_text(encoding="utf-8"))


def viewed_topics() -> set[str]:
    """The topics of the live Foxglove layout and of the RViz view."""
    view = yaml.safe_load((PACKAGE / "rviz" / "tensegrity.rviz").read_text(encoding="utf-8"))
    shown = [display["Topic"]["Value"] for display in view["Visualization Manager"]["Displays"] if "Topic" in display]
    return {path.split(".")[0] for path in paths_of(layout("tensegrity")["configById"])} | {f"/{topic}" for topic in shown}


def placed(tree: Any) -> Iterator[str]:
    """The panels that a layout shows."""
    if isinstance(tree, str):
        yield tree
    else:
        yield from placed(tree["first"])
        yield from placed(tree["second"])


def paths_of(configs: dict[str, Any]) -> Iterator[str]:
    """Every topic, and topic.field, that the panels ask for."""
    for config in configs.values():
        yield from config.get("topics", ())
        yield from (path["value"] for path in config.get("paths", ()))
        yield from (config[key] for key in ("topicPath", "topicToRender") if key in config)


@pytest.fixture(scope="module")
def bag():
    """The example bag, by a reader that is not ours: (connections by topic, messages by topic)."""
    with AnyReader([BAG]) as reader:
        messages: dict[str, list[Any]] = {}
        for connection, _, data in reader.messages():
            messages.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
        yield {connection.topic: connection.msgtype for connection in reader.connections}, messages


def test_every_recorded_message_has_a_stamp_and_a_place_its_frame(bag):
    types, messages = bag
    assert set(messages) >= {f"{PREFIX}/{name}" for name in ("bridge/joint_states", "twin/joint_states", "bridge/observed_joints")}
    for topic, all_of_it in messages.items():
        markers = types[topic] == "visualization_msgs/msg/MarkerArray"
        headers = [part.header for message in all_of_it for part in (message.markers if markers else [message])]
        assert min(header.stamp.sec + 1e-9 * header.stamp.nanosec for header in headers) > 1.7e9, (
            f"{topic}: a message without a stamp"
        )
        if markers or types[topic] in SPATIAL:
            assert {header.frame_id for header in headers} == {"odom"}, topic


def test_viewers_ask_for_topics_that_there_are():
    assert viewed_topics() <= {f"/{topic.name.removeprefix('/')}" for topic in TOPICS}


def test_joint_states_name_their_struts_in_si(bag):
    _, messages = bag
    for topic in (f"{PREFIX}/bridge/joint_states", f"{PREFIX}/twin/joint_states"):
        for message in messages[topic]:
            assert list(message.name) == ["S1", "S2", "S3", "S4", "S5", "S6"]
            assert len(message.position) == 6
            assert all(0.1 < length < 0.4 for length in message.position), "metres"
    assert all(len(message.effort) == 6 for message in messages[f"{PREFIX}/twin/joint_states"])


@pytest.mark.parametrize("name", ["tensegrity", "tensegrity_bag"])
def test_a_foxglove_layout_shows_every_panel_that_it_configures(name):
    document = layout(name)
    panels = list(placed(document["layout"]))
    assert sorted(panels) == sorted(document["configById"])


def test_the_bag_s_foxglove_layout_asks_for_what_a_bag_holds(bag):
    types, messages = bag
    for path in paths_of(layout("tensegrity_bag")["configById"]):
        topic, *fields = path.split(".")
        if topic == f"{PREFIX}/keep_in":
            continue  # the example was recorded before there was an area
        assert topic in types, f"{topic}: recorded are {sorted(types)}"
        for message in messages.get(topic, [])[:1]:
            for name in fields:
                message = getattr(message, ARRAY_INDEX.sub("", name))


def test_the_live_foxglove_layout_is_the_bag_s_and_what_only_lives():
    live, bag = (set(paths_of(layout(name)["configById"])) for name in ("tensegrity", "tensegrity_bag"))
    assert {path.removeprefix(PREFIX) for path in bag} == live
    panels = layout("tensegrity")["configById"]
    assert panels["Publish!goal"]["topicName"] == "/goal_pose"
    assert panels["3D!robot"]["publish"]["poseTopic"] == "/goal_pose"
    assert panels["CallService!stop"]["serviceName"] == "/stop"
    assert not panels["CallService!stop"]["editingMode"], "a stop button, not a form"
    assert json.loads(panels["CallService!arm"]["requestPayload"]) == {"lifted_and_clear": False}, "a person must say it"


def test_rviz_shows_topics_in_the_twin_s_frame():
    view = yaml.safe_load((PACKAGE / "rviz" / "tensegrity.rviz").read_text(encoding="utf-8"))
    manager = view["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "odom"
    topics = [display["Topic"]["Value"] for display in manager["Displays"] if "Topic" in display]
    assert {"twin/markers", "bridge/observed_joints"} <= set(topics)
    (model,) = (display for display in manager["Displays"] if display["Class"].endswith("/RobotModel"))
    assert model["Description Topic"]["Value"] == ROBOT_DESCRIPTION.name
    assert model["Description Topic"]["Durability Policy"] == "Transient Local"
