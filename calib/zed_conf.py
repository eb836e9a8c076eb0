"""The factory calibration of a StereoLabs ZED, SNxxxxxxxx.conf, as a StereoCalibration.

An INI file; the case of sections and keys varies. Lengths are millimetres, angles radians:

    [LEFT_CAM_HD], [RIGHT_CAM_HD]   fx fy cx cy, k1 k2 p1 p2 k3; newer files also k4 k5 k6, or all in [LEFT_DISTO]
    [STEREO]                        Baseline, TY, TZ (or TY_HD, TZ_HD), RX_HD, CV_HD, RZ_HD

Of the pair the maker's own writer says what the numbers are (zed-opencv-calibration, `saveCalibZED`): with OpenCV's
stereoCalibrate, which takes points from the left to the right camera, x_R = R x_L + T,

    Baseline = -T_x,  TY = T_y,  TZ = T_z,  (RX, CV, RZ) = the rotation vector of R,

hence X_RL has R = Rodrigues(RX, CV, RZ) and p = (-Baseline, TY, TZ).
"""

import configparser
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from calib.nominal import NOMINAL_RESIDUAL
from calib.strict_yaml import CalibrationError
from messages import Calibration, Lens, Pose, StereoCalibration, matrix3
from messages.text_files import read_text
from perception import so3


class ZedMode(NamedTuple):
    """A resolution: the size of one eye, px, and the fastest rate of its images."""

    width_px: int
    height_px: int
    fastest_hz: float


ZED_MODES = {
    "2K": ZedMode(2208, 1242, 15.0),
    "FHD": ZedMode(1920, 1080, 30.0),
    "HD": ZedMode(1280, 720, 60.0),
    "VGA": ZedMode(672, 376, 100.0),
}

STAMP_TO_MID_EXPOSURE_S = -0.02
"""Unchecked: images reach the host 30 to 45 ms after mid-exposure, of which their transfer takes 17 ms at 60 Hz."""

_BASELINE_MM = (20.0, 500.0)
_OFFSET_MM = 20.0
_ANGLE_RAD = 0.2
_TERM = 10.0

_Section = Mapping[str, str]


class _Conf:
    """The numbers of one file, by section and key in any case."""

    def __init__(self, text: str, where: str) -> None:
        self.where = where
        parser = configparser.ConfigParser(interpolation=None, default_section="")
        try:
            parser.read_string(text.removeprefix("\ufeff"), source=where)
        except configparser.Error as error:
            raise CalibrationError(f"{where}: no .conf file of a ZED: {' '.join(error.message.split())}") from error
        self._sections: dict[str, _Section] = {name.upper(): parser[name] for name in parser.sections()}

    def has(self, section: str, key: str) -> bool:
        """Return whether there is such a key."""
        return key.lower() in self._sections.get(section, {})

    def number(self, section: str, key: str, low: float, high: float, unit: str = "") -> float:
        """Return a number; raises CalibrationError if it is missing, no number, or not within [low, high]."""
        if section not in self._sections:
            known = ", ".join(self._sections) or "none"
            raise CalibrationError(f"{self.where}: section [{section}] is missing; there are {known}")
        text = self._sections[section].get(key.lower())
        if text is None:
            raise CalibrationError(f"{self.where}: [{section}] {key} is missing")
        try:
            value = float(text)
        except ValueError as error:
            raise CalibrationError(f"{self.where}: [{section}] {key} is {text!r}, which is no number") from error
        if not low <= value <= high:
            raise CalibrationError(
                f"{self.where}: [{section}] {key} is {value:g}, allowed {low:g} to {high:g}{f' {unit}' if unit else ''}"
            )
        return value


def load_zed_conf(path: Path, mode: str) -> StereoCalibration:
    """Return what the file says for `mode`, one of ZED_MODES; raises UserError, one line.

    The file knows nothing of shutter and stamps. `row_time_s` is the longest that the rolling shutter can take, and
    `stamp_to_mid_exposure_s` the usual delay; both are unchecked.
    """
    if mode not in ZED_MODES:
        raise CalibrationError(f"mode is {mode!r}, allowed {', '.join(ZED_MODES)}")
    conf = _Conf(read_text(path), str(path))
    pair = StereoCalibration(left=_lens(conf, "LEFT", mode), right=_lens(conf, "RIGHT", mode), X_RL=_pair(conf, mode))
    return with_zed_shutter(pair)


def with_zed_shutter(stereo: StereoCalibration) -> StereoCalibration:
    """Return a ZED's pair with the rolling shutter and the stamps that are usual at its size; unchecked, as above."""
    size = (stereo.left.width_px, stereo.left.height_px)
    rates = [mode.fastest_hz for mode in ZED_MODES.values() if mode[:2] == size]
    if not rates:
        return stereo
    row_time_s = 1.0 / (rates[0] * stereo.left.height_px)
    return msgspec.structs.replace(stereo, row_time_s=row_time_s, stamp_to_mid_exposure_s=STAMP_TO_MID_EXPOSURE_S)


def _lens(conf: _Conf, side: str, mode: str) -> Lens:
    section = f"{side}_CAM_{mode}"
    width_px, height_px, _ = ZED_MODES[mode]
    focal_px = 0.2 * width_px, 3.0 * width_px
    return Lens(
        width_px=width_px,
        height_px=height_px,
        fx_px=conf.number(section, "fx", *focal_px, "px"),
        fy_px=conf.number(section, "fy", *focal_px, "px"),
        cx_px=conf.number(section, "cx", 0.0, width_px - 1, "px"),
        cy_px=conf.number(section, "cy", 0.0, height_px - 1, "px"),
        distortion=_distortion(conf, section, f"{side}_DISTO"),
    )


def _distortion(conf: _Conf, section: str, apart: str) -> tuple[float, ...]:
    """Return k1 k2 p1 p2 k3 and, of a rational model, k4 k5 k6, in OpenCV's order."""
    seat = apart if conf.has(apart, "k1") and not conf.has(section, "k1") else section
    further = 4 if conf.has(seat, "k4") else 1 if conf.has(seat, "k3") else 0
    keys = ("k1", "k2", "p1", "p2", *("k3", "k4", "k5", "k6")[:further])
    terms = tuple(conf.number(seat, key, -_TERM, _TERM) for key in keys)
    if not any(terms):
        raise CalibrationError(f"{conf.where}: [{seat}] {', '.join(keys)} are all 0, as no lens of a ZED is")
    return terms


def _pair(conf: _Conf, mode: str) -> Pose:
    baseline_mm = conf.number("STEREO", "Baseline", -math.inf, math.inf)
    low_mm, high_mm = _BASELINE_MM
    if low_mm <= 1e3 * baseline_mm <= high_mm:
        raise CalibrationError(
            f"{conf.where}: [STEREO] Baseline is {baseline_mm:g}, which looks like metres; the file's lengths are mm, "
            f"allowed {low_mm:g} to {high_mm:g} mm"
        )
    baseline_mm = conf.number("STEREO", "Baseline", low_mm, high_mm, "mm")
    offset_keys = (f"{key}_{mode}" if conf.has("STEREO", f"{key}_{mode}") else key for key in ("TY", "TZ"))
    ty_mm, tz_mm = (conf.number("STEREO", key, -_OFFSET_MM, _OFFSET_MM, "mm") for key in offset_keys)
    rotvec = [conf.number("STEREO", f"{key}_{mode}", -_ANGLE_RAD, _ANGLE_RAD, "rad") for key in ("RX", "CV", "RZ")]
    return Pose(R=matrix3(so3.exp(np.array(rotvec))), p_m=(-baseline_mm * 1e-3, ty_mm * 1e-3, tz_mm * 1e-3))


def with_factory_pair(known: Calibration, stereo: StereoCalibration, unit: str | None) -> Calibration:
    """Return `known` with this pair in place of its own, named `unit` if that is given.

    Shutter and stamps stay as they are known where the size of the images does; the toe-in is known no better than the
    factory's.
    """
    replace = msgspec.structs.replace
    before = known.stereo
    if (before.left.width_px, before.left.height_px) == (stereo.left.width_px, stereo.left.height_px):
        stereo = replace(stereo, row_time_s=before.row_time_s, stamp_to_mid_exposure_s=before.stamp_to_mid_exposure_s)
        time_s = known.residual.time_s
    else:
        time_s = max(known.residual.time_s, NOMINAL_RESIDUAL.time_s)
    toe_in_rad = max(known.residual.toe_in_rad, NOMINAL_RESIDUAL.toe_in_rad)
    return replace(
        known,
        unit=known.unit if unit is None else unit,
        stereo=stereo,
        residual=replace(known.residual, time_s=time_s, toe_in_rad=toe_in_rad),
    )


def zed_conf_text(stereo: StereoCalibration, mode: str) -> str:
    """Return the file of a pair in one resolution, which `load_zed_conf` reads again.

    Raises CalibrationError where the pictures' size is not that of `mode`, or a lens has terms that the file has not.
    """
    size = ZED_MODES[mode]
    given = (stereo.left.width_px, stereo.left.height_px)
    if given != size[:2]:
        raise CalibrationError(f"the pair is {given[0]}x{given[1]} px, mode {mode} of a ZED {size[0]}x{size[1]} px")
    tx, ty, tz = (1e3 * part for part in stereo.X_RL.p_m)
    rx, ry, rz = so3.log(np.array(stereo.X_RL.R)).tolist()
    pair = {"Baseline": -tx, "TY": ty, "TZ": tz, f"RX_{mode}": rx, f"CV_{mode}": ry, f"RZ_{mode}": rz}
    sections = [
        (f"LEFT_CAM_{mode}", _conf_lens(stereo.left)),
        (f"RIGHT_CAM_{mode}", _conf_lens(stereo.right)),
        ("STEREO", pair),
    ]
    return "\n".join(
        f"[{name}]\n" + "".join(f"{key}={value!r}\n" for key, value in values.items()) for name, values in sections
    )


def _conf_lens(lens: Lens) -> dict[str, float]:
    if any(lens.distortion[8:]):
        raise CalibrationError(f"the lens has {len(lens.distortion)} terms of distortion, a ZED's file 8 at most")
    terms = (*lens.distortion, 0.0)[: 8 if len(lens.distortion) > 5 else 5]
    named = dict(zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), terms, strict=False))
    return {"fx": lens.fx_px, "fy": lens.fy_px, "cx": lens.cx_px, "cy": lens.cy_px, **named}
