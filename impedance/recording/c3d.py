"""Motion capture's C3D files as recordings of the platform.

A C3D file holds markers in the laboratory's axes and a force plate's raw channels. What it does not hold, a layout
says: where the markers sit on plate and foot, which channels are the wrench, and how laboratory and sensor lie to I
and P. The pose of a frame B from its markers r_k, seen at p_k, is the one of least squares [Kabsch, Acta Cryst. A32,
1976]:

    H = Σ_k (r_k − r̄) (p_k − p̄)ᵀ = U S Vᵀ,   R_IB = V diag(1, 1, det V Uᵀ) Uᵀ,   p_IB = p̄ − R_IB r̄                  (1)

over the markers seen at that time; NaN where fewer than three are.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from impedance.body import geometry
from impedance.body.rigid_body import wrench_transform
from impedance.recording.c3d_file import Channels, read_contents
from impedance.recording.check import Stream
from impedance.recording.plain_files import read_toml
from impedance.recording.recording import (
    FOOT_COLUMNS,
    LARGEST_SETTING,
    PLATE_COLUMNS,
    WRENCH_COLUMNS,
    PlatformRecording,
    PlatformSettings,
    Triple,
    settings_of,
)
from messages.arrays import FloatArray
from messages.checked import checked
from messages.errors import UserError
from messages.text_files import check_sizes

_LENGTHS_M: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MOMENTS_NM: Final = {"Nm": 1.0, "N.m": 1.0, "N*m": 1.0, "Nmm": 0.001, "N.mm": 0.001, "N*mm": 0.001}
_LEAST_SPREAD: Final = 1e-3
_AXES: Final = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}

AxisName = Annotated[str, Meta(pattern="^-?[xyz]$")]
Axes = tuple[AxisName, AxisName, AxisName]


class C3dLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a C3D file leaves open.

    `plate_markers`, `foot_markers`: labels and positions in P and F. `channels`: the labels of fx, fy, fz, mx, my, mz.
    `lab_axes`: the laboratory's axes that point along I's X, Y, Z, such as ["y", "z", "x"] where Z is up;
    `joint_in_lab_m` is I's origin there. `sensor_axes`: the sensor's axes along P's X, Y, Z; `sensor_in_plate_m` is
    the point of P about which its moments are. `reaction`: the channels hold what plate and foot exert on the sensor,
    and change sign.
    """

    plate_markers: dict[str, Triple]
    channels: tuple[str, str, str, str, str, str]
    foot_markers: dict[str, Triple] = msgspec.field(default_factory=dict)
    lab_axes: Axes = ("x", "y", "z")
    joint_in_lab_m: Triple = (0.0, 0.0, 0.0)
    sensor_axes: Axes = ("x", "y", "z")
    sensor_in_plate_m: Triple = (0.0, 0.0, 0.0)
    reaction: bool = False


def read_c3d(path: Path, layout_path: Path) -> PlatformRecording:
    """Return the recording in a C3D file; `layout_path` is a `platform.toml` with a further table `[c3d]`, the layout.

    Raises UserError, one line, where ezc3d is absent, a file cannot be read, labels are missing, units are unknown, or
    the recording does not pass its checks.
    """
    document = read_toml(layout_path)
    if "c3d" not in document:
        raise UserError(f"{layout_path}: has no table [c3d], the layout of markers and channels")
    check_sizes(document["c3d"], LARGEST_SETTING, f"{layout_path}: c3d")
    layout = checked(document["c3d"], C3dLayout, f"{layout_path}: c3d")
    settings = settings_of({key: value for key, value in document.items() if key != "c3d"}, str(layout_path))
    _check_layout(layout, settings, str(layout_path))
    points, analogs = read_contents(path)
    motion = [_poses(path, points, layout.plate_markers, layout)]
    if settings.foot.present:
        motion.append(_poses(path, points, layout.foot_markers, layout))
    columns = (*PLATE_COLUMNS, *FOOT_COLUMNS) if settings.foot.present else PLATE_COLUMNS
    wrench = _wrench(path, analogs, layout)
    motion_s, force_s = _times_s(path, points, "POINT"), _times_s(path, analogs, "ANALOG")
    return PlatformRecording.from_streams(
        settings,
        Stream(str(path), columns, motion_s, np.hstack(motion)),
        Stream(f"{path} (channels)", WRENCH_COLUMNS, force_s, wrench),
    )


def pose_of_markers(seen_m: FloatArray, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return p_IB (n, 3) and R_IB (n, 3, 3) by (1) of markers seen at (n, k, 3) in I that sit at (k, 3) in B."""
    there = np.asarray(np.isfinite(seen_m).all(axis=2), dtype=np.float64)
    count = there.sum(axis=1)
    share = there / np.maximum(count, 1.0)[:, None]
    p = np.where(there[:, :, None] > 0.0, seen_m, 0.0)
    p_mean, r_mean = np.einsum("nk,nki->ni", share, p), share @ places_m
    H = np.einsum("nk,nki,nkj->nij", there, places_m - r_mean[:, None], p - p_mean[:, None])
    U, _, Vt = np.linalg.svd(H)
    V, Ut = np.swapaxes(Vt, 1, 2), np.swapaxes(U, 1, 2)
    V[:, :, 2] *= np.sign(np.linalg.det(V @ Ut))[:, None]
    R = V @ Ut
    p_IB = p_mean - np.einsum("nij,nj->ni", R, r_mean)
    hidden = count < 3
    R[hidden], p_IB[hidden] = np.nan, np.nan
    return p_IB, R


def _poses(path: Path, points: Channels, markers: Mapping[str, Triple], layout: C3dLayout) -> FloatArray:
    unit = points.units[0] if points.units else ""
    if unit not in _LENGTHS_M:
        raise UserError(f"{path}: POINT:UNITS is {unit!r}, allowed {', '.join(_LENGTHS_M)}")
    places = _places(path, points, markers, "marker")
    seen_lab = points.values[:, places].transpose(2, 1, 0) * _LENGTHS_M[unit]
    seen_I = (seen_lab - np.array(layout.joint_in_lab_m)) @ _rotation(layout.lab_axes).T
    p_m, R = pose_of_markers(seen_I, np.array(list(markers.values())))
    return np.hstack((p_m, geometry.euler_of(R)))


def _wrench(path: Path, analogs: Channels, layout: C3dLayout) -> FloatArray:
    places = _places(path, analogs, layout.channels, "channel")
    channels = analogs.values[0][places].T.copy()
    for column, place in enumerate(places):
        allowed = {"N": 1.0} if column < 3 else _MOMENTS_NM
        unit = analogs.units[place] if place < len(analogs.units) else ""
        if unit not in allowed:
            raise UserError(f"{path}: channel {analogs.labels[place]} is in {unit!r}, allowed {', '.join(allowed)}")
        channels[:, column] *= allowed[unit]
    X = wrench_transform(_rotation(layout.sensor_axes), np.array(layout.sensor_in_plate_m))
    wrench: FloatArray = (-1.0 if layout.reaction else 1.0) * channels @ X.T
    return wrench


def _places(path: Path, channels: Channels, wanted: Mapping[str, Triple] | tuple[str, ...], what: str) -> list[int]:
    labels = channels.labels[: channels.values.shape[1]]
    for name in wanted:
        if name not in labels:
            raise UserError(f"{path}: {what} {name} is missing; it holds {', '.join(labels) or 'none'}")
    return [labels.index(name) for name in wanted]


def _times_s(path: Path, channels: Channels, group: str) -> FloatArray:
    rate_hz = channels.rate_hz
    if rate_hz is None:
        raise UserError(f"{path}: has no {group}:RATE")
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise UserError(f"{path}: {group}:RATE is {rate_hz:g}, allowed above 0 Hz")
    return np.arange(channels.values.shape[2]) / rate_hz


def _check_layout(layout: C3dLayout, settings: PlatformSettings, where: str) -> None:
    for field in ("lab_axes", "sensor_axes"):
        R = _rotation(getattr(layout, field))
        if abs(np.linalg.det(R) - 1.0) > 0.5:
            raise UserError(f"{where}: c3d.{field}: three right-handed axes are needed, such as y, z, x")
    for field, needed in (("plate_markers", True), ("foot_markers", settings.foot.present)):
        places = np.array(list(getattr(layout, field).values())).reshape(-1, 3)
        if needed and (len(places) < 3 or np.linalg.svd(places - places.mean(axis=0))[1][1] < _LEAST_SPREAD):
            raise UserError(f"{where}: c3d.{field}: three markers or more that are not in line are needed")


def _rotation(axes: Axes) -> FloatArray:
    """Return the matrix (3, 3) that takes vectors of the old axes to the new ones, which lie along `axes`."""
    return np.array([_AXES[name] for name in axes], dtype=np.float64)
