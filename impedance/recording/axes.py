"""Wrong units and swapped axes, found from what plate and wrench must do on the universal joint.

Small motions about level, within a band where gravity hardly counts:

    p_x = −L θ,   p_z = L φ,   f_x ∝ −θ̈,   f_z ∝ φ̈,   T_z ∝ θ̈,   T_x ∝ φ̈                                          (1)

with positive factors, the centre of gravity being on the plate's side of the joint. So four triples of columns,
positions, angles, forces and moments, tell of the same two rotations. One triple that disagrees with the others and
agrees once its columns are exchanged or reversed has them so.

A strap or a damper above the sensor adds moments in proportion to angles and rates that may be larger than those of
inertia, and dry friction does nearly so: whatever angles and rates tell is taken out of all columns before they are
compared. And what neither rotation moves is the smallest of its triple: an exchange after which it is not is none.
"""

from itertools import permutations, product
from typing import Final

import numpy as np

from messages.arrays import BoolArray, FloatArray, rms
from messages.errors import UserError

_BAND_HZ: Final = (3.0, 15.0)
_AGREES: Final = 0.7
_DISAGREES: Final = 0.4
_NEITHER: Final = 5.0
"""A length or slope within this factor of what it must be is no matter of units."""
_MOST_ANGLE_RAD: Final = 0.5
_LEAST_SWING_RAD: Final = 1e-4
_LONGEST_LEVER_M: Final = 10.0
_LEAST_FORCE_SHARE: Final = 0.02
_UNITS: Final = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))

_TRIPLES: Final = (
    ("plate_x_m", "plate_y_m", "plate_z_m"),
    ("plate_psi_rad", "plate_theta_rad", "plate_phi_rad"),
    ("fx_n", "fy_n", "fz_n"),
    ("tx_nm", "ty_nm", "tz_nm"),
)
_TURNS: Final = (((0, -1.0), (2, 1.0)), ((1, 1.0), (2, 1.0)), ((0, -1.0), (2, 1.0)), ((2, 1.0), (0, 1.0)))
"""By (1), for each triple: the column that follows θ̈ and the one that follows φ̈, and their signs."""


def check_units(where: str, motion: FloatArray, joint_to_surface_m: float, foot_in_plate_m: FloatArray | None) -> None:
    """Raise UserError unless the columns of `motion` (n, 6 or 12) can be metres and radians, with Y up."""
    plate_m, angles_rad = motion[:, :3], motion[:, 3:6]
    mean_m = np.nanmean(plate_m, axis=0)
    _check_length(f"{where}: plate_x_m, plate_y_m, plate_z_m", float(np.linalg.norm(mean_m)), joint_to_surface_m)
    if mean_m[1] < 0.5 * float(np.linalg.norm(mean_m)):
        axis = int(np.argmax(np.abs(mean_m)))
        sign = "" if axis != 1 else "−"
        raise UserError(
            f"{where}: swapped axes: the plate lies {joint_to_surface_m:g} m from the joint along {sign}{'xyz'[axis]}, "
            "but y must point up"
        )
    if float(np.nanmax(np.abs(angles_rad))) > _MOST_ANGLE_RAD:
        axis = int(np.argmax(np.nanmax(np.abs(angles_rad), axis=0)))
        largest = float(np.nanmax(np.abs(angles_rad[:, axis])))
        raise UserError(
            f"{where}: {_TRIPLES[1][axis]} reaches {largest:.3g}, allowed {_MOST_ANGLE_RAD:g} rad: wrong unit?"
        )
    if foot_in_plate_m is not None:
        foot_m = np.nanmean(motion[:, 6:9] - plate_m, axis=0)
        expected_m = float(np.linalg.norm(foot_in_plate_m))
        _check_length(
            f"{where}: foot_x_m, foot_y_m, foot_z_m minus the plate's", float(np.linalg.norm(foot_m)), expected_m
        )


def check_axes(
    where: tuple[str, str],
    rate_hz: float,
    motion: FloatArray,
    wrench: FloatArray,
    joint_to_surface_m: float,
    plate_mass_kg: float,
) -> None:
    """Raise UserError where columns of motion (n, 6) or wrench (n, 6) are swapped, reversed or in another unit by (1).

    `where` names the two files. A recording that hardly moves tells nothing and passes.
    """
    valid = np.asarray(np.isfinite(np.hstack((motion, wrench))).all(axis=1), dtype=np.bool_)
    if valid.mean() < _DISAGREES:
        return
    columns = _in_band(np.hstack((motion, wrench)), valid, rate_hz)
    rates = np.gradient(columns[:, :6], 1.0 / rate_hz, axis=0)
    slow = np.hstack((columns[:, 3:6], rates[:, 3:]))[valid]
    columns[:, :6] = np.gradient(rates, 1.0 / rate_hz, axis=0)
    moved = columns[valid]
    _check_swaps(where, _triples(moved - slow @ np.linalg.lstsq(slow, moved, rcond=None)[0]))
    _check_slopes(where, motion, _triples(moved), joint_to_surface_m, plate_mass_kg)


def _triples(columns: FloatArray) -> list[FloatArray]:
    return [columns[:, 3 * k : 3 * k + 3] for k in range(4)]


def _check_swaps(where: tuple[str, str], triples: list[FloatArray]) -> None:
    declared = [_turns(triple, turns) for triple, turns in zip(triples, _TURNS, strict=True)]
    agreement = np.array([[_agreement(a, b) for a in declared] for b in declared])
    others = [[j for j in range(4) if j != k] for k in range(4)]
    for k in np.argsort([np.median(agreement[k, others[k]]) for k in range(4)]).tolist():
        united = np.median([agreement[i, j] for i in others[k] for j in others[k] if i < j])
        if np.median(agreement[k, others[k]]) <= _DISAGREES and united >= _AGREES:
            change = _healing([k], triples, [declared[j] for j in others[k]])
            if change is not None:
                raise UserError(f"{where[k // 2]}: {_swap_words(k, *change)}")
    if agreement[0, 1] >= _AGREES and agreement[:2, 2:].max() <= _DISAGREES:
        change = _healing([2, 3], triples, declared[:2])
        if change is not None:
            raise UserError(f"{where[1]}: {_swap_words(2, *change)}; moments alike")


def _healing(
    changed: list[int], triples: list[FloatArray], rest: list[FloatArray]
) -> tuple[list[int], FloatArray] | None:
    """Return the order and signs of columns by which the triples `changed` agree with the `rest`, if any do.

    The triples that are changed together have the same idle column, and it must be their smallest.
    """
    idle = _idle(changed[0])
    smallest = {int(np.argmin((triples[k] ** 2).sum(axis=0))) for k in changed}
    changes = [
        (list(order), np.array(signs))
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
        if signs[idle] > 0.0 and smallest == {order[idle]}
    ]
    if not changes:
        return None
    healed = [
        np.median(
            [_agreement(_turns(triples[k][:, order] * signs, _TURNS[k]), other) for k in changed for other in rest]
        )
        for order, signs in changes
    ]
    best = int(np.argmax(healed))
    return changes[best] if healed[best] > _AGREES else None


def _check_slopes(
    where: tuple[str, str],
    motion: FloatArray,
    triples: list[FloatArray],
    joint_to_surface_m: float,
    plate_mass_kg: float,
) -> None:
    """Raise UserError where the sizes of what moves together do not fit."""
    position, angle, force, moment = (_turns(triple, turns) for triple, turns in zip(triples, _TURNS, strict=True))
    for axis, (name, turn) in enumerate((("plate_x_m", "plate_theta_rad"), ("plate_z_m", "plate_phi_rad"))):
        if float(np.nanstd(motion[:, (4, 5)[axis]])) < _LEAST_SWING_RAD:
            continue
        if _agreement(position[:, axis : axis + 1], angle[:, axis : axis + 1]) > _AGREES:
            ratio = rms(position[:, axis]) / (joint_to_surface_m * rms(angle[:, axis]))
            if ratio > _NEITHER:
                raise UserError(
                    f"{where[0]}: {name} swings {ratio:.3g} times what {turn} says: wrong unit, like mm for m"
                )
            if ratio < 1.0 / _NEITHER:
                raise UserError(
                    f"{where[0]}: {turn} swings {1.0 / ratio:.3g} times what {name} says: wrong unit, like ° for rad"
                )
    if _agreement(force, angle) > _AGREES:
        share = rms(force) / (plate_mass_kg * joint_to_surface_m * rms(angle))
        if share < _LEAST_FORCE_SHARE:
            raise UserError(
                f"{where[1]}: fx_n, fz_n are {share:.2g} of what moves the plate alone: wrong unit, like kN for N"
            )
    if _agreement(moment, angle) > _AGREES and _agreement(force, angle) > _AGREES:
        lever_m = rms(moment) / rms(force)
        if lever_m > _LONGEST_LEVER_M:
            raise UserError(
                f"{where[1]}: tx_nm, tz_nm are {lever_m:.3g} m times the forces: wrong unit, like N mm for N m"
            )


def _check_length(what: str, found_m: float, expected_m: float) -> None:
    ratio = found_m / expected_m
    if 1.0 / _NEITHER < ratio < _NEITHER:
        return
    for factor, unit in _UNITS:
        if 1.0 / _NEITHER < ratio / factor < _NEITHER and factor != 1.0:
            raise UserError(
                f"{what} average {found_m:.4g} where {expected_m:g} m is set: wrong unit, like {unit} for metres"
            )
    raise UserError(f"{what} average {found_m:.4g} m, allowed {expected_m:g} m as set, within a factor of {_NEITHER:g}")


def _in_band(columns: FloatArray, valid: BoolArray, rate_hz: float) -> FloatArray:
    """Return the columns (n, c) between the limits of the band, by a Fourier transform; gaps are bridged by lines."""
    index = np.arange(len(columns))
    bridged = np.column_stack([np.interp(index, index[valid], column[valid]) for column in columns.T])
    spectrum = np.fft.rfft(bridged - bridged.mean(axis=0), axis=0)
    f_hz = np.fft.rfftfreq(len(columns), 1.0 / rate_hz)
    spectrum[(f_hz < _BAND_HZ[0]) | (f_hz > _BAND_HZ[1])] = 0.0
    return np.fft.irfft(spectrum, len(columns), axis=0)


def _turns(triple: FloatArray, turns: tuple[tuple[int, float], tuple[int, float]]) -> FloatArray:
    """Return what a triple (n, 3) says of (θ̈, φ̈), (n, 2)."""
    return np.column_stack([sign * triple[:, column] for column, sign in turns])


def _agreement(a: FloatArray, b: FloatArray) -> float:
    """Return the lesser correlation of a's and b's columns, 0 where one does not move."""
    power = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return float(np.where(power > 0.0, (a * b).sum(axis=0) / np.where(power > 0.0, power, 1.0), 0.0).min())


def _idle(k: int) -> int:
    """Return the column of triple k that neither rotation moves."""
    return ({0, 1, 2} - {column for column, _ in _TURNS[k]}).pop()


def _swap_words(k: int, order: list[int], signs: FloatArray) -> str:
    names = _TRIPLES[k]
    moved = [f"{names[i]} is what {names[j]} should be" for j, i in enumerate(order) if i != j and j != _idle(k)]
    reversed_ = [names[j] for j in range(3) if signs[j] < 0.0]
    said = [f"swapped axes: {', '.join(moved)}"] if moved else []
    return "; ".join(said + ([f"reversed sign: {', '.join(reversed_)}"] if reversed_ else []))
