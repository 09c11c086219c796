# SPDX-License-Identifier: Apache-2.0
"""The one reader of YAML: strict, bounded in everything, and light to import.

Files come from anywhere: from other people, out of bags, half written. So a file is bounded in size, nodes, depth and digits before
anything is made of it. What YAML 1.1 and 1.2 read differently is refused, since nobody can have known what it means; but
dates are text, and so are keys. Documents are made from the parser's events, without recursion and without PyYAML's constructors.
"""

import hashlib
import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from sim_core.errors import FileError, SimError, YamlError
from sim_core.files.bounded_reader import MOST_BYTES, read_bytes, text_of
from sim_core.printable import printable

MOST_NODES = 500_000
MOST_DEPTH = 32
MOST_DIGITS = 40

_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Only its events are used."""
_RESOLVER = yaml.resolver.Resolver()
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_TRUTH = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_SEAL = re.compile(r"^# sha256 of all below: ([0-9a-f]{16})\n", re.MULTILINE)
_LOG = logging.getLogger(__name__)
_told: set[tuple[str, str]] = set()
_DIRECTIVE = re.compile(rb"^%", re.MULTILINE)
_PRIVATE = "tag:yaml.org,2002:"


def read_yaml(path: Path | str) -> Any:
    """The document in a file: mappings with text keys, lists, text, whole numbers, floats (NaN too), truth values and None.

    Raises:
        YamlError: one line with file, line, what is wrong and what to do.
        OSError: it cannot be read.
    """
    try:
        data = read_bytes(path)
    except FileError as error:
        raise YamlError(str(path), error.problem, error.remedy) from None
    return parse_yaml(data, str(path))


def read_yaml_or(raised: type[SimError], path: Path | str, what: str, hint: str = "") -> Any:
    """`read_yaml`, but an error is of the kind `raised`: it says what the file should be and, where there is none, the hint."""
    try:
        return read_yaml(path)
    except OSError as error:
        raise raised(f"cannot read {what} {path}: {error.strerror}{hint}") from error
    except YamlError as error:
        raise raised(str(error)) from error


def parse_yaml(data: bytes | str, where: str) -> Any:
    """The document in bytes or text; `where` names them in errors. Raises YamlError, as `read_yaml`."""
    if isinstance(data, str):
        data = data.encode("utf-8", errors="surrogatepass")
    if len(data) > MOST_BYTES:
        raise YamlError(where, f"it has more than {MOST_BYTES // 1_000_000} MB", "is it the right file?")
    text = text_of(data, where, YamlError)
    _tell_if_changed(text, where)
    directive = _DIRECTIVE.search(data)
    if directive is not None:
        raise YamlError(where, "a directive (%)", "leave it out", data.count(b"\n", 0, directive.start()) + 1)
    try:
        return _Document(where).of(_events(text))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "a character that YAML does not permit"
        raise YamlError(where, str(problem), "correct it", mark.line + 1 if mark else None) from None
    except (RecursionError, ValueError) as error:  # the parser written in Python, of a PyYAML without libyaml
        raise YamlError(where, str(error), "correct it") from None


def sealed(text: str) -> str:
    """Text of a file that a program writes, with a first line by which a reader knows whether it was changed since."""
    text = _SEAL.sub("", text)
    return f"# sha256 of all below: {_hash(text)}\n{text}"


def _hash(text: str) -> str:
    return hashlib.sha256(text.strip().encode()).hexdigest()[:16]


def _tell_if_changed(text: str, where: str) -> None:
    """Says so once, on the program's log: edited files are welcome, but what refers to the old one does not mean this one."""
    text = text.replace("\r\n", "\n")  # a checkout may have changed the ends of lines
    seal = _SEAL.search(text)
    if seal is None or (_hash(text[seal.end() :]) == seal[1] and not text[: seal.start()].strip()):
        return
    if (where, seal[1]) not in _told:
        _told.add((where, seal[1]))
        _LOG.warning("%s: edited by hand since it was written, or damaged; it is used as it is", printable(where, 200))


def _events(text: str) -> Iterator[Any]:
    parser = _Parser(text)
    try:
        while parser.check_event():
            yield parser.get_event()
    finally:
        parser.dispose()


def yaml_text(document: Any) -> str:
    """The YAML of plain data, in the form of all files that are written here."""
    return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120))


@dataclass
class _Open:
    """A collection that has not ended; of a mapping also the lines of its keys, and the key whose value comes next."""

    value: Any
    lines: dict[str, int] | None
    key: str | None = None

    @property
    def wants_key(self) -> bool:
        return self.lines is not None and self.key is None


class _Document:
    """Makes a document of a parser's events."""

    def __init__(self, where: str):
        self._where = where
        self._open: list[_Open] = []
        self._nodes = self._documents = 0
        self._root: Any = None

    def of(self, events: Iterator[Any]) -> Any:
        """The one document; None if there is nothing. Raises YamlError, yaml.YAMLError."""
        for event in events:
            match event:
                case yaml.ScalarEvent():
                    self._check(event)
                    self._scalar(event)
                case yaml.MappingStartEvent() | yaml.SequenceStartEvent():
                    self._check(event)
                    self._begin(event)
                case yaml.MappingEndEvent() | yaml.SequenceEndEvent():
                    self._open.pop()
                case yaml.AliasEvent():
                    self._refuse(event, f"an alias (*{event.anchor})", "write out what it stands for")
                case yaml.DocumentStartEvent():
                    self._documents += 1
                    if self._documents > 1:
                        self._refuse(event, "a second document (---)", "keep one document in a file")
        return self._root

    def _refuse(self, event: Any, problem: str, remedy: str) -> NoReturn:
        raise YamlError(self._where, problem, remedy, event.start_mark.line + 1)

    def _check(self, event: Any) -> None:
        self._nodes += 1
        if self._nodes > MOST_NODES:
            self._refuse(event, f"more than {MOST_NODES} values", "is it the right file?")
        if event.anchor is not None:
            self._refuse(event, f"an anchor (&{event.anchor})", "write values out where they are used")
        if event.tag is not None:
            self._refuse(event, f"a tag ({event.tag})", "leave it out")

    def _begin(self, event: Any) -> None:
        if len(self._open) >= MOST_DEPTH:
            self._refuse(event, f"nested deeper than {MOST_DEPTH} levels", "is it the right file?")
        if self._open and self._open[-1].wants_key:
            self._refuse(event, "a key that is a mapping or a list", "valid keys are text")
        mapping = isinstance(event, yaml.MappingStartEvent)
        value: Any = {} if mapping else []
        self._add(value)
        self._open.append(_Open(value, {} if mapping else None))

    def _scalar(self, event: Any) -> None:
        if not self._open or not self._open[-1].wants_key:
            self._add(self._value(event))
            return
        mapping, key = self._open[-1], event.value
        assert mapping.lines is not None
        if key == "<<" and event.implicit[0]:
            self._refuse(event, "a merge (<<)", "write values out where they are used")
        if key in mapping.lines:
            self._refuse(event, f"{key} is given twice, first in line {mapping.lines[key]}", "keep one")
        mapping.lines[key] = event.start_mark.line + 1
        mapping.key = key

    def _add(self, value: Any) -> None:
        if not self._open:
            self._root = value
            return
        collection = self._open[-1]
        if collection.lines is None:
            collection.value.append(value)
        else:
            collection.value[collection.key] = value
            collection.key = None

    def _value(self, event: Any) -> Any:  # noqa: PLR0911 (one row a kind)
        text = event.value
        if not event.implicit[0]:  # quoted, or a block: text whatever it looks like
            return text
        if len(text) > 4 * MOST_DIGITS:
            return self._long(event, text)
        kind = _RESOLVER.resolve(yaml.ScalarNode, text, (True, False)).removeprefix(_PRIVATE)
        if kind in ("str", "timestamp"):  # a date is text, as in YAML 1.2
            return text
        if kind == "null":
            return None
        if kind == "bool" and text in _TRUTH:
            return _TRUTH[text]
        if kind == "int" and _INTEGER.fullmatch(text) and len(text) <= MOST_DIGITS:
            return int(text, 16 if "x" in text else 10)
        if kind == "float" and _FLOAT.fullmatch(text):
            return float(text.lstrip("+").replace(".i", "i").replace(".I", "i").replace(".n", "n").replace(".N", "n"))
        return self._refuse_plain(event, text, kind)

    def _refuse_plain(self, event: Any, text: str, kind: str) -> NoReturn:
        """Plain text that another reader may take for something else."""
        remedy = "write it in quotes if it is text"
        match kind:
            case "bool":
                self._refuse(event, f"{text} may mean {text in YES_WORDS} or be text", f"{remedy}, else true or false")
            case "int" if len(text) > MOST_DIGITS:
                self._refuse(event, f"a number of {len(text)} digits, valid are {MOST_DIGITS}", remedy)
            case "int" | "float":
                self._refuse(event, f"{text} may be read as several numbers", f"{remedy}, else a plain decimal number")
            case _:
                self._refuse(event, f"{text!r} has a special meaning ({kind})", remedy)

    def _long(self, event: Any, text: str) -> str:
        """Text too long to be a number, which the resolver's patterns shall not see; what looks like one is refused."""
        if not text.strip("+-_.:0123456789abcdefxABCDEF"):
            self._refuse(event, f"a number of {len(text)} digits, valid are {MOST_DIGITS}", "write it in quotes if it is text")
        return text


YES_WORDS = frozenset(word for base in ("yes", "on") for word in (base, base.title(), base.upper()))
