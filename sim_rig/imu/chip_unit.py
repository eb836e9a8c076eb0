"""One MPU-6050 as it left the factory: how far it is from the nominal chip, drawn within the datasheet's limits.

Source: InvenSense MPU-6000/MPU-6050 Product Specification, tables 6.1 (gyroscope), 6.2 (accelerometer) and
6.6 (clock).
"""

from dataclasses import dataclass, field

import numpy as np

from drivers.imu.self_test import TrimCodes
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

SCALE_LIMIT = 0.03
CROSS_AXIS_LIMIT = 0.02
ZERO_G_LIMIT_MPS2 = np.array([0.050, 0.050, 0.080]) * STANDARD_GRAVITY_MPS2
ZERO_RATE_LIMIT_RADPS = float(np.deg2rad(20.0))
G_SENSITIVITY_LIMIT_RADPS_PER_MPS2 = float(np.deg2rad(0.1)) / STANDARD_GRAVITY_MPS2
CLOCK_LIMIT = 0.01
ZERO_RATE_LIMIT_RADPS_PER_K = ZERO_RATE_LIMIT_RADPS / 125.0
"""±20 °/s over −40 to 85 °C."""
ZERO_G_LIMIT_MPS2_PER_K = np.array([0.035, 0.035, 0.060]) / 70.0 * STANDARD_GRAVITY_MPS2
"""±35 mg (x, y) and ±60 mg (z) over 0 to 70 °C."""
SF_NOISE_DENSITY = 400e-6 * STANDARD_GRAVITY_MPS2
W_NOISE_DENSITY = float(np.deg2rad(0.005))
_DIE_TEMPERATURE_DEGC = (25.0, 40.0)
_TYPICAL_TRIM = TrimCodes(accel=(17, 15, 19), gyro=(13, 11, 14))


def _zero_vector() -> FloatArray:
    return np.zeros(3)


def _identity() -> FloatArray:
    return np.eye(3)


def _zero_matrix() -> FloatArray:
    return np.zeros((3, 3))


def _whole() -> FloatArray:
    return np.ones(6)


@dataclass(frozen=True, eq=False)
class ChipUnit:
    """The true error model of one chip; the defaults are a perfect, silent chip.

    measured_sf = sf_matrix @ sf_B + sf_bias_mps2
    measured_w  = w_matrix @ w_B + w_bias_radps + g_sensitivity @ sf_B

    The biases (3,) are those at `temperature_degC`, the die's when it has warmed up, and change by so much per kelvin.
    Matrices are (3, 3). `g_sensitivity` is in (rad/s) per (m/s²). Noise densities are one-sided, in
    m/s²/√Hz and rad/s/√Hz. `clock_error` is relative: a positive one makes the chip's clock fast, its sample rate
    (1 + clock_error) times nominal. `trim_codes` is what the factory wrote for the self-test, `push_share` (6,), the
    accelerometer first, how much of the factory's response is left: 0 is an axis that no longer moves.
    """

    sf_matrix: FloatArray = field(default_factory=_identity)
    sf_bias_mps2: FloatArray = field(default_factory=_zero_vector)
    w_matrix: FloatArray = field(default_factory=_identity)
    w_bias_radps: FloatArray = field(default_factory=_zero_vector)
    g_sensitivity: FloatArray = field(default_factory=_zero_matrix)
    sf_noise_density: float = 0.0
    w_noise_density: float = 0.0
    clock_error: float = 0.0
    temperature_degC: float = 30.0
    sf_bias_mps2_per_K: FloatArray = field(default_factory=_zero_vector)
    w_bias_radps_per_K: FloatArray = field(default_factory=_zero_vector)
    trim_codes: TrimCodes = _TYPICAL_TRIM
    push_share: FloatArray = field(default_factory=_whole)


def draw_chip_unit(rng: np.random.Generator) -> ChipUnit:
    """Return a unit drawn from `rng`; 1 σ is a third of the datasheet's limit, and the limit is never passed."""

    def within(limit: float | FloatArray, shape: tuple[int, ...]) -> FloatArray:
        return np.clip(rng.normal(0.0, 1.0 / 3.0, shape), -1.0, 1.0) * limit

    def sensitivity() -> FloatArray:
        off_diagonal = within(CROSS_AXIS_LIMIT, (3, 3)) * (1.0 - np.eye(3))
        return np.eye(3) + np.diag(within(SCALE_LIMIT, (3,))) + off_diagonal

    return ChipUnit(
        sf_matrix=sensitivity(),
        sf_bias_mps2=within(ZERO_G_LIMIT_MPS2, (3,)),
        w_matrix=sensitivity(),
        w_bias_radps=within(ZERO_RATE_LIMIT_RADPS, (3,)),
        g_sensitivity=within(G_SENSITIVITY_LIMIT_RADPS_PER_MPS2, (3, 3)),
        sf_noise_density=SF_NOISE_DENSITY,
        w_noise_density=W_NOISE_DENSITY,
        clock_error=float(within(CLOCK_LIMIT, ())),
        temperature_degC=float(rng.uniform(*_DIE_TEMPERATURE_DEGC)),
        sf_bias_mps2_per_K=within(ZERO_G_LIMIT_MPS2_PER_K, (3,)),
        w_bias_radps_per_K=within(ZERO_RATE_LIMIT_RADPS_PER_K, (3,)),
    )
