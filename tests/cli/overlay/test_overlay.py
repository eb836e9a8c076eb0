"""What is drawn lies where it is in the picture, and what cannot be written is told in one line."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.files import format_calibration
from cli.overlay import picture_files
from cli.overlay.drawing import drawn, numbers
from cli.overlay.picture_files import open_pictures
from cli.overlay.projection import Projection, Sight
from cli.overlay.shapes import UP, Said
from cli.replay import replay
from daemon.recorder import Recorder, RecordingInfo
from messages import (
    GroundPlane,
    Reason,
    Side,
    Source,
    Terrain,
    TerrainKind,
    UserError,
)
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.history import AttitudeAt
from perception.depth.rectify import intrinsics
from perception.ground.foothold import FootholdSettings
from perception.heading import heading
from perception.terrain.surfaces import PathSurfaces, Surface
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario, scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer
from tests.bench.told_ground import told_edge, told_terrain

START_NS = 10_000_000_000
STEP_AT_M, STEP_M = 4.0, 0.15


def test_an_edge_is_drawn_on_the_edge_of_a_rendered_step() -> None:
    """Against the true lip, seen row by row by the rig's own camera, on a walk through a rolling shutter."""
    ground = WorldBuilder().level(STEP_AT_M, "concrete").step(STEP_M, "kerbstone").level(6.0, "paving")
    world = ground.step(-STEP_M, "kerbstone").level(6.0, "paving").build()
    walk = Scenario("step", "a step up", world, (Stand(1.6), Pace(1.4, 1.9).to(10.0), Stand(0.5)))
    wearer = SimulatedWearer(3, walk, START_NS, perfect_calibration=True)
    checked = 0
    for k in (72, 74, 76):
        frame, _ = next(wearer.frames(1, k))
        t_ns = wearer.shutter.true_ns(k)
        edge = wearer.terrain(frame.header.t_exposure_ns).edges[0]
        sight, height_m = _true_sight(wearer, t_ns)
        said = Said(
            t_s=0.0,
            ground=_no_ground(frame.header.t_exposure_ns),
            terrain=told_terrain(TerrainKind.STEP_UP, (told_edge(edge.distance_m, edge.rise_m, edge.yaw_rad),)),
            surfaces=PathSurfaces(
                [_level(0.2, edge.distance_m, -height_m), _level(edge.distance_m, 2.5, STEP_M - height_m)], 0.0
            ),
            sight=sight,
        )
        before = cv2.cvtColor(frame.left, cv2.COLOR_GRAY2BGR)
        picture = drawn(frame.left, said, FootholdSettings())[-len(before) :]
        rows, columns = np.nonzero((picture == UP).all(axis=2) & (before != picture).any(axis=2))
        on_lip = _lip_rows(wearer, t_ns)
        known = [
            (row, on_lip[column])
            for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
            if column in on_lip
        ]
        off_px = np.array([row - true for row, true in known])
        assert len(off_px) > 300
        assert abs(np.median(off_px)) < 1.0
        assert np.abs(off_px).max() < 6.0  # the line is 6 px wide
        checked += 1
    assert checked == 3


def test_a_depth_camera_s_points_are_drawn_on_the_pixels_that_measured_them() -> None:
    wearer = DepthWearer(2, scenario("level"), START_NS, perfect_calibration=True)
    lens, X_BD = wearer.calibration.depth.lens, wearer.calibration.X_BD
    attitude = AttitudeAt(0, so3.quaternion_from_matrix(_R_WB(0.1)), (0.3, -0.5, 0.2), 0.0, np.zeros((3, 3)))
    sight = Projection(wearer.calibration).sight(attitude, np.array([1.2, 0.1, 0.0]))
    assert sight is not None
    R_WD = attitude.R_WB @ np.array(X_BD.R)
    R_WH = heading(R_WD)
    assert R_WH is not None
    pixel = np.array([lens.cx_px + 90.0, (lens.height_px - 1) / 2])  # of the middle row, which is not late
    ray = np.array([*cv2.undistortPoints(pixel, intrinsics(lens), np.array(lens.distortion)).ravel(), 1.0])
    point_H = R_WH.T @ R_WD @ (1.3 * ray)
    np.testing.assert_allclose(sight.pixels(point_H[None])[0], pixel, atol=0.05)
    assert np.isnan(sight.pixels(-point_H[None])).all()  # behind the camera


def test_why_there_is_no_ground_is_written() -> None:
    nothing = Terrain.invalid(
        t_exposure_ns=1, frame_seq=1, reason=Reason.LOW_TEXTURE, side=Side.RIGHT, calibration_id="c"
    )
    said = Said(t_s=1.25, ground=_no_ground(1), terrain=nothing, surfaces=PathSurfaces((), 0.0), sight=None)
    assert [text for text, _ in numbers(said)] == ["no ground: not_planar", "1.25 s   no terrain: low_texture"]
    grey = np.full((360, 640), 90, np.uint8)
    picture = drawn(grey, said, FootholdSettings())
    assert (picture[-360:] == 90).all()
    assert (picture[:-360] > 150).any()


def test_a_replay_of_a_depth_camera_becomes_a_video_or_a_folder(tmp_path: Path) -> None:
    recording = tmp_path / "depth.mcap"
    _record_depth(recording)
    replay(recording, overlay=tmp_path / "walk.avi")
    replay(recording, overlay=tmp_path / "pictures")
    pictures = sorted((tmp_path / "pictures").iterdir())
    assert pictures[0].name == "000000.png"
    first = cv2.imread(str(pictures[0]))
    assert first is not None
    film = cv2.VideoCapture(str(tmp_path / "walk.avi"))
    frames = 0
    while True:
        more, picture = film.read()
        if not more:
            break
        assert picture.shape == first.shape
        frames += 1
    assert frames == len(pictures) > 20


@pytest.mark.parametrize("name", ["missing/walk.mp4", "file/pictures", "walk.gif"])
def test_what_cannot_be_written_is_told_in_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(UserError, match="--overlay") as told:
        open_pictures(tmp_path / name, 20.0)
    assert str(tmp_path / name) in str(told.value)
    assert "\n" not in str(told.value)


def test_a_video_that_no_codec_takes_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(picture_files.CODECS, ".mp4", "none")
    with pytest.raises(UserError, match="codec none"):
        open_pictures(tmp_path / "walk.mp4", 20.0).write(np.zeros((48, 64, 3), np.uint8))


def _record_depth(path: Path) -> None:
    wearer = DepthWearer(4, scenario("standing"), START_NS)
    info = RecordingInfo(
        device="bench",
        source=Source.SIMULATED,
        calibration_text=format_calibration(wearer.calibration),
        configuration_text="",
    )
    recorder = Recorder(path, info)
    for message in wearer.offline_inputs(1.6):
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()


def _true_sight(wearer: SimulatedWearer, t_ns: int) -> tuple[Sight, float]:
    """Return how the camera truly stood and moved, and how high it was over the ground before the step."""
    step_ns = 1_000_000
    motion = wearer.gait.at(np.array([t_ns - step_ns, t_ns, t_ns + step_ns]))
    R_WB, p_BL_m = motion.R_WB[1], np.array(wearer.calibration.X_BL.p_m)
    w_B = so3.log(motion.R_WB[0].T @ motion.R_WB[2]) / (2e-9 * step_ns)
    eye_W = motion.p_WB_m + motion.R_WB @ p_BL_m
    projection = Projection(wearer.calibration)
    attitude = AttitudeAt(t_ns, so3.quaternion_from_matrix(R_WB), tuple(w_B.tolist()), 0.0, np.zeros((3, 3)))
    resting = projection.sight(attitude, np.zeros(3))
    assert resting is not None
    R_WH = R_WB @ np.array(wearer.calibration.X_BL.R) @ resting.R_EH
    sight = projection.sight(attitude, R_WH.T @ (eye_W[2] - eye_W[0]) / (2e-9 * step_ns))
    assert sight is not None
    return sight, float(eye_W[1, 2])


def _lip_rows(wearer: SimulatedWearer, t_ns: int) -> dict[int, float]:
    """Return by column the row in which the true lip shows, each point at the instant of its row."""
    y = np.linspace(-0.2, 0.2, 800)  # where no label is
    lip_W = np.column_stack((np.full(800, STEP_AT_M), y, np.full(800, STEP_M)))
    lens, X_BL = wearer.unit.stereo.left, wearer.unit.X_BL
    at_ns = np.full(800, t_ns)
    pixels: FloatArray = np.zeros((800, 2))
    for _ in range(4):
        motion = wearer.gait.at(at_ns)
        points_B = np.einsum("nji,nj->ni", motion.R_WB, lip_W - motion.p_WB_m)
        points_L = (points_B - np.array(X_BL.p_m)) @ np.array(X_BL.R)
        pixels = cv2.projectPoints(points_L, np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion))[0][
            :, 0
        ].astype(np.float64)
        at_ns = t_ns + np.rint(1e9 * wearer.unit.stereo.row_time_s * (pixels[:, 1] - (lens.height_px - 1) / 2)).astype(
            int
        )
    return dict(zip(np.rint(pixels[:, 0]).astype(int).tolist(), pixels[:, 1].tolist(), strict=True))


def _R_WB(roll_rad: float) -> FloatArray:
    pitch = so3.exp(np.array([0.0, math.radians(45.0), 0.0]))
    return pitch @ so3.exp(np.array([roll_rad, 0.0, 0.0]))


def _no_ground(t_ns: int) -> GroundPlane:
    return GroundPlane.invalid(
        t_exposure_ns=t_ns, frame_seq=1, reason=Reason.NOT_PLANAR, ahead_m=0.7, calibration_id="c"
    )


def _level(from_m: float, to_m: float, height_m: float) -> Surface:
    return Surface(from_m, to_m, 0.5 * (from_m + to_m), height_m, 0.0, 0.001, 0.001)
