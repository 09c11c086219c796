# SPDX-License-Identifier: Apache-2.0
"""What makes a folder with a log a bag of rosbag2: its `metadata.yaml`, as Jazzy writes it."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.records import Channel
from mcap.summary import Summary

from hardware_bridge.recording.bag_reader import ROSBAG2, file_of
from sim_core.errors import YamlError
from sim_core.files.yaml_reader import parse_yaml, yaml_text

VERSION = 9
"""Of the layout; rosbag2 of Iron and older reads up to 8."""
_DISTRO = "jazzy"


def write_metadata(file: Path, summary: Summary) -> None:
    """Beside a log that is alone in a folder of its own name; to be renamed into place with the log. Raises OSError."""
    if file != file_of(file.parent):
        return
    target = file.with_name(ROSBAG2)
    temporary = target.with_name(target.name + ".tmp")
    with temporary.open("w", encoding="utf-8") as stream:
        stream.write(yaml_text(_document(file.name, summary)))
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(target)


def _document(name: str, summary: Summary) -> dict[str, Any]:
    told = summary.statistics
    assert told is not None
    counts = told.channel_message_counts
    begins = {"nanoseconds_since_epoch": told.message_start_time}
    lasts = {"nanoseconds": told.message_end_time - told.message_start_time}

    def topic(channel: Channel) -> dict[str, Any]:
        schema, offered = summary.schemas.get(channel.schema_id), None
        with suppress(YamlError):  # a journal may come from anywhere
            offered = parse_yaml(channel.metadata.get("offered_qos_profiles", ""), channel.topic)
        return {
            "name": channel.topic,
            "type": schema.name if schema is not None else "",
            "serialization_format": channel.message_encoding,
            "offered_qos_profiles": offered if isinstance(offered, list) else [],
            "type_description_hash": channel.metadata.get("topic_type_hash", ""),
        }

    topics = [{"topic_metadata": topic(one), "message_count": counts.get(one.id, 0)} for one in summary.channels.values()]
    return {
        "rosbag2_bagfile_information": {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": lasts,
            "starting_time": begins,
            "message_count": told.message_count,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name],
            "files": [{"path": name, "starting_time": dict(begins), "duration": dict(lasts), "message_count": told.message_count}],
            "custom_data": {},
            "ros_distro": os.environ.get("ROS_DISTRO") or _DISTRO,
        }
    }
