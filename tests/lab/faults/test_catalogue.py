"""The catalogue is complete, every fault can be made on the rig's objects, and nothing of it stays."""

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.imu.registers import Register
from lab.faults.can_adapter import SimulatedCanAdapter
from lab.faults.catalogue import CATALOGUE, carry_out, expected_together, named, pairs
from lab.faults.daemon_process import DaemonPlan, Order
from lab.faults.fault import Expect, Fault, HardwareAction, Layer, Restart
from lab.faults.faulty_camera import TRANSFER_S, Pair
from lab.faults.hardware import FaultyHardware
from messages import UserError
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

ON_HARDWARE = [fault for fault in CATALOGUE.values() if isinstance(fault.act, HardwareAction)]


def test_there_are_sixty_faults_on_every_layer_and_each_says_what_must_follow() -> None:
    assert len(CATALOGUE) >= 60
    assert set(Layer) == {fault.layer for fault in CATALOGUE.values()}
    for fault in CATALOGUE.values():
        assert (fault.limit_s > 0.0) is (fault.expect is Expect.FLAGGED), fault.name
        without_reason = fault.expect in (Expect.FLAGGED, Expect.REFUSED)
        assert bool(fault.reason) is not without_reason, fault.name
        assert fault.how


def test_thirty_pairs_are_drawn_by_the_seed_alone() -> None:
    drawn = pairs(30, seed=1)
    assert len({frozenset((a.name, b.name)) for a, b in drawn}) == 30
    assert drawn == pairs(30, seed=1)
    assert drawn != pairs(30, seed=2)
    assert max(Counter(fault.name for pair in drawn for fault in pair).values()) <= 3
    for first, second in drawn:
        assert first.touches
        assert second.touches
        assert first.touches != second.touches
        assert Expect.UNDETECTABLE not in (first.expect, second.expect)


def test_two_faults_are_flagged_as_soon_as_the_sooner_one() -> None:
    assert expected_together(CATALOGUE["imu-nak-eio"], CATALOGUE["cam-frozen"])[:2] == (Expect.FLAGGED, 0.050)
    slow = expected_together(CATALOGUE["imu-flip-gyro-x"], CATALOGUE["can-flood"])
    assert slow == (Expect.FLAGGED, 3.0, True)
    assert expected_together(CATALOGUE["imu-nak-once"], CATALOGUE["can-flood"])[0] is Expect.TOLERATED
    assert expected_together(CATALOGUE["imu-nak-eio"], CATALOGUE["host-paused-2s"])[0] is Expect.SILENT


def test_faults_are_named_by_their_beginning() -> None:
    assert [fault.name for fault in named("cam-unplugged,imu-frozen")] == [
        "cam-unplugged-2s",
        "cam-unplugged-10s",
        "imu-frozen",
    ]
    with pytest.raises(UserError, match="--only nothing"):
        named("nothing")


@pytest.fixture(scope="module")
def hardware() -> Iterator[FaultyHardware]:
    """One for all tests: its rendering process takes two seconds to start."""
    wearer = SimulatedWearer(1, scenario("standing"), 0)
    with closing(FaultyHardware(wearer)) as made:
        yield made


def touch(hardware: FaultyHardware) -> None:
    """Let the chip see a transfer, in which its faults happen."""
    hardware.chip.write(bytes([Register.WHO_AM_I]))
    hardware.chip.read(1)


def state(hardware: FaultyHardware) -> dict[str, object]:
    node, kernel = hardware.camera.node, hardware.camera.kernel
    with closing(hardware.wires.open()) as bus:
        answers = bus.read_byte_data(0x68, Register.WHO_AM_I)
    return {
        "identity": answers,
        "repeated": dict(hardware.chip.repeated),
        "image_changes": dict(hardware.camera.image_changes),
        "frame_faults": dict(hardware.camera.frame_faults),
        "stamp": node.stamp_jitter_s(0),
        "transfer": node.transfer_s,
        "period": node.slow_period_s,
        "held": node.held,
        "call": (kernel.dequeue_error, kernel.silent),
    }


@pytest.mark.parametrize("fault", ON_HARDWARE, ids=lambda fault: fault.name)
def test_every_fault_of_the_hardware_comes_and_goes(hardware: FaultyHardware, fault: Fault) -> None:
    before = state(hardware)
    assert before["transfer"] == TRANSFER_S
    carry_out(hardware, Order(fault.name, inject=True))
    touch(hardware)
    carry_out(hardware, Order(fault.name, inject=False))
    failed = sum(fails(hardware) for _ in range(_MOST_FAILURES))
    assert failed < _MOST_FAILURES
    touch(hardware)
    assert state(hardware) == before


_MOST_FAILURES = 4


def fails(hardware: FaultyHardware) -> bool:
    """Whether a transfer still fails: what was to fail once may have had no transfer yet."""
    try:
        with closing(hardware.wires.open()) as bus:
            bus.read_byte_data(0x68, Register.WHO_AM_I)
    except OSError:
        return True
    return False


@pytest.mark.parametrize(
    "fault", [fault for fault in ON_HARDWARE if fault.touches == "pictures"], ids=lambda fault: fault.name
)
def test_a_changed_image_differs_and_the_true_one_stays(hardware: FaultyHardware, fault: Fault) -> None:
    rng = np.random.default_rng(2)
    carry_out(hardware, Order(fault.name, inject=True))
    (change,) = hardware.camera.image_changes.values()
    changed = []
    for _ in range(2):
        true: Pair = (rng.integers(40, 200, (720, 1280), np.uint8), rng.integers(40, 200, (720, 1280), np.uint8))
        kept = (true[0].copy(), true[1].copy())
        seen = change(true)
        for before, after, shown in zip(kept, true, seen, strict=True):
            np.testing.assert_array_equal(before, after)
            assert shown.shape == (720, 1280)
            assert shown.dtype == np.uint8
        changed.append(any(not np.array_equal(a, b) for a, b in zip(true, seen, strict=True)))
    carry_out(hardware, Order(fault.name, inject=False))
    assert changed[-1]
    assert not hardware.camera.image_changes


def test_nothing_is_called_undetectable() -> None:
    """One that is needs an argument from observability, here and in docs/results/faults.md."""
    assert not [fault.name for fault in CATALOGUE.values() if fault.expect is Expect.UNDETECTABLE]


def test_what_is_there_before_the_start_is_a_fault_of_the_hardware(tmp_path: Path) -> None:
    plan = DaemonPlan(
        seed=1, scenario="ramps", start_ns=0, zenoh="", can=SimulatedCanAdapter(tmp_path / "c").settings, log=tmp_path
    )
    for fault in CATALOGUE.values():
        if isinstance(fault.act, Restart) and fault.layer is Layer.CAMERA:
            for name in fault.act.change(plan, tmp_path).from_start:
                assert isinstance(CATALOGUE[name].act, HardwareAction)


def distorted(name: str, hardware: FaultyHardware, counts: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return what the chip shows of `counts` (n, 7), given one by one as they would be complete."""
    carry_out(hardware, Order(name, inject=True))
    touch(hardware)
    distort = hardware.chip.distortion
    assert distort is not None
    shown = np.concatenate([distort(counts[k : k + 1]) for k in range(len(counts))])
    carry_out(hardware, Order(name, inject=False))
    touch(hardware)
    assert hardware.chip.distortion is None
    return shown


def test_repeated_samples_are_those_that_came_before(hardware: FaultyHardware) -> None:
    counts = np.arange(40 * 7, dtype=np.int16).reshape(40, 7)
    doubled, repeated = (distorted(f"imu-samples-{word}", hardware, counts) for word in ("doubled", "repeated"))
    np.testing.assert_array_equal(doubled, np.repeat(counts[::2], 2, axis=0))
    np.testing.assert_array_equal(repeated, np.repeat(counts[::10], 10, axis=0))


def test_a_warming_accelerometer_is_off_as_its_temperature_tells(
    hardware: FaultyHardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    began_s = time.monotonic()
    monkeypatch.setattr("lab.faults.signal_faults.time.monotonic", lambda: began_s)
    carry_out(hardware, Order("imu-accel-warming", inject=True))
    touch(hardware)
    distort = hardware.chip.distortion
    assert distort is not None
    still = np.zeros((1, 7), np.int16)
    np.testing.assert_array_equal(distort(still), still)
    monkeypatch.setattr("lab.faults.signal_faults.time.monotonic", lambda: began_s + 60.0)
    shown = distort(still)[0]
    assert shown[[0, 2]] / 8192 == pytest.approx(0.040, abs=0.001)  # g, after 40 °C
    assert shown[3] / 340 == pytest.approx(40.0)
    assert not shown[[1, 4, 5, 6]].any()
    carry_out(hardware, Order("imu-accel-warming", inject=False))
    touch(hardware)


def test_frames_that_come_late_are_the_rigs_failure_but_for_a_start_and_after_a_silence(
    hardware: FaultyHardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = hardware.camera
    now_ns, rendered = 0, False
    monkeypatch.setattr(camera, "_show", lambda _k: rendered)
    monkeypatch.setattr(camera.node, "monotonic_ns", lambda: now_ns)
    monkeypatch.setattr(camera, "_exposed_ns", 0)

    def frames(count: int) -> int:
        """Let frames be exposed, and return how many of them count as late."""
        nonlocal now_ns
        before = camera.rig_late
        for _ in range(count):
            now_ns += 50_000_000
            camera.get(0)
        return camera.rig_late - before

    assert frames(40) == 0  # the rendering process starts
    rendered = True
    assert frames(40) == 0
    rendered = False
    assert frames(40) == 40
    rendered, now_ns = True, now_ns + 2_000_000_000
    assert frames(1) == 0
    rendered = False
    assert frames(15) == 0  # it catches up
    assert frames(40) > 30
