"""What Foxglove's panels need is in the file, in its own schemas, at the right place and time."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foxglove.messages import CameraCalibration, FrameTransform, SceneUpdate
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from cli.overlay.shapes import REGION, Shape
from cli.scene.conversion import camera_calibration, scene, straightened, transform
from cli.scene.foxglove_file import CALIBRATION, LAYOUT, PICTURE, SCENE, TRANSFORMS, FoxgloveFile
from daemon import replay as replaying
from daemon.config import Configuration
from daemon.pipeline import Pipeline
from daemon.replay_source import ReplaySource
from messages import TOPICS, DepthFrame, Lens, UserError
from messages.arrays import FloatArray
from perception import so3
from perception.depth.rectify import intrinsics
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import scenario

START_NS = 10_000_000_000
UTC_OFFSET_NS = 1_795_000_000_000_000_000


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    """Messages by channel, each with its time in the log, of a second and a half of a depth camera's walk."""
    path = tmp_path_factory.mktemp("foxglove") / "walk.mcap"
    wearer = DepthWearer(4, scenario("standing"), START_NS)
    source = ReplaySource(
        title="walk",
        calibration=wearer.calibration,
        configuration=Configuration(),
        inputs=lambda: wearer.offline_inputs(1.5),
        utc_offset_ns=UTC_OFFSET_NS,
    )
    pipeline = Pipeline(source.calibration, source.configuration.foothold)
    file = FoxgloveFile(path, source, lambda: pipeline.surfaces)
    replaying.replay(source.inputs(), pipeline, None, [file])
    file.close()
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message in reader.iter_messages():
            found[channel.topic].append((message.log_time, message.data))
        stream.seek(0)
        schemas = {channel.topic: schema.name for schema, channel, _ in make_reader(stream).iter_messages() if schema}
        stream.seek(0)
        for _, channel, message, decoded in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages(topics=[PICTURE, CALIBRATION, SCENE, TRANSFORMS]):
            found[f"decoded {channel.topic}"].append((message.log_time, decoded))
    found["schemas"] = [(0, schemas)]
    return found


@pytest.mark.long
def test_each_channel_has_the_schema_that_its_panel_knows(written: dict[str, list[tuple[int, Any]]]) -> None:
    ((_, schemas),) = written["schemas"]
    assert schemas[PICTURE] == "foxglove.CompressedImage"
    assert schemas[CALIBRATION] == "foxglove.CameraCalibration"
    assert schemas[SCENE] == "foxglove.SceneUpdate"
    assert schemas[TRANSFORMS] == "foxglove.FrameTransform"
    assert schemas["/ground"] == "gaiteyes.GroundPlane"


@pytest.mark.long
def test_pictures_and_lens_belong_together_and_times_are_utc(written: dict[str, list[tuple[int, Any]]]) -> None:
    pictures, lenses = written[f"decoded {PICTURE}"], written[f"decoded {CALIBRATION}"]
    assert len(pictures) == len(lenses) > 20
    for (_, shown), (_, lens) in zip(pictures, lenses, strict=True):
        image = cv2.imdecode(np.frombuffer(shown.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert image.shape == (lens.height, lens.width)
        assert shown.frame_id == lens.frame_id == "D"
        assert (shown.timestamp.seconds, shown.timestamp.nanos) == (lens.timestamp.seconds, lens.timestamp.nanos)
        assert -1 <= shown.timestamp.seconds - (START_NS + UTC_OFFSET_NS) // 10**9 <= 2  # exposed before it arrived
    times = [t_ns for t_ns, _ in written["/attitude"]]
    assert times == sorted(times)
    assert times[0] > UTC_OFFSET_NS


@pytest.mark.long
def test_the_transforms_make_one_tree(written: dict[str, list[tuple[int, Any]]]) -> None:
    transforms = [each for _, each in written[f"decoded {TRANSFORMS}"]]
    assert {(each.parent_frame_id, each.child_frame_id) for each in transforms} == {("W", "H"), ("W", "D"), ("D", "B")}
    for each in transforms:
        q = each.rotation
        assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1.0)
        if each.child_frame_id == "H":  # turned about the vertical alone
            assert (q.x, q.y) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.long
def test_the_scene_holds_the_region_where_the_ground_says(written: dict[str, list[tuple[int, Any]]]) -> None:
    grounds = {ground["t_exposure_ns"]: ground for _, text in written["/ground"] for ground in [json.loads(text)]}
    checked = 0
    for _, update in written[f"decoded {SCENE}"]:
        for entity in update.entities:
            assert entity.frame_id == "H"
            if entity.id != "region":
                continue
            ground = grounds[_instant_ns(entity)]
            points = np.array([(p.x, p.y, p.z) for line in entity.lines for p in line.points])
            np.testing.assert_allclose(points.mean(axis=0)[:2], (ground["ahead_m"], ground["left_m"]), atol=1e-9)
            slope = np.polyfit(points[:, 0], points[:, 2], 1)[0]
            assert slope == pytest.approx(np.tan(ground["slope_sagittal_rad"]), abs=5e-3)
            checked += 1
    assert checked > 10


@pytest.mark.long
def test_the_region_lies_on_what_the_camera_measured(written: dict[str, list[tuple[int, Any]]]) -> None:
    """From the file alone: out of H by the transforms, through the lens, onto the depth image of that instant."""
    wearer = DepthWearer(4, scenario("standing"), START_NS)
    frames = {frame.header.t_exposure_ns: frame for frame, _ in wearer.frames(30)}
    lens = written[f"decoded {CALIBRATION}"][0][1]
    K, distortion = np.array(lens.K).reshape(3, 3), np.array(lens.D)
    turned: dict[tuple[int, str], FloatArray] = {}
    for _, each in written[f"decoded {TRANSFORMS}"]:
        q = (each.rotation.w, each.rotation.x, each.rotation.y, each.rotation.z)
        turned[_instant_ns(each), each.child_frame_id] = so3.matrix_from_quaternion(q)
    off_m = []
    for _, update in written[f"decoded {SCENE}"]:
        for entity in (each for each in update.entities if each.id == "region"):
            t_ns = _instant_ns(entity)
            points_H = np.array([(p.x, p.y, p.z) for line in entity.lines for p in line.points])
            points_D = points_H @ turned[t_ns, "H"].T @ turned[t_ns, "D"]
            pixels = np.rint(cv2.projectPoints(points_D, np.zeros(3), np.zeros(3), K, distortion)[0].reshape(-1, 2))
            frame = frames[t_ns]
            assert isinstance(frame, DepthFrame)
            for (column, row), z_m in zip(pixels.astype(int).tolist(), points_D[:, 2].tolist(), strict=True):
                if 0 <= column < lens.width and 0 <= row < lens.height and frame.depth[row, column]:
                    off_m.append(z_m - wearer.calibration.depth.step_m * float(frame.depth[row, column]))
    assert len(off_m) > 100
    assert np.median(np.abs(off_m)) < 0.02


def test_an_area_is_a_fan_of_triangles_beside_its_outline() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
    (entity,) = _read(scene([Shape("region", [square], REGION, 2, filled=True, label="here")], 5)).entities
    (line,), (area,), (text,) = entity.lines, entity.triangles, entity.texts
    assert [(p.x, p.y) for p in line.points] == [(x, y) for x, y, _ in square.tolist()]
    assert [(p.x, p.y) for p in area.points] == [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)]
    assert text.text == "here"
    assert (area.color.r, area.color.g) == pytest.approx((80 / 255, 220 / 255))


def test_a_transform_takes_points_of_the_child_to_the_parent() -> None:
    R, p = so3.exp(np.array([0.1, -0.2, 0.3])), np.array([1.0, 2.0, 3.0])
    told = _read(transform("W", "B", R, p, 7))
    q = (told.rotation.w, told.rotation.x, told.rotation.y, told.rotation.z)
    np.testing.assert_allclose(so3.matrix_from_quaternion(q), R, atol=1e-12)
    assert (told.translation.x, told.translation.y, told.translation.z) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("terms", "model", "told"), [(4, "plumb_bob", 5), (5, "plumb_bob", 5), (8, "rational_polynomial", 8)]
)
def test_a_lens_is_told_in_foxglove_s_terms(terms: int, model: str, told: int) -> None:
    distortion = tuple(0.01 * (k + 1) for k in range(terms))
    made = camera_calibration(_lens(distortion), "L", 3)
    calibration = _read(made)
    assert calibration.distortion_model == model
    assert list(calibration.D) == [*distortion, *[0.0] * (told - terms)]
    assert list(calibration.K) == [700, 0, 640, 0, 701, 360, 0, 0, 1]


@pytest.mark.parametrize("terms", [12, 14])
def test_what_a_lens_of_more_terms_sees_is_straightened(terms: int) -> None:
    lens = _lens((-0.3, 0.1, 0.001, 0.002, 0.0, 0.02, 0.01, 0.0, 0.01, 0.0, 0.02, 0.0, 0.01, -0.02)[:terms])
    told = _read(camera_calibration(lens, "L", 3))
    assert (told.distortion_model, list(told.D)) == ("plumb_bob", [0.0] * 5)
    K, size = intrinsics(lens), (lens.width_px, lens.height_px)
    px = cv2.projectPoints(np.array([[[0.12, -0.08, 1.0]]]), np.zeros(3), np.zeros(3), K, np.array(lens.distortion))[0]
    raw = np.zeros((lens.height_px, lens.width_px), np.uint8)
    cv2.circle(raw, np.rint(px.ravel()).astype(int).tolist(), 3, 255, -1)
    straight = straightened(raw, lens)
    row, column = np.unravel_index(int(cv2.GaussianBlur(straight, (0, 0), 2.0).argmax()), straight.shape)
    assert straight.shape == size[::-1]
    np.testing.assert_allclose((column, row), (K @ (0.12, -0.08, 1.0))[:2], atol=1.5)
    assert straightened(raw, _lens((0.1,) * 8)) is raw


def test_the_layout_s_topics_and_fields_exist() -> None:
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    panels: dict[str, Any] = layout["configById"]
    assert set(panels) == set(_panels(layout["layout"]))
    assert panels["Image!left"]["imageMode"] == {"imageTopic": PICTURE, "calibrationTopic": CALIBRATION}
    assert panels["3D!space"]["followTf"] == "H"
    assert SCENE in panels["3D!space"]["topics"]
    assert SCENE in panels["Image!left"]["topics"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    for path in (*paths, panels["RawMessages!health"]["topicPath"]):
        name, _, field = path.removeprefix("/").partition(".")
        assert TOPICS[name].published
        assert not field or field.split("[")[0] in TOPICS[name].message.__struct_fields__


@pytest.mark.parametrize("name", ["walk.txt", "missing/walk.mcap"])
def test_what_cannot_be_written_is_told_in_one_line(tmp_path: Path, name: str) -> None:
    wearer = DepthWearer(4, scenario("standing"), START_NS)
    source = ReplaySource(
        title="", calibration=wearer.calibration, configuration=Configuration(), inputs=lambda: iter(())
    )
    with pytest.raises(UserError, match="--foxglove") as told:
        FoxgloveFile(tmp_path / name, source, lambda: Pipeline(source.calibration, Configuration().foothold).surfaces)
    assert "\n" not in str(told.value)


def _instant_ns(stamped: Any) -> int:
    """Return a time stamp on the unit's own clock."""
    return int(stamped.timestamp.seconds * 10**9 + stamped.timestamp.nanos - UTC_OFFSET_NS)


def _read(message: CameraCalibration | FrameTransform | SceneUpdate) -> Any:
    """Return a message as its readers see it."""
    schema = message.get_schema()
    decode = DecoderFactory().decoder_for("protobuf", Schema(1, schema.data, schema.encoding, schema.name))
    assert decode is not None
    return decode(message.encode())


def _panels(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else _panels(node["first"]) + _panels(node["second"])


def _lens(distortion: tuple[float, ...]) -> Lens:
    return Lens(width_px=1280, height_px=720, fx_px=700.0, fy_px=701.0, cx_px=640.0, cy_px=360.0, distortion=distortion)
