"""The sender's side: a set-point for ground that is seen well enough, and a reason in every other case."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance.modulation.curve import Limits
from impedance.modulation.modulator import MOST_SLOPE_SD_RAD, STANDS_IN_NS, USUAL_SLOPE_RAD, Modulator, weighed
from impedance.modulation.table import published
from messages import AnkleState, GaitPhase, GroundPlane, NextFoothold, Reason, Setpoint, Side, Status, TerrainKind
from messages.arrays import FloatArray
from tests.bench.can_samples import NAN, ground, terrain

CYCLE_NS = 50_000_000
MASS_KG = 75.0
LIMITS = Limits(published().level(MASS_KG))
UPHILL_RAD = 0.1


def foothold(slope_rad: float = UPHILL_RAD, **changes: object) -> NextFoothold:
    found = msgspec.structs.replace(terrain().foothold, slope_sagittal_rad=slope_rad)
    return msgspec.structs.replace(found, **changes)


def at(t_ns: int, reason: Reason = Reason.NONE) -> GroundPlane:
    seen = ground(t_exposure_ns=t_ns, frame_seq=t_ns // CYCLE_NS)
    return seen if reason is Reason.NONE else seen.without_numbers(reason)


def ankle(t_ns: int, phase: GaitPhase) -> AnkleState:
    return AnkleState(t_sample_ns=t_ns, ankle_angle_rad=0.0, ankle_rate_radps=0.0, load_n=0.0, phase=phase)


def told(
    modulator: Modulator, n: int, slope_rad: float = UPHILL_RAD, kind: TerrainKind = TerrainKind.RAMP_UP
) -> Setpoint:
    return modulator.setpoint(at(n * CYCLE_NS), foothold(slope_rad), kind)


def points(setpoint: Setpoint) -> FloatArray:
    columns = (setpoint.equilibrium_rad, setpoint.stiffness_nm_per_rad, setpoint.damping_nms_per_rad)
    found: FloatArray = np.array(columns, dtype=np.float64).T
    return found


def test_on_a_ramp_it_comes_to_the_tables_curve_no_faster_than_the_limits_allow() -> None:
    modulator, slope_rad = Modulator(published(), MASS_KG), weighed(UPHILL_RAD, foothold().slope_sagittal_sd_rad)
    wanted = published().at(slope_rad, 0.0, MASS_KG)[0].points
    before = LIMITS.level.points
    for n in range(1, 12):
        setpoint = told(modulator, n)
        assert (setpoint.status, setpoint.reason) == (Status.VALID, Reason.NONE)
        assert (np.abs(points(setpoint) - before) <= LIMITS.rates * 1e-9 * CYCLE_NS + 1e-9).all()
        before = points(setpoint)
    np.testing.assert_allclose(before, wanted)
    assert setpoint.slope_rad == UPHILL_RAD
    assert setpoint.table_id == published().id
    assert min(setpoint.equilibrium_sd_rad) > 0.0


def test_a_slope_is_acted_upon_less_the_wider_it_is() -> None:
    assert weighed(0.1, 0.0) == 0.1
    assert weighed(0.1, USUAL_SLOPE_RAD) == pytest.approx(0.05)
    assert weighed(-0.1, 0.04) == pytest.approx(-weighed(0.1, 0.04))
    assert weighed(0.1, 0.08) < weighed(0.1, 0.04) < 0.1


@given(slope=st.floats(allow_nan=True), sd=st.floats(allow_nan=True), kind=st.sampled_from(TerrainKind))
def test_a_set_point_is_whole_and_within_the_bounds_or_says_why_not(slope: float, sd: float, kind: TerrainKind) -> None:
    modulator = Modulator(published(), MASS_KG)
    for n in range(3):
        setpoint = modulator.setpoint(at(n * CYCLE_NS), foothold(slope, slope_sagittal_sd_rad=sd), kind)
        if setpoint.status is Status.VALID:
            assert np.isfinite(points(setpoint)).all()
            assert (points(setpoint) >= LIMITS.low - 1e-9).all()
            assert (points(setpoint) <= LIMITS.high + 1e-9).all()
            assert sd <= MOST_SLOPE_SD_RAD
        else:
            assert setpoint.reason is not Reason.NONE
            assert np.isnan(points(setpoint)).all()


@pytest.mark.parametrize(
    ("found", "kind", "reason"),
    [
        (foothold(slope_sagittal_sd_rad=MOST_SLOPE_SD_RAD + 0.001), TerrainKind.RAMP_UP, Reason.UNCERTAIN),
        (foothold(slope_sagittal_sd_rad=NAN), TerrainKind.RAMP_UP, Reason.UNCERTAIN),
        (foothold(NAN), TerrainKind.RAMP_UP, Reason.FOOTHOLD_OUT_OF_VIEW),
        (NextFoothold.unknown(Side.RIGHT), TerrainKind.LEVEL, Reason.NO_NEXT_STEP),
        (foothold(math.radians(12.0)), TerrainKind.RAMP_UP, Reason.NO_SET_POINT),
        *((foothold(), kind, Reason.NO_SET_POINT) for kind in TerrainKind if "ramp" not in kind and kind != "level"),
    ],
)
def test_ground_that_it_does_not_know_gives_a_reason(found: NextFoothold, kind: TerrainKind, reason: Reason) -> None:
    setpoint = Modulator(published(), MASS_KG).setpoint(at(CYCLE_NS), found, kind)
    assert (setpoint.status, setpoint.reason) == (Status.INVALID, reason)
    assert math.isnan(setpoint.slope_rad)


@pytest.mark.parametrize("reason", [reason for reason in Reason if reason is not Reason.NONE])
def test_without_ground_it_says_why_there_is_none(reason: Reason) -> None:
    setpoint = Modulator(published(), MASS_KG).setpoint(at(CYCLE_NS, reason), foothold(), TerrainKind.LEVEL)
    assert (setpoint.status, setpoint.reason) == (reason.status, reason)


def test_a_frame_that_sees_nothing_repeats_the_set_point_with_its_age_for_a_moment() -> None:
    modulator = Modulator(published(), MASS_KG)
    seen = told(modulator, 1)
    for n in range(2, 2 + STANDS_IN_NS // CYCLE_NS):
        assert modulator.setpoint(at(n * CYCLE_NS, Reason.OCCLUDED), foothold(), TerrainKind.LEVEL) is seen
    late = modulator.setpoint(at(4 * CYCLE_NS, Reason.OCCLUDED), foothold(), TerrainKind.LEVEL)
    assert (late.reason, late.t_exposure_ns) == (Reason.OCCLUDED, 4 * CYCLE_NS)


@pytest.mark.parametrize("reason", [Reason.IMU_INCONSISTENT, Reason.DISTANCES_WRONG, Reason.NO_IMU, Reason.UNCONFIRMED])
def test_a_fault_of_the_eyes_ends_it_at_once(reason: Reason) -> None:
    modulator = Modulator(published(), MASS_KG)
    told(modulator, 1)
    assert modulator.setpoint(at(2 * CYCLE_NS, reason), foothold(), TerrainKind.LEVEL).reason is reason


def test_after_a_refusal_it_begins_at_level_ground_again() -> None:
    modulator = Modulator(published(), MASS_KG)
    first = told(modulator, 1)
    for n in range(2, 12):
        told(modulator, n)
    told(modulator, 12, kind=TerrainKind.ROUGH)
    again = told(modulator, 13)
    np.testing.assert_allclose(points(again), points(first))


@pytest.mark.parametrize(
    ("phase", "since_s", "to_contact_s", "contradicts"),
    [
        (GaitPhase.SWING, 0.2, 0.3, False),
        (GaitPhase.SWING, 0.4, 1.0, True),  # would have swung for 1.4 s
        (GaitPhase.STANCE, 0.3, 0.05, True),  # has yet to swing
        (GaitPhase.STANCE, 0.02, 0.04, False),  # it has landed a little early
        (GaitPhase.STANCE, 0.3, 0.8, False),
        (GaitPhase.UNKNOWN, 0.3, 0.05, False),
    ],
)
def test_a_phase_that_does_not_fit_the_contact_foretold_is_refused(
    phase: GaitPhase, since_s: float, to_contact_s: float, contradicts: bool
) -> None:
    modulator, t_ns = Modulator(published(), MASS_KG), 10**9
    other = GaitPhase.SWING if phase is GaitPhase.STANCE else GaitPhase.STANCE
    modulator.add_ankle(ankle(t_ns - round(1e9 * since_s) - 10_000_000, other))
    modulator.add_ankle(ankle(t_ns - round(1e9 * since_s), phase))
    modulator.add_ankle(ankle(t_ns, phase))
    found = foothold(time_to_contact_s=to_contact_s, time_to_contact_sd_s=0.01)
    setpoint = modulator.setpoint(at(t_ns), found, TerrainKind.RAMP_UP)
    assert setpoint.reason is (Reason.PHASE_CONTRADICTS if contradicts else Reason.NONE)
    assert setpoint.phase is phase


def test_an_ankle_that_has_fallen_silent_is_not_believed_any_more() -> None:
    modulator = Modulator(published(), MASS_KG)
    modulator.add_ankle(ankle(0, GaitPhase.STANCE))
    setpoint = told(modulator, 20)
    assert (setpoint.phase, setpoint.reason) == (GaitPhase.UNKNOWN, Reason.NONE)
