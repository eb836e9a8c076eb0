"""What the discrepancy finder has found wrong of a unit, taken over into its calibration.

Every effect of `explain wearable` says by what the unit differs from its calibration; here stands what that makes of
the calibration's own values. Signs: what is true minus what is calibrated, in the rectified camera C; `time_offset` is
stamp minus true.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from calib.pair import lengthened, toed_in
from calib.strict_yaml import CalibrationError
from messages import Calibration, Lens, matrix3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.depth.rectify import Rectifier

Values = Mapping[str, float]
_AXES = "xyz"


class Change(NamedTuple):
    """What one effect has changed, for a person."""

    effect: str
    what: str
    by: str


@dataclass(frozen=True)
class Applied:
    """The new calibration, what has changed, and which effects were left, by name, with the reason."""

    calibration: Calibration
    changes: tuple[Change, ...]
    left: dict[str, str]


def applied(known: Calibration, effects: Mapping[str, Mapping[str, tuple[float, str]]], where: str) -> Applied:
    """Return `known` with the `effects` (value and unit of each parameter) taken over.

    Raises CalibrationError, its line beginning with `where`, where none of them is a calibration's.
    """
    made, changes, left = known, list[Change](), dict[str, str]()
    for name, parameters in effects.items():
        change = _CHANGES.get(name)
        if change is None:
            left[name] = "no value of the calibration; see what the explanation advises"
            continue
        made = change(made, {key: value for key, (value, _) in parameters.items()})
        by = ", ".join(f"{key} {value:+.4g} {unit}".removesuffix(" 1") for key, (value, unit) in parameters.items())
        changes.append(Change(name, _WHAT[name], by))
    if not changes:
        told = ", ".join(effects) or "none"
        raise CalibrationError(f"{where}: effects {told}; allowed at least one of {', '.join(_CHANGES)}")
    return Applied(made, tuple(changes), left)


def _extrinsic_rotation(known: Calibration, values: Values) -> Calibration:
    """A turn δ of C in itself: R_BC ← R_BC exp(δ), so R_BL ← R_BC exp(δ) R_BCᵀ R_BL."""
    R_BL = np.array(known.X_BL.R)
    R_BC = R_BL @ Rectifier(known.stereo, 4).R_LC
    turn_C = np.array((values.get("x_rad", 0.0), 0.0, values.get("z_rad", 0.0)))
    turned = R_BC @ so3.exp(turn_C) @ R_BC.T @ R_BL
    return msgspec.structs.replace(known, X_BL=msgspec.structs.replace(known.X_BL, R=matrix3(turned)))


def _time_offset(known: Calibration, values: Values) -> Calibration:
    stamp_s = known.stereo.stamp_to_mid_exposure_s - values["value_s"]
    return _with_stereo(known, stamp_to_mid_exposure_s=stamp_s)


def _baseline_error(known: Calibration, values: Values) -> Calibration:
    return lengthened(known, 1.0 + values["share"])


def _focal_error(known: Calibration, values: Values) -> Calibration:
    by = 1.0 + values["share"]
    return _with_lenses(known, lambda lens: {"fx_px": by * lens.fx_px, "fy_px": by * lens.fy_px})


def _toe_in(known: Calibration, values: Values) -> Calibration:
    return toed_in(known, values["y_rad"])


def _distortion_residual(known: Calibration, values: Values) -> Calibration:
    return _with_lenses(known, lambda lens: {"distortion": (lens.distortion[0] + values["k1"], *lens.distortion[1:])})


def _rolling_shutter(known: Calibration, values: Values) -> Calibration:
    longer_s = values["readout_s"] / known.stereo.left.height_px
    return _with_stereo(known, row_time_s=max(0.0, known.stereo.row_time_s + longer_s))


def _imu_bias(known: Calibration, values: Values) -> Calibration:
    """What is left after the matrices: the biases in the chip's units grow by S⁻¹ a and W⁻¹ b."""
    sf, w = (np.array([values.get(f"{kind}_{axis}_{unit}", 0.0) for axis in _AXES]) for kind, unit in _BIASES)
    return _with_biases(known, sf, w)


_BIASES = (("acc", "mps2"), ("gyro", "radps"))


def _with_biases(known: Calibration, sf: FloatArray, w: FloatArray) -> Calibration:
    imu = known.imu
    sf_bias = np.array(imu.sf_bias_mps2) + np.linalg.solve(np.array(imu.sf_matrix), sf)
    w_bias = np.array(imu.w_bias_radps) + np.linalg.solve(np.array(imu.w_matrix), w)
    return msgspec.structs.replace(
        known, imu=msgspec.structs.replace(imu, sf_bias_mps2=vec3(sf_bias), w_bias_radps=vec3(w_bias))
    )


def _with_stereo(known: Calibration, **fields: object) -> Calibration:
    return msgspec.structs.replace(known, stereo=msgspec.structs.replace(known.stereo, **fields))


def _with_lenses(known: Calibration, fields: Callable[[Lens], dict[str, object]]) -> Calibration:
    left, right = known.stereo.left, known.stereo.right
    return _with_stereo(
        known,
        left=msgspec.structs.replace(left, **fields(left)),
        right=msgspec.structs.replace(right, **fields(right)),
    )


_CHANGES: dict[str, Callable[[Calibration, Values], Calibration]] = {
    "extrinsic_rotation": _extrinsic_rotation,
    "time_offset": _time_offset,
    "baseline_error": _baseline_error,
    "focal_error": _focal_error,
    "toe_in": _toe_in,
    "distortion_residual": _distortion_residual,
    "rolling_shutter": _rolling_shutter,
    "imu_bias": _imu_bias,
}
_WHAT = {
    "extrinsic_rotation": "the camera's angles in the IMU's axes",
    "time_offset": "time stamp to mid-exposure",
    "baseline_error": "baseline",
    "focal_error": "focal lengths of both eyes",
    "toe_in": "the right eye's angle against the left's",
    "distortion_residual": "k1 of both eyes",
    "rolling_shutter": "row time",
    "imu_bias": "biases of accelerometer and gyroscope",
}
