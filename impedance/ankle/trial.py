"""A human trial on the vibrating platform: some cycles of stance on one slope and in one manoeuvre, as a folder.

- `trial.toml`: the settings (`TrialSettings`);
- `cycles.csv`: the samples, one row each, columns `COLUMNS` and, where the foot's markers were seen, `FOOT_COLUMNS`;
- `events.csv`: one row per cycle: `cycle, perturbation, onset_s`; none, ramp or random; the onset on the cycle's t_s.

Plate angles are θ and φ of R_IP = Rz(θ) Rx(φ), so θ holds the slope; the shank's are its turns about Z and X from
upright, the foot's those from where it stood in P when the ankle's centre was measured. The wrench is the one that the
platform exerts, in P, about P's origin, tared with the bare plate level. The foot stands flat on the plate between the
two shares of stance that the settings tell, and before its heel rises: only there is anything estimated. Where the foot
was not seen it counts as turning with the plate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.recording.plain_files import read_table, read_toml, write_table, write_toml
from impedance.recording.table import header_of, read_columns, write_columns
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.checked import checked
from messages.errors import UserError

COLUMNS: Final = (
    *("cycle", "t_s", "stance_percent", "plate_theta_rad", "plate_phi_rad", "shank_theta_rad", "shank_phi_rad"),
    *("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"),
)
FOOT_COLUMNS: Final = ("foot_theta_rad", "foot_phi_rad", "heel_rise_m")
EVENT_COLUMNS: Final = ("cycle", "perturbation", "onset_s")

Length = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
Moment = Annotated[float, msgspec.Meta(ge=-10.0, le=10.0)]
Deviation = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
Known = Annotated[float, msgspec.Meta(gt=0.0, le=1e5)]
Percent = Annotated[float, msgspec.Meta(ge=0.0, le=100.0)]

_LARGEST_ANGLE_RAD = 1.0
_WEIGHT_SHARE = (0.2, 2.0)
_STEP_TOLERANCE = 0.05
_LEAST_SAMPLES = 50
_LARGEST_HEEL_RISE_M = 0.3


class Manoeuvre(Enum):
    """What is done on the plate; `mockup`: springs and dampers of known values stand there, nobody."""

    STANDING = "standing"
    STRAIGHT = "straight"
    STEP_TURN = "step_turn"
    SPIN_TURN = "spin_turn"
    SIDESTEP = "sidestep"
    MOCKUP = "mockup"


class Perturbation(Enum):
    """How the plate moves during one cycle: not at all, by one short ramp, or at random all the time."""

    NONE = "none"
    RAMP = "ramp"
    RANDOM = "random"


class Subject(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Who walks: a code, never a name."""

    code: str
    mass_kg: Annotated[float, msgspec.Meta(ge=10.0, le=300.0)]


class FlatFoot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The share of stance, heel strike 0 to toe off 100, in which the foot stands flat on the plate.

    Where the heel was seen, a step's foot is no longer flat once it has risen by `heel_rise_m`.
    """

    from_percent: Percent
    to_percent: Percent
    heel_rise_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.1)] = 0.005


class Ankle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the ankle's centre A lies in P while the foot is flat, with its standard deviation."""

    in_plate_m: tuple[Length, Length, Length]
    deviation_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.05)]


class Contact(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """About which point of P the flat foot turns against the plate as shoe and heel pad give way, and its deviation."""

    in_plate_m: tuple[Length, Length, Length]
    deviation_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.1)] = 0.01


class Mockup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What stands on the plate instead of a person: known stiffness and damping about Z and X."""

    stiffness_nm_per_rad: tuple[Known, Known]
    damping_nms_per_rad: tuple[Known, Known]


class BodyPrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of a body beforehand: mass, centre of gravity in P, tensor about it along P; and deviations.

    The tensor's order is xx, yy, zz, yz, xz, xy.
    """

    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
    cog_m: tuple[Length, Length, Length]
    inertia_kgm2: tuple[Moment, Moment, Moment, Moment, Moment, Moment]
    mass_deviation_kg: Deviation
    cog_deviation_m: tuple[Deviation, Deviation, Deviation]
    inertia_deviation_kgm2: tuple[Deviation, Deviation, Deviation, Deviation, Deviation, Deviation]


class Instruments(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of the wrench's delay behind the motion, and one standard deviation of it and of the gain.

    Where a weight stood on the plate before, the finder's explanation of it tells the delay (`force_delay`,
    impedance.ankle.inherited). `crosstalk_deviation_share` is that of either moment in the other.
    """

    delay_s: Annotated[float, msgspec.Meta(ge=-0.02, le=0.02)] = 0.0
    delay_deviation_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.01)] = 0.001
    gain_deviation_share: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.005
    crosstalk_deviation_share: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.005


class TrialSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What `trial.toml` holds; without `contact` the foot turns about the point of the surface below the ankle."""

    manoeuvre: Manoeuvre
    ground_slope_deg: Annotated[float, msgspec.Meta(ge=-30.0, le=30.0)]
    rate_hz: Annotated[float, msgspec.Meta(ge=100.0, le=5000.0)]
    joint_to_surface_m: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    subject: Subject
    flat_foot: FlatFoot
    ankle: Ankle
    plate: BodyPrior
    foot: BodyPrior
    instruments: Instruments = Instruments()
    contact: Contact | None = None
    mockup: Mockup | None = None


@dataclass(frozen=True)
class AnkleTrial:
    """n samples of c cycles, one cycle after the other.

    `cycle` (n,) counts from 0; `t_s`, `stance` (n,), 0 at heel strike and 1 at toe off; `plate_rad` (n, 2) is (θ, φ),
    `shank_rad` (n, 2) likewise about Z and X; `wrench` (n, 6) is (f, T). Of each cycle: `perturbation` and `onset_s`
    (c,), NaN where there is none. `foot_rad` (n, 2) and `heel_rise_m` (n,), the heel's height above where it stands in
    P, are None where the foot was not seen.
    """

    settings: TrialSettings
    cycle: IntArray
    t_s: FloatArray
    stance: FloatArray
    plate_rad: FloatArray
    shank_rad: FloatArray
    wrench: FloatArray
    perturbation: tuple[Perturbation, ...]
    onset_s: FloatArray
    foot_rad: FloatArray | None = None
    heel_rise_m: FloatArray | None = None

    def rows_of(self, cycle: int) -> slice:
        """Return the samples of one cycle."""
        first, end = np.searchsorted(self.cycle, (cycle, cycle + 1)).tolist()
        return slice(first, end)


def load_trial(folder: Path) -> AnkleTrial:
    """Return the trial in `folder`; raises UserError, one line with file, field or row, and what is allowed."""
    settings_path, cycles_path, events_path = (folder / n for n in ("trial.toml", "cycles.csv", "events.csv"))
    settings = checked(read_toml(settings_path), TrialSettings, str(settings_path))
    _check_settings(settings, settings_path)
    columns = not set(header_of(cycles_path)).isdisjoint(FOOT_COLUMNS)
    rows = _numbers(cycles_path, (*COLUMNS, *FOOT_COLUMNS) if columns else COLUMNS)
    events = read_table(events_path, EVENT_COLUMNS)
    names, cycle = np.unique(rows[:, 0], return_inverse=True)
    trial = AnkleTrial(
        settings,
        cycle.astype(np.int64).reshape(-1),
        *(rows[:, 1], 0.01 * rows[:, 2], rows[:, 3:5], rows[:, 5:7], rows[:, 7:13]),
        *_events(events_path, events, names),
        *((rows[:, 13:15], rows[:, 15]) if columns else ()),
    )
    _check_samples(trial, rows[:, 0], cycles_path)
    _check_onsets(trial, events_path)
    return trial


def check_trial(trial: AnkleTrial, path: Path) -> None:
    """Raise UserError, beginning with `path`, for a trial that `load_trial` would refuse."""
    _check_settings(trial.settings, path)
    _check_samples(trial, trial.cycle.astype(np.float64) + 1.0, path)
    _check_onsets(trial, path)


def save_trial(folder: Path, trial: AnkleTrial) -> None:
    """Write the folder that `load_trial` reads, to 12 digits; raises UserError where it cannot."""
    write_toml(folder / "trial.toml", msgspec.to_builtins(trial.settings))
    motion = (trial.plate_rad, trial.shank_rad, trial.wrench)
    rows = np.column_stack((trial.cycle + 1.0, trial.t_s, 100.0 * trial.stance, *motion))
    columns: tuple[str, ...] = COLUMNS
    if trial.foot_rad is not None and trial.heel_rise_m is not None:
        rows, columns = np.column_stack((rows, trial.foot_rad, trial.heel_rise_m)), (*COLUMNS, *FOOT_COLUMNS)
    write_columns(folder / "cycles.csv", columns, rows)
    events = enumerate(zip(trial.perturbation, trial.onset_s.tolist(), strict=True), start=1)
    write_table(
        folder / "events.csv",
        EVENT_COLUMNS,
        [[str(c), kind.value, "" if np.isnan(at_s) else f"{at_s:.10g}"] for c, (kind, at_s) in events],
    )


def _numbers(path: Path, columns: Sequence[str]) -> FloatArray:
    rows = read_columns(path, columns)
    wrong = np.argwhere(~np.isfinite(rows))
    if len(wrong):
        row, column = wrong[0].tolist()
        raise UserError(f"{path}: row {row + 2}: {columns[column]} is not finite; leave the whole cycle out")
    return rows


def _events(path: Path, table: list[list[str]], names: FloatArray) -> tuple[tuple[Perturbation, ...], FloatArray]:
    known = {kind.value: kind for kind in Perturbation}
    found: dict[float, tuple[Perturbation, float]] = {}
    for row, (name, kind, onset) in enumerate(table, start=2):
        if kind not in known:
            raise UserError(f"{path}: row {row}: perturbation is {kind!r}, allowed {', '.join(known)}")
        try:
            number, onset_s = float(name), float(onset) if onset else np.nan
        except ValueError:
            raise UserError(
                f"{path}: row {row}: cycle and onset_s must be numbers, found {name!r}, {onset!r}"
            ) from None
        if number in found:
            raise UserError(f"{path}: row {row}: cycle {name} stands twice")
        found[number] = (known[kind], onset_s)
    for number in names.tolist():
        if number not in found:
            raise UserError(f"{path}: cycle {number:g} of cycles.csv is missing")
    kinds, onsets = zip(*(found[number] for number in names.tolist()), strict=True)
    return kinds, np.array(onsets)


def _check_settings(settings: TrialSettings, path: Path) -> None:
    flat = settings.flat_foot
    if not flat.from_percent + 10.0 <= flat.to_percent:
        raise UserError(
            f"{path}: flat_foot.to_percent is {flat.to_percent:g}, allowed from {flat.from_percent + 10.0:g} to 100: "
            "at least 10 % of stance"
        )
    if (settings.mockup is None) == (settings.manoeuvre is Manoeuvre.MOCKUP):
        raise UserError(f'{path}: manoeuvre "mockup" needs the table [mockup], and the other way round')


def _check_samples(trial: AnkleTrial, name: FloatArray, path: Path) -> None:
    """Raise UserError for what cannot be: broken or unsorted cycles, gaps, degrees, an upside-down plate."""
    if np.any(np.diff(name) < 0.0):
        row = int(np.argmax(np.diff(name) < 0.0)) + 3
        raise UserError(f"{path}: row {row}: cycle falls; the cycles must stand one after the other, rising")
    same = np.diff(trial.cycle) == 0
    step_s = 1.0 / trial.settings.rate_hz
    off = same & (np.abs(np.diff(trial.t_s) - step_s) > _STEP_TOLERANCE * step_s)
    if off.any():
        row = int(np.argmax(off))
        raise UserError(
            f"{path}: row {row + 3}: t_s steps by {trial.t_s[row + 1] - trial.t_s[row]:.6g} s, "
            f"allowed {step_s:.6g} s (rate_hz) ± {100 * _STEP_TOLERANCE:g} %: a gap, or an unequal rate"
        )
    falls = same & (np.diff(trial.stance) <= 0.0)
    if falls.any():
        raise UserError(f"{path}: row {int(np.argmax(falls)) + 3}: stance_percent must rise within a cycle")
    counts = np.bincount(trial.cycle)
    if counts.min() < _LEAST_SAMPLES:
        raise UserError(
            f"{path}: cycle {name[np.searchsorted(trial.cycle, counts.argmin())]:g} has {counts.min()} samples, "
            f"allowed from {_LEAST_SAMPLES}"
        )
    if trial.heel_rise_m is not None and np.abs(trial.heel_rise_m).max() > _LARGEST_HEEL_RISE_M:
        raise UserError(
            f"{path}: heel_rise_m reaches {np.abs(trial.heel_rise_m).max():.4g}, allowed ±{_LARGEST_HEEL_RISE_M:g} m: "
            "millimetres, or not from where the heel stands?"
        )
    angles = [trial.plate_rad, trial.shank_rad, *([] if trial.foot_rad is None else [trial.foot_rad])]
    names = (*COLUMNS[3:7], *FOOT_COLUMNS[:2])
    for column, values in zip(names, np.hstack(angles).T, strict=False):
        if np.abs(values).max() > _LARGEST_ANGLE_RAD:
            raise UserError(
                f"{path}: {column} reaches {np.abs(values).max():.4g}, allowed ±{_LARGEST_ANGLE_RAD:g} rad: degrees?"
            )
    weight_n = PLATFORM_GRAVITY_MPS2 * trial.settings.subject.mass_kg
    flat = in_flat_foot(trial)
    share = float(np.median(trial.wrench[flat, 1])) / weight_n if flat.any() else np.nan
    if not _WEIGHT_SHARE[0] <= share <= _WEIGHT_SHARE[1]:
        raise UserError(
            f"{path}: fy_n with the foot flat has the median {share:.2g} of the subject's weight, allowed "
            f"{_WEIGHT_SHARE[0]:g} to {_WEIGHT_SHARE[1]:g}: the platform pushes up; axes swapped, or another unit?"
        )


def _check_onsets(trial: AnkleTrial, path: Path) -> None:
    for cycle, (kind, onset_s) in enumerate(zip(trial.perturbation, trial.onset_s.tolist(), strict=True)):
        rows = trial.rows_of(cycle)
        first_s, last_s = trial.t_s[rows][[0, -1]].tolist()
        if kind is Perturbation.RAMP and not first_s <= onset_s <= last_s:
            raise UserError(
                f"{path}: row {cycle + 2}: onset_s of a ramp is {onset_s:g}, allowed {first_s:g} to {last_s:g}"
            )


def in_flat_foot(trial: AnkleTrial) -> BoolArray:
    """Return (n,) where the foot stands flat on the plate, of each step up to where its heel rises."""
    flat = trial.settings.flat_foot
    told: BoolArray = (trial.stance >= 0.01 * flat.from_percent) & (trial.stance <= 0.01 * flat.to_percent)
    if trial.heel_rise_m is None:
        return told
    up = told & (trial.heel_rise_m > flat.heel_rise_m)
    risen = np.concatenate([np.cumsum(up[trial.rows_of(c)]) > 0 for c in range(len(trial.perturbation))])
    flat_now: BoolArray = told & ~risen
    return flat_now
