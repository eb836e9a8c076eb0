"""The ground carried to each IMU sample against the truth, beside the last frame's value held.

    python -m benchmarks.propagated_ground [--cases level ramps stairs turns] [--seeds 1000-1004] [--seconds 8]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have. A frame's
ground is there as soon as its picture arrives: what the service needs to compute it, 20 ms or so, is not in it. Of all
samples from the first valid ground on, without those with an edge in the foothold region: root mean squares of the
errors of both, and how often the truth lies in the stated 95 % intervals of each. Of the height, what the carrying
alone adds: root mean squares of the change of the error since the exposure. Before that, between the carried plane at
the next exposure and the next frame's: root mean squares of the difference, and the share within 95 % of the deviation
stated for both. Seeds below 1000 are for tuning. Last, what one sample costs: carried, as JSON and as CAN frames.
"""

import argparse
import math
import timeit
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

from daemon.pipeline import Pipeline
from messages import TOPIC_OF, GroundPlane, PropagatedGround, Reason, Source, Stamp, Status
from messages.arrays import FloatArray, rms
from messages.can_encoder import CanEncoder
from messages.codec import encode_line
from messages.constants import NORMAL_95
from perception import so3, vec3
from perception.attitude.history import AttitudeAt
from perception.depth.stereo_camera import StereoCamera
from perception.ground.foothold import FootholdSettings
from perception.ground.propagation import GroundPropagation
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
CASES = ("level", "ramps", "stairs", "turns")
_DIAGONAL = [0, 3, 5]
_CALLS = 10_000


class Walked(NamedTuple):
    """Rows (n, 6) of errors and stated deviations, rad and m, at samples: carried, and held; (m, 6) of differences at
    exposures, with the deviation of carried and next plane together; changes (k,) of the height's error since the
    exposure. `samples` is how many samples there were."""

    carried: FloatArray
    held: FloatArray
    differences: FloatArray
    added_m: FloatArray
    samples: int


def numbers(plane: GroundPlane | PropagatedGround) -> FloatArray:
    """Return slopes and height (3,)."""
    return np.array([plane.slope_sagittal_rad, plane.slope_frontal_rad, plane.height_m])


def deviations(plane: GroundPlane | PropagatedGround) -> FloatArray:
    """Return their standard deviations (3,)."""
    found: FloatArray = np.sqrt(np.array(plane.covariance)[_DIAGONAL])
    return found


def true_numbers(wearer: SimulatedWearer, t_ns: int, seen: GroundPlane) -> FloatArray | None:
    """Return slopes and height (3,) at the instant of a sample, where `seen` was; None with an edge in the region."""
    stamp_ns = 2 * t_ns - wearer.shutter.true_of(t_ns)  # the stamp of a frame exposed then
    truth = wearer.truth(stamp_ns, seen.ahead_m, left_m=seen.left_m)
    if truth.transition:
        return None
    return np.array([truth.slope_sagittal_rad, truth.slope_frontal_rad, truth.height_m])


def walked(case: str, seed: int, seconds: float) -> Walked:
    """Return one unit's walk."""
    wearer = SimulatedWearer(seed, scenario(case), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    last: GroundPlane | None = None
    seen: GroundPlane | None = None
    last_truth: FloatArray | None = None
    path: list[PropagatedGround] = []
    carried, held, differences, added_m = list[FloatArray](), list[FloatArray](), list[FloatArray](), list[float]()
    samples = 0
    for message in wearer.offline_inputs(seconds):
        for estimate in pipeline.step(message):
            if isinstance(estimate, GroundPlane):
                last = estimate if estimate.status is Status.VALID else None
                seen = last or seen
                last_truth = None if last is None else true_numbers(wearer, estimate.t_exposure_ns, last)
                difference = None if last is None else between(path, last)
                differences += [] if difference is None else [difference]
            elif isinstance(estimate, PropagatedGround) and seen is not None:
                truth = true_numbers(wearer, estimate.t_sample_ns, seen)
                samples += truth is not None
                valid = estimate.status is Status.VALID
                path = [*path[-19:], estimate] if valid else []
                if truth is None or not valid or last is None:
                    continue
                carried.append(np.concatenate((numbers(estimate) - truth, deviations(estimate))))
                held.append(np.concatenate((numbers(last) - truth, deviations(last))))
                if last_truth is not None:
                    added_m.append(float((numbers(estimate) - truth - numbers(last) + last_truth)[2]))
    tables = [np.array(rows).reshape(-1, 6) for rows in (carried, held, differences)]
    return Walked(tables[0], tables[1], tables[2], np.array(added_m), samples)


def between(path: list[PropagatedGround], ground: GroundPlane) -> FloatArray | None:
    """Return by how much the plane carried to its exposure differs from `ground`, and the deviations of both."""
    t_ns = ground.t_exposure_ns
    later = next((k for k, plane in enumerate(path) if plane.t_sample_ns >= t_ns), 0)
    if later == 0:
        return None
    before, after = path[later - 1], path[later]
    share = (t_ns - before.t_sample_ns) / (after.t_sample_ns - before.t_sample_ns)
    there = (1.0 - share) * numbers(before) + share * numbers(after)
    return np.concatenate((there - numbers(ground), np.hypot(deviations(before), deviations(ground))))


def inside(rows: FloatArray) -> FloatArray:
    """Return the share (3,) of errors within the stated 95 % intervals."""
    share: FloatArray = (np.abs(rows[:, :3]) <= NORMAL_95 * rows[:, 3:]).mean(axis=0)
    return share


def table(case: str, walks: list[Walked]) -> None:
    """Print one line for each number."""
    carried, held, differences = (np.vstack([walk[k] for walk in walks]) for k in range(3))
    added_m = np.concatenate([walk.added_m for walk in walks])
    samples = sum(walk.samples for walk in walks)
    for k, name in enumerate(("ahead", "across", "height")):
        start = f"{case:8} {samples:6} {len(carried) / samples:7.1%}" if k == 0 else ""
        told = [f"{_shown(rms(rows[:, k]), k)} {inside(rows)[k]:6.1%}" for rows in (carried, held, differences)]
        told += [_shown(rms(added_m), k)] if k == 2 else []
        print(f"{start:24}{name:8}{'   '.join(told)}", flush=True)


def _shown(value: float, k: int) -> str:
    return f"{1e3 * value:6.2f} mm" if k == 2 else f"{math.degrees(value):7.3f}° "


def times_of_one_sample() -> dict[str, float]:
    """Return how long each part of the work for one sample takes, in seconds."""
    wearer = SimulatedWearer(1, scenario("level"), START_NS)
    camera = StereoCamera(wearer.calibration.stereo)
    propagation = GroundPropagation(wearer.calibration, np.array(wearer.calibration.X_BL.R) @ camera.R_EC)
    still = AttitudeAt(START_NS, so3.IDENTITY, vec3.ZERO, 0.0, np.eye(3))
    ground = GroundPlane(
        t_exposure_ns=START_NS,
        frame_seq=0,
        status=Status.VALID,
        reason=Reason.NONE,
        slope_sagittal_rad=0.1,
        slope_frontal_rad=0.05,
        height_m=0.95,
        covariance=(1e-5, 0.0, 0.0, 1e-5, 0.0, 1e-5),
        ahead_m=0.7,
        matched_share=1.0,
        inlier_share=1.0,
        disparity_noise_px=0.1,
        calibration_id=wearer.calibration.id,
    )
    propagation.begin(ground, [still], (1e-5, 0.0, 0.0, 1e-5, 0.0, 1e-5), 1e-6)
    later = iter(range(1, _CALLS + 2))

    def carry() -> PropagatedGround:
        return propagation.at(still._replace(t_ns=START_NS + 1000 * next(later)))

    carried, encoder = carry(), CanEncoder()
    stamp = Stamp(device="d", boot_id="b", source=Source.SIMULATED, seq=0, t_publish_ns=START_NS, age_s=0.0)
    work: dict[str, Callable[[], object]] = {
        "carrying": carry,
        "JSON": lambda: encode_line(TOPIC_OF[PropagatedGround], carried, stamp),
        "CAN frames": lambda: encoder.propagated_ground(carried, stamp, 0.004),
    }
    return {name: timeit.timeit(call, number=_CALLS) / _CALLS for name, call in work.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), metavar="CASE")
    parser.add_argument("--seeds", default="1000-1004", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    first, last = map(int, options.seeds.split("-"))
    print(f"{'':8} samples  valid  {'':8}carried            held               to the next frame  added")
    for case in options.cases:
        table(case, [walked(case, seed, options.seconds) for seed in range(first, last + 1)])
    print(", ".join(f"{name} {1e6 * time_s:.0f} µs" for name, time_s in times_of_one_sample().items()), "a sample")


if __name__ == "__main__":
    main()
