"""Several recordings fitted jointly: `python -m benchmarks.joint_recordings [--cases N]`.

A driven pendulum whose noise nobody declared, 40 s in one recording or in two of 24 and 16 s with other inputs, in the
second of which the effect is as strong, or stronger by the `--stronger` share. Judged on another of 40 s. Seeds from
1000 on.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from discrepancy import Explanation, explain
from lab.hidden.pendulum import SIZES, drawn
from lab.undeclared.pendulum import simulation

JUDGED, HELD_OUT, OTHER = 1000, 500, 300
"""The first seed, and what is added for the recording held out and for the second one fitted."""
WHOLE_S, PARTS_S = 40.0, (24.0, 16.0)


def found(effect: str, seed: int, sizes: Sequence[float], seconds: Sequence[float]) -> Explanation:
    """Return what is found in recordings in which an effect is `sizes` times as strong as usual."""
    fit = [
        simulation(drawn(seed + OTHER * place, effect, size=size, seconds=s))
        for place, (size, s) in enumerate(zip(sizes, seconds, strict=True))
    ]
    return explain(fit, simulation(drawn(seed + HELD_OUT, effect, size=sizes[0], seconds=WHOLE_S)), seed=1)


def row(effect: str, told: Sequence[Explanation]) -> str:
    """Return how often exactly the effect was named, its interval's median width over its size, and how often the
    recordings were said to disagree.
    """
    wanted = [effect] if effect else []
    right = [each for each in told if [cause.name for cause in each.verdict.causes] == wanted]
    widths = [
        (value.high - value.low) / SIZES[effect]
        for each in right
        for cause in each.verdict.causes
        if (value := cause.parameters["value"]).high is not None and value.low is not None
    ]
    width = f"{100.0 * float(np.median(widths)):.1f} %" if widths else "–"
    apart = sum(bool(each.verdict.disagreements) for each in told)
    return f"{len(right)} of {len(told)} | {width} | {apart} of {len(told)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5)
    parser.add_argument("--stronger", type=float, default=0.3)
    arguments = parser.parse_args()
    print("| hidden | fitted | right | width of the interval over the size | disagreement told |")
    print("| --- | --- | ---: | ---: | ---: |")
    for effect in (*SIZES, ""):
        unequal = (1.0, 1.0 + arguments.stronger)
        cases = [("one recording", (1.0,), (WHOLE_S,)), ("two", (1.0, 1.0), PARTS_S)]
        for what, sizes, seconds in (*cases, *([("two that disagree", unequal, PARTS_S)] if effect else [])):
            told = [found(effect, JUDGED + case, sizes, seconds) for case in range(arguments.cases)]
            print(f"| {effect or 'nothing'} | {what} | {row(effect, told)} |", flush=True)


if __name__ == "__main__":
    main()
