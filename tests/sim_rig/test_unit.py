import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.nominal import R_BL_NOMINAL
from messages import NO_RESIDUAL
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.unit import RESIDUAL, draw_unit


def test_a_seed_is_a_unit() -> None:
    assert draw_unit(7).exact_calibration().id == draw_unit(7).exact_calibration().id
    assert draw_unit(7).exact_calibration().id != draw_unit(8).exact_calibration().id


def test_units_are_like_those_the_maker_calibrates() -> None:
    for unit in map(draw_unit, range(40)):
        for lens in (unit.stereo.left, unit.stereo.right):
            assert 692 < lens.fx_px < 705
            assert abs(lens.cx_px - 639.5) <= 15
            assert abs(lens.cy_px - 359.5) <= 15
            assert -0.19 < lens.distortion[0] < -0.16
        assert unit.stereo.X_RL.p_m[0] == pytest.approx(-0.12, abs=0.0005)
        pair = Rotation.from_matrix(np.array(unit.stereo.X_RL.R)).as_rotvec(degrees=True)
        assert np.abs(pair).max() < 0.301
        tilt = Rotation.from_matrix(np.array(unit.X_BL.R) @ R_BL_NOMINAL.T).as_rotvec(degrees=True)
        assert np.abs(tilt).max() < 1.51
        assert unit.stereo.row_time_s * 720 == pytest.approx(0.016)


def test_the_shutter_may_be_global() -> None:
    assert draw_unit(1, rolling_shutter=False).exact_calibration().stereo.row_time_s == 0.0


def test_the_exact_calibration_undoes_the_chip() -> None:
    unit = draw_unit(3)
    calibration = unit.exact_calibration()
    assert calibration.residual == NO_RESIDUAL
    sf_B, w_B = np.array([1.0, -2.0, 9.0]), np.array([0.3, -0.2, 0.5])
    measured_sf = unit.chip.sf_matrix @ sf_B + unit.chip.sf_bias_mps2
    measured_w = unit.chip.w_matrix @ w_B + unit.chip.w_bias_radps
    imu = calibration.imu
    np.testing.assert_allclose(np.array(imu.sf_matrix) @ (measured_sf - imu.sf_bias_mps2), sf_B, atol=1e-12)
    np.testing.assert_allclose(np.array(imu.w_matrix) @ (measured_w - imu.w_bias_radps), w_B, atol=1e-12)


def test_a_calibration_leaves_the_residual_it_states_and_nothing_else() -> None:
    unit = draw_unit(5)
    exact = unit.exact_calibration()
    rng = np.random.default_rng(0)
    names = ("sf", "scale", "cross_axis", "toe_in", "mounting", "time", "focal", "baseline")
    errors: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(400):
        found = unit.calibration(rng)
        errors["sf"] += list(np.array(found.imu.sf_bias_mps2) - exact.imu.sf_bias_mps2)
        for matrix, true in ((found.imu.sf_matrix, exact.imu.sf_matrix), (found.imu.w_matrix, exact.imu.w_matrix)):
            ratio = np.array(matrix) @ np.linalg.inv(np.array(true))
            errors["scale"] += list(np.diag(ratio) - 1.0)
            errors["cross_axis"] += list((ratio - np.diag(np.diag(ratio)))[~np.eye(3, dtype=bool)])
        pair = Rotation.from_matrix(np.array(found.stereo.X_RL.R) @ np.array(exact.stereo.X_RL.R).T).as_rotvec()
        errors["toe_in"].append(pair[1])
        np.testing.assert_allclose(pair[[0, 2]], 0.0, atol=1e-12)
        errors["mounting"] += list(Rotation.from_matrix(np.array(found.X_BL.R) @ np.array(exact.X_BL.R).T).as_rotvec())
        errors["time"].append(found.stereo.stamp_to_mid_exposure_s - exact.stereo.stamp_to_mid_exposure_s)
        for eye, true_eye in ((found.stereo.left, exact.stereo.left), (found.stereo.right, exact.stereo.right)):
            longer = eye.fx_px / true_eye.fx_px
            assert eye.fy_px / true_eye.fy_px == pytest.approx(longer, rel=1e-12)
            errors["focal"].append(longer - 1.0)
        errors["baseline"].append(found.stereo.X_RL.p_m[0] / exact.stereo.X_RL.p_m[0] - 1.0)
        unchanged = msgspec.structs.replace(
            found.stereo,
            left=exact.stereo.left,
            right=exact.stereo.right,
            X_RL=exact.stereo.X_RL,
            stamp_to_mid_exposure_s=0.0,
        )
        assert unchanged == msgspec.structs.replace(exact.stereo, stamp_to_mid_exposure_s=0.0)
        assert found.imu.w_bias_radps == exact.imu.w_bias_radps
        assert found.residual == RESIDUAL
    assert pytest.approx(1.5e-3 * STANDARD_GRAVITY_MPS2) == RESIDUAL.specific_force_mps2
    for name, sigma in (
        ("sf", 1.5e-3 * STANDARD_GRAVITY_MPS2),
        ("scale", 0.0005),
        ("cross_axis", 0.0005),
        ("toe_in", np.deg2rad(0.01)),
        ("mounting", np.deg2rad(0.05)),
        ("time", 0.5e-3),
        ("focal", 1e-4),
        ("baseline", 5e-4),
    ):
        assert np.std(errors[name]) == pytest.approx(sigma, rel=0.15), name
        assert abs(np.mean(errors[name])) < 0.2 * sigma, name
