# SPDX-License-Identifier: Apache-2.0
"""One simulated roll, judged and plotted: strut lengths and forces over time, in one_roll.png."""

import matplotlib.pyplot as plt
import numpy as np

from sim_core import Sample, build_model, load_library, load_prototype, roll


def main(picture: str = "one_roll.png") -> None:
    model = build_model(load_prototype())
    gait = load_library("robust").gaits("TC6", "TO5")[0]  # the best one comes first
    trace: list[Sample] = []
    result = roll(model, gait.source, gait.target, gait.policy, trace=trace)
    print(f"{gait.name}: {' → '.join(result.faces)}, {'feasible' if result.feasible else result.reason}")
    print(f"{result.duration_s:.1f} s, struts pressed with up to {result.peak_force_n:.1f} N")

    times_s = [sample.time_s for sample in trace]
    figure, (above, below) = plt.subplots(2, sharex=True)
    above.plot(times_s, 1e3 * np.array([sample.lengths_m for sample in trace]))
    above.set_ylabel("rest length (mm)")
    below.plot(times_s, -np.array([sample.forces_n for sample in trace]))
    below.set(xlabel="time (s)", ylabel="compression (N)")
    above.legend([f"S{number}" for number in range(1, 7)], ncols=6, frameon=False)
    figure.savefig(picture)
    print(f"plotted in {picture}")


if __name__ == "__main__":
    main()
