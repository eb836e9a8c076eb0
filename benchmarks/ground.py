"""The ground plane against its peers, on the same frames of the rig, with the true attitude: error and time a frame.

    python -m benchmarks.ground

- this project: the foothold region alone, three-way matching at half size, robust fit in disparity space; at full
  size as well, as `matching_width_px` sets for a recording;
- the thesis: semi-global matching of the whole frame at full size, least squares on z (its Eq. 8) over the region;
- consensus: the same matching, RANSAC on points (1 cm), then least squares; the usual recipe.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

from messages import StereoFrame
from messages.arrays import FloatArray
from messages.constants import MATCHING_WIDTH_PX
from perception.depth.rectify import Rectifier, Window
from perception.ground.foothold import FootholdSettings
from perception.ground.meter import GroundMeter
from perception.ground.plane import Plane
from perception.heading import heading
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

SEEDS = (101, 102, 103)
FRAMES = 40
EVERY = 12
REGION = FootholdSettings().region


class Scene(NamedTuple):
    """One frame with its true attitude and true plane."""

    frame: StereoFrame
    R_HC: FloatArray
    w_C_radps: FloatArray
    height_rate_mps: float
    true: Plane


Method = Callable[[Scene], Plane | None]


def scenes(seed: int) -> tuple[SimulatedWearer, list[Scene]]:
    """Return frames of a walk over level ground and ramps, those whose region spans an edge left out."""
    wearer = SimulatedWearer(seed, scenario("ramps"), 10_000_000_000, perfect_calibration=True)
    R_LC = Rectifier(wearer.calibration.stereo, 1).R_LC
    R_BC = np.array(wearer.calibration.X_BL.R) @ R_LC
    found = []
    for k in range(60, 60 + FRAMES * EVERY, EVERY):
        frame, truth = next(iter(wearer.frames(1, first=k)))
        motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
        R_WC = motion.R_WB[0] @ R_BC
        R_WH = heading(R_WC)
        if truth.transition or R_WH is None:
            continue
        gradient = (float(np.tan(truth.slope_sagittal_rad)), float(np.tan(truth.slope_frontal_rad)))
        true = Plane(gradient, truth.height_m)
        climb_mps = np.tan(truth.slope_sagittal_rad) * np.hypot(*motion.v_WB_mps[0, :2])
        height_rate_mps = float(motion.v_WB_mps[0, 2] - climb_mps)
        w_C_radps = R_BC.T @ motion.w_WB_B_radps[0]
        found.append(Scene(frame, R_WH.T @ R_WC, w_C_radps, height_rate_mps, true))
    return wearer, found


def this_project(wearer: SimulatedWearer, matching_width_px: int) -> Method:
    """Return the daemon's own way, one frame at a time, without memory."""
    meter = GroundMeter(wearer.calibration.stereo, wearer.calibration.residual, matching_width_px)

    def measure(scene: Scene) -> Plane | None:
        images, rates = scene.frame.images, (scene.w_C_radps, scene.height_rate_mps)
        found = meter.measure(images, scene.R_HC, *rates, REGION, None)
        return found.fit.plane if found.fit is not None else None

    return measure


def whole_frame(wearer: SimulatedWearer, *, consensus: bool) -> Method:
    """Return the thesis's way, with or without consensus before the least squares."""
    rectifier = Rectifier(wearer.calibration.stereo, 1)
    whole = Window(0, rectifier.height_px, 0, rectifier.width_px)
    rays_C = rectifier.rays_C(whole)
    fB_px_m = rectifier.f_px * rectifier.baseline_m
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=112, blockSize=5, P1=200, P2=800, disp12MaxDiff=1, uniquenessRatio=10
    )

    def measure(scene: Scene) -> Plane | None:
        left, right = rectifier.rectify(scene.frame.left, scene.frame.right, whole, 0)
        disparity_px = matcher.compute(left, right).astype(np.float64) / 16.0
        seen = disparity_px > 0
        points_H = (rays_C[seen] * (fB_px_m / disparity_px[seen])[:, None]) @ scene.R_HC.T
        points_H = points_H[REGION.contains(points_H)]
        return least_squares(ransac(points_H) if consensus else points_H)

    return measure


def least_squares(points: FloatArray) -> Plane:
    """Return the plane of the thesis's Eq. (8) through points (N, 3)."""
    A = np.column_stack((points[:, :2], -np.ones(len(points))))
    (a, b, h), *_ = np.linalg.lstsq(A, points[:, 2], rcond=None)
    return Plane((float(a), float(b)), float(h))


def ransac(points: FloatArray, tries: int = 100, within_m: float = 0.01) -> FloatArray:
    """Return the points within `within_m` of the best of `tries` planes through three of them."""
    rng = np.random.default_rng(0)
    best = np.zeros(len(points), dtype=bool)
    for triple in rng.choice(len(points), (tries, 3)):
        p, q, r = points[triple]
        normal = np.cross(q - p, r - p)
        length = np.linalg.norm(normal)
        if length > 0.0:
            near = np.abs((points - p) @ (normal / length)) < within_m
            if np.count_nonzero(near) > np.count_nonzero(best):
                best = near
    return points[best]


def main() -> None:
    """Print error and time of each method; ratios are per frame, in the same run."""
    cv2.setNumThreads(1)
    errors: dict[str, list[FloatArray]] = {}
    times_ms: dict[str, list[float]] = {}
    for seed in SEEDS:
        wearer, frames = scenes(seed)
        methods = {
            "this project": this_project(wearer, MATCHING_WIDTH_PX),
            "the same, full size": this_project(wearer, wearer.calibration.stereo.left.width_px),
            "thesis, Eq. 8": whole_frame(wearer, consensus=False),
            "consensus": whole_frame(wearer, consensus=True),
        }
        for scene in frames:
            for name, measure in methods.items():
                start_s = time.perf_counter()
                plane = measure(scene)
                times_ms.setdefault(name, []).append(1e3 * (time.perf_counter() - start_s))
                if plane is not None:
                    errors.setdefault(name, []).append(plane.abh - scene.true.abh)
    print(
        f"{'method':14} {'frames':>6} {'sagittal':>9} {'frontal':>9} {'height':>9} {'p50':>8} {'p99':>8} {'ratio':>6}"
    )
    own_ms = np.array(times_ms["this project"])
    for name, spent in times_ms.items():
        rms = np.sqrt((np.array(errors[name]) ** 2).mean(axis=0))
        p50, p99 = np.percentile(spent, (50, 99))
        print(
            f"{name:14} {len(errors[name]):6d} {np.degrees(rms[0]):8.3f}° {np.degrees(rms[1]):8.3f}° "
            f"{1e3 * rms[2]:6.1f} mm {p50:5.1f} ms {p99:5.1f} ms {np.median(np.array(spent) / own_ms):6.1f}"
        )


if __name__ == "__main__":
    main()
