import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.evaluation.attitude import tilt_errors_W
from lab.evaluation.hip_motion import Motion, hip_motion, with_mpu6050_noise
from messages import Reason, Residual, Status, vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.attitude.filter import AttitudeFilter, AttitudeSettings
from tests.bench.attitude_reference import ReferenceAttitude

CALIBRATED = Residual(specific_force_mps2=0.0147, scale=0.0005)
PERFECT = Residual()
STANDING: list[tuple[float, float]] = []
WALKING = [(8.0, 30.0), (36.0, 58.0)]


class Run:
    """What a filter said after each sample of a motion."""

    def __init__(self, motion: Motion, filter_: AttitudeFilter) -> None:
        self.t_s: FloatArray = 1e-9 * (motion.t_ns - motion.t_ns[0])
        self.reasons: list[Reason] = []
        R_WB, cov = [], []
        for t_ns, sf_B, w_B in zip(motion.t_ns.tolist(), motion.sf_B.tolist(), motion.w_B.tolist(), strict=True):
            filter_.update(t_ns, tuple(sf_B), tuple(w_B))
            self.reasons.append(filter_.reason)
            R_WB.append(filter_.R_WB)
            cov.append(filter_.rotation_cov_W)
        self.R_WB, self.cov = np.array(R_WB), np.array(cov)
        self.tilt_W = tilt_errors_W(self.R_WB, motion.R_WB)

    def rms_deg(self, start_s: float, stop_s: float = math.inf) -> float:
        """Return the root mean square of the tilt error."""
        chosen = (self.t_s >= start_s) & (self.t_s < stop_s)
        return float(np.degrees(np.sqrt(np.mean(np.sum(self.tilt_W[chosen] ** 2, axis=1)))))

    def largest_deg(self, start_s: float) -> float:
        """Return the largest tilt error from `start_s` on."""
        return float(np.degrees(np.linalg.norm(self.tilt_W[self.t_s >= start_s], axis=1).max()))

    def coverage(self, start_s: float) -> float:
        """Return the share of tilt errors inside the stated 95 % ellipse (χ² of two degrees of freedom, 5.99)."""
        chosen = self.t_s >= start_s
        tilt, cov = self.tilt_W[chosen], self.cov[chosen][:, :2, :2]
        return float(np.mean(np.einsum("ni,nij,nj->n", tilt, np.linalg.inv(cov), tilt) < 5.99))


def run(motion: Motion, residual: Residual = PERFECT, settings: AttitudeSettings | None = None) -> Run:
    return Run(motion, AttitudeFilter(settings or AttitudeSettings(), residual))


def tilt_sigma_deg(filter_: AttitudeFilter) -> float:
    return float(np.degrees(np.sqrt(np.diag(filter_.rotation_cov_W)[:2].max())))


def fed(motion: Motion, residual: Residual = PERFECT) -> AttitudeFilter:
    filter_ = AttitudeFilter(AttitudeSettings(), residual)
    Run(motion, filter_)
    return filter_


def test_starts_after_one_second_of_standing_with_sway_and_knows_tilt_and_bias() -> None:
    motion = with_mpu6050_noise(hip_motion(STANDING, 12.0, seed=1), seed=1)
    filter_ = AttitudeFilter(AttitudeSettings(), CALIBRATED)
    told = Run(motion, filter_)
    first = told.reasons.index(Reason.NONE)
    assert 0.99 <= told.t_s[first] <= 1.05
    assert set(told.reasons[:first]) == {Reason.STARTING}
    assert set(told.reasons[first:]) == {Reason.NONE}
    assert np.isnan(told.R_WB[first - 1]).all()
    assert np.isnan(told.cov[first - 1]).all()
    assert told.largest_deg(1.05) < 0.5
    assert told.rms_deg(8.0) < 0.1
    true_bias = np.mean(motion.w_B - hip_motion(STANDING, 12.0, seed=1).w_B, axis=0)
    assert np.degrees(np.abs(np.array(filter_.gyro_bias) - true_bias).max()) < 0.15


def test_attitude_and_rate_take_vectors_from_body_to_world() -> None:
    motion = hip_motion(WALKING, 12.0, seed=2)
    filter_ = fed(motion)
    assert filter_.q_WB[0] >= 0.0
    w, x, y, z = filter_.q_WB
    np.testing.assert_allclose(filter_.R_WB[0, 1], 2 * (x * y - w * z), atol=1e-12)
    up_B = motion.R_WB[-1, 2]
    np.testing.assert_allclose(filter_.R_WB @ up_B, (0, 0, 1), atol=0.01)
    np.testing.assert_allclose(filter_.w_WB_B, motion.w_B[-1] - filter_.gyro_bias, atol=1e-9)
    # Yaw turns as the wearer does: from 4 s on, both headings differ by one constant.
    told = run(motion)
    relative = np.einsum("nij,nkj->nik", told.R_WB, motion.R_WB)[told.t_s > 4.0]
    yaw = np.unwrap(np.arctan2(relative[:, 1, 0], relative[:, 0, 0]))
    assert np.degrees(np.ptp(yaw)) < 2.0


@pytest.mark.parametrize("seed", range(3))
def test_walking_with_heel_strikes_turns_and_stops_stays_level(seed: int) -> None:
    told = run(with_mpu6050_noise(hip_motion(WALKING, 62.0, seed), seed))
    assert told.rms_deg(1.5) <= 0.3
    assert told.largest_deg(1.5) <= 1.0


@pytest.mark.parametrize("seed", range(3))
def test_an_accelerometer_worse_than_calibrated_is_noticed_where_it_stands_and_told(seed: int) -> None:
    sound = with_mpu6050_noise(hip_motion([(14.0, 22.0)], 22.0, seed), seed)
    lengthening = np.sign(sound.sf_B[:100].mean(axis=0))
    told = run(replace(sound, sf_B=sound.sf_B + 0.025 * STANDARD_GRAVITY_MPS2 * lengthening), CALIBRATED)
    assert told.largest_deg(1.5) > 0.8
    assert told.coverage(12.0) >= 0.95
    assert set(told.reasons[150:]) == {Reason.NONE}
    assert tilt_sigma_deg(fed(sound, CALIBRATED)) < 0.4, "not so where it is as good as calibrated"


def test_a_lift_that_gains_speed_is_no_worse_accelerometer() -> None:
    standing = with_mpu6050_noise(hip_motion(STANDING, 20.0, seed=1), seed=1)
    t_s = 1e-9 * (standing.t_ns - standing.t_ns[0])
    upwards_mps2 = np.where((t_s > 5.0) & (t_s < 10.0), 1.0, 0.0) - np.where((t_s > 12.0) & (t_s < 17.0), 1.0, 0.0)
    ridden = replace(standing, sf_B=standing.sf_B + upwards_mps2[:, None] * standing.R_WB[:, 2])
    assert tilt_sigma_deg(fed(ridden, CALIBRATED)) < 0.3


@pytest.mark.long
def test_stated_tilt_covariance_holds_over_units_drawn_from_the_calibrations_residual() -> None:
    runs = []
    for seed in range(6):
        motion = with_mpu6050_noise(
            hip_motion([(6.0, 26.0)], 30.0, seed),
            seed,
            sf_bias_mps2=CALIBRATED.specific_force_mps2,
            scale=CALIBRATED.scale,
        )
        runs.append(run(motion, CALIBRATED))
    assert np.mean([told.coverage(1.5) for told in runs]) >= 0.95
    rms = np.sqrt(np.mean([told.rms_deg(1.5) ** 2 for told in runs]))
    stated = np.degrees(np.sqrt(np.mean([np.trace(told.cov[200:, :2, :2], axis1=1, axis2=2) for told in runs])))
    assert stated < 3.0 * rms, "so wide a covariance says nothing"


def test_tilt_is_never_claimed_better_than_the_accelerometers_residual_bias() -> None:
    told = run(with_mpu6050_noise(hip_motion(WALKING, 40.0, seed=3), seed=3), CALIBRATED)
    started = np.isfinite(told.cov[:, 0, 0])
    smallest = np.sqrt(told.cov[started][:, (0, 1), (0, 1)].min())
    assert smallest >= CALIBRATED.specific_force_mps2 / STANDARD_GRAVITY_MPS2


def test_covariance_grows_in_strong_motion_and_yaws_only_grows() -> None:
    told = run(with_mpu6050_noise(hip_motion([(10.0, 40.0)], 40.0, seed=4), seed=4))
    standing, walking = told.t_s < 9.0, told.t_s > 20.0
    tilt = told.cov[:, 0, 0] + told.cov[:, 1, 1]
    assert np.nanmean(tilt[walking]) > 2.0 * np.nanmin(tilt[standing])
    yaw = told.cov[np.isfinite(told.cov[:, 2, 2]), 2, 2]
    assert yaw[-1] > yaw[0]
    assert np.all(np.diff(yaw) >= -1e-12)


def test_rest_soon_after_a_start_in_motion_levels_at_once() -> None:
    motion = with_mpu6050_noise(hip_motion([(-2.0, 1.5)], 12.0, seed=5), seed=5)
    told = run(motion)
    assert told.reasons[50] is Reason.STARTING
    assert told.reasons[150] is Reason.NOT_AT_REST
    assert told.t_s[told.reasons.index(Reason.NONE)] < 4.0
    assert told.coverage(1.5) >= 0.9
    assert told.rms_deg(4.5) < 0.3
    assert told.rms_deg(8.0) < 0.15


@pytest.mark.parametrize("seed", [6, 16, 26])
def test_starts_in_motion_with_a_covariance_that_admits_it_and_heals_at_rest(seed: int) -> None:
    motion = with_mpu6050_noise(hip_motion([(-2.0, 30.0)], 45.0, seed), seed)
    told = run(motion)
    started = int(np.argmax(np.isfinite(told.cov[:, 0, 0])))
    assert 0.95 <= told.t_s[started] <= 1.05
    assert np.degrees(np.sqrt(told.cov[started, 0, 0])) > 3.0
    assert told.reasons[started - 1] is Reason.STARTING
    assert told.reasons[started] is Reason.NOT_AT_REST
    assert Reason.NO_IMU not in told.reasons
    assert told.t_s[told.reasons.index(Reason.NONE)] < 5.0
    assert told.coverage(1.0) >= 0.95
    assert told.reasons[-1] is Reason.NONE
    assert told.rms_deg(38.0) < 0.2


@pytest.mark.long
def test_rate_of_the_samples_does_not_matter() -> None:
    fine = hip_motion([(10.0, 26.0)], 30.0, seed=7, rate_hz=1000)
    rms_deg = {
        rate_hz: run(hip_motion([(10.0, 26.0)], 30.0, seed=7, rate_hz=rate_hz)).rms_deg(2.0)
        for rate_hz in (50, 100, 200, 1000)
    }
    assert max(rms_deg.values()) < 0.15
    assert max(rms_deg.values()) - min(rms_deg.values()) < 0.05, rms_deg
    jittering = np.cumsum(np.random.default_rng(7).integers(9, 12, size=fine.t_ns.size // 12))
    assert run(fine.of(np.isin(np.arange(fine.t_ns.size), jittering))).rms_deg(2.0) < 0.3


def test_gyroscope_bias_that_drifts_while_walking_is_followed() -> None:
    motion = with_mpu6050_noise(hip_motion([(5.0, 118.0)], 120.0, seed=8), seed=8)
    drift_dps = 0.3 * np.linspace(0.0, 1.0, motion.t_ns.size)[:, np.newaxis]
    drifting = replace(motion, w_B=motion.w_B + np.radians(drift_dps))
    settings = AttitudeSettings(gyro_bias_walk_radps_rts=math.radians(0.01))
    filter_, steady = AttitudeFilter(settings, PERFECT), AttitudeFilter(settings, PERFECT)
    told = Run(drifting, filter_)
    Run(motion, steady)
    moved_dps = np.degrees(np.subtract(filter_.gyro_bias, steady.gyro_bias))
    tilt_part = filter_.R_WB[:2] @ moved_dps
    np.testing.assert_allclose(tilt_part, filter_.R_WB[:2] @ np.full(3, 0.3), atol=0.1)
    assert told.rms_deg(5.0) < 1.0


@pytest.mark.parametrize("outage_s", [0.2, 0.5, 3.0])
def test_an_outage_in_motion_is_flagged_and_recovered_from_soon(outage_s: float) -> None:
    motion = with_mpu6050_noise(hip_motion([(5.0, 25.0)], 34.0, seed=9), seed=9)
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    told = run(motion.of((t_s < 12.0) | (t_s >= 12.0 + outage_s)))
    after = int(np.argmax(told.t_s >= 12.0 + outage_s))
    again = told.reasons.index(Reason.NONE, after)
    assert told.reasons[after - 1] is Reason.NONE
    assert set(told.reasons[after:again]) == {Reason.NO_IMU}
    assert told.cov[after, 0, 0] > 10.0 * told.cov[after - 1, 0, 0]
    assert 0.5 < told.t_s[again] - told.t_s[after] < 2.5
    assert told.coverage(told.t_s[after]) >= 0.95
    assert set(told.reasons[again:]) == {Reason.NONE}
    assert told.rms_deg(30.0) < 0.2


def test_a_few_samples_missing_are_bridged_and_stay_valid() -> None:
    motion = with_mpu6050_noise(hip_motion([(5.0, 25.0)], 30.0, seed=9), seed=9)
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    told = run(motion.of((t_s < 2.0) | (np.mod(t_s, 2.0) >= 0.12)))
    assert set(told.reasons[150:]) == {Reason.NONE}
    assert told.rms_deg(1.5) < 1.6
    assert told.coverage(1.5) >= 0.95


@pytest.mark.parametrize("turned_deg", [20.0, 60.0])
def test_a_unit_moved_on_the_belt_during_an_outage_is_found_out(turned_deg: float) -> None:
    motion = hip_motion([(5.0, 40.0)], 40.0, seed=18)
    filter_ = fed(with_mpu6050_noise(motion, seed=18).between(0.0, 12.0))
    told = Run(with_mpu6050_noise(turned(motion, turned_deg), seed=18).between(17.0, 40.0), filter_)
    valid = told.reasons.index(Reason.NONE)
    assert told.t_s[valid] < 3.5
    assert told.largest_deg(told.t_s[valid]) < 6.0
    assert told.coverage(told.t_s[valid]) >= 0.95


def turned(motion: Motion, angle_deg: float) -> Motion:
    """Return what the unit measures after it was turned about its own y."""
    R_BT = Rotation.from_euler("y", angle_deg, degrees=True).as_matrix()
    return Motion(motion.t_ns, motion.sf_B @ R_BT, motion.w_B @ R_BT, motion.R_WB @ R_BT)


def test_reset_keeps_only_the_calibration() -> None:
    motion = with_mpu6050_noise(hip_motion([(5.0, 40.0)], 40.0, seed=19), seed=19)
    filter_ = fed(motion.between(0.0, 15.0))
    filter_.reset()
    assert filter_.status is Status.INITIALISING
    assert filter_.gyro_bias == (0.0, 0.0, 0.0)
    later = motion.between(15.0, 40.0)
    forgot, never_knew = Run(later, filter_), run(later)
    assert np.array_equal(forgot.R_WB, never_knew.R_WB, equal_nan=True)
    assert forgot.t_s[forgot.reasons.index(Reason.NONE)] < 5.0
    assert forgot.coverage(1.0) >= 0.95


@pytest.mark.parametrize("seed", [10, 20])
def test_lost_samples_cost_a_little_and_the_covariance_says_so(seed: int) -> None:
    motion = with_mpu6050_noise(hip_motion([(10.0, 28.0)], 30.0, seed), seed)
    kept = np.random.default_rng(seed).random(motion.t_ns.size) > 0.02
    told, whole = run(motion.of(kept)), run(motion)
    assert told.rms_deg(2.0) < 0.8
    assert told.coverage(2.0) >= 0.9
    assert np.nanmean(told.cov[-500:, 0, 0]) > 1.5 * np.nanmean(whole.cov[-500:, 0, 0])
    assert set(told.reasons[150:]) == {Reason.NONE}


def test_a_long_gap_starts_again_but_keeps_the_gyroscopes_bias() -> None:
    motion = with_mpu6050_noise(hip_motion(STANDING, 20.0, seed=11), seed=11)
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    filter_ = fed(motion.of(t_s < 10.0))
    bias = filter_.gyro_bias
    later = motion.of(t_s >= 12.0)
    filter_.update(int(later.t_ns[0]), tuple(later.sf_B[0].tolist()), tuple(later.w_B[0].tolist()))
    assert filter_.status is Status.INVALID
    assert filter_.reason is Reason.NO_IMU
    assert filter_.gyro_bias == bias
    told = Run(later.between(0.005, 10.0), filter_)
    assert 0.8 < told.t_s[told.reasons.index(Reason.NONE)] < 1.1


def test_a_clipped_sample_costs_certainty() -> None:
    motion = with_mpu6050_noise(hip_motion(STANDING, 4.0, seed=12), seed=12)
    sigmas = []
    for clipped in (False, True):
        filter_ = fed(motion.between(0.0, 3.0))
        for i in range(300, 310):
            filter_.update(int(motion.t_ns[i]), tuple(motion.sf_B[i].tolist()), tuple(motion.w_B[i].tolist()), clipped)
        sigmas.append(tilt_sigma_deg(filter_))
    assert sigmas[1] > 3.0 * sigmas[0]


@pytest.mark.parametrize("clipped_s", [0.2, 0.5])
def test_a_long_saturation_is_flagged_throughout_and_recovered_from_as_an_outage(clipped_s: float) -> None:
    motion = with_mpu6050_noise(hip_motion([(5.0, 25.0)], 20.0, seed=9), seed=9)
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    filter_, reasons = AttitudeFilter(AttitudeSettings(), PERFECT), []
    for k, t_ns in enumerate(motion.t_ns.tolist()):
        clipped = bool(12.0 <= t_s[k] < 12.0 + clipped_s)
        sf_B = np.copysign(39.2, motion.sf_B[k]) if clipped else motion.sf_B[k]
        filter_.update(t_ns, vec3(sf_B), vec3(motion.w_B[k]), clipped=clipped)
        reasons.append(filter_.reason)
    late = (t_s >= 12.06) & (t_s < 12.0 + clipped_s)
    assert {reasons[k] for k in np.flatnonzero(late)} == {Reason.NO_IMU}
    assert {reasons[k] for k in np.flatnonzero(t_s > 12.0 + clipped_s + 1.6)} == {Reason.NONE}


def test_a_wrong_attitude_believed_to_be_right_heals_at_rest() -> None:
    motion = with_mpu6050_noise(hip_motion(STANDING, 60.0, seed=13), seed=13)
    filter_ = fed(motion.between(0.0, 20.0))
    state = filter_.save()
    w, x, y, z = state.q_WB
    c, s = math.cos(math.radians(2.0)), math.sin(math.radians(2.0))
    state.q_WB = (c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y)
    filter_.restore(state)
    told = Run(motion.between(20.0, 60.0), filter_)
    assert np.degrees(np.linalg.norm(told.tilt_W[0])) > 3.5
    assert told.rms_deg(35.0) < 0.3


def test_saved_and_resumed_is_one_run() -> None:
    motion = with_mpu6050_noise(hip_motion([(4.0, 10.0)], 12.0, seed=14), seed=14)
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    motion = motion.of((t_s < 8.5) | (t_s >= 9.2))
    whole = run(motion, CALIBRATED)
    for stop_s in (0.5, 3.003, 7.01, 9.5):
        first = AttitudeFilter(AttitudeSettings(), CALIBRATED)
        Run(motion.between(0.0, stop_s), first)
        second = AttitudeFilter(AttitudeSettings(), CALIBRATED)
        saved = first.save()
        second.restore(saved)
        Run(motion.between(stop_s, 12.0), first)
        resumed = Run(motion.between(stop_s, 12.0), second)
        count = len(resumed.reasons)
        assert np.array_equal(resumed.R_WB, whole.R_WB[-count:], equal_nan=True)
        assert np.array_equal(resumed.cov, whole.cov[-count:], equal_nan=True)
        assert resumed.reasons == whole.reasons[-count:]


@pytest.mark.parametrize(("start_s", "stop_s", "at_rest"), [(2.0, 7.9, True), (10.0, 22.0, False)])
def test_agrees_with_the_slow_reference(start_s: float, stop_s: float, at_rest: bool) -> None:
    motion = with_mpu6050_noise(hip_motion([(8.0, 24.0)], 26.0, seed=15), seed=15, scale=0.0005)
    settings = AttitudeSettings()
    fast = AttitudeFilter(settings, CALIBRATED)
    Run(motion.between(0.0, start_s), fast)
    while fast.save().step.elapsed_s > 0.0:  # the slow one knows nothing of a correction half accumulated
        start_s += 0.01
        Run(motion.between(start_s - 0.01, start_s), fast)
    slow = ReferenceAttitude(settings, CALIBRATED, fast.save())
    rest = motion.between(start_s, stop_s)
    told = Run(rest, fast)
    assert fast.at_rest is at_rest
    slow_R_WB = []
    for t_ns, sf_B, w_B in zip(rest.t_ns.tolist(), rest.sf_B, rest.w_B, strict=True):
        slow.update(t_ns, sf_B, w_B)
        slow_R_WB.append(slow.R_WB)
    assert np.degrees(np.abs(tilt_errors_W(told.R_WB, np.array(slow_R_WB))).max()) < 0.01
    np.testing.assert_allclose(fast.gyro_bias, slow.b, atol=math.radians(0.002))
    but_the_velocities = np.r_[0:6, 12:24]  # whose variance the fast one brings up to date at corrections only
    fast_var = np.diag(fast.save().covariance)
    np.testing.assert_allclose(fast_var[but_the_velocities], np.diag(slow.P)[but_the_velocities], rtol=0.03)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_refuses_values_that_are_not_finite_and_stays_as_it_was(bad: float) -> None:
    motion = hip_motion(STANDING, 2.0, seed=16)
    filter_ = fed(motion)
    before, t_ns = filter_.q_WB, int(motion.t_ns[-1])
    with pytest.raises(ValueError, match=r"must be finite"):
        filter_.update(t_ns + 10_000_000, (0.0, bad, 9.8), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=rf"must be later than the one before it, at {t_ns} ns"):
        filter_.update(t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))
    assert filter_.q_WB == before
    filter_.update(t_ns + 10_000_000, tuple(motion.sf_B[-1].tolist()), tuple(motion.w_B[-1].tolist()))
    assert filter_.status is Status.VALID


def test_refuses_settings_that_make_no_sense() -> None:
    with pytest.raises(ValueError, match=r"AttitudeSettings\.correction_s is 0\.0; it must be positive and finite"):
        AttitudeSettings(correction_s=0.0)
    with pytest.raises(ValueError, match=r"AttitudeSettings\.gravity_mps2 is nan"):
        AttitudeSettings(gravity_mps2=math.nan)
