"""The linear effects of an IMU's library, of one set of values: matrices, and responses at bins of frequency.

Names of matrices and responses are those of systems.imu.simulation, (2) to (6) and (8).
"""

from dataclasses import dataclass

import numpy as np

from discrepancy.simulation import Values
from messages.arrays import ComplexArray, FloatArray
from perception import so3
from systems.imu.effects import AXES


@dataclass(frozen=True, eq=False)
class Chain:
    """What acts on readings of gyroscope and accelerometer (k, 6), bin by bin.

    `sharpened` (k, 1) undoes the reference's smoothing, `turned` (6, 6) is E on both, `mount` (k, 6) V behind ones, or
    None without one, `sensitivity` (6, 6) M, G and N, `filter` (k, 6) H with the delays τ and τf. What does nothing has
    one row.
    """

    sharpened: FloatArray
    turned: FloatArray
    mount: ComplexArray | None
    sensitivity: FloatArray
    filter: ComplexArray

    @staticmethod
    def of(values: Values, f_hz: FloatArray) -> "Chain":
        """Return the chain of `values` at the bins `f_hz` (k,)."""
        smoothed_hz = values["reference_smoothing.cut_off_hz"]
        mount_hz = vector(values, "vibration.{}_hz")
        mount: ComplexArray | None = None
        if np.isfinite(mount_hz).any():
            mount = np.ones((len(f_hz), 6), dtype=np.complex128)
            mount[:, 3:] = _vibration(f_hz, mount_hz, values["vibration.zeta"])
        sensitivity = np.zeros((6, 6))
        sensitivity[:3, :3] = _sensitivity(values, "gyro_scale", "gyro_misalignment")
        sensitivity[:3, 3:] = _square(values, "g_sensitivity")
        sensitivity[3:, 3:] = _sensitivity(values, "acc_scale", "acc_misalignment")
        return Chain(
            np.exp2(0.5 * (f_hz[:, None] / smoothed_hz) ** 2) if np.isfinite(smoothed_hz) else np.ones((1, 1)),
            _twice(so3.exp(vector(values, "frame_rotation.{}_rad"))),
            mount,
            sensitivity,
            _filter(values, f_hz),
        )

    def on_motion(self, readings: ComplexArray) -> ComplexArray:
        """Return ideal readings (k, 6) turned, shaken by the mount, and measured with the sensitivity."""
        turned: ComplexArray = readings @ self.turned.T
        found: ComplexArray = (turned if self.mount is None else turned * self.mount) @ self.sensitivity.T
        return found

    def off_motion(self, readings: ComplexArray) -> ComplexArray:
        """Return readings (k, 6) with all that undone."""
        measured: ComplexArray = readings @ np.linalg.inv(self.sensitivity).T
        found: ComplexArray = (measured if self.mount is None else measured / self.mount) @ self.turned
        return found

    @property
    def passed(self) -> FloatArray:
        """Return how much of the motion filter and mount pass, (k, 6) or (1, 6)."""
        return np.abs(self.filter) if self.mount is None else np.abs(self.filter * self.mount)


def vector(values: Values, form: str) -> FloatArray:
    """Return the parameters (3,) of the three axes."""
    return np.array([values[form.format(axis)] for axis in AXES])


def _twice(E: FloatArray) -> FloatArray:
    """Return the matrix (6, 6) that turns both sensors' readings by E (3, 3)."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = E
    return both


def _filter(values: Values, f_hz: FloatArray) -> ComplexArray:
    """Return the low pass with the constant delays at `f_hz`, (k, 6), or ones (1, 6)."""
    cut_off_hz = np.array((values["low_pass.gyro_hz"], values["low_pass.acc_hz"]))
    late_s = values["time_offset.value_s"] / (1.0 + values["clock_drift.rate"])
    late_each_s = np.array((late_s, late_s + values["time_offset.acc_s"]))
    response = np.ones((1, 2), dtype=np.complex128)
    if np.isfinite(cut_off_hz).any():
        response = _low_pass(f_hz, cut_off_hz, values["low_pass.zeta"])
    if late_each_s.any():
        response = response * np.exp(-2j * np.pi * f_hz[:, None] * late_each_s)
    return np.repeat(response, 3, axis=1)


def _vibration(f_hz: FloatArray, mount_hz: FloatArray, zeta: float) -> ComplexArray:
    """Return V of a mount's three axes at `f_hz`, (k, 3)."""
    s_over_w0 = 1j * f_hz[:, None] * (1.0 / mount_hz)
    damping = 2.0 * zeta * s_over_w0
    found: ComplexArray = (1.0 + damping) / (1.0 + damping + s_over_w0**2)
    return found


def _low_pass(f_hz: FloatArray, cut_off_hz: FloatArray, zeta: float) -> ComplexArray:
    """Return H of both sensors at `f_hz`, (k, 2): second order, −3 dB at the cut-offs (2,), whatever the damping."""
    lean = 2.0 * zeta**2 - 1.0
    w0_over_w3 = np.sqrt(lean + np.sqrt(lean**2 + 1.0))
    s_over_w0 = 1j * f_hz[:, None] * (1.0 / (cut_off_hz * w0_over_w3))
    found: ComplexArray = 1.0 / (1.0 + 2.0 * zeta * s_over_w0 + s_over_w0**2)
    return found


def _square(values: Values, effect: str) -> FloatArray:
    """Return the parameters xx, xy, … (3, 3): row reads, column acts."""
    return np.array([[values[f"{effect}.{row}{column}"] for column in AXES] for row in AXES])


def _sensitivity(values: Values, scale: str, misalignment: str) -> FloatArray:
    """Return the sensitivity (3, 3) of a sensor."""
    return np.array(
        [
            [
                1.0 + values[f"{scale}.{row}"] if row == column else values[f"{misalignment}.{row}{column}"]
                for column in AXES
            ]
            for row in AXES
        ]
    )
