# SPDX-License-Identifier: Apache-2.0
"""The commands as a user types them, in a process of their own where exit codes and streams matter."""

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from sixstrut_cli import app
from sixstrut_cli.registry import entries

ROOT = Path(__file__).parents[2]


def sixstrut(*words, limit_s=60):
    return subprocess.run(
        [sys.executable, "-m", "sixstrut_cli", *words], capture_output=True, text=True, timeout=limit_s, check=False
    )


def test_parameters_prints_every_number_with_its_source():
    result = sixstrut("parameters")
    assert result.returncode == 0
    for word in ("box_mass_kg", "0.1276", "paper", "stand-in", "tendon_stiffness_n_m", "joint_inertia_kg_m2"):
        assert word in result.stdout.replace("\n", "")


def test_the_export_is_enough_to_build_the_robot_elsewhere():
    document = json.loads(sixstrut("parameters", "--export", "json").stdout)
    elements = document["elements"]
    assert len(elements["cable_ends"]) == len(elements["cable_point_1_m"]) == len(elements["cable_rest_m"]) == 48
    assert len(elements["contact_point_m"]) == 60
    assert len(elements["mass_kg"]) == len(elements["inertia_kg_m2"]) == 13
    assert document["sources"]["box_mass_kg"] == "paper"


def test_a_feasible_roll_exits_0_and_speaks_json():
    result = sixstrut("roll", "--from", "TC6", "--to", "TO5", "--json")
    assert result.returncode == 0
    document = json.loads(result.stdout)
    assert document["feasible"] is True
    assert document["faces"][-1] == "TO5"


def test_a_route_names_every_roll_with_its_gait_and_odds():
    result = sixstrut("route", "TC6", "TC1", "--json")
    route = json.loads(result.stdout)
    assert route["faces"][0] == "TC6"
    assert route["faces"][-1] == "TC1"
    assert [roll["from"] for roll in route["rolls"]] == route["faces"][:-1]
    assert all(0.0 < roll["odds"] <= 1.0 for roll in route["rolls"])
    assert "TC6 → " in sixstrut("route", "TC6", "TC1").stdout


@pytest.mark.parametrize("place", [("-0.2,0.1",), ("-0.2", "0.1")])
def test_a_place_may_be_anywhere_on_the_floor(place):
    result = sixstrut("route", "TC6", *place, "--reach", "0.2", "--json")
    assert result.returncode == 0, result.stderr
    x, y = json.loads(result.stdout)["places_m"][-1]
    assert (x + 0.2) ** 2 + (y - 0.1) ** 2 < 0.2**2


@pytest.mark.slow
def test_a_search_that_was_interrupted_is_gone_on_with_and_leaves_no_state(tmp_path):
    path = tmp_path / "few.yaml"
    words = ("search", "--class", "TO5-TC6", "--keep", "2", "--generations", "2", "-o", str(path), "--json")
    done = sixstrut(*words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["primitives"] == {"TO5-TC6": 2}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["few.png", "few.yaml"]
    first = path.read_text(encoding="utf-8")
    (tmp_path / "few.search.json").write_text("{", encoding="utf-8")
    assert "--fresh begins anew" in sixstrut(*words).stderr
    assert sixstrut(*words, "--fresh").returncode == 0
    assert path.read_text(encoding="utf-8") == first


def test_a_roll_that_does_not_work_exits_4_and_says_why():
    result = sixstrut("roll", "--policy", "0 0 0 0 0 0")
    assert result.returncode == 4
    assert "not feasible: after actuation it stood on TC6" in result.stdout


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("roll", "--from", "TC9"), 1, "unknown face 'TC9': valid are TC1..TC8"),
        (("roll", "--to", "TO1"), 1, "TO1 is not adjacent to TC6: one roll from TC6 reaches TO5, TO7, TO9"),
        (("roll", "--policy", "0 0 0 0 0 60"), 1, "S6 = 60 mm: valid is a whole number of mm in [-45, 45]"),
        (("roll", "--policy", "a b"), 2, "valid are six whole numbers"),
        (("roll", "--primitive", "P99"), 1, "no primitive 'P99'"),
        (
            ("roll", "--library", "nowhere"),
            1,
            "no library is called 'nowhere'; shipped are: continuous, improved, previous, robust",
        ),
        (("roll", "--library", "/nowhere.yaml"), 1, "cannot read library /nowhere.yaml: No such file"),
        (("roll", "--perturbation", "0.9"), 1, "perturbation scale 0.9"),
        (("parameters", "--prototype", "/nowhere.yaml"), 1, "/nowhere.yaml: No such file"),
        (("robustness", "nowhere"), 1, "shipped are: continuous, improved, previous, robust"),
        (("robustness", "robust", "--seed", "1"), 1, "seed 1 is a training seed of library 'robust'"),
        (("robustness", "robust", "--groups", "mas"), 1, "unknown uncertainty 'mas': valid are judged, all, stiffness"),
        (("robustness", "robust", "--groups", "all", "--one-gait"), 1, "leave out slope"),
        (("robustness", "robust", "--scheduler", "nonsense"), 1, "no Dask scheduler answers at 'nonsense'"),
        (("route", "TC6", "TC9"), 1, "unknown face 'TC9'"),
        (("route", "TC6", "TC1", "--odds", "/nowhere"), 1, "make them with: sixstrut robustness LIBRARY --odds FILE"),
        (("search", "best"), 2, "robust"),
        (("search", "--class", "TC1-TO1", "-o", "/tmp/x.yaml"), 1, "valid are TC6-TO5, TO5-TC6"),
        (("replay", "/nowhere.mcap"), 1, "cannot read bag /nowhere.mcap"),
        (("replay", __file__), 1, "is no MCAP file (it begins with"),
        (("demo", "--from-face", "TX"), 1, "unknown face 'TX'"),
        (("demo", "--rolls", "0"), 2, "--rolls"),
        (("travel",), 2, "give a place such as 0.6,0.3"),
        (("travel", "there"), 2, "valid is a face such as TC1, or a place"),
        (("travel", "1", "2", "3"), 2, "'1,2,3': valid is a face such as TC1, or a place"),
        (("travel", "-1,0", "--from-face", "TX"), 1, "unknown face 'TX'"),
        (("console", "--token", "a&b"), 1, "every user of this machine sees --token: choose another secret"),
        (("fly",), 2, "fly"),
    ],
)
def test_bad_input_is_one_line_that_says_what_is_valid(words, code, message, capsys):
    assert app.run(list(words)) == code
    said = capsys.readouterr().err
    assert message in " ".join(said.split())
    assert "Traceback" not in said
    if code == 1:
        assert len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(("words", "code"), [(("roll", "--from", "TC9"), 1), (("fly",), 2)])
def test_a_shell_hears_the_exit_code_and_one_line(words, code):
    result = sixstrut(*words)
    assert (result.returncode, result.stdout) == (code, "")
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_robustness_study_writes_json_tables_and_picture(tmp_path):
    one = tmp_path / "one.yaml"
    one.write_text("schema: 1\nprimitives:\n- {name: A, class: TO5-TC6, policy_mm: [36, 7, -30, -23, -34, 14]}\n")
    more = ("--picture", str(tmp_path / "p.png"), "--csv", str(tmp_path / "csv"))
    result = sixstrut(
        "robustness", str(one), "--prototypes", "1", "--scale", "0.2", "--failures", "1", "--json", *more, limit_s=110
    )
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["overall"]["trials"] == 24
    assert [row["name"] for row in document["primitives"]] == ["A"]
    assert (tmp_path / "p.png").exists()
    assert len((tmp_path / "csv" / "trials.csv").read_text().splitlines()) == 25


BEFORE_ANYTHING_IS_LOADED = """
import contextlib, io, json, sys
rooms = "search studies uncertainty planning rolling twin dynamics gaits structure".split()
sys.modules |= dict.fromkeys(f"sim_core.{room}" for room in rooms)
sys.modules |= dict.fromkeys(("numpy", "rclpy", "rich", "tensegrity_lab", "tensegrity_console"))
from sixstrut_cli import app

class Terminal(io.StringIO):
    isatty = lambda self: True

told = {}
for line in sys.argv[1:]:
    with contextlib.redirect_stderr(Terminal()) as said, contextlib.redirect_stdout(io.StringIO()):
        app.run(line.split())
    told[line] = said.getvalue().splitlines()
print(json.dumps(told))
"""
SLOW = (
    "demo", "console", "foxglove", "roll", "replay x.mcap", "doctor", "rehearse", "route TC6 TC1", "robustness robust", "climb",
    "search", "recheck x.yaml", "calibrate-model", "travel 0.3,0.2", "play x.mcap", "report", "odds", "fit", "campaign", "validate",
    "bench", "faults",
)  # fmt: skip


def test_a_command_that_loads_or_computes_says_first_what_it_does(tmp_path):
    environ = {**os.environ, "SIXSTRUT_ROOT": str(ROOT)}
    command = [sys.executable, "-c", BEFORE_ANYTHING_IS_LOADED, *SLOW]
    told = json.loads(subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=True).stdout)
    for line, (first, *_, last) in told.items():
        assert not first.startswith("error:"), line
        assert last.startswith("error: ModuleNotFoundError"), (line, last)


def test_commands_accept_the_perturbations_that_the_model_does():
    from sim_core.uncertainty.perturbation_law import MAX_SCALE
    from sixstrut_cli.options import MOST_PERTURBATION

    assert MOST_PERTURBATION == MAX_SCALE


@pytest.mark.parametrize("name", [entry.name for entry in entries() if entry.module is not None])
def test_help_of_a_command_shows_an_example(name, capsys):
    assert app.run([name, "--help"]) == 0
    assert f"sixstrut {name}" in capsys.readouterr().out


@pytest.mark.parametrize("columns", ["60", "120"])
def test_help_tells_defaults_in_words_at_any_width(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    assert app.run(["docs", "--help"]) == 0
    assert "default: out/site" in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.fixture
def library(tmp_path):
    """A primitive library that nobody wants to lose."""
    path = tmp_path / "mine.yaml"
    path.write_text("schema: 1\nprimitives:\n- {name: A, class: TO5-TC6, policy_mm: [36, 7, -30, -23, -34, 14]}\n")
    return path


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("calibrate-model", "-o"), "a prototype"),
        (("calibrate", "--virtual"), "a calibration"),
        (("robustness", "robust", "--odds"), "gaits' success counts"),
        (("fit", "nowhere", "--ensemble"), "an ensemble"),
        (("climb", "-o"), "climb limits"),
    ],
)
def test_a_file_of_another_kind_is_never_overwritten_and_found_before_any_work(library, words, wanted, capsys):
    before = library.read_bytes()
    assert app.run([*words, str(library)]) == 2
    said = "".join(capsys.readouterr().err.split())
    assert "".join(f"exists and is a primitive library, not {wanted}: it is left as it is".split()) in said
    assert library.read_bytes() == before


def test_a_picture_is_not_written_over_a_file_that_is_none(library, capsys):
    assert app.run(["roll", "--picture", str(library)]) == 2
    assert "validendsare.png,.svg,.pdf" in "".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(("kind", "root"), [("urdf", "robot"), ("mjcf", "mujoco")])
def test_export_writes_over_its_own_kind_alone(kind, root, tmp_path, library, capsys):
    file = tmp_path / "new" / "robot.xml"
    for _ in range(2):
        assert app.run(["export", kind, str(file)]) == 0
        assert ElementTree.parse(file).getroot().tag == root
    other = {"urdf": "mjcf", "mjcf": "urdf"}[kind]
    for arguments in ([other, str(file)], [kind, str(library)]):
        before = Path(arguments[1]).read_bytes()
        assert app.run(["export", *arguments]) == 2
        assert "it is left as it is" in " ".join(capsys.readouterr().err.split())
        assert Path(arguments[1]).read_bytes() == before


def test_the_kinds_of_files_are_told_apart(tmp_path):
    from importlib.resources import files

    import numpy as np

    from sim_core.sensing.mounting import Mounting, mounting_text
    from sixstrut_cli.outputs import KINDS, kind_of

    shipped = {
        "libraries/robust.yaml": "primitive library",
        "prototype.yaml": "prototype",
        "odds/robust.yaml": "gaits' success counts",
        "climbs/robust.yaml": "climb limits",
        "actuators.yaml": "actuator file",
    }
    for name, kind in shipped.items():
        assert kind_of(files("sim_core") / "data" / name) == kind
    assert kind_of(files("hardware_bridge") / "data" / "calibration_default.yaml") == "calibration"
    mounting = tmp_path / "mounting.yaml"
    mounting.write_text(mounting_text(Mounting(np.eye(3), {"TC6": 0.01})), encoding="utf-8")
    assert kind_of(mounting) == "mounting"
    assert set(shipped.values()) | {"calibration", "ensemble", "mounting"} == set(KINDS)


@pytest.mark.parametrize(
    "line",
    [
        "roll --picture HERE/x.png", "climb -o HERE/x.yaml", "robustness robust --csv HERE",
        "robustness robust --picture HERE/x.png",
        "robustness robust --odds HERE/x.yaml", "search -o HERE/x.yaml", "parameters --picture HERE/x.png",
        "parameters --export json -o HERE/x.json", "export urdf HERE/x.urdf", "calibrate-model -o HERE/x.yaml", "validate -o HERE",
        "demo --bags HERE", "travel 1,1 -o HERE", "travel --study 1 -o HERE", "console --virtual --bags HERE", "campaign HERE/new",
        "trial HERE/new --virtual", "report -o HERE SESSION", "odds --picture HERE/x.png BAG", "fit --odds HERE/x.yaml SESSION",
        "fit --demonstrate -o HERE", "replay --picture HERE/x.png BAG", "replay --animation HERE/x.webp BAG", "docs -o HERE",
        "calibrate --virtual HERE/x.yaml", "faults -o HERE", "bench -o HERE",
    ],
)  # fmt: skip
def test_an_output_that_cannot_be_written_is_refused_before_anything_is_read_or_computed(line, tmp_path, monkeypatch, capsys):
    """For root, to whom permissions mean nothing, there is a file where the folder should be."""
    monkeypatch.setenv("SIXSTRUT_ROOT", str(ROOT))
    (tmp_path / "file").touch()
    here = {"HERE": f"{tmp_path}/file/folder", "SESSION": "/nowhere", "BAG": "/nowhere.mcap"}
    words = [next((word.replace(key, path) for key, path in here.items() if key in word), word) for word in line.split()]
    monkeypatch.setattr("sixstrut_cli.commands.develop.docs._build", None)
    monkeypatch.setattr("docs.from_code.pages", dict)
    assert app.run(words) in (1, 2)
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert "file/folder" in last
    assert "cannot be written" in last


def test_letters_that_a_terminal_cannot_show_are_replaced():
    command = [sys.executable, "-m", "sixstrut_cli", "route", "TC6", "TC1"]
    environ = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(command, env=environ, capture_output=True, check=True, timeout=60)
    assert "TC6 > TO5 > " in done.stdout.decode("latin-1")
