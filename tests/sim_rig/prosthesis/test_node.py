"""The prosthesis on a bus: it follows set-points that pass their checks, and nothing else."""

from collections.abc import Sequence

import numpy as np
import pytest

from impedance.modulation.table import published
from messages import GaitPhase, Reason, Side, Source, Stamp, Status, TerrainKind
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame, CanMessage, can_id, decode_ankle
from messages.refusal import Refusal
from messages.setpoint import Points, Setpoint
from sim_rig.prosthesis.bus_faults import Arrived, BusFaults
from sim_rig.prosthesis.node import ProsthesisNode, SetpointControls
from sim_rig.prosthesis.prosthesis import VirtualProsthesis
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder

START_NS = 5_000_000_000
CYCLE_NS = 50_000_000
SEEN_NS = 30_000_000
MASS_KG = 80.0
UPHILL_RAD = 0.1
STANDING = Scenario("stand", "standing", WorldBuilder().level(4.0, "wood").build(), (Stand(5.0),))


def five(numbers: Sequence[float]) -> Points:
    a, b, c, d, e = numbers
    return a, b, c, d, e


def told(t_ns: int, seq: int, encoder: CanEncoder, slope_rad: float = UPHILL_RAD) -> list[CanFrame]:
    """Return the frames of a set-point for a slope, seen SEEN_NS before `t_ns`."""
    curve, deviations = published().at(slope_rad, 0.005, MASS_KG)
    setpoint = Setpoint(
        t_exposure_ns=t_ns - SEEN_NS,
        frame_seq=seq,
        status=Status.VALID,
        reason=Reason.NONE,
        phase=GaitPhase.SWING,
        kind=TerrainKind.RAMP_UP,
        slope_rad=slope_rad,
        slope_sd_rad=0.005,
        equilibrium_rad=five(curve.points[:, 0].tolist()),
        equilibrium_sd_rad=five(deviations[:, 0].tolist()),
        stiffness_nm_per_rad=five(curve.points[:, 1].tolist()),
        stiffness_sd_nm_per_rad=five(deviations[:, 1].tolist()),
        damping_nms_per_rad=five(curve.points[:, 2].tolist()),
        damping_sd_nms_per_rad=five(deviations[:, 2].tolist()),
        table_id="00000000",
        calibration_id="00000000",
    )
    stamp = Stamp(device="d", boot_id="b", source=Source.SIMULATED, seq=seq, t_publish_ns=t_ns, age_s=1e-9 * SEEN_NS)
    return list(encoder.setpoint(setpoint, stamp, 1e-9 * SEEN_NS))


def refusal(t_ns: int, seq: int, encoder: CanEncoder) -> tuple[CanFrame, ...]:
    """Return the frames that say that there is no set-point."""
    setpoint = Setpoint.invalid(
        t_exposure_ns=t_ns - SEEN_NS,
        frame_seq=seq,
        reason=Reason.LOW_TEXTURE,
        phase=GaitPhase.SWING,
        table_id="00000000",
        calibration_id="00000000",
    )
    stamp = Stamp(device="d", boot_id="b", source=Source.SIMULATED, seq=seq, t_publish_ns=t_ns, age_s=1e-9 * SEEN_NS)
    return encoder.setpoint(setpoint, stamp, 1e-9 * SEEN_NS)


def controls_after(
    updates: int, damaged: frozenset[int] = frozenset(), *, refused_at_last: bool = False
) -> tuple[SetpointControls, int]:
    """Return the controls of a foot in swing after so many updates, and the time; bits of some frames are flipped."""
    controls, encoder, t_ns, sent = SetpointControls(MASS_KG, START_NS), CanEncoder(), START_NS, 0
    for seq in range(updates + refused_at_last):
        t_ns += CYCLE_NS
        for frame in told(t_ns, seq, encoder) if seq < updates else refusal(t_ns, seq, encoder):
            data = bytearray(frame.data)
            data[4] ^= 1 if sent in damaged else 0
            controls.hear(Arrived(t_ns + 1_000 * (sent % 6), CanFrame(frame.can_id, bytes(data))))
            sent += 1
        for step_ns in range(t_ns, t_ns + CYCLE_NS, 2_000_000):
            controls.impedance(step_ns, GaitPhase.SWING, 0.0)
    return controls, t_ns


def lands(controls: SetpointControls, t_ns: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the impedance at a contact and half way through the stance after it."""
    controls.impedance(t_ns, GaitPhase.STANCE, 0.0)
    return np.array(controls.impedance(t_ns + 2_000_000, GaitPhase.STANCE, 0.5))


def test_fresh_set_points_are_held_over_the_stance() -> None:
    controls, t_ns = controls_after(12)
    wanted = np.array(published().at(UPHILL_RAD, 0.0, MASS_KG)[0].at(0.5))
    assert lands(controls, t_ns + 60_000_000) == pytest.approx(wanted, rel=0.02, abs=0.002)
    assert controls.contacts == [(t_ns + 60_000_000, True)]
    assert controls.heard == 11  # the first frame of each message has nothing to be judged against


def test_without_them_and_after_a_silence_it_walks_as_on_level_ground() -> None:
    level = np.array(published().level(MASS_KG).at(0.5))
    controls, t_ns = controls_after(0)
    assert lands(controls, t_ns) == pytest.approx(level)
    controls, t_ns = controls_after(12)
    for step_ns in range(t_ns, t_ns + 600_000_000, 2_000_000):
        controls.impedance(step_ns, GaitPhase.SWING, 0.0)
    assert lands(controls, t_ns + 600_000_000) == pytest.approx(level)
    assert controls.contacts[-1][1] is False


def test_a_flipped_bit_is_refused_and_the_update_before_stands_in() -> None:
    controls, t_ns = controls_after(12, frozenset({62}))
    assert controls.refused[Refusal.WRONG_CRC] == 1
    lands(controls, t_ns + 60_000_000)
    assert controls.contacts[-1][1] is True


def test_eyes_that_say_that_they_know_nothing_end_what_they_said_before() -> None:
    controls, t_ns = controls_after(12, refused_at_last=True)
    lands(controls, t_ns + CYCLE_NS)
    assert controls.refused[Refusal.NOT_VALID] > 0
    assert controls.contacts == [(t_ns + CYCLE_NS, False)]


def node(faults: BusFaults) -> ProsthesisNode:
    gait = STANDING.gait(1, START_NS)
    controls = SetpointControls(MASS_KG, START_NS)
    footholds = Footholds(STANDING.world, gait, 1)
    prosthesis = VirtualProsthesis(STANDING, gait, footholds, controls, side=Side.LEFT, mass_kg=MASS_KG, seed=1)
    return ProsthesisNode(controls, prosthesis, faults, 1)


def test_it_tells_its_state_a_hundred_times_a_second() -> None:
    standing = node(BusFaults())
    frames = [frame for k in range(1, 101) for frame in standing.advance_to(START_NS + 5_000_000 * k)]
    assert len(frames) == 51
    assert {frame.can_id for frame in frames} == {can_id(CanMessage.ANKLE_STATE)}
    state = decode_ankle(frames[-1].data, 0)
    assert state.phase is GaitPhase.STANCE
    assert state.load_n == pytest.approx(0.5 * MASS_KG * 9.81, rel=0.15)


def test_what_is_late_is_left_out() -> None:
    standing = node(BusFaults())
    assert len(list(standing.advance_to(START_NS + 500_000_000))) == 1
    assert standing.prosthesis.t_ns == START_NS + 500_000_000


def test_a_babbling_bus_is_refused_frame_by_frame() -> None:
    standing = node(BusFaults(babble_hz=1000.0))
    frames = [frame for k in range(1, 201) for frame in standing.advance_to(START_NS + 5_000_000 * k)]
    assert len(frames) > 1000
    facts = standing.facts()
    assert facts.set_points == 0
    assert facts.refused[Refusal.WRONG_CRC] > 100
