"""Small folders in the EuRoC/ASL layout, made for the tests."""

import gzip
from pathlib import Path

import cv2
import numpy as np

T0_NS = 1_403_715_273_262_142_976
FRAME_NS = 50_000_000

CAMERA_YAML = """%YAML:1.0
# made for a test
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, 0.0, 1.0, 0.02,
         -1.0, 0.0, 0.0, {y_m},
         0.0, -1.0, 0.0, 0.01,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [{width_px}, {height_px}]
camera_model: pinhole
intrinsics: [{f_px}, {f_px}, {cx_px}, {cy_px}] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 1e-4, 1.76e-05]
"""


def image(seed: int, width_px: int, height_px: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    coarse = np.random.default_rng(seed).integers(0, 256, (5, 7), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (width_px, height_px), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def camera_yaml(width_px: int, height_px: int, y_m: float) -> str:
    return CAMERA_YAML.format(
        width_px=width_px, height_px=height_px, y_m=y_m, f_px=0.6 * width_px, cx_px=width_px / 2, cy_px=height_px / 2
    )


def imu_rows(count: int, period_ns: int = 5_000_000, start_ns: int = T0_NS) -> list[str]:
    return [f"{start_ns + k * period_ns},{k}.25,0.5,-0.125,9.5,1e-3,{k}" for k in range(count)]


def make_folder(
    root: Path,
    *,
    width_px: int = 60,
    height_px: int = 40,
    frames: int = 4,
    below_data: bool = False,
    imu_hz: int = 200,
    imu_lead_ns: int = 0,
    suffix: str = ".png",
) -> Path:
    """A folder with `frames` pairs 50 ms apart; the IMU runs from `imu_lead_ns` before them to 50 ms after them."""
    for number, camera in enumerate(("cam0", "cam1")):
        folder = root / camera / "data" if below_data else root / camera
        folder.mkdir(parents=True)
        for k in range(frames):
            name = folder / f"{T0_NS + k * FRAME_NS}{suffix}"
            assert cv2.imwrite(str(name), image(2 * k + number, width_px, height_px))
        text = camera_yaml(width_px, height_px, (0.06, -0.06)[number])
        (root / camera / "sensor.yaml" if below_data else root / f"{camera}_sensor.yaml").write_text(text)
    period_ns = 1_000_000_000 // imu_hz
    count = (frames * FRAME_NS + imu_lead_ns) // period_ns + 1
    rows = imu_rows(count, period_ns, T0_NS - imu_lead_ns)
    table = "\n".join(["#timestamp [ns],w x,y,z,a x,y,z", *rows])
    if below_data:
        (root / "imu0").mkdir()
        (root / "imu0" / "data.csv").write_text(table)
    else:
        (root / "imu0.csv.gz").write_bytes(gzip.compress(table.encode()))
    return root
