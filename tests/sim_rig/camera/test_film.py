"""A walk's frames from a file: the same as rendered, lap after lap, and never before their time."""

import os
import resource
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from drivers.camera.frame_grid import GRID_NS
from drivers.protocols import DeviceError
from messages import UserError
from sim_rig.camera.film import Film, make_film
from sim_rig.camera.rendered_frames import PAIR_BYTES, Scene
from sim_rig.camera.renderer import Effects
from sim_rig.camera.shutter import Shutter
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario, repeating, scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

FRAMES = 4
FRAME_S = 1e-9 * GRID_NS


def short_walk() -> Scenario:
    """Return a lap of a few seconds that does not take a whole number of frames."""
    world = WorldBuilder().level(2.0, "concrete").level(2.0, "brick").build()
    return Scenario("short", "four metres", world, (Stand(0.3), Pace().to(4.0), Stand(0.217)))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Film:
    wearer = SimulatedWearer(1, short_walk(), 0)
    return wearer.film(FRAMES * FRAME_S, tmp_path_factory.mktemp("film") / "walk.film")


def at_ns(monkeypatch: pytest.MonkeyPatch, t_ns: int) -> None:
    """Let it be this instant."""
    monkeypatch.setattr(time, "monotonic_ns", lambda: t_ns)


def at_frame(monkeypatch: pytest.MonkeyPatch, k: int) -> None:
    """Let it be the middle between the true exposures of frames k and k + 1 of a walk that begins at 0."""
    at_ns(monkeypatch, round((k + 0.5) * GRID_NS))


def test_a_film_is_what_the_renderer_shows(film: Film) -> None:
    wearer = SimulatedWearer(1, short_walk(), 0)
    assert film == Film(film.path, FRAMES, repeats=False)
    assert film.path.stat().st_size == FRAMES * PAIR_BYTES
    pairs = np.fromfile(film.path, np.uint8).reshape(FRAMES, 2, 720, 1280)
    for (frame, _), pair in zip(wearer.frames(FRAMES), pairs, strict=True):
        np.testing.assert_array_equal(np.stack((frame.left, frame.right)), pair)


def test_the_camera_hands_frames_over_when_they_are_due_and_none_after_the_end(
    film: Film, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_frame(monkeypatch, -10)
    wearer = SimulatedWearer(1, short_walk(), 0, film=film)
    camera = wearer.camera()
    shown = []
    for k in range(FRAMES):
        before_ns, due_ns = wearer.shutter.due_ns(k) - 1, wearer.shutter.due_ns(k)
        at_ns(monkeypatch, before_ns)
        assert camera.read(0.0) is None
        at_ns(monkeypatch, due_ns)
        frame = camera.read(0.0)
        assert frame is not None
        shown.append(frame)
    for frame, (rendered, _) in zip(shown, wearer.frames(FRAMES), strict=True):
        assert frame.header == rendered.header
        np.testing.assert_array_equal(frame.left, rendered.left)
        np.testing.assert_array_equal(frame.right, rendered.right)
    at_frame(monkeypatch, FRAMES + 3)
    assert camera.read(0.0) is None
    assert not camera.dropped
    camera.close()
    camera.close()
    with pytest.raises(DeviceError, match="it is closed"):
        camera.read(0.0)


def test_a_film_that_repeats_begins_anew_and_goes_on_from_the_present(
    film: Film, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutter = SimulatedWearer(1, short_walk(), 0).shutter
    at_frame(monkeypatch, 6)
    frames = Film(film.path, FRAMES, repeats=True).frames(shutter)
    pairs = np.fromfile(film.path, np.uint8).reshape(FRAMES, 2, 720, 1280)
    collected = list(frames.collect())
    assert [rendered.k for rendered in collected] == list(range(6, 27))  # a second ahead
    for rendered in collected[:5]:
        np.testing.assert_array_equal(np.stack(frames.pictures(rendered)), pairs[rendered.k % FRAMES])
    assert not list(frames.collect())
    frames.close()


def test_laps_that_repeat_look_alike() -> None:
    walk = repeating(short_walk())
    wearer = SimulatedWearer(2, walk, 0)
    frames = round(wearer.gait.lap_s / FRAME_S)
    assert wearer.gait.lap_s == pytest.approx(frames * FRAME_S, abs=1e-9)
    assert 0.0 <= wearer.gait.lap_s - short_walk().gait(2, 0).lap_s < FRAME_S
    t_ns = np.arange(0, round(wearer.gait.lap_s * 1e9), 7_000_000)
    first, second = wearer.gait.at(t_ns), wearer.gait.at(t_ns + frames * GRID_NS)
    for name in ("v_WB_mps", "a_WB_mps2", "R_WB", "w_WB_B_radps"):
        np.testing.assert_allclose(getattr(second, name), getattr(first, name), atol=1e-9)
    np.testing.assert_allclose(second.p_WB_m - first.p_WB_m, np.tile([[4.0, 0.0, 0.0]], (len(t_ns), 1)), atol=1e-9)

    # The blur of motion is drawn by the exposure, which has a period of its own.
    still = SimulatedWearer(2, walk, 0, effects=Effects(noise=False, motion_blur=False))
    for k in (0, frames // 2):
        ((now, _),), ((later, _),) = still.frames(1, first=k), still.frames(1, first=k + frames)
        difference = np.abs(now.left.astype(int) - later.left)
        assert difference.max() <= 1
        assert difference.mean() < 1e-3


@pytest.mark.parametrize("name", ["bus", "own-legs", "warming", "rough-ground", "polished-floor"])
def test_a_walk_that_changes_from_lap_to_lap_does_not_repeat(name: str) -> None:
    with pytest.raises(ValueError, match=f"no two laps of '{name}' are alike"):
        repeating(scenario(name))


def test_a_disk_that_is_too_full_is_told_before_anything_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = namedtuple("disk", "f_bavail f_frsize")
    monkeypatch.setattr(os, "statvfs", lambda _fd: disk(1_000_000, 2_000))
    with pytest.raises(UserError, match=r"a film of 1000 frames takes 1\.8 GB, 2\.0 GB are free"):
        SimulatedWearer(1, short_walk(), 0).film(50.0, tmp_path / "walk.film")
    assert (tmp_path / "walk.film").stat().st_size == 0


def test_a_limit_of_files_is_told(tmp_path: Path) -> None:
    least, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000_000, most))
    try:
        with pytest.raises(UserError, match=r"a film of 20 frames takes 0\.0 GB: File too large"):
            SimulatedWearer(1, short_walk(), 0).film(1.0, tmp_path / "walk.film")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (least, most))


KILLED = """
import sys
from pathlib import Path
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
if __name__ == "__main__":
    SimulatedWearer(1, scenario("level"), 0).film(20.0, Path(sys.argv[1]))
"""


def children_of(pid: int) -> list[int]:
    threads = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for thread in threads for child in thread.read_text().split()]


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.long
def test_nothing_renders_on_for_one_that_was_killed(tmp_path: Path) -> None:
    script, film = tmp_path / "killed.py", tmp_path / "walk.film"
    script.write_text(KILLED)
    home = Path(__file__).parents[3]
    with subprocess.Popen([sys.executable, script, film], cwd=home, env={**os.environ, "PYTHONPATH": str(home)}) as it:
        while len(renderers := children_of(it.pid)) < 1 + len(os.sched_getaffinity(0)):  # one is the resource tracker
            assert it.poll() is None
            time.sleep(0.05)
        it.kill()
    while any(runs(pid) for pid in renderers):
        time.sleep(0.1)
    with film.open("rb") as file:  # they ended long before the last frame
        file.seek(-PAIR_BYTES, os.SEEK_END)
        assert not any(file.read())


class BrokenShutter(Shutter):
    def exposure_s(self, k: int) -> NoReturn:
        raise RuntimeError(f"a shutter that jams at frame {k}")


def test_rendering_that_fails_is_told(tmp_path: Path) -> None:
    wearer = SimulatedWearer(1, short_walk(), 0)
    stereo = wearer.unit.stereo
    scene = Scene(wearer.unit, short_walk(), 1, 0)
    with pytest.raises(UserError, match=r"the renderer's process has ended \(exit code 1\)"):
        make_film(scene, BrokenShutter(stereo, stereo, 1, 0), 1, tmp_path / "walk.film")
