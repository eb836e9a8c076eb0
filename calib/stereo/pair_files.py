"""Stereo pairs in the formats of others: Kalibr's camchain, in and out; a ZED's .conf; a DepthAI camera's JSON.

Kalibr's `camchain.yaml` [kalibr wiki, "yaml formats"]: cam0, cam1 with camera_model pinhole, intrinsics [fu, fv, pu,
pv], distortion_model radtan [k1, k2, r1, r2] (in OpenCV's order), resolution, and in cam1 T_cn_cnm1, the 4×4 transform
of points from cam0 to cam1. T_cam_imu, of points from the IMU to the camera, stands there once the IMU was calibrated
too. Kalibr has no third radial term: a pair with one is written as the four terms nearest to it over the picture.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from calib.files import load_calibration
from calib.strict_yaml import CalibrationError, format_yaml, parse_yaml
from calib.zed_conf import load_zed_conf
from messages import Calibration, Lens, Pose, StereoCalibration, matrix3, vec3
from messages.arrays import FloatArray
from messages.text_files import read_text
from perception.depth.rectify import intrinsics

_ROTATION_TOLERANCE = 1e-4
_MODELS, _LENSES = ("pinhole",), ("radtan",)
_GRID = 25


def load_pair(path: Path, *, mode: str = "HD") -> StereoCalibration:
    """Return the pair that a file tells: a unit's calibration, Kalibr's camchain, a ZED's .conf or DepthAI's JSON.

    `mode` is a ZED's resolution. Raises UserError, one line naming file and field.
    """
    if path.suffix.lower() == ".conf":
        return load_zed_conf(path, mode)
    text = read_text(path)
    if path.suffix.lower() == ".json":
        return _depthai(text, str(path))
    document = parse_yaml(text, str(path))
    if isinstance(document, Mapping) and "cam0" in document:
        return parse_camchain(text, str(path))
    calibration = load_calibration(path)
    if not isinstance(calibration, Calibration):
        raise CalibrationError(f"{path}: is of a depth camera, which has no pair")
    return calibration.stereo


def parse_camchain(text: str, where: str) -> StereoCalibration:
    """Return the pair of cam0 (left) and cam1 (right). Raises CalibrationError, its line beginning with `where`.

    Kalibr knows nothing of shutter and stamps: they are taken as global, and as mid-exposure.
    """
    document = parse_yaml(text, where)
    cameras = [_mapping(document, name, where) for name in ("cam0", "cam1")]
    left, right = (_kalibr_lens(camera, name, where) for camera, name in zip(cameras, ("cam0", "cam1"), strict=True))
    X_RL = _rigid(_array(cameras[1], "T_cn_cnm1", (4, 4), f"{where}: cam1"), f"{where}: cam1.T_cn_cnm1")
    return StereoCalibration(left=left, right=right, X_RL=X_RL)


def imu_pose(text: str, where: str) -> Pose | None:
    """Return X_BL of cam0's T_cam_imu, None where the camchain has none. Raises CalibrationError."""
    camera = _mapping(parse_yaml(text, where), "cam0", where)
    if "T_cam_imu" not in camera:
        return None
    X_LB = _rigid(_array(camera, "T_cam_imu", (4, 4), f"{where}: cam0"), f"{where}: cam0.T_cam_imu")
    R_BL = np.array(X_LB.R).T
    return Pose(R=matrix3(R_BL), p_m=vec3(-R_BL @ np.array(X_LB.p_m)))


def camchain_text(calibration: Calibration) -> str:
    """Return Kalibr's camchain of a unit, with the IMU's place."""
    stereo, X_BL = calibration.stereo, calibration.X_BL
    R_LB, R_RL = np.array(X_BL.R).T, np.array(stereo.X_RL.R)
    X_LB = _matrix(R_LB, -R_LB @ np.array(X_BL.p_m))
    X_RL = _matrix(R_RL, np.array(stereo.X_RL.p_m))
    document: dict[str, Any] = {}
    for name, other, topic, lens, from_imu in (
        ("cam0", 1, "left", stereo.left, X_LB),
        ("cam1", 0, "right", stereo.right, X_RL @ X_LB),
    ):
        lens = radtan(lens)
        document[name] = {
            "T_cam_imu": from_imu.tolist(),
            "cam_overlaps": [other],
            "camera_model": "pinhole",
            "distortion_coeffs": list(lens.distortion),
            "distortion_model": "radtan",
            "intrinsics": [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px],
            "resolution": [lens.width_px, lens.height_px],
            "rostopic": f"/{topic}/image_raw",
            "timeshift_cam_imu": stereo.stamp_to_mid_exposure_s,
        }
    document["cam1"]["T_cn_cnm1"] = X_RL.tolist()
    return format_yaml(document)


def radtan(lens: Lens) -> Lens:
    """Return the lens with four terms, k1 k2 p1 p2, nearest to `lens` over its picture, in pixels."""
    if len(lens.distortion) == 4 or not any(lens.distortion[4:]):
        return msgspec.structs.replace(lens, distortion=lens.distortion[:4])
    u, v = np.meshgrid(np.linspace(0, lens.width_px - 1, _GRID), np.linspace(0, lens.height_px - 1, _GRID))
    px = np.stack((u.ravel(), v.ravel()), axis=-1)
    rays = cv2.undistortPoints(px[:, None], intrinsics(lens), np.array(lens.distortion))[:, 0].astype(np.float64)
    x, y = rays.T
    r2 = x * x + y * y
    along_u = lens.fx_px * np.stack((x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x), axis=-1)
    along_v = lens.fy_px * np.stack((y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y), axis=-1)
    A = np.concatenate((along_u, along_v))
    wanted = np.concatenate((px[:, 0] - lens.cx_px - lens.fx_px * x, px[:, 1] - lens.cy_px - lens.fy_px * y))
    return msgspec.structs.replace(lens, distortion=tuple(np.linalg.lstsq(A, wanted, rcond=None)[0].tolist()))


def _kalibr_lens(camera: Mapping[str, Any], name: str, where: str) -> Lens:
    for key, allowed in (("camera_model", _MODELS), ("distortion_model", _LENSES)):
        if camera.get(key) not in allowed:
            raise CalibrationError(f"{where}: {name}.{key} is {camera.get(key)!r}, allowed {', '.join(allowed)}")
    fx, fy, cx, cy = _array(camera, "intrinsics", (4,), f"{where}: {name}").tolist()
    width, height = _array(camera, "resolution", (2,), f"{where}: {name}").astype(int).tolist()
    distortion = _array(camera, "distortion_coeffs", (4,), f"{where}: {name}")
    return _lens(width, height, fx, fy, cx, cy, distortion, f"{where}: {name}")


def _depthai(text: str, where: str) -> StereoCalibration:
    """Return the pair of DepthAI's cameras 1 (left) and 2 (right); lengths are centimetres there."""
    try:
        cameras = dict(msgspec.json.decode(text)["cameraData"])
        eyes = [cameras[socket] for socket in (1, 2)]
        place = eyes[0]["extrinsics"]
        if place["toCameraSocket"] != 2:
            raise CalibrationError(f"{where}: camera 1's extrinsics lead to {place['toCameraSocket']}, allowed 2")
        p_m = 0.01 * np.array([place["translation"][axis] for axis in "xyz"])
        T = _matrix(np.array(place["rotationMatrix"]), p_m)
        lenses = []
        for eye in eyes:
            K = np.array(eye["intrinsicMatrix"], dtype=np.float64)
            width, height = (int(eye[key]) if key in eye else 0 for key in ("width", "height"))
            terms = np.array(eye["distortionCoeff"], dtype=np.float64)
            lenses.append(_lens(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2], terms, where))
    except (msgspec.MsgspecError, KeyError, IndexError, TypeError, ValueError) as error:
        raise CalibrationError(f"{where}: no calibration of a DepthAI stereo camera: {error!r}") from error
    return StereoCalibration(left=lenses[0], right=lenses[1], X_RL=_rigid(T, f"{where}: rotationMatrix"))


def _lens(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float, distortion: FloatArray, where: str
) -> Lens:
    try:
        return msgspec.convert(
            {
                "width_px": width,
                "height_px": height,
                "fx_px": float(fx),
                "fy_px": float(fy),
                "cx_px": float(cx),
                "cy_px": float(cy),
                "distortion": distortion.tolist(),
            },
            Lens,
        )
    except msgspec.ValidationError as error:
        raise CalibrationError(f"{where}: {error}") from error


def _mapping(document: object, name: str, where: str) -> Mapping[str, Any]:
    found = document.get(name) if isinstance(document, Mapping) else None
    if not isinstance(found, Mapping):
        raise CalibrationError(f"{where}: {name} is missing; expected Kalibr's cam0 and cam1")
    return found


def _array(camera: Mapping[str, Any], key: str, shape: tuple[int, ...], where: str) -> FloatArray:
    try:
        values = np.array(camera[key], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{where}.{key} is missing or no array of numbers") from error
    if values.shape != shape or not np.isfinite(values).all():
        size = "×".join(map(str, shape))
        raise CalibrationError(f"{where}.{key} has the shape {values.shape}, expected {size} finite numbers")
    return values


def _rigid(T: FloatArray, where: str) -> Pose:
    """Return a 4×4 transform as a pose, its rotation the nearest exact one. Raises CalibrationError for no rotation."""
    if not np.isfinite(T).all():
        raise CalibrationError(f"{where} holds what is no finite number")
    U, _, Vt = np.linalg.svd(T[:3, :3])
    R = U @ Vt
    if np.linalg.det(R) < 0 or np.abs(R - T[:3, :3]).max() > _ROTATION_TOLERANCE:
        raise CalibrationError(f"{where} is no rotation, allowed off by {_ROTATION_TOLERANCE:g}")
    return Pose(R=matrix3(R), p_m=vec3(T[:3, 3]))


def _matrix(R: FloatArray, p_m: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p_m
    return T
