"""Numbers of which all packages must have the same, each with its source."""

from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665
"""Third General Conference on Weights and Measures (CGPM), 1901. One g of an accelerometer's data sheet is this."""

NORMAL_95: Final = 1.959963984540054
"""Φ⁻¹(0.975): 95 % of a normal distribution lie within so many standard deviations of its mean."""

MATCHING_WIDTH_PX: Final = 640
"""Pictures are matched about so wide where nothing else is asked for: two processors of a wearable match a path and a
foothold's region so 20 times a second (docs/results/ground.md)."""
