"""Excitations designed for the platform of the laboratory, and how long each must run to tell J_yy."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.identification.experiment import (
    RATE_HZ,
    Design,
    MotionLimits,
    SensorNoise,
    designed,
    greatest_alpha_y,
    least_seconds,
    seconds_for,
)
from impedance.identification.mechanism import UniversalJoint, level_rest
from sim_rig.platform.rig import PLATE, THESIS_NOISE, Rig

AMPLITUDES_DEG: Final = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5)
COLUMNS: Final = ("limit", "rms α_y", "time", "all else known", "at least", "θ", "φ")


@dataclass(frozen=True)
class DesignedRun:
    """A design within `limits`, and how long it takes until J_yy's interval is within the share asked for."""

    limits: MotionLimits
    design: Design
    seconds: float
    seconds_all_else_known: float
    seconds_any_motion: float

    @property
    def row(self) -> list[str]:
        """Return the run for a table."""
        return [
            f"{np.rad2deg(self.limits.angle_rad):.2g}°",
            f"{self.design.alpha_y_rms_radps2:.3g} rad/s²",
            f"{self.seconds:.1f} s",
            f"{self.seconds_all_else_known:.1f} s",
            f"{self.seconds_any_motion:.2g} s",
            *(self._strongest(axis) for axis in (0, 1)),
        ]

    @property
    def facts(self) -> dict[str, object]:
        """Return the run for a program, its lines included."""
        lines = self.design.excitation
        return {
            "angle_rad": float(self.limits.angle_rad),
            "alpha_y_rms_radps2": self.design.alpha_y_rms_radps2,
            "seconds": self.seconds,
            "seconds_all_else_known": self.seconds_all_else_known,
            "seconds_any_motion": self.seconds_any_motion,
            "period_s": lines.period_s,
            "f_hz": lines.f_hz.tolist(),
            "amplitude_rad": np.abs(lines.amplitude_rad).tolist(),
            "phase_rad": np.angle(lines.amplitude_rad).tolist(),
        }

    def _strongest(self, axis: int) -> str:
        lines = self.design.excitation
        size = np.abs(lines.amplitude_rad[axis])
        shown = [k for k in np.argsort(-size)[:2] if size[k] > 0.1 * size.max()]
        return " + ".join(f"{np.rad2deg(size[k]):.2f}°·{lines.f_hz[k]:g} Hz" for k in shown)


def designed_for(limits: MotionLimits, share: float, seed: int) -> DesignedRun:
    """Return the best motion of the bare plate within `limits`, at the thesis's noise, for ± `share` of J_yy (95 %)."""
    noise = SensorNoise(THESIS_NOISE.angle_rad, THESIS_NOISE.force_n, THESIS_NOISE.torque_nm)
    vector, J_yy = PLATE.vector, float(PLATE.inertia_kgm2[1, 1])
    design = designed(limits, vector, level_rest(), UniversalJoint(Rig().joint_to_surface_m), noise, seed)
    return DesignedRun(
        limits=limits,
        design=design,
        seconds=seconds_for(design.information_per_s, vector, share),
        seconds_all_else_known=least_seconds(design.alpha_y_rms_radps2, J_yy, noise.torque_nm, RATE_HZ, share),
        seconds_any_motion=least_seconds(greatest_alpha_y(limits), J_yy, noise.torque_nm, RATE_HZ, share),
    )
