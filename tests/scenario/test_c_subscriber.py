"""The subscriber in C, made as docs/listening.md says, refuses and tells exactly what the one in Python does."""

import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import can
import pytest

from daemon.config import Configuration, format_configuration
from daemon.setpoints import SetpointSettings
from drivers.can.settings import CanInterface, CanSettings
from drivers.zenoh.settings import ZenohSettings
from messages import GaitPhase, GroundPlane, Reason, Source, Status
from messages.can_encoder import CanEncoder
from messages.can_estimates import ReceivedGround
from messages.can_frames import CanFrame, CanMessage, can_id
from messages.can_receiver import CanReceiver
from messages.can_setpoint import SetpointReceiver
from messages.refusal import Refusal
from tests.bench.can_samples import ground, health, invalid_ground, setpoint, stamp
from tests.bench.zenoh_peer import free_endpoint
from tests.docs.pages import ROOT

SOURCES = ROOT / "examples" / "c"
CYCLE_NS, US_NS = 50_000_000, 1_000
SILENT = (Refusal.FIRST_HALF, Refusal.OTHER_MESSAGE)
LONGEST_LINES = {"frame_checks.c": 120, "ground_receiver.c": 100, "setpoint_receiver.c": 220}


@pytest.fixture(scope="module")
def subscriber(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("c")
    generated = [sys.executable, "-m", "cantools", "generate_c_source", str(ROOT / "messages" / "gaiteyes.dbc")]
    subprocess.run(generated, cwd=folder, check=True, capture_output=True)
    own = sorted(SOURCES.glob("*.c"))
    strict = ["-std=c11", "-D_DEFAULT_SOURCE", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsanitize=undefined"]
    command = [compiler, *strict, "-I.", f"-I{SOURCES}", *map(str, own), "gaiteyes.c", "-o", "can_subscriber"]
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "can_subscriber"


def drawn(chance: random.Random) -> GroundPlane:
    """Return a ground as the service may send it: mostly valid, now and then not, or beyond what a frame can tell."""
    kind = chance.random()
    if kind < 0.1:
        return invalid_ground(
            *chance.choice([(Status.INVALID, Reason.LOW_TEXTURE), (Status.INITIALISING, Reason.STARTING)])
        )
    return ground(
        slope_sagittal_rad=chance.uniform(-0.4, 0.4) * (1.0 if kind < 0.95 else 10.0),
        slope_frontal_rad=chance.uniform(-0.3, 0.3),
        height_m=chance.uniform(0.6, 1.4),
        covariance=(chance.uniform(1e-6, 1e-2), 0.0, 0.0, chance.uniform(1e-6, 1e-2), 0.0, chance.uniform(1e-7, 1e-3)),
    )


def stream(chance: random.Random, pairs: int) -> list[tuple[int, CanFrame]]:
    """Return frames with their times of reception: lost, repeated, late, torn, flipped and foreign ones among them."""
    encoder, heard, t_ns = CanEncoder(), list[tuple[int, CanFrame]](), 1_000_000_000_000
    for seq in range(pairs):
        t_ns += CYCLE_NS if chance.random() < 0.97 else chance.choice([5_000_000, 200_000_000, 400_000_000])
        source = chance.choice([Source.SIMULATED, Source.REPLAY]) if chance.random() < 0.05 else Source.LIVE
        age_s = chance.uniform(0.01, 0.11) if chance.random() < 0.97 else chance.choice([0.3, 0.2])
        for place, frame in enumerate(encoder.ground(drawn(chance), stamp(seq=seq, source=source), age_s)):
            at_ns = t_ns + place * chance.choice([300_000, 300_000, 300_000, 40_000_000])
            data, fate = bytearray(frame.data), chance.random()
            if fate < 0.04:
                continue
            if fate < 0.08:
                data[chance.randrange(8)] ^= 1 << chance.randrange(8)
            if 0.08 <= fate < 0.1:
                data = data[: chance.randrange(8)]
            heard.append((at_ns // US_NS * US_NS, CanFrame(frame.can_id, bytes(data))))
            if 0.1 <= fate < 0.13:
                heard.append((at_ns // US_NS * US_NS, CanFrame(frame.can_id, bytes(data))))
        if chance.random() < 0.03:  # another sender, whose frames are not heard
            for _ in range(6):
                encoder.ground(ground(), stamp(), 0.04)
        if seq % 20 == 0:
            heard.append((t_ns // US_NS * US_NS, encoder.health(health(), stamp(seq=seq))))
    return heard


def logged(t_ns: int, frame: CanFrame) -> str:
    """Return the line that `candump -L` writes of a frame."""
    seconds, rest_ns = divmod(t_ns, 1_000_000_000)
    flags = "#0" if frame.can_id == can_id(CanMessage.SETPOINT_FD) else ""
    return f"({seconds}.{rest_ns // US_NS:06d}) can0 {frame.can_id:X}#{flags}{frame.data.hex().upper()}\n"


def said(subscriber: Path, heard: list[tuple[int, CanFrame]], *options: str) -> list[str]:
    """Return what the subscriber in C says of the frames."""
    log = "".join(logged(*each) for each in heard)
    done = subprocess.run([subscriber, "-", *options], input=log, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def told(receiver: CanReceiver[ReceivedGround], t_ns: int, frame: CanFrame) -> str | None:
    found = receiver.feed(frame.can_id, frame.data, t_ns)
    if isinstance(found, Refusal):
        return None if found in SILENT else f"refused {found.value}"
    deviations = f"{found.slope_sagittal_sd_rad:.4f} {found.slope_frontal_sd_rad:.4f} {found.height_sd_m:.4f}"
    slopes = f"{found.slope_sagittal_rad:+.4f} {found.slope_frontal_rad:+.4f} rad"
    age = f"age {found.age_s:.6f} s calibration {found.calibration_id}"
    return f"ground {slopes} {found.height_m:.3f} m sd {deviations} {age}"


@pytest.mark.long
@pytest.mark.parametrize("options", [(), ("--accept-simulated",)])
def test_it_says_of_each_frame_what_the_python_receiver_says(subscriber: Path, options: tuple[str, ...]) -> None:
    heard = stream(random.Random(1), 1500)
    receiver = CanReceiver(ReceivedGround, max_age_s=0.1, accept_simulated=bool(options))
    expected = [line for each in heard if (line := told(receiver, *each)) is not None]
    assert said(subscriber, heard, *options) == expected
    seen = {line.split()[1] for line in expected if line.startswith("refused")}
    protection = {"wrong_crc", "wrong_length", "wrong_sequence", "initial", "repeated", "too_soon", "frame_mismatch"}
    always = protection | {"not_valid", "stale"}
    assert seen == (always if options else always | {"not_live"})
    assert sum(line.startswith("ground") for line in expected) > 500


def updates(chance: random.Random, count: int, *, fd: bool) -> list[tuple[int, CanFrame]]:
    """Return the frames of set-points with their times of reception, lost, late, repeated and flipped ones too."""
    encoder, heard, t_ns = CanEncoder(), list[tuple[int, CanFrame]](), 1_000_000_000_000
    for seq in range(count):
        t_ns += CYCLE_NS if chance.random() < 0.95 else chance.choice([5_000_000, 100_000_000, 400_000_000])
        source = chance.choice([Source.SIMULATED, Source.REPLAY]) if chance.random() < 0.05 else Source.LIVE
        age_s = chance.uniform(0.01, 0.16) if chance.random() < 0.95 else chance.choice([0.3, float("nan")])
        sent = setpoint(
            slope_rad=chance.uniform(-0.2, 0.2),
            equilibrium_rad=tuple(chance.uniform(-0.5, 0.5) for _ in range(5)),
            stiffness_nm_per_rad=tuple(chance.uniform(10.0, 900.0) for _ in range(5)),
            phase=chance.choice(list(GaitPhase)),
        )
        if chance.random() < 0.1:
            sent = sent.without_numbers(chance.choice([Reason.UNCERTAIN, Reason.NO_FRAME]))
        told = stamp(seq=seq, source=source)
        frames = (encoder.setpoint_fd(sent, told, age_s),) if fd else encoder.setpoint(sent, told, age_s)
        for place, frame in enumerate(frames):
            data, fate = bytearray(frame.data), chance.random()
            if fate < 0.04:
                continue
            if fate < 0.06:
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            if 0.06 <= fate < 0.07:
                data = data[: chance.randrange(len(data))]
            at_ns = t_ns + place * 300_000
            heard += [(at_ns, CanFrame(frame.can_id, bytes(data)))] * (2 if 0.07 <= fate < 0.09 else 1)
    return heard


def told_setpoint(receiver: SetpointReceiver, t_ns: int, frame: CanFrame) -> str | None:
    found = receiver.feed(frame.can_id, frame.data, t_ns)
    if isinstance(found, Refusal):
        return None if found in SILENT else f"refused setpoint {found.value}"
    curves = zip(found.equilibrium_rad, found.stiffness_nm_per_rad, found.damping_nms_per_rad, strict=True)
    points = " ".join(f"{one:+.4f} {stiff:.1f} {damp:.2f}" for one, stiff, damp in curves)
    phase = list(GaitPhase).index(found.phase)
    ground = f"slope {found.slope_rad:+.4f} sd {found.slope_sd_rad:.4f} rad phase {phase} age {found.age_s:.6f} s"
    return (
        f"setpoint {ground} {points} sd {found.equilibrium_sd_rad:.3f} {found.stiffness_sd_share:.2f} "
        f"{found.damping_sd_share:.2f}"
    )


@pytest.mark.long
@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("options", [(), ("--accept-simulated",)])
def test_it_says_of_each_set_point_what_the_python_receiver_says(
    subscriber: Path, options: tuple[str, ...], fd: bool
) -> None:
    heard = updates(random.Random(2), 1200, fd=fd)
    receiver = SetpointReceiver(accept_simulated=bool(options))
    expected = [line for each in heard if (line := told_setpoint(receiver, *each)) is not None]
    assert said(subscriber, heard, *options) == expected
    seen = {line.split()[2] for line in expected if line.startswith("refused")}
    always = {"wrong_crc", "wrong_length", "initial", "repeated", "too_soon", "not_valid", "stale"}
    assert seen >= (always if options else always | {"not_live"})
    assert sum(line.startswith("setpoint") for line in expected) > 300


@pytest.mark.long
@pytest.mark.realtime
def test_it_says_of_a_running_service_what_the_python_receivers_say(subscriber: Path, tmp_path: Path) -> None:
    channel = f"239.74.163.{100 + os.getpid() % 100}"
    configuration = Configuration(
        device="c-subscriber",
        can=CanSettings(interface=CanInterface.UDP_MULTICAST, channel=channel),
        zenoh=ZenohSettings(listen=free_endpoint()),
        setpoint=SetpointSettings(mass_kg=75.0),
    )
    (tmp_path / "gaiteyes.toml").write_text(format_configuration(configuration), encoding="utf-8")
    command = [sys.executable, "-m", "cli.main", "demo", "--scenario", "level", "--seconds", "14"]
    with (
        can.Bus(channel, "udp_multicast", ignore_config=True, hop_limit=0, fd=True) as bus,
        subprocess.Popen([*command, "--config", str(tmp_path / "gaiteyes.toml")], stdout=subprocess.DEVNULL) as demo,
    ):
        messages = list[can.Message]()
        while demo.poll() is None:
            message = bus.recv(0.5)
            messages += [] if message is None else [message]
    t_ns = [round(1e6 * (message.timestamp - messages[0].timestamp)) * US_NS + 10**12 for message in messages]
    heard = [
        (at_ns, CanFrame(message.arbitration_id, bytes(message.data)))
        for at_ns, message in zip(t_ns, messages, strict=True)
    ]
    ground = CanReceiver(ReceivedGround, max_age_s=0.1, accept_simulated=True)
    setpoints = SetpointReceiver(accept_simulated=True)
    both = [line for each in heard for line in (told(ground, *each), told_setpoint(setpoints, *each))]
    expected = [line for line in both if line is not None]
    assert said(subscriber, heard, "--accept-simulated") == expected
    assert sum(frame.can_id == can_id(CanMessage.SETPOINT) for _, frame in heard) > 100
    assert not any("wrong_crc" in line or "wrong_length" in line for line in expected)


@pytest.mark.long
def test_rubbish_and_an_absent_bus_are_one_line(subscriber: Path) -> None:
    for arguments, text, said in (
        (["-"], "rubbish\n", "not a line of candump -L: rubbish"),
        (["nocan"], "", "nocan: "),
        ([], "", "usage: "),
    ):
        done = subprocess.run([subscriber, *arguments], input=text, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(said)
        assert done.stderr.count("\n") == 1


def test_it_is_short_enough_to_be_read_and_its_data_ids_are_those_of_the_dbc() -> None:
    dbc = (ROOT / "messages" / "gaiteyes.dbc").read_text(encoding="utf-8")
    for name, longest in LONGEST_LINES.items():
        assert len((SOURCES / name).read_text(encoding="utf-8").splitlines()) <= longest
    for name, frame_ids in (("ground_receiver.c", (416, 417)), ("setpoint_receiver.c", (424, 425))):
        receiver = (SOURCES / name).read_text(encoding="utf-8")
        for frame_id in frame_ids:
            ids = dbc.split(f'BA_ "E2EDataIdList" BO_ {frame_id} "')[1].split('"')[0].split()
            assert ", ".join(f"0x{each}" for each in ids) in receiver
    assert 'BA_ "E2EDataId" BO_ 426 41901;' in dbc
    assert "DATA_ID_FD = 41901" in receiver
