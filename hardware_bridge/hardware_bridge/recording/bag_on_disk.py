# SPDX-License-Identifier: Apache-2.0
"""What a bag is on the disk: a folder with the log and rosbag2's `metadata.yaml`, as Jazzy writes it; or a single .mcap file."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.records import Channel
from mcap.summary import Summary

from hardware_bridge.errors import BagError
from sim_core.errors import FileError, YamlError
from sim_core.files.yaml_reader import parse_yaml, read_yaml, yaml_text
from sim_core.printable import printable

ROSBAG2 = "metadata.yaml"
"""What rosbag2 keeps beside the files of a bag."""
MOST_FILES = 1000
"""Of one folder."""
CONVERT = "convert it with `ros2 bag convert` to storage mcap, or give an .mcap file"
AT_ITS_END = "the bridge makes a bag of it at its next start with this bag_folder, or when that session ends"
VERSION = 9
"""Of the layout; rosbag2 of Iron and older reads up to 8."""
_DISTRO = "jazzy"


def is_bag(path: Path) -> bool:
    """Whether it is called like a bag, or is a folder that is one: not a session's folder, which holds bags."""
    return path.suffix == ".mcap" or is_bag_folder(path)


def is_bag_folder(path: Path) -> bool:
    """Whether it is a folder that rosbag2 would read as one bag."""
    return (path / ROSBAG2).is_file()


def file_of(bag: Path) -> Path:
    """Where the log lies in the folder of a bag that the bridge recorded; rosbag2 numbers its own files."""
    return bag / f"{bag.name}.mcap"


def journal_of(bag: Path) -> Path:
    """What lies there while the session lives, or after it was cut short."""
    return bag / f"{bag.name}.mcap.journal"


def whole_bag(path: Path) -> Path:
    """The bag's folder, if the path is of the bridge's file in it; else the path."""
    return path.parent if is_bag_folder(path.parent) and path == file_of(path.parent) else path


def bags_in(folder: Path) -> list[Path]:
    """The bags that lie in a folder, by name: folders, and single files, as older bridges wrote them."""
    return sorted([*folder.glob("*.mcap"), *(path.parent for path in folder.glob(f"*/{ROSBAG2}"))])


def journals_in(folder: Path) -> list[Path]:
    """The journals of a folder's bags, and of single files, as older bridges wrote them."""
    own = [path for path in folder.glob("*/*.mcap.journal") if path == journal_of(path.parent)]
    return sorted([*folder.glob("*.mcap.journal"), *own])


def files_of(bag: Path) -> list[Path]:
    """A bag's files, in order: itself, or those in the folder. Raises BagError: it is none, or not of our storage; OSError."""
    return _files_in(bag) if bag.is_dir() else [bag]


def _files_in(folder: Path) -> list[Path]:
    if not is_bag_folder(folder):
        if file_of(folder).is_file():  # its metadata is lost, or comes in a moment
            return [file_of(folder)]
        if journal_of(folder).exists():
            raise BagError(f"{folder} is of a session that lives or was cut short: {AT_ITS_END}")
        inside = [path.name for path in sorted(folder.iterdir()) if path.suffix in (".mcap", ".db3")]
        what = f"it holds {inside[0]}" if inside else "there is no .mcap file in it"
        remedy = f" of the bridge, or write its {ROSBAG2} with `ros2 bag reindex`" if inside else ""
        raise BagError(f"{folder} is a folder without {ROSBAG2}, and {what}: give an .mcap file{remedy}")
    try:
        information = read_yaml(folder / ROSBAG2)["rosbag2_bagfile_information"]
        names, storage = information["relative_file_paths"], information["storage_identifier"]
        packed = information.get("compression_mode") or ""
        parts = [folder / Path(name).name for name in names][: MOST_FILES + 1]  # old ones name the folder too
    except (FileError, KeyError, TypeError, AttributeError) as error:
        why = error.problem if isinstance(error, FileError) else "rosbag2 did not write it"
        raise BagError(f"{folder / ROSBAG2} makes no sense ({why}): write it again with `ros2 bag reindex`") from error
    if storage != "mcap":
        raise BagError(f"{folder} is a bag of rosbag2's {printable(str(storage), 20)} storage: {CONVERT}")
    if str(packed).lower() == "message":
        raise BagError(f"{folder} has messages compressed one by one: {CONVERT}")
    if not parts or len(parts) > MOST_FILES:
        raise BagError(f"{folder / ROSBAG2} names {len(names)} files, valid are 1 to {MOST_FILES}: {CONVERT}")
    return parts


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
