# SPDX-License-Identifier: Apache-2.0
"""Whatever the bytes, a document comes out or one short line: in bounded time and memory."""

import os

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sim_core.dynamics.actuators import load_actuators
from sim_core.errors import SimError, YamlError
from sim_core.files.bounded_reader import MOST_BYTES
from sim_core.files.yaml_reader import parse_yaml, read_yaml, sealed
from sim_core.gaits.climb_limits import load_climbs
from sim_core.gaits.library import LIBRARIES, library_text, load_library, parse_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.structure.parameters import load_prototype
from sim_core.studies.model_agreement import load_gaits
from sim_core.studies.sensitivity import stored_influences
from sim_core.twin.model_versions import frozen_models
from sim_core.uncertainty.ensemble import load_posterior
from tests.scale import examples

LAUGHS = "\n".join([f"a0: &a0 [{'lol, ' * 9}]", *(f"a{n}: &a{n} [{f'*a{n - 1}, ' * 9}]" for n in range(1, 10))])

REFUSED = {
    "Latin-1": ("name: r\xf6ll".encode("latin-1"), "line 1: byte 7 (0xf6) is not UTF-8; save it as UTF-8"),
    "UTF-16": ("a: 1".encode("utf-16"), "byte 0 (0xff) is not UTF-8"),
    "a key twice": (b"a: 1\nb:\n  c: 1\n  c: 2\n", "line 4: c is given twice, first in line 3"),
    "yes and no": (b"name: NO\n", "line 1: NO may mean False or be text; write it in quotes if it is text, else true or false"),
    "sixties": (b"a: 1:30\n", "line 1: 1:30 may be read as several numbers"),
    "octal": (b"a: 017\n", "017 may be read as several numbers"),
    "underscores": (b"a: 1_000.5\n", "1_000.5 may be read as several numbers"),
    "digits": (b"a: " + b"9" * 3_000_000 + b"\n", "a number of 3000000 digits, valid are 40"),
    "some digits": (b"a: " + b"9" * 50 + b"\n", "a number of 50 digits, valid are 40"),
    "laughs": (LAUGHS.encode(), "line 1: an anchor (&a0)"),
    "an alias": (b"a: *b\n", "an alias (*b)"),
    "a merge": (b"<<: {a: 1}\n", "a merge (<<)"),
    "a tag": (b"a: !!python/object/apply:os.system [ls]\n", "a tag (tag:yaml.org,2002:python/object/apply:os.system)"),
    "depth": (b"[" * 1_000_000, "nested deeper than 32 levels"),
    "blocks in blocks": (b"- " * 1_000_000, "nested deeper than 32 levels"),
    "values": (b"[" + b"1," * 600_000 + b"]", "more than 500000 values"),
    "size": (b"#" * (MOST_BYTES + 1), "it has more than 4 MB"),
    "directives": (b"%TAG !a! b\n" * 300_000 + b"--- 1", "line 1: a directive (%)"),
    "two documents": (b"a: 1\n---\nb: 2\n", "line 2: a second document (---)"),
    "a mapping as key": (b"{a: 1}: 2\n", "a key that is a mapping or a list"),
    "control characters": (b"a: \x1b[31m\n", "characters are not allowed"),
    "broken": (b"a: [1,\n", "is not valid YAML"),
}


@pytest.mark.timeout(30)  # where some would take hours
@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_plain_yaml_is_refused_in_one_short_line(case):
    data, told = REFUSED[case]
    with pytest.raises(YamlError) as caught:
        parse_yaml(data, "x.yaml")
    text = str(caught.value)
    assert text.startswith("x.yaml is not valid YAML")
    assert told in text
    assert len(text) < 300
    assert text.isprintable()


def test_what_is_plain_is_read_as_written():
    text = "a: {b: [1, -2, 0x1F, 1.5, .5, 1.0e-3], c: null, d: ~, e: true}\n"
    text += "1: one\nf: 1e5\ndate: 2026-01-02\ng: '1:30'\nh: \"NO\"\ni: |\n  two\n  lines\n"
    assert parse_yaml(text, "x") == {
        "a": {"b": [1, -2, 31, 1.5, 0.5, 0.001], "c": None, "d": None, "e": True},
        "1": "one",
        "f": "1e5",
        "date": "2026-01-02",
        "g": "1:30",
        "h": "NO",
        "i": "two\nlines\n",
    }
    assert parse_yaml(b"", "x") is None
    assert parse_yaml(b"\xef\xbb\xbfa: 1", "x") == {"a": 1}


def plain(value):
    if isinstance(value, dict):
        return all(isinstance(key, str) and plain(item) for key, item in value.items())
    if isinstance(value, list):
        return all(map(plain, value))
    return value is None or isinstance(value, (str, bool, int, float))


def refusal(read):
    """What it is refused with; empty if it is not. Any other error is let through."""
    try:
        read()
    except SimError as error:
        return str(error)
    return ""


PIECES = st.sampled_from(
    [bytes([byte]) for byte in b"ab-[]{},'\"|>#%1=?\t\n\x00\xff"]
    + [b"b: ", b"- ", b"  ", b"&a ", b"*a", b"!t ", b": ", b"---", b"...", b"0x", b"1:2", b"NO", b".nan", b"<<"]
    + [b"\xc3\xa9", b"\xe2\x80\xa8"]
)


@settings(max_examples=examples(600), deadline=None)
@given(st.one_of(st.binary(max_size=200), st.lists(PIECES, max_size=40).map(b"".join)))
@example(b"a: =")
@example(b"? - a")
@example(b"\xed\xa0\x80")
def test_any_bytes_give_a_plain_document_or_the_error(data):
    told = refusal(lambda: plain(parse_yaml(data, "x")) or pytest.fail("not plain"))
    assert told.isprintable()
    assert len(told) < 400


TEXT = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Zl", "Zp")))


@settings(max_examples=examples(200), deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(10**30), 10**30) | st.floats(allow_nan=False) | TEXT,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
        max_leaves=20,
    )
)
def test_what_our_writer_writes_reads_back(document):
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120)
    if "&id" not in text and "\n? " not in f"\n{text}":  # a very long key
        assert parse_yaml(text, "x") == document


def test_a_pipe_a_folder_and_a_device_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(YamlError, match="no regular file"):
        read_yaml(tmp_path / "pipe.yaml")
    with pytest.raises(YamlError, match="no regular file"):
        read_yaml("/dev/zero")
    with pytest.raises((YamlError, OSError)):
        read_yaml(tmp_path)


LIBRARY = "schema: 1\nname: mine\nprimitives:\n- {name: P1, class: TC6-TO5, policy_mm: [1, 2, 3, 4, 5, 6]}\n"
BAD_LIBRARIES = {
    "Latin-1": (LIBRARY.replace("mine", "m\xefne").encode("latin-1"), "is not UTF-8"),
    "no primitives": (b"schema: 1\nprimitives:\n", "primitives is None; valid is a list of one or more"),
    "primitives twice": (LIBRARY.encode() + b"primitives: []\n", "primitives is given twice, first in line 3"),
    "a name that is no text": (LIBRARY.replace("mine", "NO").encode(), "line 2: NO may mean False"),
    "a number for a name": (LIBRARY.replace("mine", "1.5").encode(), "name is 1.5; valid is text"),
    "a list": (b"[]", "is not a primitive library"),
    "an empty file": (b"", "is not a primitive library"),
    "text": (b"hello", "is not a primitive library"),
    "rows that are none": (b"schema: 1\nprimitives: [1, 2]\n", "primitive 1 is 1; valid is"),
    "a truth for a name": (LIBRARY.replace("name: P1", "name: true").encode(), "primitive 1: name is True; valid is text"),
    "margins of text": (LIBRARY.replace("}", ", margins: {odds: high}}").encode(), "primitive 1 is"),
    "huge rows": (b"schema: 1\nprimitives: [{name: [" + b"1," * 50_000 + b"]}]\n", "primitive 1"),
}


@pytest.mark.parametrize("case", BAD_LIBRARIES)
def test_a_bad_library_is_one_clear_line(tmp_path, case):
    data, told = BAD_LIBRARIES[case]
    file = tmp_path / "bad.yaml"
    file.write_bytes(data)
    with pytest.raises(SimError) as caught:
        load_library(file)
    assert told in str(caught.value)
    assert str(file) in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(file))
    assert "\n" not in str(caught.value)


def test_a_library_that_we_write_reads_back(tmp_path):
    library = load_library("robust")
    assert parse_library(parse_yaml(library_text(library), "x"), "x") == library


READERS = [load_library, load_prototype, load_actuators, load_posterior, lambda path: load_gaits(path, 100)]
DOCUMENTS = st.recursive(
    st.sampled_from(["1", "-5", "1.5", "true", "null", "text", "'1'", "2", "TC6-TO5", "[]", "{}"]),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]")
        | st.dictionaries(
            st.sampled_from(
                ["schema", "primitives", "name", "policy_mm", "class", "margins", "gaits", "members", "columns", "value", "mu_s"]
            ),
            inner,
            max_size=5,
        ).map(lambda items: "{" + ", ".join(f"{key}: {value}" for key, value in items.items()) + "}")
    ),
    max_leaves=12,
)


@settings(max_examples=examples(300), deadline=None)
@given(DOCUMENTS)
def test_no_document_makes_a_reader_fail_but_by_its_own_error(tmp_path_factory, text):
    file = tmp_path_factory.getbasetemp() / "any.yaml"
    file.write_text(text)
    for read in READERS:
        assert "\n" not in refusal(lambda read=read: read(file))
    refusal(lambda: load_success_counts(load_library("robust"), file))


def test_everything_that_is_shipped_is_read():
    for file in sorted(LIBRARIES.glob("*.yaml")):
        library = load_library(file)
        if file.stem != "previous":
            assert load_success_counts(library) is not None
        assert load_climbs(library) is not None
    load_prototype()
    load_actuators()
    assert frozen_models()
    assert stored_influences(load_prototype()) is not None


def test_a_sealed_file_that_somebody_edited_says_so_once_and_is_read(caplog):
    text = sealed("# ours\na: 1\n")
    for untouched in (text, text.replace("\n", "\r\n"), "\ufeff" + text, "a: 1\n", sealed(text), text + "\n"):
        assert parse_yaml(untouched.encode(), "untouched.yaml") == {"a": 1}
    assert not caplog.messages
    for number, edited in enumerate((text.replace("1", "2"), "b: 1\n" + text, text + "b: 1\n", text[:-5])):
        where = f"edited_{number}.yaml"
        assert parse_yaml(edited, where) == parse_yaml(edited, where)
        assert caplog.messages == [f"{where}: edited by hand since it was written, or damaged; it is used as it is"]
        caplog.clear()


def test_what_is_written_is_sealed(tmp_path, caplog):
    library = load_library()
    path = tmp_path / "own.yaml"
    path.write_text(library_text(library), encoding="utf-8")
    assert load_library(path).hash == library.hash
    assert not caplog.messages
    path.write_text(path.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
    assert load_library(path).hash == library.hash
    assert len(caplog.messages) == 1
