# SPDX-License-Identifier: Apache-2.0
"""One strut of a virtual prototype, moved through the bridge as on a real robot: arm, execute, disarm."""

import time

from hardware_bridge import Bridge, Limits, Mode, Rules, Trajectory, load_calibration, parse_board, practice_prototype


def main(strut: int = 3, stroke_m: float = 0.010, time_scale: float = 4.0) -> None:
    rules = Rules(load_calibration(), Limits())
    with (
        practice_prototype(time_scale, "lsc") as port,
        Bridge(str(port), rules, board=parse_board("lsc"), state_dir=port.parent, rested_s=600.0) as bridge,
    ):
        mid_m = [rules.calibration.mid_stroke_length_m] * 6
        lease = bridge.arm("example", lifted_and_clear=True, confirmed_lengths_m=mid_m)  # what a person would have looked at
        while bridge.snapshot().mode is not Mode.ARMED:  # it homes: every strut goes to mid stroke
            bridge.prove(lease)  # at least twice a second, or the bridge takes its commander for dead
            time.sleep(0.1)
        there = list(bridge.snapshot().lengths_m)
        there[strut - 1] += stroke_m
        motion = bridge.execute(Trajectory([stroke_m / rules.limits.speed_m_s], [there]), lease)
        while not motion.wait(0.1):
            bridge.prove(lease)
            print(f"S{strut} at {1e3 * motion.progress().lengths_m[strut - 1]:.1f} mm")
        result = motion.result()
        print(f"{result.outcome.value}: S{strut} at {1e3 * result.lengths_m[strut - 1]:.1f} mm")
        bridge.disarm(lease)


if __name__ == "__main__":
    main()
