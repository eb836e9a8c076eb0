"""`ankle_impedance.toml`: the ankle's impedance over stance for one slope and one manoeuvre, what a prosthesis can use.

Values stand with their 95 % intervals; where the interval holds zero the value is not identifiable: it is nan, and
`not_identifiable` says what and where. A whole curve is refused likewise where its intervals are, on average over
stance, wider than a controller can use. The intervals stay, for they are what is known.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np

from impedance.ankle.impedance import AnkleImpedance, AxisImpedance, Curve
from impedance.ankle.trial import AnkleTrial, Manoeuvre, Perturbation, TrialSettings
from impedance.recording.plain_files import read_toml, write_toml
from messages.arrays import BoolArray, FloatArray
from messages.checked import checked
from messages.constants import NORMAL_95
from messages.errors import UserError

_HEADING: Final = """\
# Intrinsic impedance of an ankle over stance: 0 % heel strike, 100 % toe off; only where the foot is flat.
# low, high: 95 % intervals. nan: not identifiable.
# Dorsi-plantarflexion is about Z of the plate, inversion-eversion about X.
"""
_CURVES: Final = ("stiffness_nm_per_rad", "damping_nms_per_rad")
_SET_POINTS: Final = ("mean_moment_nm", "equilibrium_rad", "cross_stiffness_nm_per_rad")
MOST_HALF_SHARE: Final = {"stiffness": 0.10, "damping": 0.20}
"""Half of a 95 % interval over its value: mean errors of 4 and 8 %, which a controller may have, lie within."""


class AxisTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One axis: lists as long as `stance_percent`, and the foot's moment of inertia about the ankle's axis.

    The quality of stiffness and damping is `…_half_share`: half of a 95 % interval over the value, on average.
    `mean_moment_nm` is the unperturbed moment and `equilibrium_rad` the angle of foot against shank at which a spring
    of this stiffness makes none, positive as the plate's angles are; `cross_stiffness_nm_per_rad` is the moment about
    this axis that a turn about the other one makes: with both axes' own, stiffness is a matrix of two rows.
    """

    stiffness_nm_per_rad: list[float]
    stiffness_nm_per_rad_low: list[float]
    stiffness_nm_per_rad_high: list[float]
    damping_nms_per_rad: list[float]
    damping_nms_per_rad_low: list[float]
    damping_nms_per_rad_high: list[float]
    foot_inertia_kgm2: float
    foot_inertia_kgm2_low: float
    foot_inertia_kgm2_high: float
    not_identifiable: list[str]
    stiffness_half_share: float | None = None
    damping_half_share: float | None = None
    mean_moment_nm: list[float] = msgspec.field(default_factory=list)
    mean_moment_nm_low: list[float] = msgspec.field(default_factory=list)
    mean_moment_nm_high: list[float] = msgspec.field(default_factory=list)
    equilibrium_rad: list[float] = msgspec.field(default_factory=list)
    equilibrium_rad_low: list[float] = msgspec.field(default_factory=list)
    equilibrium_rad_high: list[float] = msgspec.field(default_factory=list)
    cross_stiffness_nm_per_rad: list[float] = msgspec.field(default_factory=list)
    cross_stiffness_nm_per_rad_low: list[float] = msgspec.field(default_factory=list)
    cross_stiffness_nm_per_rad_high: list[float] = msgspec.field(default_factory=list)


class AnkleTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What `ankle_impedance.toml` holds."""

    manoeuvre: Manoeuvre
    ground_slope_deg: Annotated[float, msgspec.Meta(ge=-30.0, le=30.0)]
    subject: str
    body_mass_kg: Annotated[float, msgspec.Meta(ge=10.0, le=300.0)]
    perturbed_cycles: Annotated[int, msgspec.Meta(ge=0)]
    stance_percent: list[float]
    dorsi_plantarflexion: AxisTable
    inversion_eversion: AxisTable
    wrench_delay_s: float | None = None
    wrench_delay_deviation_s: float | None = None

    def axes(self) -> tuple[AxisTable, AxisTable]:
        """Return both axes."""
        return self.dorsi_plantarflexion, self.inversion_eversion


def table_of(trial: AnkleTrial, found: AnkleImpedance) -> AnkleTable:
    """Return the table of what was identified in a trial."""
    axes = [_axis_table(axis, found.stance) for axis in found.axes]
    table = table_with(axes, found.stance, trial.settings, trial.perturbation)
    return msgspec.structs.replace(
        table, wrench_delay_s=found.delay_s, wrench_delay_deviation_s=found.delay_deviation_s
    )


def table_with(
    axes: Sequence[AxisTable], stance: FloatArray, settings: TrialSettings, perturbation: Sequence[Perturbation]
) -> AnkleTable:
    """Return the table of both `axes` at the shares `stance` (k,) of a trial, the `perturbation` of each cycle told."""
    dorsi_plantarflexion, inversion_eversion = axes
    return AnkleTable(
        manoeuvre=settings.manoeuvre,
        ground_slope_deg=settings.ground_slope_deg,
        subject=settings.subject.code,
        body_mass_kg=settings.subject.mass_kg,
        perturbed_cycles=sum(kind is not Perturbation.NONE for kind in perturbation),
        stance_percent=(100.0 * stance).round(6).tolist(),
        dorsi_plantarflexion=dorsi_plantarflexion,
        inversion_eversion=inversion_eversion,
    )


def save_table(path: Path, table: AnkleTable) -> None:
    """Write the file in one step; raises UserError where it cannot, or `load_table` would refuse it."""
    check_table(table, str(path))
    write_toml(path, msgspec.to_builtins(table), _HEADING)


def load_table(path: Path) -> AnkleTable:
    """Return the checked table; raises UserError, one line with file, field and what is allowed."""
    table = checked(read_toml(path), AnkleTable, str(path))
    check_table(table, str(path))
    return table


def _axis_table(axis: AxisImpedance, stance: FloatArray) -> AxisTable:
    reasons: list[str] = []
    shown: dict[str, list[float]] = {}
    shares: dict[str, float] = {}
    for name, curve in zip(_CURVES, (axis.stiffness, axis.damping), strict=True):
        unknown = curve.low <= 0.0
        quantity = name.split("_")[0]
        share = float((NORMAL_95 * curve.deviation / np.abs(curve.value)).mean())
        shares[quantity] = share
        if share > MOST_HALF_SHARE[quantity]:
            reasons.append(
                f"{quantity} refused: its 95 % intervals are ±{100.0 * share:.0f} % on average over stance, allowed "
                f"±{100.0 * MOST_HALF_SHARE[quantity]:.0f} %"
            )
            shown |= _shown(name, curve, np.ones(len(stance), dtype=np.bool_))
            continue
        if unknown.any():
            percent = 100.0 * stance[unknown]
            reasons.append(f"{name} from {percent.min():.1f} to {percent.max():.1f} %: its interval holds zero")
        shown |= _shown(name, curve, unknown)
    half = NORMAL_95 * axis.inertia_deviation_kgm2
    known = axis.inertia_kgm2 - half > 0.0
    if not known:
        reasons.append("foot_inertia_kgm2: its interval holds zero")
    shown |= _shown("mean_moment_nm", axis.mean_moment, np.zeros(len(stance), dtype=np.bool_))
    shown |= _shown("cross_stiffness_nm_per_rad", axis.cross_stiffness, np.zeros(len(stance), dtype=np.bool_))
    shown |= _shown("equilibrium_rad", axis.equilibrium, np.isnan(shown["stiffness_nm_per_rad"]))
    return AxisTable(
        stiffness_nm_per_rad=shown["stiffness_nm_per_rad"],
        stiffness_nm_per_rad_low=shown["stiffness_nm_per_rad_low"],
        stiffness_nm_per_rad_high=shown["stiffness_nm_per_rad_high"],
        damping_nms_per_rad=shown["damping_nms_per_rad"],
        damping_nms_per_rad_low=shown["damping_nms_per_rad_low"],
        damping_nms_per_rad_high=shown["damping_nms_per_rad_high"],
        foot_inertia_kgm2=axis.inertia_kgm2 if known else np.nan,
        foot_inertia_kgm2_low=axis.inertia_kgm2 - half,
        foot_inertia_kgm2_high=axis.inertia_kgm2 + half,
        not_identifiable=reasons,
        stiffness_half_share=shares["stiffness"],
        damping_half_share=shares["damping"],
        mean_moment_nm=shown["mean_moment_nm"],
        mean_moment_nm_low=shown["mean_moment_nm_low"],
        mean_moment_nm_high=shown["mean_moment_nm_high"],
        equilibrium_rad=shown["equilibrium_rad"],
        equilibrium_rad_low=shown["equilibrium_rad_low"],
        equilibrium_rad_high=shown["equilibrium_rad_high"],
        cross_stiffness_nm_per_rad=shown["cross_stiffness_nm_per_rad"],
        cross_stiffness_nm_per_rad_low=shown["cross_stiffness_nm_per_rad_low"],
        cross_stiffness_nm_per_rad_high=shown["cross_stiffness_nm_per_rad_high"],
    )


def _shown(name: str, curve: Curve, unknown: BoolArray) -> dict[str, list[float]]:
    value: list[float] = np.where(unknown, np.nan, curve.value).tolist()
    return {name: value, f"{name}_low": curve.low.tolist(), f"{name}_high": curve.high.tolist()}


def check_table(table: AnkleTable, where: str) -> None:
    """Raise UserError, its line beginning with `where`, for curves that do not fit each other."""
    problem = next(_problems(table), None)
    if problem is not None:
        raise UserError(f"{where}: {problem}")


def _problems(table: AnkleTable) -> Iterator[str]:
    stance = np.array(table.stance_percent)
    if len(stance) < 2 or not (np.all(np.diff(stance) > 0.0) and stance[0] >= 0.0 and stance[-1] <= 100.0):
        yield "stance_percent must rise from 0 at least to 100 at most, two values or more"
    for axis, part in zip(("dorsi_plantarflexion", "inversion_eversion"), table.axes(), strict=True):
        for name in _CURVES:
            value, low, high = (np.array(getattr(part, name + end)) for end in ("", "_low", "_high"))
            if not len(value) == len(low) == len(high) == len(stance):
                yield f"{axis}.{name} and its low and high must hold {len(stance)} values each, as stance_percent does"
            elif not (np.isfinite(low) & np.isfinite(high)).all():
                yield f"{axis}.{name}_low and _high must be finite"
            elif np.any((value < low) | (value > high) | (low > high)):
                k = int(np.argmax((value < low) | (value > high) | (low > high)))
                yield f"{axis}.{name}[{k}] is {value[k]:.6g}, allowed {low[k]:.6g} to {high[k]:.6g}: low to high"
            elif np.any(value <= 0.0):
                k = int(np.argmax(value <= 0.0))
                yield f"{axis}.{name}[{k}] is {value[k]:.6g}, allowed above 0, or nan"
        for name in _SET_POINTS:
            value, low, high = (np.array(getattr(part, name + end)) for end in ("", "_low", "_high"))
            if not len(value) == len(low) == len(high) or len(value) not in (0, len(stance)):
                yield f"{axis}.{name} and its low and high must hold {len(stance)} values each, as stance_percent does"
            elif np.any((value < low) | (value > high) | (low > high)):
                yield f"{axis}.{name} must lie between its low and high, which must rise"
