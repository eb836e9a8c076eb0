"""What each imperfection of the study does to the tables: one cause at a time, beside the printed anomalies."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from impedance.thesis.estimator import Variant
from lab.thesis.printed import FOOT, PLATE, RATES_HZ, ROWS, PrintedTable, body_of, rows_of
from lab.thesis.study import NOISE_FREE, Experiment, Laboratory, Treatment
from messages.arrays import FloatArray
from sim_rig.platform.rig import THESIS_NOISE, Noise

_THESIS: Final = Treatment()
_USUAL: Final = Experiment()


@dataclass(frozen=True)
class Ablation:
    """A cause, and the runs and treatment that have it."""

    cause: str
    treatment: Treatment = _THESIS
    experiment: Experiment = _USUAL


@dataclass(frozen=True)
class Effect:
    """Errors (draws, 10) of plate and foot against what the runs were made with, in the tables' units.

    `impossible` is the share of draws whose foot breaks the triangle inequality.
    """

    cause: str
    plate: FloatArray
    foot: FloatArray
    impossible: float

    @property
    def facts(self) -> dict[str, object]:
        """Return the same for a program."""
        return {
            "cause": self.cause,
            "rows": ROWS,
            "plate_errors": self.plate.tolist(),
            "foot_errors": self.foot.tolist(),
            "impossible_feet": self.impossible,
        }


def _variant(**changes: bool) -> Treatment:
    return replace(_THESIS, variant=Variant(**changes))


def _gains(force: float, Tz: float) -> Treatment:
    """Return the thesis's treatment, moments bounded, of a force plate that reads so many times the truth."""
    return replace(_THESIS, gains=(force, force, force, 1.0, 1.0, Tz), moments_bounded=True)


def _noise(position: float, angle: float, wrench: float) -> Treatment:
    """Return the thesis's treatment with each kind of noise so many times as large."""
    n = THESIS_NOISE
    return replace(
        _THESIS, noise=Noise(position * n.position_m, angle * n.angle_rad, wrench * n.force_n, wrench * n.torque_nm)
    )


ABLATIONS: Final = (
    Ablation("none: as described, corrected"),
    Ablation("no noise, unfiltered", NOISE_FREE),
    Ablation("no noise, filtered", replace(_THESIS, noise=None)),
    Ablation("no noise, raw torque steps", NOISE_FREE, Experiment(raw=True)),
    Ablation("raw torque steps", _THESIS, Experiment(raw=True)),
    Ablation("noise of positions only", _noise(1.0, 0.0, 0.0)),
    Ablation("noise of angles only", _noise(0.0, 1.0, 0.0)),
    Ablation("noise of force and torque only", _noise(0.0, 0.0, 1.0)),
    Ablation("noise of positions twice", _noise(2.0, 1.0, 1.0)),
    Ablation("noise of positions twice, J ≥ 0", replace(_noise(2.0, 1.0, 1.0), moments_bounded=True)),
    Ablation("unfiltered", _variant(filtered=False)),
    Ablation("actuators at a quarter of their span", _THESIS, Experiment(span=0.25)),
    Ablation("updates at 29 Hz", _THESIS, Experiment(update_hz=29.0)),
    Ablation("updates at 67 Hz", _THESIS, Experiment(update_hz=67.0)),
    Ablation("a sixth of the length", _THESIS, Experiment(length=1.0 / 6.0)),
    Ablation("J ≥ 0", replace(_THESIS, moments_bounded=True)),
    Ablation("foot stood there at the tare", replace(_THESIS, foot_tared=True)),
    Ablation("foot stood there at the tare, J ≥ 0", replace(_THESIS, foot_tared=True, moments_bounded=True)),
    Ablation("plate known exactly", replace(_THESIS, plate_known=True)),
    Ablation("moments of the tare left out", _variant(tare_moment=False)),
    Ablation("signs of (1.b), (3) as printed", _variant(printed_signs=True, tare_moment=False)),
    Ablation("T_s twice in (4)", _variant(torque_twice=True)),
    Ablation("no lever from P to F in (4)", _variant(lever=False)),
    Ablation("forces read 6 % high, J ≥ 0", _gains(1.06, 1.0)),
    Ablation("forces 6 % and T_z 20 % high, J ≥ 0", _gains(1.06, 1.2)),
    Ablation("forces 8 % and T_z 20 % high, J ≥ 0", _gains(1.08, 1.2)),
    Ablation("no noise, descent from half", replace(NOISE_FREE, descent_from=0.5)),
    Ablation("no noise, descent from 110 %", replace(NOISE_FREE, descent_from=1.1)),
    Ablation("descent from half, J ≥ 0", replace(_THESIS, descent_from=0.5, moments_bounded=True)),
    Ablation(
        "descent from half, J ≥ 0, foot tared",
        replace(_THESIS, descent_from=0.5, moments_bounded=True, foot_tared=True),
    ),
)

FOOT_SHOWN: Final = ("m", "y0", "Jx", "Jy", "Jz")
PLATE_SHOWN: Final = ("x0", "y0", "Jx", "Jy", "Jz")


def effect_of(ablation: Ablation, laboratory: Laboratory, draws: int) -> Effect:
    """Return what the cause does, over so many draws of noise, or once where there is none."""
    count = 1 if ablation.treatment.noise is None else draws
    pairs = [laboratory.estimated(ablation.experiment, ablation.treatment, draw) for draw in range(count)]
    return Effect(
        cause=ablation.cause,
        plate=np.array([rows_of(plate) for plate, _ in pairs]) - PLATE.reference,
        foot=np.array([rows_of(foot) for _, foot in pairs]) - FOOT.reference,
        impossible=float(np.mean([not foot.is_consistent for _, foot in pairs])),
    )


def foot_row(effect: Effect) -> list[str]:
    """Return the cause, its errors of the foot in FOOT_SHOWN, and how many of the feet are impossible."""
    return [effect.cause, *(_cell(effect.foot, name) for name in FOOT_SHOWN), f"{100.0 * effect.impossible:.0f} %"]


def plate_row(effect: Effect) -> list[str]:
    """Return the cause and its errors of the plate in PLATE_SHOWN."""
    return [effect.cause, *(_cell(effect.plate, name) for name in PLATE_SHOWN)]


def printed_effects() -> list[Effect]:
    """Return the printed errors: simulated with and without noise, and the three experiments."""
    effects = [
        Effect("printed, w/ noise", _noisy(PLATE), _noisy(FOOT), _impossible(np.add(FOOT.reference, FOOT.noisy_mean))),
        Effect(
            "printed, no noise",
            np.array([PLATE.noise_free]),
            np.array([FOOT.noise_free]),
            _impossible(np.add(FOOT.reference, FOOT.noise_free)),
        ),
    ]
    for hz, plate, foot in zip(RATES_HZ, PLATE.experiment, FOOT.experiment, strict=True):
        errors = (np.subtract(plate, PLATE.reference)[None], np.subtract(foot, FOOT.reference)[None])
        effects.append(Effect(f"printed, experiment {hz} Hz", *errors, _impossible(np.array(foot))))
    return effects


def _noisy(table: PrintedTable) -> FloatArray:
    """Return two draws that have the printed mean and deviation."""
    spread = np.array(table.noisy_deviation) / np.sqrt(2.0)
    draws: FloatArray = np.array(table.noisy_mean) + np.array([spread, -spread])
    return draws


def _impossible(rows: FloatArray) -> float:
    return float(not body_of(tuple(rows.tolist())).is_consistent)


def _cell(errors: FloatArray, name: str) -> str:
    column = errors[:, ROWS.index(name)]
    if len(column) == 1:
        return f"{column[0]:.1f}"
    return f"{column.mean():.1f} ± {column.std(ddof=1):.1f}"
