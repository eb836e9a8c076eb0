"""A recording of the platform: a folder of plain files that a laboratory can write.

`platform.toml` holds the settings below; `motion.csv` the poses of plate and foot in I; `force_plate.csv` the tared
wrench (f, T) that the platform exerts on what stands above the sensor, in P about P's origin. R_IP = Ry(ψ) Rz(θ)
Rx(φ), Y up. A table `[truth]` may say what a simulation knows. It is kept apart: no recording carries it to an
estimator.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from impedance.body.rigid_body import Inertia
from impedance.recording.check import Stream, on_grid, prepared
from impedance.recording.plain_files import read_toml, write_toml
from impedance.recording.table import read_columns, write_columns
from messages.arrays import FloatArray
from messages.checked import checked
from messages.errors import UserError
from messages.text_files import check_sizes

SETTINGS_FILE: Final = "platform.toml"
MOTION_FILE: Final = "motion.csv"
FORCE_FILE: Final = "force_plate.csv"

LARGEST_SETTING: Final = 1e6
"""No length, mass, rate or force of a platform is beyond it, in SI units."""

_LEAST_FOOT_M: Final = 0.001

_POSE: Final = ("x_m", "y_m", "z_m", "psi_rad", "theta_rad", "phi_rad")
PLATE_COLUMNS: Final = tuple(f"plate_{name}" for name in _POSE)
FOOT_COLUMNS: Final = tuple(f"foot_{name}" for name in _POSE)
WRENCH_COLUMNS: Final = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")

Triple = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
_Rate = Annotated[float, Meta(ge=20.0, le=20_000.0)]
_Deviation = Annotated[float, Meta(gt=0.0, le=100.0)]
_Share = Annotated[float, Meta(ge=0.0, le=0.5)]
_Place = Annotated[float, Meta(ge=0.0, le=0.2)]


class RateSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Samples per second of the two streams."""

    motion_hz: _Rate
    force_hz: _Rate


class PlateSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The plate above the sensor: its mass, and the rest of its inertia where an earlier run told it.

    `cog_m` is in P, `inertia_kgm2` are the entries xx, yy, zz, yz, xz, xy of the tensor about it along P.
    """

    mass_kg: Annotated[float, Meta(gt=0.0, le=500.0)]
    joint_to_surface_m: Annotated[float, Meta(ge=0.01, le=1.0)]
    cog_m: Triple | None = None
    inertia_kgm2: Six | None = None

    @property
    def inertia(self) -> Inertia | None:
        """Return the plate's inertia, or None where the file leaves it open."""
        if self.cog_m is None or self.inertia_kgm2 is None:
            return None
        return Inertia.about(self.mass_kg, np.array(self.cog_m), np.array(self.inertia_kgm2))


class FootSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Whether a foot is mounted on the plate, and where its frame's origin lies in P, measured to ±1 mm.

    `mass_kg` ± `mass_deviation_kg` where another scale weighed it, or it is a weight that was calibrated: only that
    tells a gain which all channels of the force plate share.
    """

    present: bool = False
    origin_in_plate_m: Triple = (0.0, 0.1814, 0.0)
    mass_kg: Annotated[float, Meta(gt=0.0, le=500.0)] | None = None
    mass_deviation_kg: Annotated[float, Meta(gt=0.0, le=50.0)] = 0.005


class TareSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What the force plate's tare took away from every sample.

    `force_n`, `moment_nm` are the constants subtracted and `with_foot` tells whether the foot stood on the plate then.
    With `at_rest` the constants are not known; a resting second, level, averages to zero instead.
    """

    force_n: Triple = (0.0, 0.0, 0.0)
    moment_nm: Triple = (0.0, 0.0, 0.0)
    with_foot: bool = False
    at_rest: bool = False


class NoiseSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Standard deviations of one sample, where they are known."""

    position_m: _Deviation | None = None
    angle_rad: _Deviation | None = None
    force_n: _Deviation | None = None
    torque_nm: _Deviation | None = None


class UncertaintySettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Standard deviations of what a laboratory does not know exactly and no second of noise tells; zero means exact.

    `gain_share` of all six channels alike, of each one besides, and of the reading of the plate's mass unless
    `mass_share` tells that of another scale;
    `crosstalk_share` of each channel in each other one, where `moment_per_force_m`, the rated moment over the rated
    force, stands between the units; `axes_rad` of the force plate's axes against the markers'; `reference_m` of the
    point about which moments are told; `delay_s` of the force stamps against the motion's; `joint_m` of
    `plate.joint_to_surface_m`, along each axis; `foot_origin_m` of `foot.origin_in_plate_m`. The defaults are those of
    a six-component force plate of good make that was mounted and surveyed with care.
    """

    gain_share: _Share = 0.005
    crosstalk_share: _Share = 0.005
    moment_per_force_m: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.25
    axes_rad: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.005
    reference_m: _Place = 0.001
    delay_s: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.0003
    joint_m: _Place = 0.001
    foot_origin_m: _Place = 0.0005
    mass_share: _Share | None = None

    @classmethod
    def none(cls) -> "UncertaintySettings":
        """Return what says that all of it is known exactly, as in a simulation."""
        return cls(
            gain_share=0.0,
            crosstalk_share=0.0,
            axes_rad=0.0,
            reference_m=0.0,
            delay_s=0.0,
            joint_m=0.0,
            foot_origin_m=0.0,
            mass_share=0.0,
        )


class PlatformSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of `platform.toml` but the truth."""

    rates: RateSettings
    plate: PlateSettings
    foot: FootSettings = FootSettings()
    tare: TareSettings = TareSettings()
    noise: NoiseSettings = NoiseSettings()
    uncertainty: UncertaintySettings = UncertaintySettings()


class Truth(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a simulation knows and no estimator may: inertias as `plate` has them, and how the run was made."""

    plate_mass_kg: float
    plate_cog_m: Triple
    plate_inertia_kgm2: Six
    foot_mass_kg: float | None = None
    foot_cog_m: Triple | None = None
    foot_inertia_kgm2: Six | None = None
    update_hz: float | None = None
    seed: int | None = None

    @classmethod
    def of(cls, plate: Inertia, foot: Inertia | None, update_hz: float | None, seed: int) -> "Truth":
        """Return the truth of a plate in P and a foot in F."""
        return cls(
            plate_mass_kg=plate.mass_kg,
            plate_cog_m=tuple(plate.cog_m.tolist()),
            plate_inertia_kgm2=tuple(plate.about_cog().tolist()),
            foot_mass_kg=None if foot is None else foot.mass_kg,
            foot_cog_m=None if foot is None else tuple(foot.cog_m.tolist()),
            foot_inertia_kgm2=None if foot is None else tuple(foot.about_cog().tolist()),
            update_hz=update_hz,
            seed=seed,
        )

    @property
    def plate(self) -> Inertia:
        """Return the plate's inertia in P."""
        return Inertia.about(self.plate_mass_kg, np.array(self.plate_cog_m), np.array(self.plate_inertia_kgm2))

    @property
    def foot(self) -> Inertia | None:
        """Return the foot's inertia in F, or None without a foot."""
        if self.foot_mass_kg is None or self.foot_cog_m is None or self.foot_inertia_kgm2 is None:
            return None
        return Inertia.about(self.foot_mass_kg, np.array(self.foot_cog_m), np.array(self.foot_inertia_kgm2))


@dataclass(frozen=True)
class Poses:
    """A frame's way in I: `p_m` (n, 3) of its origin, `euler_rad` (n, 3) as (ψ, θ, φ); NaN where it was not seen."""

    p_m: FloatArray
    euler_rad: FloatArray

    @property
    def columns(self) -> FloatArray:
        """Return both side by side, (n, 6)."""
        return np.hstack((self.p_m, self.euler_rad))

    @classmethod
    def from_columns(cls, columns: FloatArray) -> "Poses":
        """Return the poses of `columns` (n, 6)."""
        return cls(columns[:, :3], columns[:, 3:])


@dataclass(frozen=True)
class PlatformRecording:
    """Motion at `t_s` (n,) and wrench (k, 6) at `force_t_s` (k,), each on a uniform grid; NaN marks what is missing.

    `notes` tell what the check of a loaded recording found and could live with, one line each.
    """

    settings: PlatformSettings
    t_s: FloatArray
    plate: Poses
    foot: Poses | None
    force_t_s: FloatArray
    wrench: FloatArray
    notes: tuple[str, ...] = ()

    @classmethod
    def load(cls, folder: Path) -> "PlatformRecording":
        """Return the recording in `folder`, checked; raises UserError, one line, for what cannot be used."""
        settings_path = folder / SETTINGS_FILE
        settings = settings_of(read_toml(settings_path), str(settings_path))
        foot_columns = FOOT_COLUMNS if settings.foot.present else ()
        motion = read_columns(folder / MOTION_FILE, ("t_s", *PLATE_COLUMNS, *foot_columns))
        force = read_columns(folder / FORCE_FILE, ("t_s", *WRENCH_COLUMNS))
        return cls.from_streams(
            settings,
            Stream(str(folder / MOTION_FILE), (*PLATE_COLUMNS, *foot_columns), motion[:, 0], motion[:, 1:]),
            Stream(str(folder / FORCE_FILE), WRENCH_COLUMNS, force[:, 0], force[:, 1:]),
        )

    @classmethod
    def from_streams(cls, settings: PlatformSettings, motion: Stream, force: Stream) -> "PlatformRecording":
        """Return the recording of two raw streams, put on uniform grids and checked; raises UserError."""
        motion, motion_notes = on_grid(motion, settings.rates.motion_hz, "rates.motion_hz")
        force, force_notes = on_grid(force, settings.rates.force_hz, "rates.force_hz")
        notes = prepared(
            motion,
            force,
            plate_mass_kg=settings.plate.mass_kg,
            joint_to_surface_m=settings.plate.joint_to_surface_m,
            foot_in_plate_m=np.array(settings.foot.origin_in_plate_m) if settings.foot.present else None,
        )
        foot = Poses.from_columns(motion.values[:, 6:]) if settings.foot.present else None
        return cls(
            settings=settings,
            t_s=motion.t_s,
            plate=Poses.from_columns(motion.values[:, :6]),
            foot=foot,
            force_t_s=force.t_s,
            wrench=force.values,
            notes=(*motion_notes, *force_notes, *notes),
        )

    @property
    def exact(self) -> "PlatformRecording":
        """Return this recording with instruments that are stated to be exact: intervals then hold noise alone."""
        settings = msgspec.structs.replace(self.settings, uncertainty=UncertaintySettings.none())
        return replace(self, settings=settings)

    def save(self, folder: Path, truth: Truth | None = None) -> None:
        """Write the three files, with `truth` in its own table where given; raises UserError where it cannot."""
        document: dict[str, object] = _present(msgspec.to_builtins(self.settings))
        if truth is not None:
            document["truth"] = _present(msgspec.to_builtins(truth))
        write_toml(folder / SETTINGS_FILE, document, _HEADING)
        poses = [self.plate.columns] if self.foot is None else [self.plate.columns, self.foot.columns]
        names = PLATE_COLUMNS if self.foot is None else (*PLATE_COLUMNS, *FOOT_COLUMNS)
        write_columns(folder / MOTION_FILE, ("t_s", *names), np.column_stack((self.t_s, *poses)))
        write_columns(folder / FORCE_FILE, ("t_s", *WRENCH_COLUMNS), np.column_stack((self.force_t_s, self.wrench)))


def settings_of(document: Mapping[str, object], where: str) -> PlatformSettings:
    """Return the settings of a parsed `platform.toml` without `[truth]`; raises UserError beginning with `where`."""
    told = {key: value for key, value in document.items() if key != "truth"}
    check_sizes(told, LARGEST_SETTING, where)
    settings = checked(told, PlatformSettings, where)
    inertia = settings.plate.inertia
    if inertia is not None and not inertia.is_consistent:
        raise UserError(
            f"{where}: plate.inertia_kgm2: no rigid body has it (each moment at most the sum of the others)"
        )
    if settings.foot.present and np.linalg.norm(settings.foot.origin_in_plate_m) < _LEAST_FOOT_M:
        raise UserError(
            f"{where}: foot.origin_in_plate_m is at P's origin, allowed {_LEAST_FOOT_M:g} m from it or more"
        )
    if settings.tare.at_rest and any((*settings.tare.force_n, *settings.tare.moment_nm)):
        raise UserError(f"{where}: tare.at_rest is true, so tare.force_n and tare.moment_nm must be left out")
    return settings


def read_truth(folder: Path) -> Truth:
    """Return what the simulation that wrote `folder` knows; raises UserError where there is none."""
    path = folder / SETTINGS_FILE
    document = read_toml(path)
    if "truth" not in document:
        raise UserError(f"{path}: has no table [truth]")
    return checked(document["truth"], Truth, f"{path}: truth")


def _present(table: Mapping[str, object]) -> dict[str, object]:
    """Return `table` without what is None, which TOML cannot say."""
    return {
        key: _present(value) if isinstance(value, Mapping) else value
        for key, value in table.items()
        if value is not None
    }


_HEADING: Final = "# Recording of the vibrating platform. SI units. Y up; R_IP = Ry(psi) Rz(theta) Rx(phi).\n"
