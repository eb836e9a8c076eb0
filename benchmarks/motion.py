"""The published motion against the truth, whole pipeline, on units and walks that nothing was tuned on:

    python -m benchmarks.motion [--scenarios turns standing] [--seeds 1000-1001] [--seconds 45] [--processes 1]

Of the valid estimates: root mean square errors of velocity and rate in H (all axes), and how often all stay inside the
stated 95 %. The way is compared with the true optical centre's in the same chords of 10 cm, its error also in stated
standard deviations. The end is where a consumer comes to that turns each velocity by the heading of the attitude told
last, in shares of the way, after the headings of the first second are laid on each other.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pool

import cv2
import numpy as np

from daemon.pipeline import Pipeline
from messages import TOPICS, Attitude, Estimate, Motion, Status
from messages.arrays import FloatArray, rms
from messages.constants import NORMAL_95
from perception import so3
from perception.attitude.path_length import CHORD_M
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from perception.heading import heading
from sim_rig.walk.scenario import scenario
from sim_rig.walk.truth import rectified_axis_L
from sim_rig.wearer import SimulatedWearer

_START_NS = 10_000_000_000
_FRAME_NS = TOPICS["frame"].period_ns
_DIAGONAL = [0, 3, 5]


@dataclass(frozen=True)
class Followed:
    """Errors (n, 6) of velocity (m/s) and rate (rad/s), and the stated deviations (n, 6); ways told and true, and the
    deviation stated of the former, m; the distance between the ends, m; and how many estimates there were."""

    errors: FloatArray
    deviations: FloatArray
    way_m: float
    true_way_m: float
    way_std_m: float
    end_error_m: float
    estimates: int


def followed(seed: int, name: str, seconds: float) -> Followed:
    """Return what the pipeline tells of one unit's motion, beside the truth."""
    cv2.setNumThreads(1)
    wearer = SimulatedWearer(seed, scenario(name), _START_NS)
    foothold = FootholdSettings()
    R_BC = GroundEstimator(wearer.calibration, foothold).R_BC
    pipeline = Pipeline(wearer.calibration, foothold)
    told: list[tuple[Motion, FloatArray]] = []
    estimates, R_WB = 0, np.eye(3)
    for estimate in _estimates(pipeline, wearer, seconds):
        if isinstance(estimate, Attitude) and estimate.status is Status.VALID:
            R_WB = so3.matrix_from_quaternion(estimate.q_WB)
        if isinstance(estimate, Motion):
            estimates += 1
            R_WH = heading(R_WB @ R_BC)
            if estimate.status is Status.VALID and R_WH is not None:
                told.append((estimate, R_WH))
    times_ns = np.array([wearer.shutter.true_of(motion.t_exposure_ns) for motion, _ in told])
    centre_W, v_W, w_W, true_R_WH = _truth(wearer, times_ns)
    errors, deviations = [], []
    for (motion, _), true_R, v, w in zip(told, true_R_WH, v_W, w_W, strict=True):
        found = np.array((*motion.velocity_H_mps, *motion.rate_H_radps))
        errors.append(found - np.concatenate((true_R.T @ v, true_R.T @ w)))
        variances = np.array((*motion.velocity_cov_H, *motion.rate_cov_H))[[*_DIAGONAL, *(6 + k for k in _DIAGONAL)]]
        deviations.append(np.sqrt(variances))
    velocities_W = np.array([R_WH @ np.array(motion.velocity_H_mps) for motion, R_WH in told])
    # headings laid on each other: W's yaw is arbitrary
    turns = np.array([true @ found.T for (_, found), true in zip(told[:20], true_R_WH, strict=False)])
    yaw = np.arctan2(turns[:, 1, 0].mean(), turns[:, 0, 0].mean())
    walked_W = so3.exp(np.array((0.0, 0.0, yaw))) @ _integrated(velocities_W, times_ns)
    first, last = told[0][0], told[-1][0]
    return Followed(
        np.array(errors),
        np.array(deviations),
        last.distance_m - first.distance_m,
        _chords_m(_truth(wearer, np.arange(times_ns[0], times_ns[-1], _FRAME_NS))[0]),
        float(np.sqrt(last.distance_var_m2 - first.distance_var_m2)),
        float(np.linalg.norm((walked_W - (centre_W[-1] - centre_W[0]))[:2])),
        estimates,
    )


def _estimates(pipeline: Pipeline, wearer: SimulatedWearer, seconds: float) -> Iterator[Estimate]:
    for message in wearer.offline_inputs(seconds):
        yield from pipeline.step(message)


def _truth(wearer: SimulatedWearer, times_ns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return position and velocity of the true optical centre, angular rate, each (n, 3) in W, and R_WH (n, 3, 3)."""
    truth, X_BL = wearer.gait.at(times_ns.astype(np.int64)), wearer.unit.X_BL
    lever_W = truth.R_WB @ np.array(X_BL.p_m)
    w_W = np.einsum("nij,nj->ni", truth.R_WB, truth.w_WB_B_radps)
    axis_W = truth.R_WB @ np.array(X_BL.R) @ rectified_axis_L(wearer.unit.stereo)
    ahead = axis_W[:, :2] / np.linalg.norm(axis_W[:, :2], axis=1, keepdims=True)
    R_WH = np.zeros((len(ahead), 3, 3))
    R_WH[:, :2, 0], R_WH[:, 0, 1], R_WH[:, 1, 1], R_WH[:, 2, 2] = ahead, -ahead[:, 1], ahead[:, 0], 1.0
    return truth.p_WB_m + lever_W, truth.v_WB_mps + np.cross(w_W, lever_W), w_W, R_WH


def _integrated(velocities: FloatArray, times_ns: FloatArray) -> FloatArray:
    steps_s = 1e-9 * np.diff(times_ns)[:, np.newaxis]
    way: FloatArray = (0.5 * (velocities[1:] + velocities[:-1]) * steps_s).sum(axis=0)
    return way


def _chords_m(positions: FloatArray) -> float:
    """Return the horizontal length in the chords that the path is counted in."""
    chords_m, start = 0.0, positions[0, :2]
    for position in positions[:, :2]:
        chord_m = float(np.linalg.norm(position - start))
        if chord_m >= CHORD_M:
            chords_m, start = chords_m + chord_m, position
    return chords_m + float(np.linalg.norm(positions[-1, :2] - start))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.motion", description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=["turns", "standing"])
    parser.add_argument("--seeds", default="1000-1001", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=45.0)
    parser.add_argument("--processes", type=int, choices=(1, 2), default=1)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    seeds = range(first, last + 1)
    with Pool(options.processes) as pool:
        for name in options.scenarios:
            found = pool.imap(partial(followed, name=name, seconds=options.seconds), seeds)
            for seed, unit in zip(seeds, found, strict=True):
                inside = np.abs(unit.errors) < NORMAL_95 * unit.deviations
                way_error_m = unit.way_m - unit.true_way_m
                print(
                    f"{name} {seed}: valid {len(unit.errors) / unit.estimates:.1%}, "
                    f"velocity RMS {1e3 * rms(unit.errors[:, :3]):.1f} mm/s (95 %: {inside[:, :3].mean():.1%}), "
                    f"rate {np.degrees(rms(unit.errors[:, 3:])):.2f} °/s ({inside[:, 3:].mean():.1%}), "
                    f"way {unit.true_way_m:.2f} m {way_error_m:+.3f} m ({way_error_m / unit.way_std_m:+.1f} σ), "
                    f"end off by {unit.end_error_m:.3f} m",
                    flush=True,
                )


if __name__ == "__main__":
    main()
