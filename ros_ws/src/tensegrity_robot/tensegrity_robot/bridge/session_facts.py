# SPDX-License-Identifier: Apache-2.0
"""What a session's bag says of itself: the files that made it, and their hashes."""

from importlib.resources import files
from pathlib import Path

from sim_core.gaits.library import LIBRARIES, load_library
from sim_core.structure.elements import elements_of
from sim_core.structure.parameters import FILE, load_prototype
from sim_core.twin.model_versions import label_of
from tensegrity_robot.bridge.bridge_parameters import BridgeParameters


def session_files(p: BridgeParameters) -> tuple[dict[str, bytes], dict[str, str]]:
    """Files that go into the bag, and their hashes. Raises SimError, OSError."""
    library = Path(p.library) if Path(p.library).suffix == ".yaml" else LIBRARIES / f"{p.library}.yaml"
    prototype = load_prototype(p.prototype_file or None)
    facts = {
        "library": load_library(p.library).hash,
        "prototype": prototype.hash,
        "model": label_of(elements_of(prototype).hash),
    }
    default = files("hardware_bridge") / "data" / "calibration_default.yaml"
    attachments = {
        "library.yaml": library.read_bytes(),
        "prototype.yaml": (Path(p.prototype_file) if p.prototype_file else FILE.path).read_bytes(),
        "calibration.yaml": Path(p.calibration).read_bytes() if p.calibration else default.read_bytes(),
    }
    return attachments, facts
