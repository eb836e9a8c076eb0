"""Does the IMU feel the motion that the camera sees? What the monitor says of each contradiction, and of none.

    python -m benchmarks.consistency [--seeds 31 32 …] [--scenario mixed] [--seconds 9]

Each unit's walk is rendered once; the contradictions are then made of its samples and stamps. Times are in seconds of
CLOCK_MONOTONIC between the fault's begin (or end) and the arrival of the frame that says so (or no longer).
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import msgspec
import numpy as np

from messages import ImuSample, Reason, StereoFrame, vec3
from perception.consistency import ConsistencyMonitor
from perception.ego_motion import EgoMotion, VisualOdometer
from perception.imu_model import corrected
from perception.so3 import Array
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

S = 1_000_000_000
START_NS = 10 * S
HELD_S = 2.5
FAULT_AFTER_S = 4.0
"""After the start: the wearers of all scenarios that walk are then at full pace, and walk on until the fault ends."""

Sampled = Callable[[ImuSample], ImuSample]
Stamped = Callable[[int], int]


@dataclass(frozen=True)
class Walk:
    """All that is told of one unit: samples in the order of arrival, and what each frame showed, with its arrival."""

    wearer: SimulatedWearer
    R_LC: Array
    samples: list[ImuSample]
    motions: list[tuple[int, EgoMotion | None]]


@dataclass(frozen=True)
class Contradiction:
    """A fault in force between two instants."""

    name: str
    sample: Sampled | None = None
    late_ns: Stamped | None = None


def walk(seed: int, name: str, seconds: float) -> Walk:
    wearer = SimulatedWearer(seed, scenario(name), START_NS)
    odometer = VisualOdometer(wearer.calibration.stereo)
    samples: list[ImuSample] = []
    motions: list[tuple[int, EgoMotion | None]] = []
    for message in wearer.offline_inputs(seconds):
        if isinstance(message, ImuSample):
            samples.append(message)
        elif isinstance(message, StereoFrame):
            header = message.header
            motions.append((header.t_arrival_ns, odometer.see(header.t_exposure_ns, message.left, message.right)))
    return Walk(wearer, odometer.R_LC, samples, motions)


def verdicts(told: Walk, fault: Contradiction, from_ns: int, to_ns: int) -> Iterator[tuple[int, Reason]]:
    """Yield what the monitor says at the arrival of each frame."""
    calibration = told.wearer.calibration
    monitor = ConsistencyMonitor(calibration, told.R_LC)
    samples = iter(told.samples)
    sample = next(samples, None)

    def late_ns(t_ns: int) -> int:
        return fault.late_ns(t_ns - from_ns) if fault.late_ns is not None and from_ns <= t_ns < to_ns else 0

    for t_arrival_ns, motion in told.motions:
        while sample is not None and sample.t_arrival_ns <= t_arrival_ns:
            altered = sample
            if fault.sample is not None and from_ns <= sample.t_sample_ns < to_ns:
                altered = fault.sample(sample)
            monitor.feel(altered.t_sample_ns, *corrected(altered, calibration.imu))
            sample = next(samples, None)
        if motion is not None:
            motion = replace(
                motion,
                t_before_ns=motion.t_before_ns + late_ns(motion.t_before_ns),
                t_after_ns=motion.t_after_ns + late_ns(motion.t_after_ns),
            )
        monitor.see(motion)
        yield t_arrival_ns, monitor.reason


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
    *(Contradiction(f"frames stamped {ms:+d} ms", late_ns=later(ms)) for ms in (-90, -50, -20, 20, 50, 90)),
    *(Contradiction(f"frame clock {rate:+.0%}", late_ns=drifting(rate)) for rate in (-0.01, 0.01)),
)


def judged(told: Walk, fault: Contradiction) -> tuple[float, float]:
    """Return after how long the fault is flagged, and how long after its end no more; NaN where it never is."""
    from_ns = START_NS + round(FAULT_AFTER_S * S)
    to_ns = from_ns + round(HELD_S * S)
    said = list(verdicts(told, fault, from_ns, to_ns))
    flagged = [t_ns for t_ns, reason in said if reason is not Reason.NONE and t_ns >= from_ns]
    if not flagged or flagged[0] >= to_ns + S:
        return np.nan, np.nan
    cleared = [t_ns for t_ns, _ in said if t_ns > flagged[-1]]
    return 1e-9 * (flagged[0] - from_ns), 1e-9 * (cleared[0] - to_ns) if cleared else np.nan


def odometry_errors(told: Walk) -> tuple[Array, Array]:
    """Return errors and truth (n, 6) of the rates (rad/s) and the velocity (m/s), in C."""
    calibration, shutter = told.wearer.calibration, told.wearer.shutter
    R_BC = np.array(calibration.X_BL.R) @ told.R_LC
    errors, truths = [], []
    for _, motion in told.motions:
        if motion is None:
            continue
        from_ns, to_ns = shutter.true_of(motion.t_before_ns), shutter.true_of(motion.t_after_ns)
        truth = told.wearer.gait.at(np.linspace(from_ns, to_ns, 21).astype(np.int64))
        centre_m = truth.p_WB_m + truth.R_WB @ np.array(calibration.X_BL.p_m)
        v_C = (truth.R_WB[0] @ R_BC).T @ (centre_m[-1] - centre_m[0]) / (1e-9 * (to_ns - from_ns))
        w_C = R_BC.T @ np.trapezoid(truth.w_WB_B_radps, axis=0) / 20
        truths.append(np.concatenate((w_C, v_C)))
        errors.append(np.concatenate((motion.w_C_radps, motion.v_C_mps)) - truths[-1])
    return np.array(errors), np.array(truths)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(31, 39)))
    parser.add_argument("--scenario", default="mixed")
    parser.add_argument("--seconds", type=float, default=9.0)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    walks = []
    for seed in options.seeds:
        walks.append(walk(seed, options.scenario, options.seconds))
        print(f"unit {seed}: {len(walks[-1].motions)} frames", flush=True)

    errors, truths = (np.concatenate(rows) for rows in zip(*map(odometry_errors, walks), strict=True))
    frames = sum(len(told.motions) for told in walks)
    print(f"\nvisual odometry in C, {len(errors)} steps of {frames} frames: RMS error (of RMS motion)")
    for unit, part in (("rad/s", slice(0, 3)), ("m/s", slice(3, 6))):
        pairs = zip(_rms(errors[:, part]), _rms(truths[:, part]), strict=True)
        print(f"  {unit:6}" + "".join(f"  {error:.3f} ({motion:.3f})" for error, motion in pairs))

    clean = [list(verdicts(told, Contradiction("none"), 0, 0)) for told in walks]
    alarms = sum(reason is not Reason.NONE for said in clean for _, reason in said)
    print(f"\nfalse alarms without a fault: {alarms} of {frames} frames")

    print(f"\n{'fault for ' + str(HELD_S) + ' s of walking':36}flagged   after: median  worst   cleared: median  worst")
    for fault in CONTRADICTIONS:
        after, cleared = np.array([judged(told, fault) for told in walks]).T
        found = np.isfinite(after)
        numbers = [f"{np.nanmedian(x):.2f} {np.nanmax(x):.2f}" if found.any() else "-" for x in (after, cleared)]
        print(f"{fault.name:36}{found.sum()} of {len(walks)}" + "".join(f"{text:>20}" for text in numbers))


def _rms(values: Array) -> Array:
    rms: Array = np.sqrt((values**2).mean(axis=0))
    return rms


if __name__ == "__main__":
    main()
