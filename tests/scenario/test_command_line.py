"""The command as a person uses it: whole processes, real files, one clear line for each mistake."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cli.console import VOID
from drivers.recording.recording import McapRecording
from messages import StereoFrame
from tests.bench.zenoh_peer import free_endpoint, taken

GAITEYES = [sys.executable, "-m", "cli.main"]


def gaiteyes(*arguments: object, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*GAITEYES, *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s, check=False
    )


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the recording and the summary of a short simulated walk."""
    folder = tmp_path_factory.mktemp("walk")
    done = gaiteyes(
        "demo", "--seconds", 7, "--scenario", "level", "--zenoh", free_endpoint(), "--can", "virtual:test",
        "--record", folder / "walk.mcap", "--json", folder / "walk.json",
    )  # fmt: skip
    assert done.returncode in (0, VOID), done.stderr
    assert bool(json.loads((folder / "walk.json").read_bytes())["void"]) is (done.returncode == VOID)
    return folder


@pytest.mark.realtime
def test_the_demo_sees_the_ground_and_says_so(walk: Path) -> None:
    facts = json.loads((walk / "walk.json").read_bytes())
    assert facts["run"]["health"]["zenoh_errors"] == 0
    # how often a busy machine makes samples or planes late is for docs/results; nothing else may cost a frame but
    # that a plane waits for its confirmation
    late = {"starting", "not_at_rest", "no_imu", "no_frame", "late", "not_planar", "unconfirmed"}
    refused, ground = facts["run"]["health"]["refused"], facts["ground"]["all"]
    assert set(refused) <= late
    if facts["void"]:
        pytest.skip(f"the host is too busy to see much: {facts['void']}")
    valid = ground["valid_share"] * ground["frames"]
    assert facts["run"]["imu_lost"] == 0
    assert ground["frames"] > 20
    assert valid >= 10, refused
    assert refused.get("not_planar", 0) < 0.2 * valid, refused
    assert ground["height_rms_mm"] < 15.0


@pytest.mark.long
@pytest.mark.realtime
def test_a_recording_that_stops_early_is_told_by_the_exit_code(tmp_path: Path) -> None:
    """The file may not grow beyond 45 MB, as on a disk that fills."""
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (45_000_000,) * 2); import cli.main; "
    command = ["demo", "--seconds", "8", "--scenario", "level", "--zenoh", free_endpoint(), "--can", "virtual:test"]
    path = tmp_path / "walk.mcap"
    done = subprocess.run(
        [sys.executable, "-c", limited + "cli.main.main()", *command, "--record", str(path)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert f"recording {path} stopped: File too large" in done.stdout
    assert len(McapRecording(path).truth()) > 2


@pytest.mark.long
@pytest.mark.realtime
def test_outputs_alone_are_recorded_without_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "outputs.mcap"
    done = gaiteyes(
        "demo", "--seconds", 4, "--scenario", "level", "--zenoh", free_endpoint(), "--can", "virtual:test",
        "--record", path, "--outputs-only",
    )  # fmt: skip
    assert done.returncode in (0, VOID), done.stderr
    assert path.stat().st_size < 1_000_000
    assert gaiteyes("replay", path).stderr.endswith("holds outputs only, recorded without inputs: nothing to replay\n")


def lines_of(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_bytes().splitlines()]


@pytest.mark.long
@pytest.mark.realtime
def test_two_replays_give_the_same_bytes_and_what_was_said_live(walk: Path, tmp_path: Path) -> None:
    for name in ("one.jsonl", "two.jsonl"):
        assert gaiteyes("replay", walk / "walk.mcap", "--out", tmp_path / name).returncode == 0
    assert (tmp_path / "one.jsonl").read_bytes() == (tmp_path / "two.jsonl").read_bytes()
    replayed = [line for line in lines_of(tmp_path / "one.jsonl") if line["topic"] == "ground"]
    live = recorded_grounds(walk / "walk.mcap")
    assert [line | {"topic": "ground"} for line in live] == replayed


def recorded_grounds(path: Path) -> list[dict[str, object]]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["ground"], log_time_order=False)
        return [json.loads(message.data) for _, _, message in messages]


@pytest.mark.realtime
def test_a_recording_cut_in_the_middle_replays_up_to_the_damage(walk: Path, tmp_path: Path) -> None:
    whole = (walk / "walk.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    done = gaiteyes("replay", cut, "--out", tmp_path / "cut.jsonl", "--json", tmp_path / "cut.json")
    assert done.returncode == 3, done.stderr
    assert str(cut) in json.loads((tmp_path / "cut.json").read_bytes())["damage"]
    progress, told = done.stderr.strip().split("\n")
    assert progress == "gaiteyes: replaying"
    assert "damage" in told
    assert len(lines_of(tmp_path / "cut.jsonl")) > 100


@pytest.mark.long
@pytest.mark.realtime
def test_interrupting_ends_cleanly_and_keeps_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    outlets = ["--zenoh", free_endpoint(), "--can", "virtual:test"]
    command = [*GAITEYES, "demo", "--seconds", "20", *outlets, "--record", str(path)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline_s = time.monotonic() + 90.0
    while not (path.exists() and path.stat().st_size > 20e6) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode in (0, VOID), err
    assert "Traceback" not in err
    assert "recorded to" in out
    recording = McapRecording(path)
    inputs = list(recording.inputs())
    assert recording.damage is None
    assert sum(isinstance(message, StereoFrame) for message in inputs) > 5


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["replay", "nowhere.mcap"], "nowhere.mcap"),
        (["replay", "pyproject.toml"], "pyproject.toml"),
        (["replay", "docs"], "docs: no image in cam0/"),
        (["demo", "--scenario", "moon"], "moon"),
        (["demo", "--speed", "9"], "speed is 9.0 m/s, allowed is 0.4 to 2.0 m/s"),
        (["demo", "--can", "flexray:1"], "CAN 'flexray:1': expected INTERFACE:CHANNEL"),
        (["demo", "--json", "/nowhere/facts.json"], "/nowhere/facts.json: its folder does not exist"),
        (["run", "--config", "nowhere.toml"], "nowhere.toml: No such file"),
        (["evaluate", "rig", "--seeds", "a"], "--seeds a: expected"),
        (["run", "--outputs-only"], "--last and --outputs-only choose a part of what --record FILE records"),
        (["run", "--nonsense"], "No such option: --nonsense"),
        (["demo", "--seconds", "soon"], "'--seconds'"),
    ],
)
def test_a_mistake_is_one_clear_line(arguments: list[str], line: str) -> None:
    done = gaiteyes(*arguments)
    assert done.returncode == 2
    assert line in done.stderr
    assert done.stderr.strip().count("\n") == 0


def test_a_mistyped_recording_is_one_clear_line_before_anything_is_rendered(tmp_path: Path) -> None:
    done = gaiteyes("demo", "--zenoh", free_endpoint(), "--record", tmp_path / "nowhere" / "walk.mcap")
    assert done.returncode == 2
    assert done.stderr == f"gaiteyes: {tmp_path}/nowhere/walk.mcap: cannot record here: No such file or directory\n"
    assert done.stdout == ""


@pytest.mark.long
@pytest.mark.realtime
def test_a_taken_socket_is_told_and_leaves_no_recording_behind(tmp_path: Path) -> None:
    endpoint, path = free_endpoint(), tmp_path / "walk.mcap"
    with taken(endpoint):
        done = gaiteyes("demo", "--seconds", 5, "--zenoh", endpoint, "--can", "virtual:test", "--record", path)
    assert done.returncode == 2
    assert endpoint in done.stderr
    assert done.stderr.strip().count("\n") == 0
    assert not path.exists()


@pytest.mark.realtime
def test_run_never_falls_back_to_simulation(tmp_path: Path, walk: Path) -> None:
    config = tmp_path / "gaiteyes.toml"
    config.write_text("[imu]\nbus = 250\n")
    (tmp_path / "calibration.yaml").write_text(McapRecording(walk / "walk.mcap").calibration_text)
    done = gaiteyes("run", "--config", config)
    assert done.returncode == 2
    assert "/dev/i2c-250" in done.stderr


def test_help_names_the_commands() -> None:
    done = gaiteyes("--help")
    assert done.returncode == 0
    assert all(command in done.stdout for command in ("run", "demo", "replay", "evaluate"))
