# SPDX-License-Identifier: Apache-2.0
"""The robot that hangs on the emulated board: a perturbed model, stepped to robot time."""

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.virtual_prototype.inertial_sensor import InertialSensor
from sim_core.dynamics import actuators
from sim_core.dynamics.actuators import ActuatorParameters, following
from sim_core.twin.rest_detector import OBSERVER_HOLD_S, RestWatch


class SimulatedBody:
    """A robot of `sim_core` with perturbed parameters, drawn here and told to nobody; its actuators are ideal.

    It is what the board's outputs drive. Time is its own, in [s], from 0.

    Args:
        face: it rests on.
        perturbation: scale of its perturbation, 0.05 for 5 %.
        seed: of the draw.
        parameters: of actuators that the solver's own are to follow; None: these are the robot's.
        incline_deg: of the ground.
        downhill_rad: direction on the floor; None: of the draw.
    """

    def __init__(
        self,
        face: str,
        perturbation: float,
        seed: int,
        parameters: ActuatorParameters | None = None,
        incline_deg: float = 0.0,
        downhill_rad: float | None = None,
    ) -> None:
        from sim_core.dynamics.model import build_model
        from sim_core.dynamics.robot import Robot
        from sim_core.structure.parameters import load_prototype
        from sim_core.uncertainty.perturbation_law import inclined, inclined_towards, perturb

        prototype = load_prototype()
        if parameters is not None:
            prototype = following(prototype, parameters)
        self.mid_stroke_length_m = prototype.strut_length_m
        model = perturb(build_model(prototype), perturbation, seed) if perturbation else build_model(prototype)
        if downhill_rad is not None:
            model = inclined_towards(model, incline_deg, downhill_rad)
        elif incline_deg:
            model = inclined(model, incline_deg, seed)
        self._steps_per_second = int(model.steps_per_second)
        self._robot = Robot.resting_on(model, face)
        self._first_step = self._robot.step
        self._targets_m = np.full(6, self.mid_stroke_length_m)
        self._rest = RestWatch(OBSERVER_HOLD_S, sees_drives=False, resting=True)
        self._settled = True

    @property
    def time_s(self) -> float:
        """Robot time in [s]: whole steps since the start."""
        return self._steps / self._steps_per_second

    @property
    def _steps(self) -> int:
        return self._robot.step - self._first_step

    def set_targets(self, lengths_m: NDArray[np.float64]) -> None:
        """Six rest lengths in [m] for the actuators to drive to; NaN leaves a strut as it is."""
        targets_m = np.where(np.isnan(lengths_m), self._targets_m, lengths_m)
        if not np.array_equal(targets_m, self._targets_m):
            self._targets_m = targets_m
            self._robot.set_targets(targets_m)

    def advance_to(self, time_s: float) -> None:
        """Steps to the last whole step not after `time_s`."""
        steps = int(time_s * self._steps_per_second) - self._steps
        if steps > 0:
            self._step(steps)

    def _step(self, steps: int) -> None:
        self._robot.advance(steps)
        self._settled = self._rest.at_rest(self._robot, self._robot.step)

    @property
    def supply_v(self) -> float | None:
        """Voltage of the servo supply; None: not modelled."""
        return None

    def take_brown_out(self) -> bool:
        """Whether the supply has been too low for the board since this was last asked."""
        return False

    def sensor(self, seed: int) -> InertialSensor:
        """An inertial sensor in its box, with errors that the seed draws."""
        return InertialSensor(self._robot, seed)

    def observe(self) -> Observation:
        """What can be seen now."""
        footing = self._robot.footing()
        return Observation(
            robot_time_ns=self._steps * 1_000_000_000 // self._steps_per_second,
            face=footing.face if self._settled else self._robot.face_under(),
            detail=footing.detail,
            settled=self._settled,
            joints_m=self._robot.joints_m(),
            box_m=self._robot.box_m(),
        )


class ActuatedBody(SimulatedBody):
    """A perturbed robot whose actuators slow down, stall, slide and pull down their supply. Drawn here and told to nobody.

    Each actuator's speed, stall and back-drive force are off by up to the perturbation, from a draw of their own, so that
    body and ropes are those of the same seed with ideal actuators.
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
