import gzip
import math
import shutil
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.protocols import DeviceError
from drivers.recording.asl_folder import FRAME_LATENCY_NS, START_NS, TAIL_NS, AslFolder, _paired
from messages import DropCause, DroppedFrame, ImuSample, Input, StereoFrame, Tick
from tests.bench.asl import FRAME_NS, T0_NS, image, imu_rows, make_folder
from tests.bench.data_folder import shared_data
from tests.bench.recorded import all_facts


def arrival_ns(message: Input) -> int:
    if isinstance(message, StereoFrame | DroppedFrame):
        return message.header.t_arrival_ns
    if isinstance(message, ImuSample):
        return message.t_arrival_ns
    assert isinstance(message, Tick)
    return message.t_ns


def complaint(root: Path) -> str:
    with pytest.raises(DeviceError) as raised:
        list(AslFolder(root).inputs())
    line = str(raised.value)
    assert line.startswith(str(root))
    assert "\n" not in line
    return line.removeprefix(str(root))


@pytest.mark.parametrize(("width_px", "height_px"), [(752, 480), (1280, 720), (61, 37)])
@pytest.mark.parametrize("below_data", [False, True])
def test_every_layout_and_size_gives_the_exact_pixels(
    tmp_path: Path, width_px: int, height_px: int, below_data: bool
) -> None:
    folder = AslFolder(
        make_folder(tmp_path, width_px=width_px, height_px=height_px, frames=2, below_data=below_data, imu_hz=100)
    )
    assert (folder.width_px, folder.height_px) == (width_px, height_px)
    frames = [message for message in folder.inputs() if isinstance(message, StereoFrame)]
    assert [frame.header.t_exposure_ns for frame in frames] == [T0_NS, T0_NS + FRAME_NS]
    for k, frame in enumerate(frames):
        assert (frame.header.width_px, frame.header.height_px) == (width_px, height_px)
        assert np.array_equal(frame.left, image(2 * k, width_px, height_px))
        assert np.array_equal(frame.right, image(2 * k + 1, width_px, height_px))
        assert not frame.left.flags.writeable
    assert set(folder.sensor_files) == {"cam0", "cam1"}


@pytest.mark.parametrize("imu_hz", [100, 200, 1000])
def test_everything_comes_in_the_order_of_arrival_whatever_the_rate(tmp_path: Path, imu_hz: int) -> None:
    folder = AslFolder(make_folder(tmp_path, imu_hz=imu_hz, imu_lead_ns=2_000_000_000))
    inputs = list(folder.inputs())
    times = [arrival_ns(message) for message in inputs]
    assert times == sorted(times)
    samples = [message for message in inputs if isinstance(message, ImuSample)]
    assert len(samples) == 2 * imu_hz + imu_hz // 5 + 1
    assert samples[3].w_WB_B_radps == (3.25, 0.5, -0.125)
    assert samples[3].sf_B_mps2 == (9.5, 1e-3, 3.0)
    assert math.isnan(samples[3].temperature_degC)
    shots = [message for message in inputs if isinstance(message, StereoFrame)]
    assert [shot.header.t_exposure_ns for shot in shots] == [T0_NS + k * FRAME_NS for k in range(4)]
    assert all(shot.header.t_arrival_ns - shot.header.t_exposure_ns == FRAME_LATENCY_NS for shot in shots)
    ticks = [message.t_ns for message in inputs if isinstance(message, Tick)]
    first_ns, last_ns = shots[0].header.t_arrival_ns, shots[-1].header.t_arrival_ns
    assert ticks == list(range(first_ns, last_ns + TAIL_NS + 1, 10_000_000))
    assert all_facts(list(AslFolder(tmp_path).inputs())) == all_facts(inputs)


def test_no_frame_comes_before_an_attitude_can_be_known(tmp_path: Path) -> None:
    inputs = list(AslFolder(make_folder(tmp_path, frames=30)).inputs())
    shots = [message for message in inputs if isinstance(message, StereoFrame)]
    assert [shot.header.t_exposure_ns for shot in shots] == [T0_NS + k * FRAME_NS for k in range(30)]
    start_ns = T0_NS + START_NS
    assert [shot.header.t_arrival_ns for shot in shots] == [
        max(start_ns, shot.header.t_exposure_ns + FRAME_LATENCY_NS) for shot in shots
    ]
    assert shots[0].header.t_arrival_ns == shots[24].header.t_arrival_ns == start_ns < shots[25].header.t_arrival_ns
    times = [arrival_ns(message) for message in inputs]
    assert times == sorted(times)


def test_images_as_jpeg_and_everything_below_mav0(tmp_path: Path) -> None:
    make_folder(tmp_path / "V1" / "mav0", below_data=True, suffix=".JPG")
    folder = AslFolder(tmp_path / "V1")
    assert folder.unit == "asl-V1"
    assert Counter(type(message) for message in folder.inputs())[StereoFrame] == 4


def test_an_image_without_its_other_eye_becomes_a_dropped_frame(tmp_path: Path) -> None:
    make_folder(tmp_path)
    (tmp_path / "cam1" / f"{T0_NS + FRAME_NS}.png").unlink()
    late = tmp_path / "cam0" / f"{T0_NS + 2 * FRAME_NS}.png"
    late.rename(tmp_path / "cam0" / f"{T0_NS + 2 * FRAME_NS + 6_000_000}.png")
    near = tmp_path / "cam0" / f"{T0_NS + 3 * FRAME_NS}.png"
    near.rename(tmp_path / "cam0" / f"{T0_NS + 3 * FRAME_NS - 4_000_000}.png")
    frames = [m for m in AslFolder(tmp_path).inputs() if isinstance(m, StereoFrame | DroppedFrame)]
    assert [(type(m), m.header.t_exposure_ns - T0_NS) for m in frames] == [
        (StereoFrame, 0),
        (DroppedFrame, FRAME_NS),
        (DroppedFrame, 2 * FRAME_NS),
        (DroppedFrame, 2 * FRAME_NS + 6_000_000),
        (StereoFrame, 3 * FRAME_NS - 4_000_000),
    ]
    assert [m.header.seq for m in frames] == [0, 1, 2, 3, 4]
    assert all(m.cause is DropCause.CAMERA_GAP for m in frames if isinstance(m, DroppedFrame))


times_ns = st.lists(st.integers(0, 200_000_000), min_size=1, max_size=20, unique=True).map(sorted)


@given(times_ns, times_ns)
def test_pairs_are_each_others_nearest_and_no_image_is_lost_or_used_twice(left: list[int], right: list[int]) -> None:
    shots = _paired({t: Path(f"l{t}") for t in left}, {t: Path(f"r{t}") for t in right})
    assert sorted(int(shot.left.name[1:]) for shot in shots if shot.left) == left
    assert sorted(int(shot.right.name[1:]) for shot in shots if shot.right) == right
    assert [shot.t_ns for shot in shots] == sorted(shot.t_ns for shot in shots)
    for shot in shots:
        if shot.left and shot.right:
            apart = abs(shot.t_ns - int(shot.right.name[1:]))
            assert apart <= 5_000_000
            assert apart == min(abs(shot.t_ns - t) for t in right)


def test_missing_imu_samples_are_counted(tmp_path: Path) -> None:
    make_folder(tmp_path)
    rows = imu_rows(41)
    table = "\n".join(rows[:10] + rows[13:20] + rows[21:])
    (tmp_path / "imu0.csv.gz").write_bytes(gzip.compress(table.encode()))
    samples = [message for message in AslFolder(tmp_path).inputs() if isinstance(message, ImuSample)]
    assert {place: s.lost_before for place, s in enumerate(samples) if s.lost_before} == {10: 3, 17: 1}


def test_the_truth_is_normalised_with_w_not_negative(tmp_path: Path) -> None:
    make_folder(tmp_path)
    assert AslFolder(tmp_path).truth_attitude() is None
    (tmp_path / "truth_lab.csv").write_text(
        f"# ns,p,q\n{T0_NS},1,2,3,-0.6,0,0.8,0,9,9\n{T0_NS + 1},1,2,4,0.6001,0,0.8,0,9,9\n"
    )
    track = AslFolder(tmp_path).truth_attitude()
    assert track is not None
    assert track.t_ns.tolist() == [T0_NS, T0_NS + 1]
    assert track.p_WB_m.tolist() == [[1, 2, 3], [1, 2, 4]]
    np.testing.assert_allclose(track.q_WB, [[0.6, 0, -0.8, 0], [0.6, 0, 0.8, 0]], atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(track.q_WB, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ("1,0,0,0,2,0,0,0", "line 2: the quaternion has the length 2, allowed 0.99 to 1.01"),
        ("1,0,0,0,nan,0,0,0", "line 2: a number that is not finite or beyond ±1e+12"),
        ("1,0,0,0,1,0,0", "line 2: 7 columns, allowed 8 or more"),
    ],
)
def test_an_unsound_truth_gets_one_line(tmp_path: Path, rows: str, line: str) -> None:
    make_folder(tmp_path)
    path = tmp_path / "state_groundtruth_estimate0" / "data.csv"
    path.parent.mkdir()
    path.write_text(f"#ns\n{rows}\n")
    with pytest.raises(DeviceError) as raised:
        AslFolder(tmp_path).truth_attitude()
    assert str(raised.value) == f"{path}: {line}"


def test_two_truths_get_one_line(tmp_path: Path) -> None:
    make_folder(tmp_path)
    for name in ("truth_a.csv", "truth_b.csv"):
        (tmp_path / name).write_text("1,0,0,0,1,0,0,0\n")
    with pytest.raises(DeviceError, match=r"more than one truth: truth_a\.csv, truth_b\.csv$"):
        AslFolder(tmp_path).truth_attitude()


@pytest.mark.parametrize(
    ("row", "line"),
    [
        (
            f"{T0_NS},0,0,0,0,0,9.8",
            f"line 43: time {T0_NS} ns, allowed above {T0_NS + 200_000_000} ns of the row before",
        ),
        (f"{T0_NS + 200_000_000},0,0,0,0,0,9.8", f"line 43: time {T0_NS + 200_000_000} ns, allowed above "),
        (f"{T0_NS + 10**9},0,nan,0,0,0,9.8", "line 43: a number that is not finite"),
        (f"{T0_NS + 10**9},0,0,0,0,0", "line 43: 6 columns, allowed 7 or more"),
        (f"{T0_NS + 10**9},0,0,x,0,0,9.8", "line 43: could not convert string to float: 'x'"),
        ("1.4e18,0,0,0,0,0,9.8", "line 43: time '1.4e18', allowed whole ns from 0 to 2^63 - 1"),
        (f"{2**63},0,0,0,0,0,9.8", f"line 43: time '{2**63}', allowed whole ns from 0 to 2^63 - 1"),
    ],
)
def test_an_unsound_imu_row_is_named(tmp_path: Path, row: str, line: str) -> None:
    make_folder(tmp_path)
    path = tmp_path / "imu0.csv.gz"
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()) + f"\n{row}\n".encode()))
    assert complaint(tmp_path).startswith(f"/imu0.csv.gz: {line}")


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "cannot be read: Compressed file ended"),
        (b"ns,0,0", "cannot be read: Not a gzipped file"),
        (gzip.compress(b"1,0,0,0,0,0,9.8\n" * 99, mtime=0)[:-12], "cannot be read: "),
        (gzip.compress(b"# nothing\n\n", mtime=0), "holds no row"),
        (gzip.compress(b"\xff\xfe", mtime=0), "is not text (byte 0)"),
    ],
    ids=["empty", "no gzip", "cut", "no row", "no text"],
)
def test_an_imu_table_that_cannot_be_read_is_named(tmp_path: Path, content: bytes, line: str) -> None:
    make_folder(tmp_path)
    (tmp_path / "imu0.csv.gz").write_bytes(content)
    found = complaint(tmp_path)
    assert found.startswith(f"/imu0.csv.gz: {line}") or (content == b"" and found == "/imu0.csv.gz: holds no row")


def image_file(root: Path, k: int) -> Path:
    return root / "cam0" / f"{T0_NS + k * FRAME_NS}.png"


def test_an_image_that_is_cut_damaged_or_empty_is_named(tmp_path: Path) -> None:
    make_folder(tmp_path)
    path = image_file(tmp_path, 2)
    sound = path.read_bytes()
    for size in (0, 20, len(sound) - 20):
        path.write_bytes(sound[:size])
        assert complaint(tmp_path) == f"/cam0/{path.name}: the image is cut off"
    path.write_bytes(b"not a picture" + sound[-12:])
    assert complaint(tmp_path) == f"/cam0/{path.name}: cannot be read as an image"


def test_the_messages_before_an_unreadable_image_still_come(tmp_path: Path) -> None:
    make_folder(tmp_path, imu_lead_ns=2_000_000_000)
    image_file(tmp_path, 2).write_bytes(b"")
    inputs = AslFolder(tmp_path).inputs()
    got: list[Input] = []
    with pytest.raises(DeviceError, match="cut off"):
        got.extend(inputs)
    assert Counter(type(message) for message in got)[StereoFrame] == 2
    assert arrival_ns(got[-1]) >= T0_NS + 2 * FRAME_NS + FRAME_LATENCY_NS - 10_000_000


def test_images_of_another_size_or_depth_are_named(tmp_path: Path) -> None:
    make_folder(tmp_path)
    path = image_file(tmp_path, 1)
    cv2.imwrite(str(path), image(1, 64, 40))
    assert complaint(tmp_path) == f"/cam0/{path.name}: is 64x40 px, allowed 60x40 px as the first image {T0_NS}.png"
    cv2.imwrite(str(path), image(1, 60, 40).astype(np.uint16) * 256)
    assert complaint(tmp_path) == f"/cam0/{path.name}: has 16 bits a pixel, allowed 8"


def test_names_that_are_no_times_are_named_and_hidden_files_ignored(tmp_path: Path) -> None:
    make_folder(tmp_path)
    (tmp_path / "cam0" / "._1.png").write_bytes(b"x")
    (tmp_path / "cam0" / "notes.txt").write_text("x")
    assert len(list(AslFolder(tmp_path).inputs())) > 10
    (tmp_path / "cam0" / "first.png").write_bytes(b"x")
    assert complaint(tmp_path) == "/cam0/first.png: an image's name must be its time in ns"
    (tmp_path / "cam0" / "first.png").rename(tmp_path / "cam0" / f"0{T0_NS}.png")
    assert complaint(tmp_path) == f"/cam0/{T0_NS}.png: has the same time as 0{T0_NS}.png"


def test_what_is_missing_altogether_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"absent: is no folder$"):
        AslFolder(tmp_path / "absent")
    assert complaint(tmp_path) == ": no image in cam0/ or cam0/data/ (PNG or JPEG named by the time in ns)"
    make_folder(tmp_path)
    (tmp_path / "imu0.csv.gz").unlink()
    assert complaint(tmp_path) == ": no IMU: none of imu0.csv, imu0.csv.gz, imu0/data.csv, imu0/data.csv.gz"
    shutil.rmtree(tmp_path / "cam1")
    assert complaint(tmp_path).startswith(": no image in cam1/")


def test_times_that_do_not_fit_together_are_named(tmp_path: Path) -> None:
    make_folder(tmp_path)
    path = tmp_path / "imu0.csv.gz"
    path.write_bytes(gzip.compress("\n".join(imu_rows(50, 5_000, T0_NS // 1000)).encode()))
    assert complaint(tmp_path).startswith(": images and IMU do not overlap in time: images 14037")
    path.write_bytes(gzip.compress(f"1,0,0,0,0,0,9.8\n{T0_NS},0,0,0,0,0,9.8".encode()))
    assert complaint(tmp_path).startswith(": longer than a day, allowed up to 24 h: images 14037")
    shutil.rmtree(tmp_path / "cam1")
    shutil.copytree(tmp_path / "cam0", tmp_path / "cam1")
    for image_path in list((tmp_path / "cam1").iterdir()):
        image_path.rename(image_path.with_stem(str(int(image_path.stem) + 20_000_000)))
    assert complaint(tmp_path) == ": no image of cam0 is within 5 ms of one of cam1"


def test_the_real_folder() -> None:
    folder = AslFolder(shared_data("euroc_v1_01_easy"))
    assert (folder.width_px, folder.height_px) == (752, 480)
    assert folder.unit == "asl-euroc_v1_01_easy"
    assert set(folder.sensor_files) == {"cam0", "cam1", "imu0"}
    inputs = list(folder.inputs())
    counts = Counter(type(message) for message in inputs)
    assert (counts[ImuSample], counts[StereoFrame], counts[DroppedFrame]) == (14_000, 10, 0)
    samples = [message for message in inputs if isinstance(message, ImuSample)]
    assert all(message.lost_before == 0 for message in samples)
    # At rest the accelerometer measures gravity, upwards in the world of the truth.
    track = folder.truth_attitude()
    assert track is not None
    w, x, y, z = track.q_WB[0]
    up_B = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])
    sf_B = np.mean([message.sf_B_mps2 for message in samples[:100]], axis=0)
    assert np.linalg.norm(sf_B) == pytest.approx(9.81, abs=0.1)
    assert np.degrees(np.arccos(up_B @ sf_B / np.linalg.norm(sf_B))) < 1.0
