"""The rig's camera in real time, with its rendering process. Nothing here depends on how fast the machine is."""

import os
import signal
import time
from collections.abc import Iterator
from multiprocessing import active_children

import numpy as np
import pytest

from drivers.camera.frame_grid import GRID_NS
from drivers.protocols import DeviceError
from messages import DropCause, StereoFrame
from sim_rig.camera.rig_camera import RigCamera
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def wearer() -> Iterator[SimulatedWearer]:
    """Yield one who is shared by the tests up to the one that closes his camera."""
    made = SimulatedWearer(1, scenario("level"), time.monotonic_ns(), perfect_calibration=True)
    yield made
    made.close()


def read(camera: RigCamera) -> StereoFrame:
    frame = camera.read(20.0)
    assert frame is not None
    return frame


def read_on(camera: RigCamera) -> None:
    for _ in range(50):
        camera.read(0.2)


def renderer_pid() -> int:
    (child,) = [process for process in active_children() if process.name == "gaiteyes-renderer"]
    assert child.pid is not None
    return child.pid


def test_frames_are_those_of_the_walk_and_none_comes_early_or_twice(wearer: SimulatedWearer) -> None:
    camera = wearer.camera()
    assert wearer.camera() is camera
    frames = []
    for _ in range(6):
        frame = read(camera)
        assert time.monotonic_ns() >= frame.header.t_arrival_ns
        frames.append(frame)
    seqs = [frame.header.seq for frame in frames]
    assert seqs == sorted(set(seqs))
    assert not frames[0].left.flags.writeable
    for frame in frames[::5]:
        (again,) = [f for f, _ in wearer.frames(1, first=frame.header.seq)]
        assert frame.header == again.header
        np.testing.assert_array_equal(frame.left, again.left)
        np.testing.assert_array_equal(frame.right, again.right)


def test_the_newest_frame_wins_and_an_old_one_is_never_handed_over(wearer: SimulatedWearer) -> None:
    camera = wearer.camera()
    before = read(camera)
    lost_before = sum(camera.dropped.values())
    time.sleep(8 * GRID_NS * 1e-9)
    asked_ns = time.monotonic_ns()
    after = read(camera)
    assert after.header.seq - before.header.seq >= 7
    assert after.header.t_arrival_ns > asked_ns - GRID_NS
    assert camera.dropped[DropCause.SUPERSEDED] >= 1
    assert sum(camera.dropped.values()) - lost_before == after.header.seq - before.header.seq - 1


def test_frames_the_renderer_could_not_finish_in_time_are_late(wearer: SimulatedWearer) -> None:
    camera = wearer.camera()
    before = read(camera)
    late_before = camera.dropped.get(DropCause.LATE, 0)
    pid = renderer_pid()
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.3)
    while camera.read(0.1) is not None:
        pass
    time.sleep(0.4)
    os.kill(pid, signal.SIGCONT)
    asked_ns = time.monotonic_ns()
    after = read(camera)
    assert camera.dropped[DropCause.LATE] - late_before >= 4
    assert after.header.seq > before.header.seq
    assert after.header.t_arrival_ns > asked_ns - GRID_NS


def test_held_frames_bound_memory_and_the_camera_recovers(wearer: SimulatedWearer) -> None:
    camera = wearer.camera()
    held: list[StereoFrame] = []
    while DropCause.POOL_EXHAUSTED not in camera.dropped:
        frame = camera.read(1.0)
        held += [frame] if frame is not None else []
    assert len(held) == 12
    newest = held.pop().header.seq
    assert read(camera).header.seq > newest


def test_ctrl_c_does_not_reach_the_renderer_and_close_ends_it(wearer: SimulatedWearer) -> None:
    camera = wearer.camera()
    pid = renderer_pid()
    os.kill(pid, signal.SIGINT)
    frame = read(camera)
    os.kill(pid, signal.SIGINT)
    assert read(camera).header.seq > frame.header.seq
    left = frame.left.copy()
    camera.close()
    camera.close()
    assert not [process for process in active_children() if process.name == "gaiteyes-renderer"]
    np.testing.assert_array_equal(frame.left, left)
    with pytest.raises(DeviceError, match="simulated camera: it is closed"):
        camera.read(0.0)


def test_a_renderer_that_dies_is_a_device_error_in_one_line_and_leaves_nothing_behind() -> None:
    files_before = len(os.listdir("/proc/self/fd"))
    wearer = SimulatedWearer(1, scenario("standing"), time.monotonic_ns())
    camera = wearer.camera()
    os.kill(renderer_pid(), signal.SIGKILL)
    for _ in range(2):
        with pytest.raises(DeviceError, match=r"^simulated camera: its rendering process has ended \(exit code -9\)$"):
            read_on(camera)
    wearer.close()
    assert len(os.listdir("/proc/self/fd")) <= files_before + 1  # multiprocessing's own helper process stays
