"""Two cameras as one: which frames are partners, which pairs are refused, and what happens to the rest."""

import numpy as np
import pytest

from drivers.camera.pair import V4l2CameraPair
from drivers.protocols import DeviceError
from messages import DropCause, StereoFrame
from sim_rig.camera.v4l2_node import Fault, Mode
from tests.bench.v4l2_pair_bench import HEIGHT, LEFT, RIGHT, T0_NS, WIDTH, Cameras, cameras, eye_scene, jitter_s


def read(source: V4l2CameraPair, timeout_s: float = 0.2) -> StereoFrame:
    frame = source.read(timeout_s)
    assert frame is not None
    return frame


def sequences(source: V4l2CameraPair, count: int) -> list[int]:
    return [read(source).header.seq for _ in range(count)]


def read_until_error(source: V4l2CameraPair, found: list[int] | None = None) -> None:
    """Read for 20 s at most, or until the cameras fail; the sequence numbers go into `found`."""
    for _ in range(400):
        frame = source.read(0.05)
        if frame is not None and found is not None:
            found.append(frame.header.seq)


def refusal(bench: Cameras) -> str:
    with pytest.raises(DeviceError) as caught:
        bench.pair()
    line = str(caught.value)
    assert "\n" not in line
    return line


# Which frames come.


@pytest.mark.parametrize("code", ["GREY", "YUYV"])
@pytest.mark.parametrize("row_padding", [0, 6])
def test_each_eye_shows_what_its_own_camera_saw_in_the_same_frame(code: str, row_padding: int) -> None:
    source = cameras({"row_padding": row_padding}, {"row_padding": row_padding}, code=code).pair()
    for _ in range(4):
        frame = read(source)
        np.testing.assert_array_equal(frame.left, eye_scene(0)(frame.header.seq)[0])
        np.testing.assert_array_equal(frame.right, eye_scene(1)(frame.header.seq)[0])


def test_header_and_stamp_are_the_left_eyes() -> None:
    source = cameras(right={"startup_s": 0.1004}).pair()
    header = read(source).header
    assert header.t_exposure_ns == T0_NS + 100_000_000
    assert header.t_arrival_ns >= T0_NS + 115_400_000
    assert source.skew_s == pytest.approx(0.0004)


def test_every_third_pair_comes_and_the_others_are_no_drops() -> None:
    source = cameras({"stamp_jitter_s": jitter_s(1, 0.0004)}, {"stamp_jitter_s": jitter_s(2, 0.0004)}).pair()
    assert sequences(source, 100) == list(range(0, 300, 3))
    assert source.dropped == {}


def test_an_eye_that_takes_longer_to_arrive_only_delays_its_pair() -> None:
    source = cameras(right={"transfer_s": 0.045}).pair()
    assert sequences(source, 20) == list(range(0, 60, 3))
    assert source.dropped == {}


def test_eyes_that_count_differently_are_paired_by_their_stamps() -> None:
    source = cameras(right={"startup_s": 0.1 + 5 / 60}).pair()
    frame = read(source)
    assert frame.header.seq == 5
    np.testing.assert_array_equal(frame.right, eye_scene(1)(0)[0])
    assert source.dropped == {DropCause.UNPAIRED: 5}


def test_a_frame_lost_in_one_eye_leaves_the_others_unpaired() -> None:
    source = cameras({"faults": {3: Fault.LOST}}, {"faults": {10: Fault.LOST, 11: Fault.SHORT}}).pair()
    assert sequences(source, 5) == [0, 4, 6, 9, 12]
    assert source.dropped == {DropCause.CAMERA_GAP: 2, DropCause.CORRUPT: 1, DropCause.UNPAIRED: 3}


def test_a_pair_of_large_skew_is_refused_and_the_next_stands_in() -> None:
    late = {6: 0.003}
    source = cameras(right={"stamp_jitter_s": lambda frame: late.get(frame, 0.0)}).pair()
    assert sequences(source, 4) == [0, 3, 7, 9]
    assert source.dropped == {DropCause.UNPAIRED: 1}


def test_the_newest_pair_wins_when_the_reader_was_away() -> None:
    bench = cameras()
    source = bench.pair()
    assert sequences(source, 1) == [0]
    bench.machine.sleep(0.101)
    assert read(source, 0.0).header.seq == 6
    assert source.dropped == {DropCause.SUPERSEDED: 1}
    bench.machine.sleep(1.001)
    sequences(source, 1)
    assert sequences(source, 1)[0] > 60


def test_a_full_pool_is_counted_and_recovers() -> None:
    source = cameras().pair(pool_frames=2)
    held = [read(source), read(source)]
    assert source.read(0.11) is None
    assert source.dropped == {DropCause.POOL_EXHAUSTED: 2}
    held.clear()
    assert read(source).header.seq == 12


# Cameras that run freely.


def test_cameras_that_expose_from_the_start_of_their_stream_are_brought_together() -> None:
    source = cameras(right={"startup_s": 0.1062}).pair()
    with pytest.raises(DeviceError, match=r"right camera .* expose 6.2 ms apart, camera.max_skew_s allows 1 ms; both"):
        read_until_error(source)
    assert 50 <= source.dropped[DropCause.UNPAIRED] <= 60
    read(source, 2.0)
    assert set(np.diff(sequences(source, 20))) == {3}
    assert abs(source.skew_s) < 1e-4


def test_a_steady_phase_out_of_bounds_is_an_error_not_silence() -> None:
    source = cameras({"phase_ns": T0_NS}, {"phase_ns": T0_NS + 5_000_000}).pair()
    for _ in range(4):
        with pytest.raises(DeviceError, match=r"expose 5\.0 ms apart"):
            read_until_error(source)


def test_free_cameras_slowed_by_poor_light_do_not_starve_in_silence() -> None:
    slow: dict[str, object] = {"slow_period_s": 1 / 30}
    source = cameras({"phase_ns": T0_NS} | slow, {"phase_ns": T0_NS + 12_000_000} | slow).pair(max_skew_s=0.00834)
    with pytest.raises(DeviceError, match="ms apart"):
        read_until_error(source)


@pytest.mark.parametrize("phase_ms", [-8.0, -3.0, 0.0, 4.0, 8.0])
def test_with_a_bound_of_half_a_period_every_phase_serves_the_grid(phase_ms: float) -> None:
    source = cameras({"phase_ns": T0_NS}, {"phase_ns": T0_NS + round(phase_ms * 1e6)}).pair(max_skew_s=0.00834)
    assert set(np.diff(sequences(source, 50))) == {3}
    assert source.skew_s == pytest.approx(phase_ms * 1e-3, abs=1e-6)


def test_clocks_that_drift_are_used_while_they_agree() -> None:
    drift = 2e-4  # of one clock against the other: 0.2 ms a second
    source = cameras(right={"stamp_jitter_s": lambda frame: drift * frame / 60}).pair()
    found: list[int] = []
    with pytest.raises(DeviceError, match="expose"):
        read_until_error(source, found)
    assert len(found) == pytest.approx(20 * 0.001 / drift, abs=5)


# Cameras that fail.


def test_a_missing_eye_is_named() -> None:
    assert "right camera /dev/video2: no such device" in refusal(cameras(right={"path": "/dev/video7"}))
    assert "left camera /dev/video0: no such device" in refusal(cameras({"path": "/dev/video7"}))


def test_an_eye_of_another_size_is_named_and_the_other_left_free() -> None:
    bench = cameras(right={"modes": (Mode("GREY", 2 * WIDTH, HEIGHT, (60,)),)})
    assert refusal(bench) == (
        f"right camera {RIGHT} (Eye 1): an eye of 64x32, the calibration's size, needs GREY or YUYV 64x32; "
        "the camera answers GREY 128x32 and offers GREY 128x32 (60 Hz)"
    )
    bench.right.modes = bench.left.modes
    assert sequences(bench.pair(), 1) == [0]


def test_eyes_of_different_rates_are_refused() -> None:
    bench = cameras(right={"rates_hz": (30,)})
    assert refusal(bench) == (
        f"left camera {LEFT} (Eye 0) 60 Hz and right camera {RIGHT} (Eye 1) 30 Hz: both cameras must have one rate"
    )


@pytest.mark.parametrize("eye", ["left", "right"])
def test_an_unplugged_eye_is_named_and_both_come_back(eye: str) -> None:
    bench = cameras()
    source = bench.pair()
    sequences(source, 3)
    node = getattr(bench, eye)
    node.unplug()
    with pytest.raises(DeviceError, match=f"^{eye} camera /dev/video[02] .*unplugged"):
        source.read(0.2)
    with pytest.raises(DeviceError, match=f"^{eye} camera /dev/video[02]: no such device"):
        source.read(1.0)
    node.plug_in()
    before_ns = bench.machine.monotonic_ns()
    assert read(source, 2.0).header.t_exposure_ns > before_ns - 10**9
    assert set(np.diff(sequences(source, 10))) == {3}


@pytest.mark.parametrize("eye", ["left", "right"])
def test_a_silent_eye_is_named(eye: str) -> None:
    bench = cameras()
    source = bench.pair()
    sequences(source, 3)
    getattr(bench, eye).slow_period_s = 1e6
    with pytest.raises(DeviceError, match=f"^{eye} camera .*no image for 3 s"):
        read_until_error(source)
    getattr(bench, eye).slow_period_s = 0.0
    assert read(source, 2.0).left.any()


def test_closed_cameras_are_free_and_read_no_more() -> None:
    bench = cameras()
    source = bench.pair()
    sequences(source, 2)
    source.close()
    source.close()
    with pytest.raises(DeviceError, match="left /dev/video0, right /dev/video2: closed"):
        source.read(0.1)
    assert sequences(bench.pair(), 2) == [0, 3]
