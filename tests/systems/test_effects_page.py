"""docs/effects.md tells what the libraries hold, and the libraries hold what is wanted of them."""

from pathlib import Path

import pytest

from discrepancy.simulation import Effect
from systems.listing import libraries, page

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"
WANTED = {
    "platform": "force_delay force_lag motion_smoothing aliasing force_gain crosstalk reference_height plate_rotation "
    "foot_marker_offset joint_offset parallel_spring parallel_damping coulomb_friction hidden_mass backlash "
    "tape_compliance tare_error clock_drift saturation quantisation dropped_samples position_scale",
    "imu": "time_offset clock_drift gyro_bias gyro_bias_drift gyro_scale gyro_misalignment g_sensitivity acc_bias "
    "acc_scale acc_misalignment lever_arm frame_rotation clipping low_pass temperature gravity_magnitude vibration",
    "wearable": "imu_bias acceleration_disturbance extrinsic_rotation time_offset baseline_error toe_in focal_error "
    "distortion_residual motion_blur rolling_shutter pixel_locking exposure_change texture_bias ground_not_flat "
    "soft_mount",
    "own simulation with ports": "viscous_friction_at_joint coulomb_friction_at_joint stribeck_friction_at_joint "
    "asymmetric_friction_at_joint quadratic_drag_at_joint missing_inertia_at_joint hysteresis_at_joint "
    "constant_at_joint spring_at_joint cubic_spring_at_joint dead_band_spring_at_joint upper_stop_at_joint "
    "lower_stop_at_joint cogging_at_joint leak_at_tank overflow_at_tank delay_of_output_m lag_of_output_m "
    "gain_of_output_m offset_of_output_m drift_of_output_m clock_drift_of_output_m saturation_of_output_m "
    "quantisation_of_output_m dropped_samples_of_output_m aliasing_of_output_m tone_of_output_m play_of_output_m "
    "curve_of_output_m cross_coupling_of_output_m delay_of_input_V gain_of_input_V dead_band_of_input_V",
}


@pytest.fixture(scope="module")
def held() -> dict[str, tuple[Effect, ...]]:
    return libraries()


def test_the_page_is_what_the_libraries_hold(held: dict[str, tuple[Effect, ...]]) -> None:
    assert PAGE.read_text(encoding="utf-8") == page(held), "write it: gaiteyes explain effects --out docs/effects.md"


@pytest.mark.parametrize("system", WANTED)
def test_every_wanted_effect_is_there_once(held: dict[str, tuple[Effect, ...]], system: str) -> None:
    names = [effect.name for effect in held[system]]
    assert len(names) == len(set(names))
    assert set(WANTED[system].split()) <= set(names)


@pytest.mark.parametrize("system", WANTED)
def test_every_effect_speaks_to_a_person_and_knows_its_choices(
    held: dict[str, tuple[Effect, ...]], system: str
) -> None:
    for effect in held[system]:
        assert all(text.endswith((".", ")")) for text in (effect.explanation, effect.remedy, effect.experiment)), effect
        own = {parameter.name for parameter in effect.parameters}
        assert all(set(choice) <= own for choice in effect.choices), effect.name
        assert all(set(start) <= own for start in effect.starts), effect.name
