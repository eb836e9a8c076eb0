"""The wearable's library of effects: what may be wrong with cameras, IMU, mount and ground.

How far each formula is to be trusted was measured on the rig's development recordings, whose truth is known: matching
itself answers to most of these by a few per cent more or less than geometry says, and to texture by a third.
"""

import math

from discrepancy.simulation import Effect, Parameter

_ONSETS_S = (0.75, 1.5, 2.25, 3.0, 3.75)
"""After the first frame, where fits of an onset begin: every three quarters of a second of a recording of some five."""
_ONSET_START_MPS2 = 0.2
"""Where fits of a room's acceleration begin: that of a tram setting off gently."""
_MOUNT_STARTS_HZ, _MOUNT_ZETA = (4.0, 6.0, 9.0, 14.0), 0.2
"""Resonances of a mount where fits begin, a factor of 1.5 apart up to the frames' band, and the damping there."""
_EXPOSURE_STARTS_S = (0.003, 0.01, 0.025)
"""Exposures untold where fits begin: a factor of three apart, up to half a frame."""
_TEXTURE_STARTS_PX = (0.1, -0.1)
"""Per octave, where fits of a bias by texture begin: five scales to either side."""


def _free(name: str, unit: str, limit: float, scale: float, inexact: float) -> Parameter:
    return Parameter(name, unit, 0.0, -limit, limit, scale, inexact)


def library(with_reference: bool) -> tuple[Effect, ...]:
    """Return the effects; `with_reference` those too that only show against a reference of attitude."""
    return (*_IMU, *_CAMERA, *_PICTURE) if with_reference else (*_CAMERA, *_PICTURE)


_IMU = (
    Effect(
        "imu_bias",
        (
            _free("acc_x_mps2", "m/s²", 2.0, 0.01, 0.01),
            _free("acc_y_mps2", "m/s²", 2.0, 0.01, 0.01),
            _free("gyro_x_radps", "rad/s", 0.2, 3e-4, 0.01),
            _free("gyro_y_radps", "rad/s", 0.2, 3e-4, 0.01),
        ),
        "The IMU reads a constant too much on an axis, beyond what its calibration takes off.",
        "Calibrate the IMU again: six resting positions for the accelerometer, one minute at rest for the gyroscope.",
        "Rest in two positions, one turned by 180° about the vertical: a bias turns with the sensor, an acceleration "
        "of the room does not. (While the unit hangs at 45°, z shows like x: acc_x and gyro_x stand for both.)",
        choices=(("acc_x_mps2",), ("acc_y_mps2",), ("gyro_x_radps",), ("gyro_y_radps",)),
    ),
    Effect(
        "acceleration_disturbance",
        (
            _free("ahead_mps2", "m/s²", 5.0, 0.02, 0.01),
            _free("left_mps2", "m/s²", 5.0, 0.02, 0.01),
            Parameter("from_s", "s", 0.0, 0.0, 600.0, 0.05),
        ),
        "From some instant on the ground itself accelerates, as in a tram or a lift, and the vertical leans with it.",
        "Do not trust the accelerometer's vertical while a vehicle speeds up or brakes; let the gyroscope carry over.",
        "Record the vehicle's own acceleration, or repeat the walk on solid ground.",
        choices=(("ahead_mps2", "from_s"), ("left_mps2", "from_s")),
        starts=tuple(
            {"from_s": from_s, "ahead_mps2": _ONSET_START_MPS2, "left_mps2": _ONSET_START_MPS2} for from_s in _ONSETS_S
        ),
    ),
)

_CAMERA = (
    Effect(
        "extrinsic_rotation",
        (_free("x_rad", "rad", 0.2, 1e-3, 0.04), _free("z_rad", "rad", 0.2, 1e-3, 0.04)),
        "The cameras are turned against the IMU, in pitch (about C's x) or roll (about z), otherwise than calibrated.",
        "Calibrate the rotation between camera and IMU again.",
        "Stand still above level ground and turn on the spot: the slope that is seen turns with it. (A turn about "
        "C's y shows like one about z at 45° of pitch; z stands for both.)",
        choices=(("x_rad",), ("z_rad",), ("x_rad", "z_rad")),
    ),
    Effect(
        "time_offset",
        (_free("value_s", "s", 0.05, 2e-4, 0.03),),
        "The frames' stamps differ from mid-exposure by a constant: stamp minus true.",
        "Add it to the calibration's stamp_to_mid_exposure_s, with the other sign.",
        "Turn the unit fast by hand: the error grows with the rate and has its sign.",
    ),
    Effect(
        "baseline_error",
        (_free("share", "1", 0.2, 1.5e-3, 0.04),),
        "The distance between the cameras is larger than calibrated by this share: all disparities grow alike.",
        "Measure the baseline anew: calibrate with a board of known size.",
        "Look at ground from two known heights: a wrong baseline errs by the same share at both, a toe-in does not.",
    ),
    Effect(
        "focal_error",
        (_free("share", "1", 0.2, 3e-3, 0.04),),
        "Both focal lengths are longer than calibrated by this share: depth and the angle of every ray change.",
        "Calibrate the lenses again; keep them at the temperature of use.",
        "Look at a board of known size at a known distance, right in the middle and far out.",
    ),
    Effect(
        "toe_in",
        (_free("y_rad", "rad", 0.05, 2e-4, 0.03),),
        "The right camera is turned against the left about its y axis: disparities move by about f times the angle.",
        "Calibrate the pair again, with distant points.",
        "Look at something 20 m away: its disparity must vanish.",
    ),
    Effect(
        "distortion_residual",
        (_free("k1", "1", 0.2, 2e-3, 0.06),),
        "The lenses bend rays otherwise than calibrated: a plane is seen as a bowl.",
        "Calibrate the lenses again with the board in the corners of the picture.",
        "Look at a flat wall from several distances: the bowl stays in the picture, a bend of the ground does not.",
    ),
    Effect(
        "rolling_shutter",
        (_free("readout_s", "s", 0.02, 6e-4, 0.03),),
        "From the first row to the last the picture takes longer to read out than the calibration says.",
        "Put the row time into the calibration, or use a global shutter.",
        "Turn the unit fast: upper and lower rows lean opposite ways; a time offset leans all rows alike.",
    ),
    Effect(
        "soft_mount",
        (
            Parameter("hz", "Hz", math.inf, 2.0, 1e3, 0.2, 0.01),
            Parameter("zeta", "1", 0.2, 0.02, 1.5, 0.02),
        ),
        "The cameras swing against the IMU on a soft mount with this resonance.",
        "Stiffen the mount, or fix IMU and cameras to one rigid part.",
        "Tap the housing and look at the picture: it rings at the resonance.",
        choices=(("hz", "zeta"),),
        starts=tuple({"hz": hz, "zeta": _MOUNT_ZETA} for hz in _MOUNT_STARTS_HZ),
    ),
)

_PICTURE = (
    Effect(
        "motion_blur",
        (Parameter("exposure_s", "s", 0.0, 0.0, 0.1, 1.4e-3, 0.1),),
        "The picture is exposed for longer than its header says, and smears along its motion.",
        "Shorten the exposure and add light or gain; read the true exposure from the camera.",
        "Stand still: a blur of motion goes, one of the lens stays.",
        starts=tuple({"exposure_s": exposure_s} for exposure_s in _EXPOSURE_STARTS_S),
    ),
    Effect(
        "pixel_locking",
        (Parameter("amplitude_px", "px", 0.0, 0.0, 0.5, 0.01, 0.2),),
        "Disparities are drawn to whole pixels more than this matcher does by itself: the pictures come resampled.",
        "Take the camera's raw picture, without its own rectification or scaling.",
        "Compare raw pictures with those of the maker's software on the same ground.",
    ),
    Effect(
        "exposure_change",
        (_free("share", "1", 3.0, 0.02, 0.04),),
        "The stamp moves against mid-exposure by this share of each change of exposure time: ½ where it marks the end.",
        "Fix the exposure, or add half of it to the stamp's offset frame by frame.",
        "Walk from light into shade with the exposure fixed, and again with it automatic.",
    ),
    Effect(
        "texture_bias",
        (_free("per_octave_px", "px", 0.5, 0.02, 0.3), Parameter("at_octaves", "1", 3.7, 1.0, 7.0, 0.2)),
        "Disparity depends on how strong the ground's texture is: by this much for each doubling of contrast, counted "
        "from 2 to the power of `at_octaves` grey levels.",
        "Look for gloss and for glass before one eye; compare matchers; trust rich texture more.",
        "Lay a printed sheet, half strong and half faint, on the same ground.",
        starts=tuple({"per_octave_px": bias_px} for bias_px in _TEXTURE_STARTS_PX),
    ),
    Effect(
        "ground_not_flat",
        (_free("sagittal_per_m", "1/m", 1.0, 3e-3, 0.07), _free("frontal_per_m", "1/m", 1.0, 4e-3, 0.07)),
        "The ground bends up from the plane that was measured, along the walk or across it.",
        "Measure the ground where the foot lands, or as more than one plane.",
        "Walk the same way over a floor known to be flat.",
        choices=(("sagittal_per_m",), ("frontal_per_m",)),
    ),
)
