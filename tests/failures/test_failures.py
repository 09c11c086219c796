# SPDX-License-Identifier: Apache-2.0
"""Each row of docs/results/failures.md, with real nodes and a virtual prototype on a real pty: `./sixstrut faults` as tests."""

from pathlib import Path

import pytest

from tests.failures.documented import DOCS_PAGE, page_rows, shape_of
from tests.failures.rig import Rig, scratch
from tests.failures.table import RUNNING_ORDER, SCENARIOS, scenario
from tests.isolated_stack import free_domain

pytestmark = pytest.mark.ros

QUICK = {1}
ROWS = [number if number in QUICK else pytest.param(number, marks=pytest.mark.slow) for number in RUNNING_ORDER]


@pytest.fixture(scope="module")
def lab():
    with free_domain() as domain, scratch() as folder:
        lab = Rig(Path(folder), domain)
        yield lab
        lab.close()


@pytest.fixture(scope="module")
def page(pytestconfig):
    """The documented rows, by number."""
    return page_rows((pytestconfig.rootpath / DOCS_PAGE).read_text(encoding="utf-8"))


@pytest.mark.parametrize("number", ROWS)
def test_it_is_survived_and_told_as_documented(lab, page, number):
    try:
        evidence = scenario(number).run(lab)
    except BaseException:
        lab.spoil()
        raise
    assert [shape_of(text) for text in page[number].told] == [shape_of(text) for text in evidence.told]


def test_the_page_says_of_every_row_what_the_code_says(page):
    assert sorted(page) == [row.number for row in SCENARIOS] == sorted(RUNNING_ORDER) == list(range(1, len(SCENARIOS) + 1))
    for row in SCENARIOS:
        written = page[row.number]
        assert (written.failure, written.happens, written.remedy) == (row.failure, row.happens, row.remedy)
