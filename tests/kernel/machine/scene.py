"""What the wearer's cameras see, rendered on the host: in the machine that would take a minute."""

from pathlib import Path

import cv2
import numpy as np

from messages.arrays import GreyImage
from sim_rig import unit
from sim_rig.camera import renderer, textures
from sim_rig.walk import gait, scenario, world
from sim_rig.wearer import SimulatedWearer
from tests.kernel.machine.host import cached, digest
from tests.kernel.shrunk import SEED, SHRINK


def scene_file() -> Path:
    """Return a NumPy file with one pair of pictures of a standing wearer, cached.

    `left`, `right`: (height_px, width_px) uint8; `sf_B_mps2`: (3,), what the IMU measures; `height_m`: the truth.
    """
    sources = (Path(str(module.__file__)) for module in (unit, renderer, textures, gait, scenario, world))
    return cached("scene.npz", digest(*sources, Path(__file__)), _make)


def _make(path: Path) -> None:
    wearer = SimulatedWearer(SEED, scenario.scenario("standing"), 10**12)
    frame, truth = next(iter(wearer.frames(1)))
    sf_B, _ = wearer.gait.imu(np.array([wearer.shutter.true_ns(0)]))
    with path.open("wb") as file:
        np.savez(file, left=_shrunk(frame.left), right=_shrunk(frame.right), sf_B_mps2=sf_B[0], height_m=truth.height_m)


def _shrunk(image: GreyImage) -> GreyImage:
    height_px, width_px = image.shape
    small = cv2.resize(image, (width_px // SHRINK, height_px // SHRINK), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)
