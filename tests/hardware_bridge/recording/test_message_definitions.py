# SPDX-License-Identifier: Apache-2.0
import json
import sys
from pathlib import Path

import pytest

from hardware_bridge.errors import SchemaError
from hardware_bridge.recording.message_definitions import ShareSchemas, dependencies, share_directories

SHARES = (*share_directories(), Path(sys.prefix) / "share")
SCHEMAS = ShareSchemas(SHARES)


def write(share: Path, package: str, name: str, text: str) -> None:
    folder = share / package / "msg"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.msg").write_text(text)


def test_a_schema_holds_every_type_once_in_order_of_need(tmp_path: Path) -> None:
    write(tmp_path, "a", "Root", "# a/NotThis x\nb/Part[3] parts\nLocal local  # c/Nor this\nint32 LIMIT=5\nstring<=9 s\n")
    write(tmp_path, "a", "Local", "b/Part[<=2] parts\nbuiltin_interfaces/msg/Time time\n")
    write(tmp_path, "b", "Part", "float64[] x\n")
    write(tmp_path, "builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n")
    text = ShareSchemas([tmp_path]).schema_text("a/msg/Root")
    bar = "=" * 80
    assert text.split(f"\n{bar}\nMSG: ")[1:] == [
        "b/Part\nfloat64[] x",
        "a/Local\nb/Part[<=2] parts\nbuiltin_interfaces/msg/Time time",
        "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
    ]


def test_every_installed_type_has_the_dependencies_that_its_installation_states() -> None:
    checked = 0
    for share in SHARES:
        for stated in share.glob("*/msg/*.json"):
            if not stated.with_suffix(".msg").exists():
                continue
            description = json.loads(stated.read_text())["type_description_msg"]
            type_name = f"{stated.parent.parent.name}/msg/{stated.stem}"
            lines = SCHEMAS.schema_text(type_name).splitlines()
            found = {line[5:].replace("/", "/msg/") for line in lines if line.startswith("MSG: ")}
            assert found == {each["type_name"] for each in description["referenced_type_descriptions"]}, type_name
            checked += 1
    assert checked > 50, "no installed messages were found"


def test_the_hash_is_the_installations() -> None:
    assert SCHEMAS.type_hash("std_msgs/msg/Header").startswith("RIHS01_")
    assert SCHEMAS.type_hash("std_msgs/msg/Nothing") == ""


def test_the_message_of_tf_is_every_other_ros_s():
    upstream = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
    assert SCHEMAS.type_hash("tf2_msgs/msg/TFMessage") == upstream


@pytest.mark.parametrize("name", ["std_msgs/msg/Nothing", "std_msgs/Header", "Header", "", "a/srv/B"])
def test_an_unknown_type_is_refused_by_name(name: str) -> None:
    with pytest.raises(SchemaError, match="not found"):
        SCHEMAS.schema_text(name)


def test_primitives_are_no_dependencies() -> None:
    text = "\n".join(f"{kind}[<=3] x" for kind in ("bool", "byte", "char", "float32", "string<=5", "wstring", "uint64"))
    assert dependencies(text, "a/B") == []


def test_an_overlay_wins(tmp_path: Path) -> None:
    write(tmp_path / "over", "a", "B", "int8 new\n")
    write(tmp_path / "under", "a", "B", "int8 old\n")
    assert ShareSchemas([tmp_path / "over", tmp_path / "under"]).schema_text("a/msg/B") == "int8 new\n"
