"""What the calibration's residual leaves out of the accelerometer: its die's temperature, a chip worse than that."""

import math

import numpy as np

from messages.arrays import FloatArray
from messages.learnt import DIE_TEMPERATURES_DEGC
from perception import so3
from perception.attitude.error_state import ROTATION, SF_BIAS
from perception.attitude.state import AttitudeSettings, AttitudeState

CROSS_UP = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""θ × e_z = CROSS_UP θ."""


def tilt_of_bias(state: AttitudeState, settings: AttitudeSettings) -> FloatArray:
    """Return ∂θ/∂δa (3, 3) of a vertical that leans as the accelerometer's bias makes it: g θ × e_z = R_WB δa."""
    leaning: FloatArray = CROSS_UP.T @ so3.matrix_from_quaternion(state.q_WB) / settings.gravity_mps2
    return leaning


def follow_temperature(state: AttitudeState, sf_per_K_mps2: float, temperature_degC: float) -> None:
    """Let the accelerometer's bias have changed as much as its die has warmed up or cooled down since the first
    sample, by `sf_per_K_mps2`, 1 σ; a temperature that is NaN, or none of a die, tells nothing."""
    low, high = DIE_TEMPERATURES_DEGC
    if not low <= temperature_degC <= high:
        return
    if math.isnan(state.first_degC):
        state.first_degC = temperature_degC
    warming_K = abs(temperature_degC - state.first_degC)
    if warming_K > state.most_warming_K:
        change_var = sf_per_K_mps2**2 * (warming_K**2 - state.most_warming_K**2)
        state.covariance[SF_BIAS, SF_BIAS] += change_var * np.eye(3)
        state.most_warming_K = warming_K


def weigh_gravity(
    state: AttitudeState, settings: AttitudeSettings, calibrated_mps2: float, sf_per_K_mps2: float
) -> None:
    """Let the accelerometer's bias, and the tilt with it, be as uncertain on every axis as the specific force of all
    rests has for long been longer or shorter than gravity, where calibration and die temperature, 1 σ, do not explain
    it."""
    P = state.covariance
    excess_mps2 = math.hypot(*state.rest.mean_sf_B) - settings.gravity_mps2
    warmed_mps2 = sf_per_K_mps2 * state.most_warming_K
    explained = (calibrated_mps2, warmed_mps2, settings.gravity_std_mps2, state.granted_mps2)
    if abs(excess_mps2) <= settings.excess_sigmas * math.hypot(*explained) or excess_mps2 * state.excess_mps2 < 0.0:
        state.excess_mps2, state.excess_from_ns = 0.0, None
        return
    state.excess_mps2 = min(excess_mps2, state.excess_mps2 or excess_mps2, key=abs)
    now_ns = state.t_ns or 0
    state.excess_from_ns = now_ns if state.excess_from_ns is None else state.excess_from_ns
    if now_ns - state.excess_from_ns < 1e9 * settings.excess_s:
        return
    state.granted_mps2 = abs(state.excess_mps2)
    more_var, leaning = state.excess_mps2**2, tilt_of_bias(state, settings)
    P[SF_BIAS, SF_BIAS] += more_var * np.eye(3)
    P[ROTATION, SF_BIAS] += more_var * leaning
    P[SF_BIAS, ROTATION] += more_var * leaning.T
    P[ROTATION, ROTATION] += more_var * leaning @ leaning.T
