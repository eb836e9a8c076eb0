"""Hardware as the configuration names it, behind the protocols of `drivers.protocols`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from daemon.config import CameraSettings, ImuSettings
from daemon.replaceable_camera import OpenCamera
from drivers.camera.depth import V4l2DepthCamera
from drivers.camera.pair import V4l2CameraPair
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.zed import ZedCamera
from drivers.imu.data_ready import GpiodDataReady, parse_data_ready
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.register_access import open_i2c
from drivers.imu.settings import Mpu6050Settings
from drivers.protocols import DeviceError, FrameSource
from messages import DepthUnitCalibration, UnitCalibration

POOL_FRAMES = 16
"""One being filled, one waiting, one in the pipeline, eight in the recorder's queue, and some to spare."""


@contextmanager
def next_step_named() -> Iterator[None]:
    """Add to what is told of a device that cannot be opened what a person does next."""
    try:
        yield
    except DeviceError as error:
        raise DeviceError(f"{error}; `gaiteyes check` looks at each device and says what to do") from error


def build_imu(config: ImuSettings) -> Mpu6050:
    """Return the driver of the IMU that is configured, not yet opened."""
    line = partial(GpiodDataReady, *parse_data_ready(config.data_ready)) if config.data_ready else None
    return Mpu6050(
        partial(open_i2c, config.bus), address=config.address, settings=Mpu6050Settings(), open_data_ready=line
    )


def camera_opener(config: CameraSettings, calibration: UnitCalibration) -> OpenCamera:
    """Return what opens the camera that is configured, of the calibration's kind and size.

    It raises DeviceError if the camera is not there or is another one, or if it is not one for the calibration.
    """

    def open_camera() -> FrameSource:
        camera = calibration.camera
        return _camera_kind(config, calibration)(
            width_px=camera.lens.width_px,
            height_px=camera.lens.height_px,
            pool_frames=POOL_FRAMES,
            stamp_to_mid_exposure_s=camera.stamp_to_mid_exposure_s,
            rate_hz=config.rate_hz,
        )

    return open_camera


def _camera_kind(config: CameraSettings, calibration: UnitCalibration) -> Callable[..., FrameSource]:
    left, right, exposure_s, gain_percent = config.left, config.right, config.exposure_s, config.gain_percent
    if isinstance(calibration, DepthUnitCalibration):
        if left is not None or exposure_s is not None:
            raise DeviceError("camera: the calibration is a depth camera's, which has no left, right or exposure_s")
        return partial(V4l2DepthCamera, config.device)
    if left is not None and right is not None:
        return partial(V4l2CameraPair, left, right, max_skew_s=config.max_skew_s)
    if exposure_s is not None and gain_percent is not None:
        return partial(ZedCamera, config.device, exposure_s=exposure_s, gain_percent=gain_percent)
    return partial(V4l2StereoCamera, config.device)
