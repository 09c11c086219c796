# SPDX-License-Identifier: Apache-2.0
"""What rolls, trials, studies and sessions look like: figures, tables and pages."""

import os
import sys

from sim_core.files.places import cache_folder

if "matplotlib" not in sys.modules:  # which reads these when it is imported, and a notebook's backend would end that
    os.environ["MPLBACKEND"] = "agg"
    os.environ["MPLCONFIGDIR"] = str(cache_folder("matplotlib", os.environ.get("MPLCONFIGDIR")))
