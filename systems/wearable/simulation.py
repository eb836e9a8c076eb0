"""What a wearable unit should measure above known ground, bound to one recording.

Channels: the disparity map as its coefficients on ten orthonormal polynomials of the picture (so that what is common to
all patches, like an error of the reference, stays in few of them), how strongly disparity locks to whole pixels, how
blurred the picture is, and the tilt by gyroscope and by gravity.
"""

import math
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from discrepancy.simulation import Channels, Effect, Parameter, Values
from discrepancy.values import predicted
from messages import Calibration, FrameHeader
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.errors import UserError
from perception.depth.stereo_camera import StereoCamera
from perception.ground.foothold import FootholdSettings
from systems.wearable import tilt, view
from systems.wearable.blur import Steepness
from systems.wearable.effects import library
from systems.wearable.ground_path import GRID_S, Attitude, GroundPath, Smooth
from systems.wearable.own_attitude import own_attitude
from systems.wearable.pictures import COLUMNS, LAGS_PX, PATCHES, ROWS, FrameNumbers, Layout, measure
from systems.wearable.recording import (
    LEAST_FRAMES,
    WearableFiles,
    read_files,
    read_frames,
    read_samples,
    with_calibration,
)

SYSTEM = "wearable"
_POLYNOMIALS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
_DISPARITY = ("mean", "x", "y", "xx", "xy", "yy", "xxx", "xxy", "xyy", "yyy")
_LEAST_PATCHES = 16
"""That a frame needs for its ten polynomials: two thirds of all."""
_DISPARITY_NOISE_PX = (0.022, 0.007, 0.015, 0.0065, 0.007, 0.007, 0.004, 0.004, 0.004, 0.006)
_LOCKING_NOISE_PX, _STEEPENING_NOISE_OCTAVES = 0.019, 0.05
_TILT_NOISE_RAD = (1e-4, 1e-4, 1.4e-3, 1.4e-3)
"""What the rig's sound recordings leave, RMS, in the loudest of them: a constant beyond it is an error, not noise."""
_LOCKING_PX = 0.165
"""How much this matcher's disparities crowd about whole pixels by themselves; measured likewise."""
_OFFSET_PX, _OFFSET_PER_OCTAVE_PX, _OCTAVES = -0.038, 0.013, 3.7
"""What semi-global matching does on the rig's own, perfect pictures: it draws to whole pixels and rounds down, by so
much where the contrast is 2^3.7 grey levels, less where it is stronger."""
_LOCKING_SEEN = 0.29
"""The share of a locking in the pictures that the matcher's smoothing over its window leaves; measured likewise."""
_MOST_SWING_SHARE = 0.45
"""Of the grid's rate: the mount's resonance at most, as the bilinear rule bends frequencies near half the rate."""


def load(folder: Path) -> "WearableSimulation":
    """Return the simulation of the recording in `folder`; raises UserError with one line."""
    return WearableSimulation(read_files(folder))


def misfit(folder: Path, calibration: Calibration) -> float:
    """Return what a unit of this calibration, without any effect, misses of a recording.

    It is the root mean square over all channels, in units of their noise. Raises UserError with one line.
    """
    simulation = WearableSimulation(with_calibration(read_files(folder), calibration))
    channels = simulation.channels
    noise = 1.0 if channels.noise_std is None else channels.noise_std
    off: FloatArray = (channels.values - predicted(simulation, {})) / noise
    return float(np.sqrt(np.nanmean(off**2)))


class WearableSimulation:
    """A Simulation of the files of one recording; the pictures are looked at once, here."""

    system = SYSTEM

    def __init__(self, files: WearableFiles) -> None:
        calibration = files.calibration
        samples = read_samples(files)
        self._camera = camera = StereoCamera(calibration.stereo)
        self._rectifier = camera.rectifier
        self._lenses = (calibration.stereo.left, calibration.stereo.right)
        self._readout_s = calibration.stereo.row_time_s * calibration.stereo.left.height_px
        position = None
        if files.reference is not None:
            attitude = Attitude.of(files.reference.t_s, files.reference.values[:, :4])
            position = Smooth(files.reference.t_s, files.reference.values[:, 4:])
        else:
            attitude = own_attitude(samples, calibration)
        self._path = GroundPath(calibration, camera, files.ground, attitude)
        mean_theta = np.nanmean(self._path.theta(self._path.grid_s), axis=0)
        self._layout = Layout.of(camera, calibration.stereo, mean_theta)
        numbers = measure(read_frames(files), self._rectifier, self._layout, self._path)
        if len(numbers.headers) < LEAST_FRAMES:
            raise UserError(f"{files.mcap}: holds {len(numbers.headers)} frames; expected at least {LEAST_FRAMES}")
        self._place, self._count = _places(numbers.headers)
        self._stamp_s = np.array([header.t_exposure_ns for header in numbers.headers]) * 1e-9
        exposure_s = np.array([header.exposure_s for header in numbers.headers])
        self._exposure_s = exposure_s
        self._scene = view.scene_of(
            self._path, self._layout, self._rectifier, calibration, self._stamp_s, position, np.nan_to_num(numbers.lean)
        )
        self._theta = self._path.theta(self._stamp_s[:, None] + self._layout.centre_time_s)
        self._late = view.right_rows_late(self._scene, self._layout, 1.0)
        self._steepness = Steepness(LAGS_PX, numbers.difference)
        self._contrast = numbers.contrast
        self._matcher_px = _OFFSET_PX + _OFFSET_PER_OCTAVE_PX * (numbers.contrast - _OCTAVES)
        self._ground_px = np.where(np.isfinite(self._scene.disparity_px), self._scene.disparity_px, 0.0)
        self._level_px = self._ground_px.mean(axis=1, keepdims=True)
        self._operator = _operators(np.isfinite(numbers.misfit_px))
        sensed = tilt.Sensed.of(samples, calibration)
        grid_s = self._path.grid_s
        w_B = np.stack([np.interp(grid_s, sensed.t_s, axis) for axis in sensed.w_B.T], axis=-1)
        self._gyro_C = w_B @ self._path.R_BC  # the sensor's own: a reference's noise, differentiated, would show
        self._tilt = None
        R_WC = attitude.R_WB(self._stamp_s) @ self._path.R_BC
        if position is not None:
            self._tilt = tilt.Tilt(sensed, attitude, position, R_WC, self._stamp_s)
        self._ahead_m = FootholdSettings().ahead_m
        self._effects = library(self._tilt is not None)
        self.channels = self._measured(numbers)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return what the base model leaves open: how late IMU samples are dated, and by how much that grows."""
        late = Parameter("imu_late_s", "s", 0.0, -5e-3, 5e-3, 1e-4)
        drift = Parameter("imu_drift", "1", 0.0, -2e-3, 2e-3, 5e-5)
        return () if self._tilt is None else (late, drift)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return the library."""
        return self._effects

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (n, c)."""
        disparity = self._disparity(values) + self._matcher_px
        disparity = np.where(np.isfinite(disparity), disparity, 0.0)
        columns = [self._coefficients(disparity - self._ground_px)]
        locking = np.full(len(self._stamp_s), _LOCKING_PX + _LOCKING_SEEN * values["pixel_locking.amplitude_px"])
        exposed_s = self._exposure_s + values["motion_blur.exposure_s"]
        steepness = view.smeared(self._scene, exposed_s, self._steepness)
        columns.append(self._level_px + np.stack((locking, _change(steepness)), axis=-1))
        if self._tilt is not None:
            since_s = self._stamp_s - self._stamp_s.mean()
            late_s = values["imu_late_s"] + values["imu_drift"] * since_s
            columns.append(self._tilted(self._tilt, values) + late_s[:, None] * self._tilt.of_lateness)
        return self._uniform(np.concatenate(columns, axis=1))

    def _disparity(self, values: Values) -> FloatArray:
        """Return (n, p) disparities at the patches' centres, without what the matcher does by itself."""
        scene, layout, f_px = self._scene, self._layout, self._rectifier.f_px
        untold_s = values["rolling_shutter.readout_s"]
        stamp_error_s = values["time_offset.value_s"] + values["exposure_change.share"] * (
            self._exposure_s - self._exposure_s.mean()
        )
        t_s = self._stamp_s[:, None] - stamp_error_s[:, None] + layout.centre_time_s + untold_s * layout.row
        still = untold_s == 0.0 and not stamp_error_s.any()
        theta = self._theta if still else self._path.theta(t_s)
        turn_C = np.array([values["extrinsic_rotation.x_rad"], 0.0, values["extrinsic_rotation.z_rad"]])
        hz = values["soft_mount.hz"]
        if math.isfinite(hz):
            swing = self._swing_C(hz, values["soft_mount.zeta"])
            at = [np.interp(t_s, self._path.grid_s, swing[:, axis]) for axis in range(3)]
            theta = view.turned(theta, np.stack(at, axis=-1))
        if turn_C.any():
            theta = view.turned(theta, turn_C)
        d: FloatArray = np.einsum("npi,pi->np", theta, layout.centre_C) * (1.0 + values["baseline_error.share"])
        d = d + (self._readout_s + untold_s) * self._late
        if (y_rad := values["toe_in.y_rad"]) != 0.0:
            d = d + view.toed_in(scene, layout, f_px, y_rad)
        for amount, swelling in (
            (values["focal_error.share"], view.longer_focus),
            (values["distortion_residual.k1"], view.more_distortion),
        ):
            if amount != 0.0:
                d = d + view.swollen(scene, layout, theta, self._rectifier, self._lenses, swelling(amount))
        along, across = values["ground_not_flat.sagittal_per_m"], values["ground_not_flat.frontal_per_m"]
        if along != 0.0 or across != 0.0:
            d = d + view.bent_ground(scene, self._ahead_m, along, across)
        if (per_octave_px := values["texture_bias.per_octave_px"]) != 0.0:
            d = d + per_octave_px * (self._contrast - values["texture_bias.at_octaves"])
        return d

    def _coefficients(self, beside_px: FloatArray) -> FloatArray:
        """Return (n, q): the ground's mean disparity plus each polynomial's share of `beside_px` (n, p).

        So every channel varies as the walk does, and its relative error means something.
        """
        total: FloatArray = self._level_px + np.einsum("nqp,np->nq", self._operator, beside_px)
        return total

    def _swing_C(self, hz: float, zeta: float) -> FloatArray:
        """Return (grid, 3): how the camera turns in its mount, δ̈ + 2ζω₀ δ̇ + ω₀² δ = −α, by the bilinear rule."""
        omega = 2.0 * math.pi * min(hz, _MOST_SWING_SHARE / GRID_S)
        k = omega / math.tan(0.5 * omega * GRID_S)
        a = np.array([k * k + 2 * zeta * omega * k + omega**2, 2 * (omega**2 - k * k), 0.0])
        a[2] = k * k - 2 * zeta * omega * k + omega**2
        rate = np.where(np.isfinite(self._gyro_C), self._gyro_C, 0.0)
        swing: FloatArray = lfilter(np.array([-k, 0.0, k]) / a[0], a / a[0], rate - rate[0], axis=0)
        return swing

    def _tilted(self, tilted: tilt.Tilt, values: Values) -> FloatArray:
        total = tilted.reference
        for bias, axis in (("acc_x_mps2", 0), ("acc_y_mps2", 1)):
            if (value := values[f"imu_bias.{bias}"]) != 0.0:
                total = total + value * tilted.of_acc_bias[axis]
        for bias, axis in (("gyro_x_radps", 0), ("gyro_y_radps", 1)):
            if (value := values[f"imu_bias.{bias}"]) != 0.0:
                total = total + value * tilted.of_gyro_bias[axis]
        ahead, left = values["acceleration_disturbance.ahead_mps2"], values["acceleration_disturbance.left_mps2"]
        if ahead != 0.0 or left != 0.0:
            total = total + tilted.of_acceleration(ahead, left, values["acceleration_disturbance.from_s"])
        return total

    def _measured(self, numbers: FrameNumbers) -> Channels:
        misfit = np.where(np.isfinite(numbers.misfit_px), numbers.misfit_px, 0.0)
        at_stamp, rate = self._path.theta(self._stamp_s), self._path.theta(self._stamp_s, 1)
        base = at_stamp @ self._layout.centre_C.T + self._layout.centre_time_s * (rate @ self._layout.centre_C.T)
        base = np.where(np.isfinite(base), base, 0.0)  # as `pictures` has it, which measured against that
        columns = [self._coefficients(base + misfit - self._ground_px)]
        columns.append(self._level_px + np.stack((numbers.locking_px, _change(numbers.sharpness)), axis=-1))
        names = [f"disparity_{name}_px" for name in _DISPARITY] + ["locking_px", "steepening_octaves"]
        if self._tilt is not None:
            columns.append(self._tilt.reference + self._tilt.error)
            names += tilt.CHANNELS
        picture_noise = (*_DISPARITY_NOISE_PX, _LOCKING_NOISE_PX, _STEEPENING_NOISE_OCTAVES)
        noise = (*picture_noise, *(() if self._tilt is None else _TILT_NOISE_RAD))
        w_C = np.stack([np.interp(self._stamp_s, self._path.grid_s, w) for w in self._gyro_C.T], axis=-1)
        rise = np.gradient(self._scene.height_m[:, 0], self._stamp_s)
        inputs = np.column_stack((w_C, rise, self._exposure_s))
        period_s = float(np.median(np.diff(self._stamp_s)))
        return Channels(
            noise_std=np.array(noise),
            t_s=period_s * np.arange(self._count, dtype=np.float64),
            values=self._uniform(np.concatenate(columns, axis=1)),
            names=tuple(names),
            inputs=np.nan_to_num(self._uniform(inputs)),
            input_names=("turn_x_radps", "turn_y_radps", "turn_z_radps", "rise_mps", "exposure_s"),
        )

    def _uniform(self, values: FloatArray) -> FloatArray:
        """Return rows (n, …) on the uniform grid of frames, NaN where one is missing."""
        if self._count == len(self._stamp_s):
            return values
        spread = np.full((self._count, values.shape[1]), np.nan)
        spread[self._place] = values
        return spread


def _places(headers: tuple[FrameHeader, ...]) -> tuple[IntArray, int]:
    """Return where each frame stands on the uniform grid, and how many places that has."""
    stamps = np.array([header.t_exposure_ns for header in headers], dtype=np.int64)
    period = float(np.median(np.diff(stamps)))
    steps = np.maximum(np.rint(np.diff(stamps) / period), 1.0)
    place = np.concatenate(([0], np.cumsum(steps))).astype(np.int64)
    return place, int(place[-1]) + 1


def _change(values: FloatArray) -> FloatArray:
    """Return (n,) the change since the frame before: what a texture is like by itself changes slowly."""
    return np.diff(values, prepend=np.nan)


def _operators(seen: BoolArray) -> FloatArray:
    """Return (n, q, p): from patches to coefficients, each the RMS in px of its term; NaN where patches are few."""
    y, x = np.meshgrid(np.linspace(-1, 1, ROWS), np.linspace(-1, 1, COLUMNS), indexing="ij")
    terms = np.stack([x.ravel() ** i * y.ravel() ** j for i, j in _POLYNOMIALS], axis=-1)
    basis = np.linalg.qr(terms)[0] * math.sqrt(PATCHES)
    basis *= np.sign(np.einsum("pq,pq->q", basis, terms))
    operators = np.full((len(seen), len(_POLYNOMIALS), PATCHES), np.nan)
    known: dict[bytes, FloatArray] = {}
    for k, row in enumerate(seen):
        if row.sum() < _LEAST_PATCHES:
            continue
        key = row.tobytes()
        if key not in known:
            known[key] = np.zeros((len(_POLYNOMIALS), PATCHES))
            known[key][:, row] = np.linalg.pinv(basis[row])
        operators[k] = known[key]
    return operators
