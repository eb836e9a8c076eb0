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
from impedance.recording.c3d_file import C3dContents, Channels, read_contents
from impedance.recording.c3d_platform import platform_of
from impedance.recording.check import Stream
from impedance.recording.plain_files import read_toml
from impedance.recording.recording import (
    FOOT_COLUMNS,
    LARGEST_SETTING,
    PLATE_COLUMNS,
    WRENCH_COLUMNS,
    PlatformRecording,
    Triple,
    settings_of,
)
from messages.arrays import FloatArray
from messages.checked import checked
from messages.errors import UserError
from messages.text_files import check_sizes

_LENGTHS_M: Final = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    **{
        f"{prefix}met{end}": size
        for prefix, size in (("", 1.0), ("centi", 0.01), ("milli", 0.001))
        for end in ("er", "ers", "re", "res")
    },
}
_FORCES_N: Final = {"n": 1.0, "newton": 1.0, "newtons": 1.0, "kn": 1e3, "kilonewton": 1e3, "kilonewtons": 1e3}
_MOMENTS_NM: Final = {
    force + length: newtons * metres for force, newtons in _FORCES_N.items() for length, metres in _LENGTHS_M.items()
}
_BETWEEN: Final = str.maketrans("", "", " .*·-_")
_LEAST_SPREAD: Final = 1e-3
_AXES: Final = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}

AxisName = Annotated[str, Meta(pattern="^-?[xyz]$")]
Axes = tuple[AxisName, AxisName, AxisName]


class C3dLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a C3D file leaves open.

    `plate_markers`, `foot_markers`: labels and positions in P and F. `channels`: the labels of fx, fy, fz, mx, my, mz;
    or `force_platform`, from 1: that of the file's own group FORCE_PLATFORM, whose corners are those of the level plate
    at rest, and then neither `sensor_axes` nor `sensor_in_plate_m` counts.
    `lab_axes`: the laboratory's axes that point along I's X, Y, Z, such as ["y", "z", "x"] where Z is up;
    `joint_in_lab_m` is I's origin there. `sensor_axes`: the sensor's axes along P's X, Y, Z; `sensor_in_plate_m` is
    the point of P about which its moments are. `reaction`: the channels hold what plate and foot exert on the sensor,
    and change sign.
    """

    plate_markers: dict[str, Triple]
    channels: tuple[str, str, str, str, str, str] | None = None
    force_platform: Annotated[int, Meta(ge=1, le=100)] | None = None
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
    present = ("plate_markers", "foot_markers") if settings.foot.present else ("plate_markers",)
    check_markers(layout, present, str(layout_path))
    points, analogs, platforms, _ = read_contents(path)
    motion = [poses_of(path, points, layout.plate_markers, layout)]
    if settings.foot.present:
        motion.append(poses_of(path, points, layout.foot_markers, layout))
    columns = (*PLATE_COLUMNS, *FOOT_COLUMNS) if settings.foot.present else PLATE_COLUMNS
    L_m = settings.plate.joint_to_surface_m
    wrench = wrench_of(path, C3dContents(points, analogs, platforms, ()), layout, L_m)
    motion_s, force_s = times_s(path, points, "POINT"), times_s(path, analogs, "ANALOG")
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


def poses_of(path: Path, points: Channels, markers: Mapping[str, Triple], layout: C3dLayout) -> FloatArray:
    """Return position and Euler angles (n, 6) in I of the frame that `markers` sit on; raises UserError."""
    places = _places(path, points, markers, "marker")
    seen_lab = points.values[:, places].transpose(2, 1, 0) * _length_m(path, points)
    seen_I = (seen_lab - np.array(layout.joint_in_lab_m)) @ _rotation(layout.lab_axes).T
    p_m, R = pose_of_markers(seen_I, np.array(list(markers.values())))
    return np.hstack((p_m, geometry.euler_of(R)))


def wrench_of(path: Path, contents: C3dContents, layout: C3dLayout, joint_to_surface_m: float) -> FloatArray:
    """Return the wrench (n, 6) in P about its origin, of named channels or the file's platform; raises UserError."""
    analogs = contents.analogs
    if layout.channels is not None:
        places = _places(path, analogs, layout.channels, "channel")
        channels = _scaled(path, analogs, places, (_FORCES_N,) * 3 + (_MOMENTS_NM,) * 3)
        X = wrench_transform(_rotation(layout.sensor_axes), np.array(layout.sensor_in_plate_m))
    else:
        length_m = _length_m(path, contents.points)
        platform = platform_of(path, contents.platforms, layout.force_platform or 1, length_m)
        if max(platform.channels) >= analogs.values.shape[1] or min(platform.channels) < 0:
            raise UserError(
                f"{path}: FORCE_PLATFORM:CHANNEL names channel {max(platform.channels) + 1}, the file holds "
                f"{analogs.values.shape[1]}"
            )
        if platform.matrix is None:
            units = (_FORCES_N,) * 8 if platform.kind == 3 else (_FORCES_N,) * 3 + (_MOMENTS_NM,) * 3
            raw = _scaled(path, analogs, list(platform.channels), units)
        else:
            raw = analogs.values[0][list(platform.channels)].T
        channels = platform.wrench(raw, length_m)
        R_IL = _rotation(layout.lab_axes)
        centre_I = R_IL @ (platform.centre_m - np.array(layout.joint_in_lab_m))
        X = wrench_transform(R_IL @ platform.axes.T, centre_I - np.array([0.0, joint_to_surface_m, 0.0]))
    return np.asarray((-1.0 if layout.reaction else 1.0) * channels @ X.T, dtype=np.float64)


def _scaled(path: Path, analogs: Channels, places: list[int], units: tuple[Mapping[str, float], ...]) -> FloatArray:
    """Return channels (n, c) in N and N·m."""
    channels: FloatArray = analogs.values[0][places].T.copy()
    for column, (place, allowed) in enumerate(zip(places, units, strict=True)):
        unit = analogs.units[place] if place < len(analogs.units) else ""
        size = allowed.get(unit.translate(_BETWEEN).lower())
        if size is None:
            known = "N, kN, newtons" if allowed is _FORCES_N else "N m, N mm, newton-meters"
            raise UserError(f"{path}: channel {analogs.labels[place]} is in {unit!r}, allowed {known} and the like")
        channels[:, column] *= size
    return channels


def _length_m(path: Path, points: Channels) -> float:
    """Return the file's unit of length."""
    unit = points.units[0] if points.units else ""
    size = _LENGTHS_M.get(unit.translate(_BETWEEN).lower())
    if size is None:
        raise UserError(f"{path}: POINT:UNITS is {unit!r}, allowed m, cm, mm, meters and the like")
    return size


def _places(path: Path, channels: Channels, wanted: Mapping[str, Triple] | tuple[str, ...], what: str) -> list[int]:
    labels = channels.labels[: channels.values.shape[1]]
    for name in wanted:
        if name not in labels:
            raise UserError(f"{path}: {what} {name} is missing; it holds {', '.join(labels) or 'none'}")
        if labels.count(name) > 1:
            raise UserError(f"{path}: {what} {name} is there {labels.count(name)} times: which one counts is not told")
    return [labels.index(name) for name in wanted]


def times_s(path: Path, channels: Channels, group: str) -> FloatArray:
    """Return the times (n,) of a file's samples from its first one; raises UserError where the rate is not told."""
    rate_hz = channels.rate_hz
    if rate_hz is None:
        raise UserError(f"{path}: has no {group}:RATE")
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise UserError(f"{path}: {group}:RATE is {rate_hz:g}, allowed above 0 Hz")
    return np.arange(channels.values.shape[2]) / rate_hz


def check_markers(layout: C3dLayout, fields: tuple[str, ...], where: str) -> None:
    """Raise UserError where the layout's axes, its source of the wrench or the markers of `fields` cannot be."""
    if (layout.channels is None) == (layout.force_platform is None):
        raise UserError(f"{where}: c3d.channels or c3d.force_platform: one of the two is needed")
    for field in ("lab_axes", "sensor_axes"):
        R = _rotation(getattr(layout, field))
        if abs(np.linalg.det(R) - 1.0) > 0.5:
            raise UserError(f"{where}: c3d.{field}: three right-handed axes are needed, such as y, z, x")
    for field in fields:
        places = np.array(list(getattr(layout, field).values())).reshape(-1, 3)
        if len(places) < 3 or np.linalg.svd(places - places.mean(axis=0))[1][1] < _LEAST_SPREAD:
            raise UserError(f"{where}: c3d.{field}: three markers or more that are not in line are needed")


def _rotation(axes: Axes) -> FloatArray:
    """Return the matrix (3, 3) that takes vectors of the old axes to the new ones, which lie along `axes`."""
    return np.array([_AXES[name] for name in axes], dtype=np.float64)
