"""Does the IMU measure the motion that the camera sees? What the pipeline makes of each contradiction, and of none.

    python -m benchmarks.consistency [--seeds 31 32 …] [--scenario mixed] [--seconds 12]

Each unit's walk is rendered once; the contradictions are then made of its samples and stamps. Times are in seconds of
CLOCK_MONOTONIC: from the fault's begin to the first ground that flags it, and from its end to the first valid one of
`STEADY_S` without a flag. Wrong is what `lab.faults.criteria` calls so.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import Pool

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults.criteria import errors_of, flags
from messages import Frame, GroundPlane, ImuSample, Input, Status, StereoFrame, vec3
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

S = 1_000_000_000
START_NS = 10 * S
HELD_S = 2.5
STEADY_S = 0.5
FAULT_AFTER_S = 4.0
"""After the start: the wearers of all scenarios that walk are then at full pace, and walk on until the fault ends."""

Sampled = Callable[[ImuSample], ImuSample]
Stamped = Callable[[int], int]


@dataclass(frozen=True)
class Walk:
    """All that is told of one unit, in the order of arrival."""

    wearer: SimulatedWearer
    inputs: list[Input]


@dataclass(frozen=True)
class Contradiction:
    """A fault in force between two instants."""

    name: str
    sample: Sampled | None = None
    late_ns: Stamped | None = None


@dataclass(frozen=True)
class Judgement:
    """Seconds until flagged and until over, NaN where never; planes that were valid and wrong, flagged, and all."""

    flagged_s: float
    over_s: float
    wrong: int
    flags: int
    frames: int


def walk(seed: int, name: str, seconds: float) -> Walk:
    wearer = SimulatedWearer(seed, scenario(name), START_NS)
    return Walk(wearer, list(wearer.offline_inputs(seconds)))


def altered(inputs: list[Input], fault: Contradiction, from_ns: int, to_ns: int) -> Iterator[tuple[int, Input]]:
    """Yield the inputs with the fault in them, a frame's with the exposure that its stamp should tell."""
    for message in inputs:
        if isinstance(message, StereoFrame):
            true_ns = message.header.t_exposure_ns
            if fault.late_ns is not None and from_ns <= true_ns < to_ns:
                stamped_ns = true_ns + fault.late_ns(true_ns - from_ns)
                header = msgspec.structs.replace(message.header, t_exposure_ns=stamped_ns)
                yield true_ns, msgspec.structs.replace(message, header=header)
            else:
                yield true_ns, message
        elif isinstance(message, ImuSample) and fault.sample and from_ns <= message.t_sample_ns < to_ns:
            yield 0, fault.sample(message)
        else:
            yield 0, message


def judged(told: Walk, fault: Contradiction) -> Judgement:
    """Return what the pipeline makes of `fault`."""
    from_ns = START_NS + round(FAULT_AFTER_S * S)
    to_ns = from_ns + round(HELD_S * S)
    pipeline = Pipeline(told.wearer.calibration, FootholdSettings())
    flagged_ns, valid_ns, wrong, now_ns, true_ns = [], [], 0, 0, 0
    for exposure_ns, message in altered(told.inputs, fault, from_ns, to_ns):
        if isinstance(message, ImuSample | Frame):
            now_ns = message.t_arrival_ns if isinstance(message, ImuSample) else message.header.t_arrival_ns
        true_ns = exposure_ns or true_ns
        for ground in pipeline.step(message):
            if not isinstance(ground, GroundPlane) or ground.frame_seq < 0:
                continue
            truth = told.wearer.truth(true_ns, ground.ahead_m, left_m=ground.left_m)
            if ground.status is Status.VALID:
                wrong += errors_of(ground, truth).wrong
                valid_ns.append(now_ns)
            elif flags(ground, truth) and now_ns >= from_ns:
                flagged_ns.append(now_ns)
    return Judgement(
        flagged_s=1e-9 * (flagged_ns[0] - from_ns) if flagged_ns else np.nan,
        over_s=next((1e-9 * (t - to_ns) for t in valid_ns if t >= to_ns and _steady(t, flagged_ns)), np.nan),
        wrong=wrong,
        flags=len(flagged_ns),
        frames=sum(isinstance(message, StereoFrame) for message in told.inputs),
    )


def _steady(t_ns: int, flagged_ns: list[int]) -> bool:
    return not any(t_ns < flag_ns <= t_ns + STEADY_S * S for flag_ns in flagged_ns)


def scaled(axis: int, scale: float, offset: float = 0.0) -> Sampled:
    """Return samples with one of the six axes, accelerometer first, scaled and moved."""

    def alter(sample: ImuSample) -> ImuSample:
        values = [*sample.sf_B_mps2, *sample.w_WB_B_radps]
        values[axis] = scale * values[axis] + offset
        return msgspec.structs.replace(sample, sf_B_mps2=vec3(values[:3]), w_WB_B_radps=vec3(values[3:]))

    return alter


def axes_swapped(sample: ImuSample) -> ImuSample:
    """Return the sample with x and y of both sensors exchanged."""
    (ax, ay, az), (wx, wy, wz) = sample.sf_B_mps2, sample.w_WB_B_radps
    return msgspec.structs.replace(sample, sf_B_mps2=(ay, ax, az), w_WB_B_radps=(wy, wx, wz))


def later(by_ms: float) -> Stamped:
    return lambda _: round(1e6 * by_ms)


def drifting(rate: float) -> Stamped:
    return lambda since_ns: round(rate * since_ns)


AXES = ("accel-x", "accel-y", "accel-z", "gyro-x", "gyro-y", "gyro-z")
CONTRADICTIONS = (
    *(Contradiction(f"{axis} changes its sign", scaled(k, -1.0)) for k, axis in enumerate(AXES)),
    Contradiction("x and y of both sensors exchanged", axes_swapped),
    Contradiction("gyro-y half as much again", scaled(4, 1.5)),
    Contradiction("accel-x off by 0.1 g", scaled(0, 1.0, 0.98)),
    Contradiction("gyro-y off by 5 °/s", scaled(4, 1.0, 0.0873)),
    *(Contradiction(f"frames stamped {ms:+d} ms", late_ns=later(ms)) for ms in (-90, -50, -20, 20, 50, 90)),
    *(Contradiction(f"frame clock {rate:+.0%}", late_ns=drifting(rate)) for rate in (-0.01, 0.01)),
)


def of_one_unit(task: tuple[int, str, float]) -> list[Judgement]:
    """Return what becomes of no fault and of each contradiction."""
    cv2.setNumThreads(1)
    told = walk(*task)
    return [judged(told, fault) for fault in (Contradiction("none"), *CONTRADICTIONS)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(31, 39)))
    parser.add_argument("--scenario", default="mixed")
    parser.add_argument("--seconds", type=float, default=12.0)
    options = parser.parse_args()
    with Pool(2) as pool:
        units = pool.map(of_one_unit, [(seed, options.scenario, options.seconds) for seed in options.seeds], 1)

    sound = [said[0] for said in units]
    frames = sum(each.frames for each in sound)
    print(
        f"without a fault: {sum(each.flags for each in sound)} flags, {sum(each.wrong for each in sound)} wrong",
        end="",
    )
    print(f" of {frames} frames")

    print(
        f"\n{'fault for ' + str(HELD_S) + ' s of walking':36}flagged  after: median worst   over: median worst   wrong"
    )
    for k, fault in enumerate(CONTRADICTIONS, start=1):
        said = [judgements[k] for judgements in units]
        found = sum(np.isfinite(each.flagged_s) for each in said)
        columns = ([each.flagged_s for each in said], [each.over_s for each in said])
        numbers = [f"{np.nanmedian(x):.2f} {np.nanmax(x):.2f}" if np.isfinite(x).any() else "-" for x in columns]
        wrong = sum(each.wrong for each in said)
        print(f"{fault.name:36}{found} of {len(said)}" + "".join(f"{text:>20}" for text in numbers) + f"{wrong:>8}")


if __name__ == "__main__":
    main()
