"""What a unit learns of its sensors: kept only where it is known, told to the next start with an honest deviation."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.evaluation.attitude import tilt_errors_W
from lab.evaluation.hip_motion import hip_motion
from messages import Attitude, BiasAtTemperature, DepthScale, Learnt, Status, UserError, Vec3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.learnt import LearningSettings, SensorLearning, unlearnt
from perception.attitude.sensor_errors import SensorErrors
from perception.attitude.track import AttitudeTrack
from sim_rig.unit import draw_unit
from tests.perception.attitude.test_track import add_all

_DRAWN = draw_unit(1).calibration(np.random.default_rng(1))
CALIBRATION = msgspec.structs.replace(_DRAWN, imu=msgspec.structs.replace(_DRAWN.imu, temperature_degC=30.0))
UNLEARNT = unlearnt(CALIBRATION)
SETTINGS = LearningSettings()
SECOND_NS = 1_000_000_000
GYRO: Vec3 = (0.02, -0.01, 0.005)
SF: Vec3 = (0.01, -0.02, 0.015)


def bias_at(temperature_degC: float, gyro: Vec3 = GYRO, sf: Vec3 = SF, seen_s: float = 0.0) -> BiasAtTemperature:
    return BiasAtTemperature(
        temperature_degC=temperature_degC,
        gyro_bias_radps=gyro,
        gyro_std_radps=(5e-4, 5e-4, 5e-4),
        sf_bias_mps2=sf,
        sf_std_mps2=(0.004, 0.004, 0.004),
        seen_s=seen_s,
    )


def learnt(*biases: BiasAtTemperature, scale: DepthScale | None = None, used_s: float = 0.0) -> Learnt:
    return Learnt(calibration_id=CALIBRATION.id, used_s=used_s, biases=biases, depth_scale=scale)


def known(gyro: Vec3 = GYRO, gyro_std: float = 1e-3, sf: Vec3 = SF, scale: float = 0.002) -> SensorErrors:
    return SensorErrors(gyro, (gyro_std**2,) * 3, sf, (0.005**2,) * 3, scale, 0.0005**2)


def told(learning: SensorLearning, from_s: float, to_s: float, temperature_degC: float, errors: SensorErrors) -> None:
    """Let the filter know `errors` from frame to frame, four a second."""
    for quarter in range(round(4.0 * from_s), round(4.0 * to_s)):
        learning.add(quarter * SECOND_NS // 4, temperature_degC, errors)


def after(*found: tuple[float, SensorErrors]) -> SensorLearning:
    """What is learnt of errors known at die temperatures, each for two seconds."""
    learning = SensorLearning(CALIBRATION, None)
    for k, (temperature_degC, errors) in enumerate(found):
        told(learning, 10.0 + 2.0 * k, 12.0 + 2.0 * k, temperature_degC, errors)
    learning.add((10 + 2 * len(found)) * SECOND_NS, 30.0, found[-1][1])
    return learning


def test_who_has_learnt_nothing_starts_as_the_calibration_says() -> None:
    assert SensorLearning(CALIBRATION, None).prior(30.0) == UNLEARNT
    assert SensorLearning(CALIBRATION, learnt(bias_at(30.0))).prior(math.nan) == UNLEARNT


def test_the_farther_a_die_is_from_where_its_bias_was_found_the_less_is_known() -> None:
    per_K = CALIBRATION.residual.sf_per_K_std_mps2
    for degC, far_K in ((30.0, 0.0), (-10.0, 40.0), (60.0, 30.0)):
        more_var = (per_K * far_K) ** 2
        expected = [variance + more_var for variance in UNLEARNT.sf_var]
        assert SensorLearning(CALIBRATION, None).prior(degC).sf_var == pytest.approx(expected)
    imu = msgspec.structs.replace(CALIBRATION.imu, temperature_degC=msgspec.UNSET)
    unstated = unlearnt(msgspec.structs.replace(CALIBRATION, imu=imu), 50.0)
    assert unstated.sf_var[0] == pytest.approx(UNLEARNT.sf_var[0] + per_K**2 * (20.0**2 + 5.0**2))


def test_what_was_learnt_in_the_cold_may_be_as_far_off_as_the_cold_allows() -> None:
    cold = bias_at(-10.0, sf=(0.2, 0.0, 0.0))
    prior = SensorLearning(CALIBRATION, learnt(cold)).prior(-10.0)
    assert prior.sf_bias[0] == pytest.approx(0.2, rel=0.05)
    with pytest.raises(UserError, match=r"sf_bias_mps2 at 30.0 °C is 0.2"):
        SensorLearning(CALIBRATION, learnt(bias_at(30.0, sf=(0.2, 0.0, 0.0))))


def test_at_a_known_temperature_a_start_knows_the_bias_but_for_turning_on() -> None:
    prior = SensorLearning(CALIBRATION, learnt(bias_at(30.0))).prior(30.0)
    kept = math.sqrt(1.0 - SETTINGS.gyro_turn_on_radps**2 / UNLEARNT.gyro_var[0])
    assert prior.gyro_bias == pytest.approx([kept * axis for axis in GYRO])
    assert np.sqrt(prior.gyro_var) == pytest.approx(math.hypot(SETTINGS.gyro_turn_on_radps, 5e-4), rel=0.01)
    assert prior.sf_bias == pytest.approx(SF, rel=0.1)
    assert max(prior.sf_var) < min(UNLEARNT.sf_var)


def test_between_two_temperatures_the_bias_lies_on_their_line_and_far_from_them_it_is_unknown() -> None:
    learning = SensorLearning(CALIBRATION, learnt(bias_at(20.0, (0.0, 0.0, 0.0)), bias_at(24.0, (0.02, 0.02, 0.02))))
    halfway = learning.prior(21.0)
    change_var = SETTINGS.gyro_turn_on_radps**2 + (0.75 * SETTINGS.gyro_radps_per_K) ** 2
    kept = math.sqrt(1.0 - change_var / UNLEARNT.gyro_var[0])
    assert halfway.gyro_bias == pytest.approx((0.005 * kept,) * 3)
    assert learning.prior(26.0).gyro_var > learning.prior(24.5).gyro_var > learning.prior(24.0).gyro_var
    assert learning.prior(60.0) == unlearnt(CALIBRATION, 60.0)


def test_what_was_seen_long_ago_is_worth_less() -> None:
    fresh, aged = (
        SensorLearning(CALIBRATION, learnt(bias_at(30.0), used_s=used_s)).prior(30.0)
        for used_s in (0.0, SETTINGS.ageing_s)
    )
    assert aged.gyro_var == pytest.approx([2.0 * variance for variance in fresh.gyro_var], rel=0.01)


deviations = st.floats(0.0, 0.1)
biases = st.floats(-0.01, 0.01)


@given(
    temperatures=st.lists(st.floats(-40.0, 85.0), min_size=1, max_size=6, unique=True),
    gyro=st.tuples(biases, biases, biases),
    std=deviations,
    at_degC=st.floats(-60.0, 100.0),
    used_s=st.floats(0.0, 1e8),
)
def test_no_start_knows_less_than_the_calibration_says_and_none_is_certain(
    temperatures: list[float], gyro: Vec3, std: float, at_degC: float, used_s: float
) -> None:
    entries = [
        msgspec.structs.replace(bias_at(t, gyro), gyro_std_radps=(std, std, std), sf_std_mps2=(std, std, std))
        for t in sorted(temperatures)
    ]
    prior = SensorLearning(CALIBRATION, learnt(*entries, used_s=used_s)).prior(at_degC)
    calibrated = unlearnt(CALIBRATION, at_degC)
    for variances, most, least in (
        (prior.gyro_var, calibrated.gyro_var, SETTINGS.gyro_turn_on_radps**2),
        (prior.sf_var, calibrated.sf_var, SETTINGS.sf_turn_on_mps2**2),
    ):
        assert all(0.999 * min(least, high) <= v <= 1.001 * high for v, high in zip(variances, most, strict=True))
    assert all(abs(found) <= 1.001 * abs(value) for found, value in zip(prior.gyro_bias, gyro, strict=True))


def test_what_is_known_is_learnt_once_nothing_has_contradicted_it_for_a_while() -> None:
    learning = SensorLearning(CALIBRATION, None)
    learning.add(10 * SECOND_NS, 30.0, known())
    told(learning, 10.25, 12.0, 30.0, known((0.0, 0.0, 0.0)))
    assert learning.learnt.is_empty
    learning.add(12 * SECOND_NS, 30.0, known((0.0, 0.0, 0.0)))
    (found,) = learning.learnt.biases
    assert (found.gyro_bias_radps, found.sf_bias_mps2, found.seen_s) == (GYRO, SF, 2.0)
    scale = learning.learnt.depth_scale
    assert scale is not None
    assert (scale.scale, scale.seen_s) == (0.002, 2.0)
    assert scale.std == pytest.approx(0.0005)


@pytest.mark.parametrize("pause_s", [0.0, 1.0])
def test_what_is_contradicted_is_not_learnt(pause_s: float) -> None:
    learning = SensorLearning(CALIBRATION, None)
    told(learning, 10.0, 11.5, 30.0, known())
    if not pause_s:
        learning.discard()
    told(learning, 11.5 + pause_s, 13.5 + pause_s, 30.0, known((0.0, 0.0, 0.0)))
    assert learning.learnt.is_empty
    told(learning, 13.5 + pause_s, 14.0 + pause_s, 30.0, known())
    assert learning.learnt.biases[0].gyro_bias_radps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("temperature_degC", "errors"),
    [
        (30.0, known(gyro_std=2.0 * SETTINGS.gyro_known_radps)),
        (30.0, known(gyro=(0.2, 0.0, 0.0))),
        (30.0, known(sf=(0.1, 0.0, 0.0))),
        (math.nan, known()),
        (120.0, known()),
    ],
)
def test_no_bias_is_kept_that_is_uncertain_or_beyond_what_the_calibration_leaves(
    temperature_degC: float, errors: SensorErrors
) -> None:
    assert after((temperature_degC, errors)).learnt.biases == ()


def test_no_scale_is_kept_beyond_what_the_calibration_leaves() -> None:
    assert after((30.0, known(scale=4.0 * math.sqrt(UNLEARNT.scale_var)))).learnt.depth_scale is None


def test_a_bias_that_changes_is_followed_and_those_at_other_temperatures_stay() -> None:
    learning = after((30.1, known()), (36.0, known((0.03, 0.0, 0.0))), (31.9, known((0.0, 0.0, 0.0))))
    assert [(each.temperature_degC, each.gyro_bias_radps) for each in learning.learnt.biases] == [
        (31.9, (0.0, 0.0, 0.0)),
        (36.0, (0.03, 0.0, 0.0)),
    ]


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (Learnt(calibration_id="00000000"), f"learnt beside calibration 00000000, the unit's is {CALIBRATION.id}"),
        (
            learnt(bias_at(30.0, (0.2, 0.0, 0.0))),
            "gyro_bias_radps at 30.0 °C is 0.2, 0, 0; the calibration ",
        ),
        (
            learnt(bias_at(30.0, sf=(0.0, 0.1, 0.0))),
            "sf_bias_mps2 at 30.0 °C is 0, 0.1, 0; the calibration ",
        ),
        (learnt(scale=DepthScale(scale=0.1, std=1e-3, seen_s=0.0)), "depth_scale is 0.1; the calibration admits ±"),
    ],
)
def test_what_no_unit_of_this_calibration_can_have_learnt_is_refused_in_one_line(wrong: Learnt, line: str) -> None:
    with pytest.raises(UserError) as refused:
        AttitudeTrack(CALIBRATION, wrong)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


def test_a_unit_that_has_learnt_starts_walking_sooner_and_with_a_smaller_bias_error() -> None:
    """Switched on while walking, a gyroscope 1.5 °/s off its calibration, and 0.2 °/s off what was learnt."""
    offset = np.radians((1.5, -1.0, 1.0))
    motion = hip_motion([(0.0, 7.0)], 7.0, seed=5).between(2.0, 6.0)
    measured = replace(motion, w_B=motion.w_B + offset)
    unit = msgspec.structs.replace(draw_unit(1).exact_calibration(), residual=CALIBRATION.residual)
    knows = Learnt(calibration_id=unit.id, biases=(bias_at(25.0, vec3(offset + np.radians(0.2)), (0.0, 0.0, 0.0)),))
    (cold_start, cold_error), (warm_start, warm_error) = (
        first_valid(add_all(track, measured), offset) for track in (AttitudeTrack(unit), AttitudeTrack(unit, knows))
    )
    assert warm_error < 0.3 < 0.8 < cold_error
    assert warm_start + 50 < cold_start


def test_a_bias_that_has_jumped_since_it_was_learnt_is_covered_though_only_the_imu_can_tell() -> None:
    motion = hip_motion([(0.0, 10.0)], 10.0, seed=7).between(2.0, 9.0)
    unit = msgspec.structs.replace(draw_unit(1).exact_calibration(), residual=CALIBRATION.residual)
    jumped = bias_at(25.0, vec3(np.radians((2.0, -2.0, 2.0))), (0.0, 0.0, 0.0))
    attitudes = add_all(AttitudeTrack(unit, Learnt(calibration_id=unit.id, biases=(jumped,))), motion)
    valid = np.array([attitude.status is Status.VALID for attitude in attitudes])
    R_WB = np.array([so3.matrix_from_quaternion(attitude.q_WB) for attitude in attitudes])
    errors_W = tilt_errors_W(R_WB, motion.R_WB)[valid, :2]
    variances = np.array([(a.rotation_cov_W_rad2[0], a.rotation_cov_W_rad2[3]) for a in attitudes])[valid]
    assert valid.mean() > 0.5
    assert ((errors_W**2 / variances).sum(axis=1) < 9.0).all()


def first_valid(attitudes: list[Attitude], bias_radps: FloatArray) -> tuple[int, float]:
    """Which attitude is the first valid one, and how far its bias is off on the worst axis, °/s."""
    first = next(k for k, attitude in enumerate(attitudes) if attitude.status is Status.VALID)
    off = np.array(attitudes[first].gyro_bias_B_radps) - bias_radps
    return first, float(np.degrees(np.abs(off).max()))


def test_a_bias_that_was_learnt_wrong_is_unlearnt_at_rest() -> None:
    motion = hip_motion([], 8.0, seed=6)
    unit = draw_unit(1).exact_calibration()
    wrong = Learnt(calibration_id=unit.id, biases=(bias_at(25.0, (math.radians(1.5), 0.0, 0.0), (0.0, 0.0, 0.0)),))
    last = add_all(AttitudeTrack(unit, wrong), motion)[-1]
    assert np.degrees(np.abs(last.gyro_bias_B_radps).max()) < 0.15
