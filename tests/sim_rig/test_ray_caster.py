"""The second renderer shows each point of the ground where the lenses put it, in both eyes."""

import cv2
import numpy as np
import pytest

from messages import Lens, StereoFrame
from messages.arrays import FloatArray, GreyImage
from sim_rig.ray_caster import RayCaster
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

STEP_M, AT_M = 0.15, 0.9


def patterned() -> GreyImage:
    """Return a picture of soft spots, which change little within a pixel and much within a finger's breadth."""
    noise = np.random.default_rng(5).normal(size=(600, 900))
    spots = cv2.GaussianBlur(noise, (0, 0), 3.0)
    grey: GreyImage = np.clip(128.0 + 50.0 * spots / spots.std(), 0, 255).astype(np.uint8)
    return grey


def standing_before_a_step() -> SimulatedWearer:
    ground = WorldBuilder().level(AT_M, "concrete").step(STEP_M, "kerbstone").level(4.0, "paving")
    world = ground.step(-STEP_M, "kerbstone").level(3.0, "brick").build()
    walk = Scenario("step", "standing before a step", world, (Stand(5.0),))
    return SimulatedWearer(3, walk, 0, rolling_shutter=False)


def shown(picture: GreyImage, lens: Lens, points_E: FloatArray) -> FloatArray:
    """Return the grey levels at which points (n, 3) before a camera are shown; NaN for those beside the picture."""
    K = np.array([[lens.fx_px, 0.0, lens.cx_px], [0.0, lens.fy_px, lens.cy_px], [0.0, 0.0, 1.0]])
    pixels = cv2.projectPoints(points_E, np.zeros(3), np.zeros(3), K, np.array(lens.distortion))[0].reshape(-1, 2)
    maps = pixels.astype(np.float32)
    u, v = maps[None, :, 0], maps[None, :, 1]
    levels = cv2.remap(picture.astype(np.float32), u, v, cv2.INTER_LINEAR, borderValue=np.nan)
    return np.asarray(levels[0], dtype=np.float64)


def alike(wearer: SimulatedWearer, frame: StereoFrame, points_W: FloatArray) -> float:
    """Return how what both eyes show of points (n, 3) correlates."""
    motion = wearer.gait.at(np.array([wearer.shutter.true_ns(0)]))
    stereo, X_BL = wearer.unit.stereo, wearer.unit.X_BL
    points_L = ((points_W - motion.p_WB_m[0]) @ motion.R_WB[0] - np.array(X_BL.p_m)) @ np.array(X_BL.R)
    points_R = points_L @ np.array(stereo.X_RL.R).T + np.array(stereo.X_RL.p_m)
    both = np.stack((shown(frame.left, stereo.left, points_L), shown(frame.right, stereo.right, points_R)))
    seen = np.isfinite(both).all(axis=0)
    assert seen.sum() > 100
    return float(np.asarray(np.corrcoef(both[:, seen]))[0, 1])


@pytest.mark.parametrize(("from_m", "to_m", "height_m"), [(0.35, AT_M - 0.02, 0.0), (AT_M + 0.02, 1.8, STEP_M)])
def test_both_eyes_show_the_same_of_every_point(from_m: float, to_m: float, height_m: float) -> None:
    wearer = standing_before_a_step()
    ((frame, _),) = RayCaster(wearer, [patterned()], 1).frames(1)
    random = np.random.default_rng(1)
    across = random.uniform(from_m, to_m, 500), random.uniform(-0.4, 0.4, 500)
    assert alike(wearer, frame, np.column_stack((*across, np.full(500, height_m)))) > 0.95
    assert alike(wearer, frame, np.column_stack((*across, np.full(500, height_m + 0.05)))) < 0.9


def test_ground_that_is_not_flat_is_refused() -> None:
    for name in ("rough-ground", "polished-floor"):
        with pytest.raises(ValueError, match="more than flat ground"):
            RayCaster(SimulatedWearer(1, scenario(name), 0), [patterned()], 1)
