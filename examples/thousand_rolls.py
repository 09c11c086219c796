# SPDX-License-Identifier: Apache-2.0
"""The same roll by a thousand robots, each built a little differently: how often does it work, and why not?"""

from collections import Counter

from sim_core import Job, build_model, load_library, load_prototype, perturb, rate_of, roll_many


def main(robots: int = 1000, off: float = 0.15) -> None:
    nominal = build_model(load_prototype())
    models = [perturb(nominal, off, seed) for seed in range(robots)]
    gait = load_library("robust").gaits("TC6", "TO5")[0]
    jobs = [Job(number, gait.source, gait.policy, gait.target) for number in range(robots)]
    results = roll_many(models, jobs)  # on all cores, eight robots at a time on each

    rate = rate_of(sum(result.feasible for result in results), robots)
    print(f"{gait.name} on {robots} virtual robots, ±{100 * off:.0f} %: {rate.successes} work")
    print(f"so it works with a probability of {100 * rate.low:.1f} to {100 * rate.high:.1f} % (95 % confidence)")
    print("the last face it stood on:", dict(Counter(result.faces[-1] for result in results).most_common()))
    for reason, count in Counter(result.reason for result in results if result.reason).most_common(3):
        print(f"  {count}: {reason}")


if __name__ == "__main__":
    main()
