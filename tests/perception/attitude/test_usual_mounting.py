import math

import numpy as np
import pytest

from perception.attitude.usual_mounting import UsualMounting, UsualMountingSettings

SETTINGS = UsualMountingSettings()


def mounting_of(pitch_deg: float, swing_deg: float, seconds: float) -> UsualMounting:
    """Return that of a unit pitched by `pitch_deg` that swings by `swing_deg` at 1.8 Hz about its y axis."""
    mounting = UsualMounting()
    for t_s in np.arange(0.0, seconds, 0.01).tolist():
        pitch = math.radians(pitch_deg + swing_deg * math.sin(2.0 * math.pi * 1.8 * t_s))
        mounting.update(SETTINGS, (-math.sin(pitch), 0.0, math.cos(pitch)), 0.01)
    return mounting


def test_learns_the_mean_tilt_and_its_scatter() -> None:
    mounting = mounting_of(45.0, 6.0, 20.0)
    mean_deg = math.degrees(math.atan2(-mounting.mean_up_B[0], mounting.mean_up_B[2]))
    assert mean_deg == pytest.approx(45.0, abs=0.6)
    # 6° of amplitude about one of two axes: a mean square of 18 deg², half of it on each
    assert math.degrees(math.sqrt(mounting.scatter_var)) == pytest.approx(3.0, rel=0.15)


def test_says_less_the_longer_the_gap_and_nothing_before_it_has_watched() -> None:
    assert mounting_of(45.0, 6.0, 0.5).tilt_rad(SETTINGS, 0.2) == math.inf
    mounting = mounting_of(45.0, 0.0, 5.0)
    assert mounting.tilt_rad(SETTINGS, 0.0) == pytest.approx(SETTINGS.tilt_rad)
    gaps = [mounting.tilt_rad(SETTINGS, gap_s) for gap_s in (0.2, 1.0, 5.0, 20.0)]
    assert gaps == sorted(gaps)
    assert math.degrees(gaps[-1]) > 10.0
