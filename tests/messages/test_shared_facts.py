"""What all packages share stands once, and is what it claims to be."""

import re

import numpy as np
import pytest
from scipy.constants import g
from scipy.stats import norm

from messages import TOPICS
from messages.arrays import column_rms, rms
from messages.constants import NORMAL_95, STANDARD_GRAVITY_MPS2
from tests.bench.packages import PACKAGES, PROJECT


def homes(pattern: str) -> set[str]:
    """Return the source files with a line of code that matches."""
    files = (path for package in PACKAGES for path in (PROJECT / package).rglob("*.py"))
    return {str(path.relative_to(PROJECT)) for path in files if re.search(pattern, path.read_text(), re.MULTILINE)}


@pytest.mark.parametrize(
    ("pattern", "home"),
    [
        (r"^\w+ = NDArray\[np\.(float64|float32|int64|bool_|complex128)\]$", "messages/arrays.py"),
        (r"\b9\.80665\b", "messages/constants.py"),
        (r"\b9\.81\b", "impedance/body/geometry.py"),
        (r"\b1\.96\b|\b1\.9599\d*|\bppf\(0\.975\)", "messages/constants.py"),
        (r"def _?rms\(", "messages/arrays.py"),
    ],
)
def test_a_fact_has_one_home(pattern: str, home: str) -> None:
    assert homes(pattern) == {home}


def test_the_constants_are_the_known_ones() -> None:
    assert g == STANDARD_GRAVITY_MPS2
    assert norm.ppf(0.975) == pytest.approx(NORMAL_95, rel=1e-15)


def test_rms_is_of_all_numbers_or_of_each_column() -> None:
    values = np.array([[3.0, 0.0], [-4.0, 2.0]])
    assert rms(values) == pytest.approx(np.sqrt((9.0 + 16.0 + 4.0) / 4.0))
    np.testing.assert_allclose(column_rms(values), np.sqrt([12.5, 2.0]))


def test_periods_are_the_inverse_of_the_rates() -> None:
    assert {name: TOPICS[name].period_ns for name in ("imu", "frame", "health")} == {
        "imu": 10_000_000,
        "frame": 50_000_000,
        "health": 1_000_000_000,
    }
    with pytest.raises(ZeroDivisionError):
        _ = TOPICS["load"].period_ns
