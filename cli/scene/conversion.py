"""From this project's messages to Foxglove's schemas, as its panels know them: lens, transforms, scene, picture.

Frames, each with its origin at the optical centre of the camera: W and H as everywhere (z up), L the raw left camera,
or D a depth camera, R the raw right one, B the IMU. What moves is the wearer's world about the camera: no place in W
is known.
"""

from collections.abc import Iterable, Sequence

import cv2
import msgspec
import numpy as np
from foxglove.messages import (
    CameraCalibration,
    Color,
    CompressedImage,
    FrameTransform,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from foxglove.messages import Duration as Lifetime
from foxglove.messages import Pose as FoxglovePose

from cli.overlay.lettering import Colour
from cli.overlay.shapes import Shape
from daemon.pictures import grey, jpeg
from messages import DepthCalibration, Image, Lens, UnitCalibration
from messages.arrays import FloatArray
from perception import so3
from perception.depth.rectify import intrinsics

WORLD, HEADING, IMU, LEFT, RIGHT, DEPTH = "W", "H", "B", "L", "R", "D"
LIFETIME_S = 0.2
"""What is said of one frame is shown until that of the next, or so long."""
_MODELS = {4: ("plumb_bob", 5), 5: ("plumb_bob", 5), 8: ("rational_polynomial", 8)}
_LINE_M, _FONT_M = 0.012, 0.05


def camera_of(calibration: UnitCalibration) -> str:
    """Return the frame of the camera whose picture is shown."""
    return DEPTH if isinstance(calibration.camera, DepthCalibration) else LEFT


def shown_lens(lens: Lens) -> Lens:
    """Return the lens of the picture that is written: the camera's own, or, where it has more terms than Foxglove knows
    (12 or 14), one without distortion, to which the picture is straightened."""
    return lens if len(lens.distortion) in _MODELS else msgspec.structs.replace(lens, distortion=(0.0,) * 4)


def straightened(image: Image, lens: Lens) -> Image:
    """Return `image` (height, width) as `shown_lens` sees it; a depth image keeps its values, no two are mixed."""
    if shown_lens(lens) is lens:
        return image
    K, size = intrinsics(lens), (lens.width_px, lens.height_px)
    maps = cv2.initUndistortRectifyMap(K, np.array(lens.distortion), np.eye(3), K, size, cv2.CV_32FC1)
    if image.dtype == np.uint8:
        return cv2.remap(image, *maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
    return cv2.remap(image, *maps, cv2.INTER_NEAREST).astype(np.uint16, copy=False)


def camera_calibration(lens: Lens, frame_id: str, t_ns: int) -> CameraCalibration:
    """Return a lens as Foxglove knows lenses; of the picture that is written, `shown_lens`."""
    lens = shown_lens(lens)
    name, terms = _MODELS[len(lens.distortion)]
    focal = (lens.fx_px, 0.0, lens.cx_px), (0.0, lens.fy_px, lens.cy_px), (0.0, 0.0, 1.0)
    return CameraCalibration(
        timestamp=timestamp(t_ns),
        frame_id=frame_id,
        width=lens.width_px,
        height=lens.height_px,
        distortion_model=name,
        D=[*lens.distortion, *(0.0,) * (terms - len(lens.distortion))],
        K=[value for row in focal for value in row],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[value for row in focal for value in (*row, 0.0)],
    )


def picture(image: Image, frame_id: str, t_ns: int) -> CompressedImage:
    """Return `image` (height, width) as JPEG; of a depth image near is bright."""
    return CompressedImage(timestamp=timestamp(t_ns), frame_id=frame_id, data=jpeg(grey(image)), format="jpeg")


def transforms(calibration: UnitCalibration, R_WE: FloatArray, R_EH: FloatArray, t_ns: int) -> Iterable[FrameTransform]:
    """Yield where H, the camera E (L or D), the IMU and the right camera are while E is turned by `R_WE` (3, 3)."""
    camera, X_BE = calibration.camera, calibration.X_BE
    eye = camera_of(calibration)
    yield transform(WORLD, HEADING, R_WE @ R_EH, np.zeros(3), t_ns)
    yield transform(WORLD, eye, R_WE, np.zeros(3), t_ns)
    R_EB = np.array(X_BE.R).T
    yield transform(eye, IMU, R_EB, -R_EB @ np.array(X_BE.p_m), t_ns)
    if not isinstance(camera, DepthCalibration):
        R_LR = np.array(camera.X_RL.R).T
        yield transform(LEFT, RIGHT, R_LR, -R_LR @ np.array(camera.X_RL.p_m), t_ns)


def transform(parent: str, child: str, R: FloatArray, p_m: FloatArray, t_ns: int) -> FrameTransform:
    """Return X of `child` in `parent`: `R` (3, 3) takes vectors from child to parent, `p_m` (3,) is child's origin."""
    w, x, y, z = so3.quaternion_from_matrix(R)
    return FrameTransform(
        timestamp=timestamp(t_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=float(p_m[0]), y=float(p_m[1]), z=float(p_m[2])),
        rotation=Quaternion(x=x, y=y, z=z, w=w),
    )


def scene(shapes: Iterable[Shape], t_ns: int) -> SceneUpdate:
    """Return all shapes of a frame in H, an entity for each kind of thing."""
    kinds: dict[str, list[Shape]] = {}
    for shape in shapes:
        kinds.setdefault(shape.what, []).append(shape)
    return SceneUpdate(entities=[_entity(what, of_it, t_ns) for what, of_it in kinds.items()])


def timestamp(t_ns: int) -> Timestamp:
    """Return an instant as Foxglove writes it; one before its beginning is its beginning."""
    seconds, nanoseconds = divmod(max(t_ns, 0), 1_000_000_000)
    return Timestamp(sec=seconds, nsec=nanoseconds)


def _entity(what: str, shapes: Sequence[Shape], t_ns: int) -> SceneEntity:
    return SceneEntity(
        timestamp=timestamp(t_ns),
        frame_id=HEADING,
        id=what,
        lifetime=Lifetime.from_secs(LIFETIME_S),
        frame_locked=True,
        lines=[_line(line, shape) for shape in shapes for line in shape.lines],
        triangles=[_area(shape.lines[0], shape.colour) for shape in shapes if shape.filled],
        texts=[_text(shape) for shape in shapes if shape.label],
    )


def _line(corners: FloatArray, shape: Shape) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        thickness=_LINE_M * shape.width / 3,
        points=_points(corners),
        color=_colour(shape.colour, 1.0),
    )


def _area(outline: FloatArray, colour: Colour) -> TriangleListPrimitive:
    """Return a convex outline, whose last corner is its first, as a fan of triangles."""
    corners = _points(outline[:-1])
    fan = [corner for k in range(1, len(corners) - 1) for corner in (corners[0], corners[k], corners[k + 1])]
    return TriangleListPrimitive(points=fan, color=_colour(colour, 0.4))


def _text(shape: Shape) -> TextPrimitive:
    x, y, z = (float(value) for value in shape.lines[0][-1])
    return TextPrimitive(
        pose=FoxglovePose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        billboard=True,
        font_size=_FONT_M,
        color=_colour(shape.colour, 1.0),
        text=shape.label,
    )


def _points(corners: FloatArray) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in corners.tolist()]


def _colour(colour: Colour, opacity: float) -> Color:
    blue, green, red = (value / 255.0 for value in colour)
    return Color(r=red, g=green, b=blue, a=opacity)
