# SPDX-License-Identifier: Apache-2.0
"""Texts from outside, made fit to be shown and kept."""

import io
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_core.printable import NAME_MOST, printable, replace_what_cannot_be_shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Ada", "Ada"),
        ("Ada Lovelace  ", "Ada Lovelace"),
        ("Zoë → 北", "Zoë → 北"),
        ("\x1b[2J\x1b]0;title\x07armed", "[2J]0;titlearmed"),
        ("one\r\ntwo\tthree\u2028four", "one two three four"),
        ("safe\u202egnihton\u2066", "safegnihton"),
        ("a\u200bb\x9bc\x00d\x7fe", "abcde"),
        ("\ud800x", "x"),
        ("\x1b\x07", ""),
    ],
)
def test_what_steers_a_terminal_or_hides_is_left_out(text, shown):
    assert printable(text) == shown


def test_a_long_name_is_cut_and_a_huge_one_not_even_read():
    assert printable("x" * 64, 64) == "x" * 64
    assert printable("x" * 65, 64) == "x" * 63 + "…"
    assert printable("\x00" * 10_000_000 + "x", 64) == "…"


@given(st.text(st.characters(exclude_categories=()), max_size=400), st.integers(1, 100))
def test_it_is_one_short_line_whatever_comes_and_stays_as_it_is(text, most):
    shown = printable(text, most)
    assert len(shown) <= most
    assert all(unicodedata.category(letter)[0] != "C" and (letter == " " or not letter.isspace()) for letter in shown)
    assert printable(shown, most) == shown
    shown.encode()


def test_a_holder_s_name_steers_nobody_s_terminal():
    from hardware_bridge.driver.bridge import _arming

    assert _arming("\x1b[31mme\r\n" + "x" * 1000, True, "lease", None).holder == "[31mme " + "x" * (NAME_MOST - 8) + "…"
    assert _arming("\x1b", True, "lease", None).holder == "somebody"


def test_letters_that_an_encoding_lacks_become_similar_ones_of_the_same_width(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(written, encoding="ascii", write_through=True))
    replace_what_cannot_be_shown()
    print("TC6 → TO5: 5 × ± 1 mm … █ \udcff")
    assert written.getvalue() == b"TC6 > TO5: 5 x ? 1 mm . # ?\n"
