"""The configuration that fits what is plugged into this machine, and what its calibration begins with."""

from calib.nominal import (
    NOMINAL_LENS_RESIDUAL,
    NominalOptics,
    nominal_lens,
    nominal_stereo,
    uncalibrated_depth_unit,
    uncalibrated_unit,
)
from calib.zed_conf import with_zed_shutter
from daemon.config import CameraSettings, Configuration, ImuSettings
from drivers.can.settings import CanSettings
from drivers.discovery.cameras import CameraKind, FoundCamera
from drivers.discovery.devices import FoundDevices
from messages import UnitCalibration


def proposed(found: FoundDevices) -> Configuration:
    """Return the configuration with the first device of each kind that was found, and the defaults for the others."""
    imu, camera, can = found.imu, found.camera, found.can
    return Configuration(
        imu=ImuSettings() if imu is None else ImuSettings(bus=imu.bus, address=imu.address),
        camera=CameraSettings() if camera is None else CameraSettings(device=camera.path),
        can=CanSettings() if can is None else CanSettings(interface=can.interface, channel=can.channel),
    )


def nominal_calibration(camera: FoundCamera, optics: NominalOptics, unit: str) -> UnitCalibration:
    """Return the calibration of a unit of which nothing but its drawings and its camera's data sheet is known.

    A `camera` that is one of two stands for both. A ZED, told by its name, has the shutter and the stamps of one.
    """
    lens = nominal_lens(camera.width_px, camera.height_px, optics.view_rad)
    if camera.kind is CameraKind.DEPTH:
        return uncalibrated_depth_unit(unit, lens, optics.baseline_m)
    pair = nominal_stereo(lens, optics.baseline_m)
    if camera.card.startswith("ZED"):
        pair = with_zed_shutter(pair)
    return uncalibrated_unit(unit, pair, NOMINAL_LENS_RESIDUAL)
