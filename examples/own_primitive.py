# SPDX-License-Identifier: Apache-2.0
"""A primitive of your own: six strokes for the roll TC6 → TO5. Symmetry makes 24 gaits of it; all are tried on perturbed robots."""

from sim_core import Ensemble, Law, Primitive, build_model, class_of, gait_of, load_prototype, rate_of, roll, rolls_of

STROKES_MM = (-31, 36, 17, 37, -34, -43)  # S1 to S6, + lengthens


def main(robots: int = 8, off: float = 0.05) -> None:
    model = build_model(load_prototype())
    result = roll(model, "TC6", "TO5", STROKES_MM)
    print("the nominal robot:", "feasible" if result.feasible else result.reason)

    primitive = Primitive("mine", class_of("TC6"), STROKES_MM)
    gaits = [gait_of(primitive, source, target) for source, target in rolls_of(primitive.roll_class)]
    rehearsed = Ensemble(model, Law(off), robots).rehearse(gaits)
    for each in rehearsed:
        gait, tried = each.gait, each.rate
        print(f"{gait.source:>4} → {gait.target:4}  {tried.successes:2d} of {tried.trials}  ends on {each.outcomes}")
    rate = rate_of(sum(each.rate.successes for each in rehearsed), len(gaits) * robots)
    print(f"±{100 * off:.0f} %: {rate.successes} of {rate.trials}, {100 * rate.low:.0f} to {100 * rate.high:.0f} %")


if __name__ == "__main__":
    main()
