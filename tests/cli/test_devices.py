"""Which driver the configuration and the calibration call for together."""

import msgspec
import pytest

from cli.devices import camera_opener
from daemon.config import CameraSettings
from drivers.protocols import DeviceError
from messages import UnitCalibration
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.unit import draw_unit

STEREO = draw_unit(1).exact_calibration()
DEPTH = draw_depth_unit(1, perfect_calibration=True)[1]
FIXED = {"exposure_s": 0.004, "gain_percent": 10.0}
PAIR = {"left": "/dev/no-left", "right": "/dev/no-right"}


@pytest.mark.parametrize(
    ("calibration", "settings", "line"),
    [
        (STEREO, {}, "^/dev/no-camera: no such device"),
        (DEPTH, {}, "^/dev/no-camera: no such device"),
        (STEREO, FIXED, "^/dev/no-camera: no such device"),
        (STEREO, PAIR, "^left camera /dev/no-left: no such device"),
        (DEPTH, PAIR, "^camera: the calibration is a depth camera's, which has no left, right or exposure_s$"),
        (DEPTH, FIXED, "^camera: the calibration is a depth camera's, which has no left, right or exposure_s$"),
    ],
)
def test_a_camera_that_is_not_there_is_told_by_the_driver_that_is_called_for(
    calibration: UnitCalibration, settings: dict[str, object], line: str
) -> None:
    config = msgspec.convert({"device": "/dev/no-camera"} | settings, CameraSettings)
    with pytest.raises(DeviceError, match=line):
        camera_opener(config, calibration)()
