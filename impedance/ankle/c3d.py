"""Motion capture's C3D files as trials of the ankle: events cut the steps, markers tell plate and shank.

The layout is a `trial.toml` with a further table `[c3d]`: what `impedance.recording.c3d` needs, the shank's markers in
a frame that is upright along I's axes, and which events begin and end a stance of the foot on the plate.
"""

from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from impedance.ankle.trial import AnkleTrial, FlatFoot, Perturbation, TrialSettings, check_trial
from impedance.body.geometry import rotation_IP
from impedance.recording.c3d import C3dLayout, check_markers, poses_of, times_s, wrench_of
from impedance.recording.c3d_file import Event, read_contents
from impedance.recording.plain_files import read_toml
from impedance.recording.recording import LARGEST_SETTING, Triple
from impedance.recording.resampling import resampled
from messages.arrays import FloatArray
from messages.checked import checked
from messages.errors import UserError
from messages.text_files import check_sizes

_LONGEST_STANCE_S: Final = 30.0
_RATE_TOLERANCE: Final = 1e-3


class AnkleC3dLayout(C3dLayout, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a C3D file of an ankle's trial leaves open, beside a recording's layout.

    `shank_markers`: labels and positions in the shank's frame. A stance goes from an event `begin` to the next event
    `end` of the context `side`, or of any where `side` is empty. `perturbation` is how the plate moves: random in every
    stance, or a ramp in those that hold an event `ramp`, at its time; the others are unperturbed. With `foot_markers`,
    in a frame along P's axes where the foot stands flat, the foot's angle is told, and how far its heel, which lies at
    `heel_in_foot_m`, rises above where it is in the first half of the flat foot's share.
    """

    shank_markers: dict[str, Triple]
    heel_in_foot_m: Triple = (0.0, 0.0, 0.0)
    side: str = ""
    begin: str = "Foot Strike"
    end: str = "Foot Off"
    perturbation: Perturbation = Perturbation.RANDOM
    ramp: str = "Perturbation"


def read_c3d_trial(path: Path, layout_path: Path) -> tuple[AnkleTrial, tuple[str, ...]]:
    """Return the trial in a C3D file, and one note for each stance that is left out.

    Raises UserError, one line, where a file cannot be read, labels, events or units are missing or unknown, or the
    trial does not pass its checks.
    """
    document = read_toml(layout_path)
    if "c3d" not in document:
        raise UserError(f"{layout_path}: has no table [c3d], the layout of markers, channels and events")
    check_sizes(document, LARGEST_SETTING, str(layout_path))
    layout = checked(document["c3d"], AnkleC3dLayout, f"{layout_path}: c3d")
    settings = checked({k: v for k, v in document.items() if k != "c3d"}, TrialSettings, str(layout_path))
    present = ("foot_markers",) if layout.foot_markers else ()
    check_markers(layout, ("plate_markers", "shank_markers", *present), str(layout_path))
    contents = read_contents(path)
    motion_s, force_s = times_s(path, contents.points, "POINT"), times_s(path, contents.analogs, "ANALOG")
    rate_hz = 1.0 / (motion_s[1] - motion_s[0]) if len(motion_s) > 1 else np.nan
    if not abs(rate_hz / settings.rate_hz - 1.0) < _RATE_TOLERANCE:
        raise UserError(f"{path}: POINT:RATE is {rate_hz:g}, rate_hz of {layout_path} is {settings.rate_hz:g}")
    plate = poses_of(path, contents.points, layout.plate_markers, layout)
    shank = poses_of(path, contents.points, layout.shank_markers, layout)[:, 4:]
    wrench = resampled(force_s, wrench_of(path, contents, layout, settings.joint_to_surface_m), motion_s)
    samples = np.column_stack((motion_s, plate[:, 4:], shank, wrench))
    if layout.foot_markers:
        foot = poses_of(path, contents.points, layout.foot_markers, layout)
        samples = np.column_stack((samples, foot[:, 4:], _heights(plate, foot, np.array(layout.heel_in_foot_m))))
    trial, notes = _cut(path, settings, layout, contents.events, samples)
    check_trial(trial, path)
    return trial, notes


def _cut(
    path: Path, settings: TrialSettings, layout: AnkleC3dLayout, events: tuple[Event, ...], samples: FloatArray
) -> tuple[AnkleTrial, tuple[str, ...]]:
    """Return the stances of samples (n, 11): time, plate and shank (2 each), wrench; of (n, 14) also foot (2) and the
    heel's height."""
    parts, shares, kinds, onsets, notes = [], [], [], [], []
    for begin_s, end_s in _stances(path, layout, events):
        inside = samples[(samples[:, 0] >= begin_s) & (samples[:, 0] <= end_s)]
        if not len(inside) or not np.isfinite(inside).all():
            notes.append(f"{path}: stance from {begin_s:.3f} to {end_s:.3f} s: samples are missing, left out")
            continue
        at_s = [event.t_s for event in events if event.label == layout.ramp and begin_s <= event.t_s <= end_s]
        ramped = layout.perturbation is Perturbation.RAMP
        kinds.append(layout.perturbation if not ramped or at_s else Perturbation.NONE)
        onsets.append(at_s[0] if ramped and at_s else np.nan)
        share = (inside[:, 0] - begin_s) / (end_s - begin_s)
        if layout.foot_markers:
            inside[:, 13] -= _standing(settings.flat_foot, share, inside[:, 13])
        parts.append(inside)
        shares.append(share)
    if not parts:
        raise UserError(f"{path}: no stance is whole; each needs all of its markers and channels")
    rows = np.vstack(parts)
    counts = [len(part) for part in parts]
    trial = AnkleTrial(
        settings=settings,
        cycle=np.repeat(np.arange(len(parts), dtype=np.int64), counts),
        t_s=rows[:, 0],
        stance=np.concatenate(shares),
        plate_rad=rows[:, 1:3],
        shank_rad=rows[:, 3:5],
        wrench=rows[:, 5:11],
        perturbation=tuple(kinds),
        onset_s=np.array(onsets),
        foot_rad=rows[:, 11:13] if layout.foot_markers else None,
        heel_rise_m=rows[:, 13] if layout.foot_markers else None,
    )
    return trial, tuple(notes)


def _heights(plate: FloatArray, foot: FloatArray, heel_in_foot_m: FloatArray) -> FloatArray:
    """Return the heel's height (n,) above P's origin along its Y, of poses (n, 6) as in a recording."""
    R_IP, R_IF = rotation_IP(*plate[:, 3:].T), rotation_IP(*foot[:, 3:].T)
    height: FloatArray = np.einsum("ni,ni->n", R_IP[:, :, 1], foot[:, :3] + R_IF @ heel_in_foot_m - plate[:, :3])
    return height


def _standing(flat: FlatFoot, share: FloatArray, height_m: FloatArray) -> float:
    """Return the heel's height in the first half of the share of stance in which the foot is flat."""
    first, last = 0.01 * flat.from_percent, 0.005 * (flat.from_percent + flat.to_percent)
    early = (share >= first) & (share <= last)
    return float(np.median(height_m[early])) if early.any() else 0.0


def _stances(path: Path, layout: AnkleC3dLayout, events: tuple[Event, ...]) -> list[tuple[float, float]]:
    """Return begin and end of every stance: a begin, and the next end before another begin."""
    ours = [event for event in events if not layout.side or event.context == layout.side]
    marks = [event for event in ours if event.label in (layout.begin, layout.end)]
    found = [
        (first.t_s, second.t_s)
        for first, second in pairwise(marks)
        if first.label == layout.begin and second.label == layout.end and second.t_s - first.t_s < _LONGEST_STANCE_S
    ]
    if not found:
        held = ", ".join(sorted({f"{event.context} {event.label}".strip() for event in events})) or "none"
        raise UserError(
            f"{path}: holds no event {layout.begin!r} that {layout.end!r} follows"
            + (f" of the side {layout.side!r}" if layout.side else "")
            + f"; it holds {held}"
        )
    return found
