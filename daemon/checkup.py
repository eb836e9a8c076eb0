"""What `gaiteyes check` looks at before a unit is worn: each device for some seconds, and what the host grants.

Every look gives findings, never an exception: a device that fails is what a check-up is for.
"""

import enum
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np

from calib.fitness import shortcomings
from daemon.state_file import read_state
from drivers.can.link import CanLink
from drivers.can.settings import CanInterface, CanSettings
from drivers.imu.self_test import SelfTest
from drivers.protocols import DeviceError, FrameSource, ImuSource
from messages import TOPICS, Frame, ImuSample, StereoFrame, UnitCalibration, UserError
from messages.constants import STANDARD_GRAVITY_MPS2

IMU_RATE_HZ = TOPICS["imu"].rate_hz
RATE_TOLERANCE = 0.04
REST_SF_STD_MPS2 = 0.3
REST_RATE_STD_RADPS = 0.05
GRAVITY_TOLERANCE_MPS2 = 0.8
GRID_HZ = TOPICS["frame"].rate_hz
DARK, BRIGHT = 20.0, 235.0
_LIGHT = "look for a cap, dirt, darkness or glare"


class Verdict(str, enum.Enum):
    """What one look found."""

    FINE = "fine"
    NOTICE = "notice"  # works, but could be better
    FAULT = "fault"


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the check-up: what was looked at, what was seen, and what a person does next where it is not fine."""

    subject: str
    verdict: Verdict
    seen: str
    next: str = ""


def guarded(subject: str, look: Callable[[], Iterator[Finding]], cure: Callable[[], str]) -> Iterator[Finding]:
    """Yield what `look` finds; a device that fails becomes a fault, and `cure` says what to do."""
    try:
        yield from look()
    except DeviceError as error:
        yield Finding(subject=subject, verdict=Verdict.FAULT, seen=str(error), next=cure())


def check_calibration(calibration: UnitCalibration) -> Iterator[Finding]:
    """Judge by its own residual whether a unit with this calibration is fit to be worn."""
    found = list(shortcomings(calibration))
    for each in found:
        told = f"not fit to be worn: {each.what}" if each.is_fault else each.what
        yield Finding(
            subject="calibration",
            verdict=Verdict.FAULT if each.is_fault else Verdict.NOTICE,
            seen=told,
            next=each.cure,
        )
    if not found:
        seen = f"{calibration.id} of unit {calibration.unit}: nothing is too uncertain"
        yield Finding(subject="calibration", verdict=Verdict.FINE, seen=seen)


def check_self_test(test: SelfTest) -> Iterator[Finding]:
    """Hold the chip's answer to its electrical self-test against the factory's."""
    changes = ", ".join(f"{axis.axis} {100 * axis.change_share:+.0f} %" for axis in test.axes)
    failed = ", ".join(axis.axis for axis in test.axes if not axis.passed)
    yield _found(
        "IMU self-test",
        f"{test.chip}, change against the factory: {changes}" + (f"; failed: {failed}" if failed else ""),
        fault=not test.passed,
        cure="lay the unit still and check again; a chip that fails twice is to be replaced",
    )


def check_imu(imu: ImuSource, seconds: float) -> Iterator[Finding]:
    """Take samples for `seconds`: rate, losses, noise, and gravity if the unit is at rest."""
    samples = _samples(imu, seconds)
    if len(samples) < 2:
        yield Finding(
            subject="IMU",
            verdict=Verdict.FAULT,
            seen=f"{len(samples)} samples in {seconds:g} s",
            next="check its supply and the wires SDA and SCL",
        )
        return
    span_s = (samples[-1].t_sample_ns - samples[0].t_sample_ns) * 1e-9
    rate_hz = (samples[-1].seq - samples[0].seq) / span_s
    lost = sum(sample.lost_before for sample in samples[1:])
    counters = imu.counters
    yield _found(
        "IMU stream",
        f"{rate_hz:.2f} samples a second, {lost} lost, {counters.bus_errors} bus errors, {counters.resets} resets, "
        f"{counters.edges_missed} data-ready edges missed",
        fault=abs(rate_hz / IMU_RATE_HZ - 1.0) > RATE_TOLERANCE or lost > 0,
        notice=counters.bus_errors + counters.edges_missed > 0,
        cure="shorten the wires, check the bus's pull-ups; data_ready names the line that INT is wired to",
    )
    sf_mps2 = np.array([sample.sf_B_mps2 for sample in samples])
    w_radps = np.array([sample.w_WB_B_radps for sample in samples])
    moving = sf_mps2.std(axis=0).max() > REST_SF_STD_MPS2 or w_radps.std(axis=0).max() > REST_RATE_STD_RADPS
    if moving:
        yield Finding(
            subject="IMU at rest", verdict=Verdict.NOTICE, seen="the unit moves", next="lay it down to check gravity"
        )
        return
    gravity_mps2 = float(np.linalg.norm(sf_mps2.mean(axis=0)))
    yield _found(
        "IMU at rest",
        f"gravity {gravity_mps2:.2f} m/s², {statistics.fmean(s.temperature_degC for s in samples):.1f} °C",
        fault=abs(gravity_mps2 - STANDARD_GRAVITY_MPS2) > GRAVITY_TOLERANCE_MPS2,
        cure="no calibration mends that much: replace the chip",
    )


def _samples(imu: ImuSource, seconds: float) -> list[ImuSample]:
    end_s, samples = time.monotonic() + seconds, list[ImuSample]()
    while time.monotonic() < end_s:
        samples += imu.read(timeout_s=0.1)
    return samples


def check_camera(camera: FrameSource, seconds: float) -> Iterator[Finding]:
    """Take frames for `seconds`: rate, losses, latency and brightness of each eye."""
    end_s, frames = time.monotonic() + seconds, list[Frame]()
    latencies_ms: list[float] = []
    while time.monotonic() < end_s:
        frame = camera.read(timeout_s=0.1)
        if frame is not None:
            frames = [*frames[-1:], frame]
            latencies_ms.append((frame.header.t_arrival_ns - frame.header.t_exposure_ns) * 1e-6)
    rate_hz = len(latencies_ms) / seconds
    dropped = ", ".join(f"{count} {cause.value}" for cause, count in camera.dropped.items()) or "none dropped"
    yield _found(
        "camera stream",
        f"{rate_hz:.1f} frames a second, {dropped}",
        fault=rate_hz < 0.5 * GRID_HZ,
        notice=rate_hz < 0.95 * GRID_HZ or bool(camera.dropped),
        cure="give the camera a USB 3 port of its own; a fixed exposure keeps its rate in poor light",
    )
    if not frames:
        return
    yield _found(
        "camera stamps",
        f"arrive {statistics.median(latencies_ms):.0f} ms after mid-exposure",
        fault=not 0.0 <= statistics.median(latencies_ms) <= 150.0,
        cure="stamp_to_mid_exposure_s of the calibration does not fit this camera",
    )
    newest = frames[-1]
    eyes = (("left", newest.left), ("right", newest.right)) if isinstance(newest, StereoFrame) else ()
    for eye, image in eyes:
        grey = float(image.mean())
        yield _found(
            f"{eye} eye",
            f"mean grey {grey:.0f} of 255",
            fault=not DARK <= grey <= BRIGHT,
            cure=_LIGHT,
        )


def check_can(settings: CanSettings, seconds: float) -> Iterator[Finding]:
    """Open the bus and listen for the ankle for `seconds`; nothing is sent."""
    link = CanLink(settings)
    try:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and link.counters.ankle_states == 0:
            link.receive(timeout_s=0.1)
        heard, health = link.counters.ankle_states > 0, link.bus_health
    finally:
        link.close()
    ankle = "the ankle is heard" if heard else "nothing is heard of the ankle"
    yield _found(
        "CAN",
        f"{settings.name} is open, {health.state.value}, {health.bus_errors} error frames; {ankle}",
        fault=health.outages > 0,
        notice=not heard or health.bus_errors > 0,
        cure=_can_cure(settings, heard=heard),
    )


def _can_cure(settings: CanSettings, *, heard: bool) -> str:
    if settings.interface is CanInterface.VIRTUAL:
        return "a virtual bus ends inside the service; [can] names a real one, as gaiteyes init --can socketcan:can0"
    return "check bit rate and termination" if heard else "switch the ankle on; check wiring, bit rate and termination"


def check_learnt(path: Path, calibration: UnitCalibration, now: datetime) -> Iterator[Finding]:
    """Say what the unit would begin with of what it has learnt before, how old that is, or why it is nothing."""
    subject = "learnt"
    try:
        state = read_state(path, calibration)
    except UserError as error:
        yield _found(subject, str(error), notice=True, cure="nothing: the unit will learn anew")
        return
    if state is None:
        yield Finding(subject=subject, verdict=Verdict.FINE, seen=f"{path}: nothing yet, the unit has not been used")
        return
    learnt = state.learnt
    degC = [each.temperature_degC for each in learnt.biases]
    biases = f"biases at {len(degC)} temperatures from {degC[0]:.0f} to {degC[-1]:.0f} °C" if degC else "no bias"
    scale = learnt.depth_scale
    depth = "no depth scale" if scale is None else f"depth scale {100 * scale.scale:+.2f} ± {100 * scale.std:.2f} %"
    days = (now - state.written).total_seconds() / 86_400.0
    yield Finding(
        subject=subject,
        verdict=Verdict.FINE,
        seen=f"{learnt.id}: {biases}, {depth}, in {learnt.used_s / 3600.0:.1f} h of use, written {days:.1f} days ago",
    )


def check_host() -> Iterator[Finding]:
    """Say what the host grants a process that has to be punctual."""
    for subject, limit, needed in (
        ("real-time priorities", resource.RLIMIT_RTPRIO, 1),
        ("locked memory", resource.RLIMIT_MEMLOCK, 1 << 28),
    ):
        granted = resource.getrlimit(limit)[0]
        enough = granted == resource.RLIM_INFINITY or granted >= needed
        told = "unlimited" if granted == resource.RLIM_INFINITY else str(granted)
        yield _found(
            subject,
            f"limit {told}",
            notice=not enough,
            cure="nothing, where systemd starts it: its unit grants more",
        )


def _found(subject: str, seen: str, *, fault: bool = False, notice: bool = False, cure: str = "") -> Finding:
    verdict = Verdict.FAULT if fault else Verdict.NOTICE if notice else Verdict.FINE
    return Finding(subject=subject, verdict=verdict, seen=seen, next="" if verdict is Verdict.FINE else cure)


def worst(findings: Sequence[Finding]) -> Verdict:
    """Return the gravest verdict."""
    order = list(Verdict)
    return max((finding.verdict for finding in findings), key=order.index, default=Verdict.FINE)
