# SPDX-License-Identifier: Apache-2.0
"""The page of files: what each kind is, its version, who writes and reads it."""

from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from docs.from_code import NOTE, table


class Kind(NamedTuple):
    """A kind of file. `module` has its reader, and `SCHEMA` if it has versions; `example`: in the repository, or empty."""

    name: str
    module: str
    form: str
    holds: str
    written: str
    read: str
    example: str = ""


# fmt: off
KINDS = (
    Kind("prototype", "sim_core.structure.parameter_file", "YAML",
         "every number of a robot, with unit and source", "by hand, `calibrate-model`",
         "`--prototype`, the nodes' `prototype_file`", "sim_core/sim_core/data/prototype.yaml"),
    Kind("actuators", "sim_core.structure.parameter_file", "YAML",
         "how the servo actuators behave under load", "by hand", "`--actuators`", "sim_core/sim_core/data/actuators.yaml"),
    Kind("library", "sim_core.gaits.library", "YAML",
         "primitives, with margins, the model's hash, and how they were found", "`search`",
         "`--library`, planner, traveller", "sim_core/sim_core/data/libraries/robust.yaml"),
    Kind("gait odds", "sim_core.gaits.success_counts", "YAML",
         "successes and trials of every gait of one library", "`robustness --odds`, `fit --odds`",
         "`route --odds`, the nodes' `odds_file`", "sim_core/sim_core/data/odds/robust.yaml"),
    Kind("climb limits", "sim_core.gaits.climb_limits", "YAML",
         "the steepest ground that each primitive of one library climbs", "`climb -o`",
         "traveller", "sim_core/sim_core/data/climbs/robust.yaml"),
    Kind("ensemble", "sim_core.uncertainty.ensemble", "YAML",
         "robots fitted to trials, with weights", "`fit --ensemble`", "`rehearse --ensemble`, `search robust --ensemble`"),
    Kind("calibration", "hardware_bridge.calibration.calibration_file", "YAML",
         "length to pulse, strut by strut, of one robot", "`calibrate`",
         "the bridge's `calibration`, `doctor`", "hardware_bridge/hardware_bridge/data/calibration_default.yaml"),
    Kind("mounting", "sim_core.sensing.mounting", "YAML",
         "how the inertial sensor sits in one robot's box", "`calibrate imu`",
         "`mounting` of launch, estimator and twin, `trial --mounting`"),
    Kind("session", "tensegrity_lab.session_data.folder", "folder",
         "a session of trials: settings, plan, ledger, bags, report", "`trial`, `campaign`",
         "`trial` (goes on), `report`, `fit`, `odds`"),
    Kind("bag", "hardware_bridge.recording.bag_on_disk", "folder with MCAP",
         "all that a bridge sent, heard and saw in one session", "the bridge",
         "`replay`, `play`, `report`, `fit`, `odds`, `recheck`, rosbag2, Foxglove, PlotJuggler", "bags/example/metadata.yaml"),
    Kind("last pulses", "hardware_bridge.saved_state.last_pulses", "JSON",
         "what each strut was last sent, of one robot", "the bridge, before each write", "the bridge, before it arms"),
    Kind("duty", "hardware_bridge.saved_state.duty_record", "JSON",
         "how long each strut has run lately, of one robot", "the bridge", "the bridge"),
)
# fmt: on

SCHEMAS = """\
*Schema* is the number that the file states as `schema:`; a file of another number is refused. Files of the robot's state are in
`$SIXSTRUT_STATE_DIR`, or `~/.local/state/sixstrut`. Every YAML file is read by one strict reader, bounded in size, depth and
digits; what YAML 1.1 and 1.2 read differently is refused.

How damage is told: chunks, sections and attachments of a bag, every record of a journal, every line of a ledger and the compiled
code have checksums. What is damaged is one line of error with file, cause and remedy; a journal loses the damaged place only, and
compiled code is compiled again. A YAML file that a program wrote begins with `# sha256 of all below: …`: if it was changed since,
whoever reads it says so once, and uses it."""

BAG = """\
A session's bag is a folder `session_TIME` with `session_TIME.mcap` and rosbag2's `metadata.yaml`, so `ros2 bag info` and `play`
take it; commands here take the folder, the file alone, and the single files of older versions. While the session lives, and after
it was cut short, there is `session_TIME.mcap.journal` instead, of which the bridge makes the bag at its end or at its next start.

MCAP with ROS 2 messages (`ros2msg`, `cdr`). Topics are under `/recorded/`, names that no live node listens to, so playing a bag
moves nothing; which topics, is in the [interfaces](interfaces.md). Attached are the library, the prototype and the calibration of
the session; the metadata hold their hashes and versions.

A folder that rosbag2 recorded (`metadata.yaml` with .mcap files) is read as one bag, under live names too; without a prototype in
it, it is taken for one of the shipped prototype. A bag of sqlite3 storage has to be converted first (`ros2 bag convert`)."""


def _schema(kind: Kind) -> str:
    module = import_module(kind.module)
    return " or ".join(map(str, getattr(module, "SCHEMAS", None) or [getattr(module, "SCHEMA", "–")]))


def page(_: Path) -> str:
    """The page, as Markdown."""
    from hardware_bridge.calibration.pulse_map import StrutCalibration
    from tensegrity_lab.session_data.ledger_line import COLUMNS

    rows = [
        (
            kind.name, kind.form, _schema(kind), kind.holds, kind.written, kind.read,
            f"[`{Path(kind.example).name}`](../../{kind.example})" if kind.example else "",
        )
        for kind in KINDS
    ]  # fmt: skip
    lines = ["# Files", "", NOTE, ""]
    lines += table(("kind", "form", "schema", "holds", "written by", "read by", "example"), rows)
    lines += [
        "",
        SCHEMAS,
        "",
        "## Calibration",
        "",
        "Beside `mid_stroke_length_m`, the name of the robot and its board, each of `S1`…`S6` under `struts` has:",
        "",
        *(f"* `{row.name}`" for row in fields(StrutCalibration)),
        "",
        "## Ledger of a session",
        "",
        "`ledger.csv`, one line an event; each line ends with its CRC-32 (`check`). Its columns, in order (what they mean:",
        "[TrialRecord](interfaces.md#trialrecordmsg)):",
        "",
        ", ".join(f"`{name}`" for name in COLUMNS) + ".",
        "",
        "## Bag",
        "",
        BAG,
    ]
    return "\n".join(lines) + "\n"
