"""The ten parameters a person reads, their slopes, their ranges, and the designed excitation."""

import numpy as np
import pytest

from impedance.body.rigid_body import Inertia
from impedance.identification.experiment import (
    RATE_HZ,
    MotionLimits,
    SensorNoise,
    designed,
    greatest_alpha_y,
    least_seconds,
    seconds_for,
)
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint, level_rest
from impedance.identification.observability import (
    NAMES,
    about_cog,
    about_cog_slope,
    covariance_of,
    moving,
    observed,
    vector_scale,
)
from tests.bench.platform_motion import FOOT, L_M, PLATE


@pytest.mark.parametrize("body", [PLATE, FOOT])
def test_slope_and_move_are_those_of_the_body(body: Inertia) -> None:
    vector, step = body.vector, 1e-6
    slope = [(about_cog(vector + step * e) - about_cog(vector - step * e)) / (2.0 * step) for e in np.eye(10)]
    assert about_cog_slope(vector) == pytest.approx(np.array(slope).T, abs=1e-7)
    origin_m = np.array([0.1, -0.2, 0.3])
    seen = body.seen_from(np.eye(3), -origin_m)
    assert moving(origin_m) @ vector == pytest.approx(seen.vector, abs=1e-12)


def test_what_nothing_is_known_of_is_not_identifiable() -> None:
    vector = PLATE.vector
    information = np.diag(1e8 / vector_scale(vector) ** 2)
    information[5, :] = information[:, 5] = 0.0
    found = observed(vector, covariance_of(information, vector_scale(vector)))
    assert [name for name, yes in zip(NAMES, found.identifiable, strict=True) if not yes] == ["Jyy"]
    assert found.null_words.startswith("Jyy")
    assert found.singular_values[0] > 1e4 * found.singular_values[-1]


@pytest.mark.parametrize("mechanism", [UniversalJoint(L_M), FreeBody()])
def test_columns_near_level_are_the_slope_of_the_equations(mechanism: Mechanism) -> None:
    size, small = mechanism.C.shape[1], 1e-6
    B0, B2 = mechanism.level_columns()
    level = level_rest()
    for j, unit in enumerate(small * np.eye(size)[:, None, :]):
        still = np.zeros((1, size))
        tilted = mechanism.kinematics(unit, still, still).regressor[0] - level
        pushed = mechanism.kinematics(still, still, unit).regressor[0] - level
        assert tilted == pytest.approx(small * B0[j], abs=1e-10)
        assert pushed == pytest.approx(small * B2[j], abs=1e-10)


def test_a_design_keeps_its_limits_and_no_motion_beats_the_bound() -> None:
    limits = MotionLimits(np.deg2rad(1.0), 3.0, 150.0)
    noise = SensorNoise(1e-5, 0.1, 0.05)
    design = designed(limits, PLATE.vector, level_rest(), UniversalJoint(L_M), noise, seed=1)
    t_s = np.arange(1400) / RATE_HZ
    for part, limit in zip(design.excitation.motion(t_s), (limits.angle_rad, 3.0, 150.0), strict=True):
        assert np.abs(part).max() <= limit * (1.0 + 1e-9)
    J_yy = float(PLATE.inertia_kgm2[1, 1])
    needed = seconds_for(design.information_per_s, PLATE.vector, 0.02)
    known = least_seconds(design.alpha_y_rms_radps2, J_yy, 0.05, RATE_HZ, 0.02)
    assert known <= needed * 1.01
    assert least_seconds(greatest_alpha_y(limits), J_yy, 0.05, RATE_HZ, 0.02) < known
    assert needed < 10.0
