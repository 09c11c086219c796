# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_core.errors import SimError
from tensegrity_lab.reports.markdown import write_into


def test_text_goes_between_the_pages_markers_of_its_name(tmp_path):
    page = tmp_path / "page.md"
    other = "<!-- other: begin -->\nstays\n<!-- other: end -->\n"
    page.write_text(f"before\n<!-- cost: begin -->\nold\n<!-- cost: end -->\n{other}after\n")
    write_into(page, "cost", "| new |")
    assert page.read_text() == f"before\n<!-- cost: begin -->\n| new |\n<!-- cost: end -->\n{other}after\n"
    with pytest.raises(SimError, match="has no place for the table"):
        write_into(page, "cycles", "x")
