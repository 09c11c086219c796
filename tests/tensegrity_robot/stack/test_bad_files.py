# SPDX-License-Identifier: Apache-2.0
"""A library that is none, given to the nodes that read one: each ends at once with one line that says why."""

import pytest

from tests.scale import few

pytestmark = pytest.mark.ros
LIBRARY = "schema: 1\nname: mine\nprimitives:\n- {name: P1, class: TC6-TO5, policy_mm: [1, 2, 3, 4, 5, 6]}\n"
BAD = {
    "Latin-1": (LIBRARY.replace("mine", "m\xefne").encode("latin-1"), "is not UTF-8; save it as UTF-8"),
    "no primitives": (b"schema: 1\nprimitives:\n", "primitives is None; valid is a list of one or more"),
    "primitives twice": (LIBRARY.encode() + b"primitives: []\n", "primitives is given twice"),
    "named NO": (LIBRARY.replace("mine", "NO").encode(), "NO may mean False or be text"),
    "a list": (b"[]", "is not a primitive library"),
}


@pytest.fixture(scope="module", params=few(BAD, 1))
def bad(request, tmp_path_factory):
    data, told = BAD[request.param]
    file = tmp_path_factory.mktemp("library") / "bad.yaml"
    file.write_bytes(data)
    return file, told


@pytest.mark.parametrize("node", ["hardware_bridge", "gait_planner"])
def test_a_node_that_is_given_a_bad_library_ends_with_one_line(processes, bad, node, tmp_path):
    file, told = bad
    more = {"port": "/dev/null", "bag_folder": str(tmp_path)} if node == "hardware_bridge" else {}
    process = processes.node(node, library=str(file), **more)
    assert process.ends() == 1
    assert "Traceback" not in process.output
    assert sum(told in line for line in process.output.splitlines()) == 1
    assert str(file) in process.output
