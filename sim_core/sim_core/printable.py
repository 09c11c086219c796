# SPDX-License-Identifier: Apache-2.0
"""Texts from outside, made fit to be shown and kept."""

import codecs
import sys
import unicodedata
from io import TextIOWrapper

NAME_MOST, WORDS_MOST = 64, 300
"""Characters of a name, and of what somebody says."""
_SIMILAR = dict(zip("→←…–—−×·•█■", "><.---x**##", strict=True))  # one letter each: columns stay
_LOOKED_AT = 8
"""Times the wanted length: more of a text is not read."""


def printable(text: object, most: int = WORDS_MOST) -> str:
    """One line of what can be printed, at most `most` characters; what was longer ends in "…".

    Line breaks and tabs become spaces. Control and escape characters, marks that turn the direction of writing, invisible ones and
    surrogates are left out, so that a text can neither steer a terminal nor look like another one.
    """
    whole = str(text)
    kept = "".join(_shown(letter) for letter in whole[: _LOOKED_AT * most])
    line = " ".join(kept.split())
    if len(line) <= most and len(whole) <= _LOOKED_AT * most:
        return line
    return line[: most - 1] + "…"


def replace_what_cannot_be_shown() -> None:
    """From now on standard output and error show something similar, or "?", for letters that their encoding lacks.

    No arrow may end a program.
    """
    codecs.register_error("similar", _similar)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="similar")


def _similar(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_SIMILAR.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


def _shown(letter: str) -> str:
    if letter.isspace():  # also the separators of lines and paragraphs
        return " "
    return "" if unicodedata.category(letter)[0] == "C" else letter
