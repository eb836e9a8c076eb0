"""The carried ground is the last plane seen from where the camera is now, by a slow computation in space too."""

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import Covariance3, GroundPlane, PropagatedGround, Quaternion, Reason, Status, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.history import AttitudeAt
from perception.ground.propagation import OLDEST_PICTURE_NS, GroundPropagation
from perception.heading import heading
from tests.bench.can_samples import calibration, ground

START_NS = 1_000_000_000
PERIOD_NS = 10_000_000
PITCH = math.radians(45.0)
R_BC = np.array(
    [
        [0.0, -math.sin(PITCH), math.cos(PITCH)],
        [-1.0, 0.0, 0.0],
        [0.0, -math.cos(PITCH), -math.sin(PITCH)],
    ]
)
"""B's x ahead, y left, z up; the camera looks ahead and down."""
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
KNOWN = (1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6)


def attitude(
    k: int, v_W_mps: Vec3 = vec3.ZERO, q_WB: Quaternion = so3.IDENTITY, period_ns: int = PERIOD_NS
) -> AttitudeAt:
    return AttitudeAt(START_NS + k * period_ns, q_WB, vec3.ZERO, 0.0, np.eye(3), v_W_mps)


def carrying(
    seen: GroundPlane,
    path: Sequence[AttitudeAt],
    *,
    lever_B_m: Vec3 = vec3.ZERO,
    velocity_cov: Covariance3 = KNOWN,
    turn_var: float = 0.0,
) -> GroundPropagation:
    unit = calibration()
    unit = msgspec.structs.replace(unit, X_BL=msgspec.structs.replace(unit.X_BL, p_m=lever_B_m))
    propagation = GroundPropagation(unit, R_BC)
    propagation.begin(seen, path, velocity_cov, turn_var)
    return propagation


def plane(slope_ahead: float = 0.0, slope_across: float = 0.0, height_m: float = 0.9) -> GroundPlane:
    return ground(
        t_exposure_ns=START_NS, slope_sagittal_rad=slope_ahead, slope_frontal_rad=slope_across, height_m=height_m
    )


def numbers(found: PropagatedGround | GroundPlane) -> list[float]:
    return [found.slope_sagittal_rad, found.slope_frontal_rad, found.height_m]


def turned(angle_rad: float) -> Quaternion:
    return so3.quaternion_from_rotvec((0.0, 0.0, angle_rad))


def test_who_stands_has_the_ground_of_the_frame_and_the_age_of_its_picture() -> None:
    propagation = carrying(plane(0.1, -0.05), [attitude(0), attitude(1)])
    found = propagation.at(attitude(2))
    assert numbers(found) == pytest.approx([0.1, -0.05, 0.9])
    assert (found.status, found.reason) == (Status.VALID, Reason.NONE)
    assert found.t_sample_ns == START_NS + 2 * PERIOD_NS
    assert found.picture_age_s == pytest.approx(0.02)
    assert found.covariance[0] == pytest.approx(ground().covariance[0])


def test_who_rises_is_higher_and_who_walks_up_a_ramp_stays_as_high() -> None:
    slope = 0.1
    rising, climbing = (0.0, 0.0, 0.3), (1.0, 0.0, math.tan(slope))
    for v, height_m in ((rising, 0.9 + 0.3 * 0.05), (climbing, 0.9)):
        propagation = carrying(plane(slope), [attitude(k, v) for k in range(3)])
        found = [propagation.at(attitude(k, v)) for k in range(3, 6)][-1]
        assert found.height_m == pytest.approx(height_m)


def test_who_turns_to_the_left_has_ahead_what_was_to_the_left() -> None:
    propagation = carrying(plane(0.1, -0.05), [attitude(0)])
    found = propagation.at(attitude(1, q_WB=turned(math.pi / 2)))
    assert numbers(found) == pytest.approx([-0.05, -0.1, 0.9])
    before = np.sqrt(np.array(ground().covariance)[[0, 3]])
    assert np.sqrt(np.array(found.covariance)[[3, 0]]) == pytest.approx(before, rel=0.02)


def test_a_camera_before_the_imu_sinks_as_the_wearer_bends() -> None:
    down = so3.quaternion_from_rotvec((0.0, 0.2, 0.0))
    found = carrying(plane(), [attitude(0)], lever_B_m=(0.1, 0.0, 0.0)).at(attitude(1, q_WB=down))
    assert found.height_m == pytest.approx(0.9 - 0.1 * math.sin(0.2))


def test_a_plane_is_not_carried_for_longer_than_150_ms() -> None:
    propagation = carrying(plane(), [attitude(0)])
    ages = OLDEST_PICTURE_NS // PERIOD_NS
    told = [propagation.at(attitude(k)) for k in range(1, ages + 2)]
    assert {each.status for each in told[:-1]} == {Status.VALID}
    assert (told[-1].status, told[-1].reason) == (Status.INVALID, Reason.LATE)
    assert all(map(math.isnan, (*numbers(told[-1]), *told[-1].covariance, told[-1].picture_age_s)))


def test_without_a_ground_there_is_none_for_the_same_reason() -> None:
    propagation = GroundPropagation(calibration(), R_BC)
    assert propagation.at(attitude(0)).reason is Reason.STARTING
    propagation.begin(plane(), [attitude(0)], KNOWN, 0.0)
    propagation.drop(Reason.LOW_TEXTURE)
    found = propagation.at(attitude(1))
    assert (found.status, found.reason) == (Status.INVALID, Reason.LOW_TEXTURE)


def test_who_looks_straight_down_has_no_ahead() -> None:
    down = so3.quaternion_from_rotvec((0.0, math.pi / 2 - PITCH, 0.0))
    assert carrying(plane(), [attitude(0)]).at(attitude(1, q_WB=down)).reason is Reason.FOOTHOLD_OUT_OF_VIEW
    propagation = carrying(plane(), [attitude(0, q_WB=down)])
    assert propagation.at(attitude(1)).reason is Reason.FOOTHOLD_OUT_OF_VIEW


def test_the_deviation_grows_with_the_age_of_the_picture() -> None:
    propagation = carrying(plane(0.2), [attitude(0)], turn_var=1e-4)
    found = [propagation.at(attitude(k)).covariance for k in range(1, 15)]
    for number in (3, 5):  # across, by the heading; height, by the velocity
        variances = [each[number] for each in found]
        assert variances == sorted(variances)
        assert variances[-1] > variances[0]


def in_space(seen: GroundPlane, path: Sequence[AttitudeAt], lever_B_m: Vec3) -> list[float]:
    """Slopes and height in H at the end of the path, from three points of the plane in W."""

    def R_WH(at: AttitudeAt) -> FloatArray:
        found = heading(at.R_WB @ R_BC)
        assert found is not None
        return found

    a, b = math.tan(seen.slope_sagittal_rad), math.tan(seen.slope_frontal_rad)
    points_H = np.array([[0.0, 0.0, -seen.height_m], [1.0, 0.0, a - seen.height_m], [0.0, 1.0, b - seen.height_m]])
    p_WC = path[0].R_WB @ lever_B_m
    points_W = p_WC + points_H @ R_WH(path[0]).T
    p_WB = np.zeros(3)
    for before, after in pairwise(path):
        p_WB = p_WB + 0.5e-9 * (after.t_ns - before.t_ns) * (np.array(before.v_W_mps) + np.array(after.v_W_mps))
    p_WC = p_WB + path[-1].R_WB @ lever_B_m
    x, y, z = ((points_W - p_WC) @ R_WH(path[-1])).T
    a, b, c = np.linalg.solve(np.column_stack((x, y, np.ones(3))), z)
    return [math.atan(a), math.atan(b), -float(c)]


small = st.floats(-0.5, 0.5)
vectors = st.tuples(small, small, small)
paths = st.lists(st.tuples(vectors, vectors), min_size=3, max_size=8)


@given(slopes=st.tuples(small, small), motions=paths, lever_B_m=vectors)
def test_it_is_what_three_points_of_the_plane_say(
    slopes: tuple[float, float], motions: list[tuple[Vec3, Vec3]], lever_B_m: Vec3
) -> None:
    path = [attitude(k, v, so3.quaternion_from_rotvec(turn)) for k, (v, turn) in enumerate(motions)]
    propagation = carrying(plane(*slopes), path[:2], lever_B_m=lever_B_m)
    found = [propagation.at(each) for each in path[2:]][-1]
    assert numbers(found) == pytest.approx(in_space(plane(*slopes), path, lever_B_m), abs=1e-9)


@given(slopes=st.tuples(small, small), motions=paths, lever_B_m=vectors)
def test_its_covariance_is_that_of_small_changes(
    slopes: tuple[float, float], motions: list[tuple[Vec3, Vec3]], lever_B_m: Vec3
) -> None:
    path = [attitude(k, v, so3.quaternion_from_rotvec(turn)) for k, (v, turn) in enumerate(motions)]
    root = np.array([[3e-3, 0.0, 0.0], [1e-3, 2e-3, 0.0], [-1e-3, 2e-3, 4e-3]])
    covariance = tuple((root @ root.T)[np.triu_indices(3)].tolist())
    start = np.array([*slopes, 0.9])

    def at_the_end(change: FloatArray) -> FloatArray:
        a, b, h = start + change
        return np.array(in_space(plane(float(a), float(b), float(h)), path, lever_B_m))

    step = 1e-5
    J = np.column_stack([(at_the_end(step * e) - at_the_end(-step * e)) / (2.0 * step) for e in np.eye(3)])
    seen = ground(
        t_exposure_ns=START_NS,
        slope_sagittal_rad=slopes[0],
        slope_frontal_rad=slopes[1],
        height_m=0.9,
        covariance=covariance,
    )
    propagation = carrying(seen, path[:2], lever_B_m=lever_B_m, velocity_cov=STILL)
    found = [propagation.at(each) for each in path[2:]][-1]
    wanted = (J @ root @ root.T @ J.T)[np.triu_indices(3)]
    a, b = math.tan(found.slope_sagittal_rad), math.tan(found.slope_frontal_rad)
    wanted[5] += (0.05 * found.picture_age_s**2) ** 2 * (1.0 + a * a + b * b)
    assert np.array(found.covariance) == pytest.approx(wanted, rel=1e-4, abs=1e-10)
