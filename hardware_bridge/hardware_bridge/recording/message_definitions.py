# SPDX-License-Identifier: Apache-2.0
"""Message definitions as a log carries them, read from the `share` folders of an installed ROS; no ROS is imported.

A log's schema is the `.msg` text of a type and, after a line of 80 `=` and `MSG: package/Name`, that of every type it
is made of, so that readers need no workspace.
"""

import json
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from hardware_bridge.errors import SchemaError

_SEPARATOR = "=" * 80
_HALVES = re.compile(r"^---[ \t]*$\n?", re.MULTILINE)
FIELD = re.compile(r"^([A-Za-z][A-Za-z0-9_/]*)(?:<=\d+)?(\[[^\]]*\])?[ \t]+([a-z][a-z0-9_]*)[ \t]*(?:[^=\s].*)?$")
"""A field in a line of a definition: type, array and name. A constant is none."""
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_PRIMITIVES = _INTEGERS | {"bool", "byte", "char", "float32", "float64", "string", "wstring"}


def share_directories() -> tuple[Path, ...]:
    """The `share` folder of each prefix in `AMENT_PREFIX_PATH`, overlays first."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return tuple(Path(prefix) / "share" for prefix in prefixes if prefix)


class ShareSchemas:
    """Looks types up in folders (None: `share_directories`), the first that has them winning. Its methods fit `Recorder`."""

    def __init__(self, directories: Iterable[Path] | None = None) -> None:
        self._directories = tuple(share_directories() if directories is None else directories)
        self._text = lru_cache(maxsize=None)(self._read)

    def schema_text(self, type_name: str) -> str:
        """The whole definition of `package/msg/Name`.

        Raises:
            SchemaError: it, or a type that it is made of, is not installed.
        """
        root = _short(type_name)
        return self._with_parts(self._text(root), root)

    def service_texts(self, type_name: str) -> tuple[str, str]:
        """The whole definitions of request and response of `package/srv/Name`; an empty one has no field.

        Raises:
            SchemaError: it, or a type that it is made of, is not installed.
        """
        root = _short(type_name, "srv")
        request, response = _HALVES.split(self._read(root, "srv"), maxsplit=1)
        return self._with_parts(request, root), self._with_parts(response, root)

    def _with_parts(self, own: str, root: str) -> str:
        """A definition and those of all that it is made of."""
        parts, waiting, seen = [own], dependencies(own, root), {root}
        while waiting:
            name = waiting.pop(0)
            if name in seen:
                continue
            seen.add(name)
            text = self._text(name)
            parts.append(f"{_SEPARATOR}\nMSG: {name}\n{text}")
            waiting += dependencies(text, name)
        return "\n".join(part.rstrip("\n") for part in parts) + "\n"

    def type_hash(self, type_name: str) -> str:
        """The type's RIHS01 hash, or an empty string where the installation does not say."""
        short = _short(type_name)
        try:
            entries = json.loads(self._read(short, suffix="json"))["type_hashes"]
            return next(str(entry["hash_string"]) for entry in entries if entry["type_name"] == type_name)
        except (SchemaError, StopIteration, ValueError, KeyError, TypeError):
            return ""

    def _read(self, short_name: str, kind: str = "msg", suffix: str = "") -> str:
        package, name = short_name.split("/")
        for directory in self._directories:
            with suppress(OSError):
                return (directory / package / kind / f"{name}.{suffix or kind}").read_text(encoding="utf-8")
        raise SchemaError(f"{package}/{kind}/{name}", [str(directory) for directory in self._directories])


def dependencies(text: str, short_name: str) -> list[str]:
    """The types (`package/Name`) that a definition's fields are made of, in order, some perhaps twice."""
    package = short_name.split("/", maxsplit=1)[0]
    found = []
    for line in text.splitlines():
        match = FIELD.match(line.split("#")[0].strip())
        if match is None or match[1] in _PRIMITIVES:
            continue
        parts = match[1].split("/")
        found.append(f"{parts[0] if len(parts) > 1 else package}/{parts[-1]}")
    return found


def _short(type_name: str, kind: str = "msg") -> str:
    parts = type_name.split("/")
    if len(parts) == 3 and parts[1] == kind:
        return f"{parts[0]}/{parts[2]}"
    raise SchemaError(type_name, [])
