# SPDX-License-Identifier: Apache-2.0
"""The robot on the emulated board's pulses, with actuators that feel their load (see `sim_core.dynamics.actuators`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.virtual_prototype.body import SimulatedBody
from sim_core.dynamics import actuators
from sim_core.dynamics.actuators import ActuatorParameters


class ActuatedBody(SimulatedBody):
    """A perturbed robot whose actuators slow down, stall, slide and pull down their supply. Drawn here and told to nobody.

    Each actuator's speed, stall and back-drive force are off by up to the perturbation, from a draw of their own, so that
    body and ropes are those of the same seed with ideal actuators.

    Args:
        face: it rests on.
        perturbation: scale of its perturbation, 0.05 for 5 %.
        seed: of the draws.
        parameters: of the actuators.
        incline_deg, downhill_rad: see `SimulatedBody`.
    """

    def __init__(
        self,
        face: str,
        perturbation: float,
        seed: int,
        parameters: ActuatorParameters,
        incline_deg: float = 0.0,
        downhill_rad: float | None = None,
    ) -> None:
        self._parameters = parameters
        super().__init__(face, perturbation, seed, parameters, incline_deg, downhill_rad)
        rng = np.random.default_rng([seed, 1])
        self._strength = 1.0 + perturbation * rng.uniform(-1.0, 1.0, 6)
        self._mid_m = self._robot.model.elements.strut_mid_m
        self._commanded_m = np.full(6, np.nan)
        self._actuators = actuators.at_rest(self._parameters, self._robot.rest_lengths_m(), self._robot.strut_forces_n())
        self._lowest_v = self._parameters.supply_open_v

    def set_targets(self, lengths_m: NDArray[np.float64]) -> None:
        """See `SimulatedBody`; NaN switches a motor off."""
        self._commanded_m = self._robot.model.rest_lengths(lengths_m)

    def advance_to(self, time_s: float) -> None:
        """See `SimulatedBody`."""
        period = max(1, round(actuators.PERIOD_S * self._steps_per_second))
        while (steps := min(period, int(time_s * self._steps_per_second) - self._steps)) > 0:
            forces_n = self._robot.strut_forces_n()
            dt_s = steps / self._steps_per_second
            self._actuators = actuators.step(
                self._parameters, self._actuators, self._commanded_m, forces_n, self._mid_m, dt_s, self._strength
            )
            self._lowest_v = min(self._lowest_v, self._actuators.supply_v)
            self._robot.set_raw_targets(actuators.lengths_m(self._parameters, self._actuators))
            self._step(steps)

    @property
    def supply_v(self) -> float | None:
        """See `SimulatedBody`."""
        return self._actuators.supply_v

    def take_brown_out(self) -> bool:
        """See `SimulatedBody`."""
        lowest_v, self._lowest_v = self._lowest_v, self._parameters.supply_open_v
        return lowest_v < self._parameters.brown_out_v
