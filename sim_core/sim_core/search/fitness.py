# SPDX-License-Identifier: Apache-2.0
"""How good a policy is, as one number: what the generator climbs.

below 1      it did not roll: the farther the centre of mass got past an edge, the more
1 to 2       it rolled, but not as it should: strut force, clearance, or it did not stay; or too few trials succeeded
from 2 on    feasible on the nominal robot: 2 + quality; or, with training prototypes, 2 + success rate + a little quality
"""

import math

from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import Policy
from sim_core.studies.local_runner import Trials

FEASIBLE = 2.0
PAST_EDGE_SCALE_M = 0.02
"""Way past an edge that makes a difference."""
INSIDE_M, CLEARANCE_M = 0.02, 0.015
"""Margins beyond which more is no better: of the centre of mass inside the base, and of the clearance above what is required."""
WEIGHTS = {"inside": 0.25, "clearance": 0.15, "force": 0.15, "gentle": 0.30, "short": 0.15}
QUALITY_SHARE = 0.05
"""Weight of the quality beside a success rate: the gentlest policy may cost this much success at the most."""


def merit_of(prototype: Prototype, policy: Policy, trials: Trials, row: int) -> float:
    """Merit of a policy from its roll on the nominal robot, row `row` of the trials."""
    if trials.feasible[row]:
        return FEASIBLE + quality(prototype, policy, trials, row)
    past = _sigmoid(float(trials.past_edge_m[row]) / PAST_EDGE_SCALE_M)
    return 1.0 + 0.5 * past if trials.landed[row] else past


def quality(prototype: Prototype, policy: Policy, trials: Trials, row: int) -> float:
    """Margins, gentleness (mean stroke) and shortness (longest stroke, which sets the time) of a feasible roll, in [0, 1]."""
    limit, strokes = prototype.policy_limit_mm, [abs(stroke) for stroke in policy]
    allowed_n = prototype.force_fraction * prototype.actuator_stall_n
    parts = {
        "inside": min(float(trials.margin_m[row]) / INSIDE_M, 1.0),
        "clearance": min((float(trials.clearance_m[row]) - prototype.clearance_margin_m) / CLEARANCE_M, 1.0),
        "force": 1.0 - float(trials.peak_force_n[row]) / allowed_n,
        "gentle": 1.0 - sum(strokes) / (len(strokes) * limit),
        "short": 1.0 - max(strokes) / limit,
    }
    return sum(WEIGHTS[name] * value for name, value in parts.items())


def trained_merit(rate: float, quality_of_roll: float) -> float:
    """Merit of a feasible policy with this success rate on all training prototypes."""
    return FEASIBLE + rate + QUALITY_SHARE * quality_of_roll


def dropped_merit(rate: float) -> float:
    """Merit of a feasible policy that was given up after its first training prototypes."""
    return 1.5 + 0.5 * min(rate, 0.999)


def _sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-50.0, min(50.0, x))))
