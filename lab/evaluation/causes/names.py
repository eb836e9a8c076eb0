"""The causes of an error, as the thesis names them."""

from typing import Final

IMU: Final = "IMU bias"
ORIENTATION: Final = "IMU orientation"
DEPTH: Final = "depth"
CAMERA: Final = "of it: pair's calibration"
EXTRINSIC: Final = "camera-IMU extrinsic"
SYNCHRONISATION: Final = "synchronisation"
BLUR: Final = "motion blur"
