"""A mock-up of springs and dampers of known values against what was identified of it: before any person stands there.

A method that is right here may still be wrong about people; one that is wrong here is wrong about people too.
"""

from dataclasses import dataclass
from typing import Final

from impedance.ankle.impedance import AXES, AnkleImpedance
from impedance.ankle.trial import AnkleTrial
from messages.constants import NORMAL_95
from messages.errors import UserError

ALLOWED_SHARE: Final = {"stiffness": 0.02, "damping": 0.05}
"""By how much the mean over the run may differ from what the mock-up is known to have."""


@dataclass(frozen=True)
class Validated:
    """One quantity about one axis: known value, found mean with half of its 95 % interval, mean over the run."""

    axis: str
    quantity: str
    known: float
    found: float
    half: float

    @property
    def off_share(self) -> float:
        """Return found over known, minus one."""
        return self.found / self.known - 1.0

    @property
    def holds(self) -> bool:
        """Tell whether the difference is allowed."""
        return abs(self.off_share) <= ALLOWED_SHARE[self.quantity]


def validated(trial: AnkleTrial, found: AnkleImpedance) -> tuple[Validated, ...]:
    """Return the four comparisons; raises UserError where the trial is not one of a mock-up."""
    mockup = trial.settings.mockup
    if mockup is None:
        raise UserError("trial.toml: has no table [mockup], the known stiffness and damping")
    return tuple(
        Validated(
            axis=name,
            quantity=quantity,
            known=known[place],
            found=float(curve.value.mean()),
            half=NORMAL_95 * float(curve.deviation.mean()),
        )
        for place, (name, axis) in enumerate(zip(AXES, found.axes, strict=True))
        for quantity, known, curve in (
            ("stiffness", mockup.stiffness_nm_per_rad, axis.stiffness),
            ("damping", mockup.damping_nms_per_rad, axis.damping),
        )
    )


def rows(every: tuple[Validated, ...]) -> list[list[str]]:
    """Return the comparisons for a table: axis, quantity, known, found, off, allowed, verdict."""
    return [
        [
            each.axis.replace("_", "-"),
            each.quantity,
            f"{each.known:.4g}",
            f"{each.found:.4g} ± {each.half:.2g}",
            f"{100.0 * each.off_share:+.2f} %",
            f"± {100.0 * ALLOWED_SHARE[each.quantity]:g} %",
            "holds" if each.holds else "fails",
        ]
        for each in every
    ]
