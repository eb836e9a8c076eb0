"""C3D files with events as trials of the ankle: the stances that were walked, and one line for what is missing."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from impedance.ankle.c3d import read_c3d_trial
from impedance.ankle.trial import AnkleTrial, Perturbation
from impedance.body import geometry
from impedance.recording.plain_files import write_toml
from messages.arrays import FloatArray
from messages.errors import UserError

pytest.importorskip("ezc3d")
pytest.importorskip("mujoco")

import ezc3d

from sim_rig.platform.ankle import walk
from sim_rig.platform.ankle_measured import AnkleNoise, measured
from sim_rig.platform.ankle_person import person

PLATE_MARKERS = {"P1": (0.2, 0.0, 0.1), "P2": (-0.2, 0.0, 0.1), "P3": (-0.2, 0.01, -0.1)}
SHANK_MARKERS = {"S1": (0.0, 0.1, 0.03), "S2": (0.0, 0.3, 0.03), "S3": (0.04, 0.2, -0.02)}
CHANNELS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
FOOT_MARKERS = {"F1": (0.0, 0.05, 0.0), "F2": (0.12, 0.06, 0.03), "F3": (0.12, 0.05, -0.03)}
HEEL_M = (-0.05, 0.0, 0.0)
BETWEEN = 40


@pytest.fixture(scope="module")
def trial() -> AnkleTrial:
    run = walk(person(5), [Perturbation.RANDOM, Perturbation.RANDOM, Perturbation.RANDOM], 5)
    return measured(run, AnkleNoise(), 5)


def markers(rad: FloatArray, places: dict[str, tuple[float, float, float]]) -> FloatArray:
    """Return markers (n, k, 3) on what turns about Z and X."""
    R = geometry.rotation_IP(np.zeros(len(rad)), *rad.T)
    seen: FloatArray = np.einsum("nij,kj->nki", R, np.array(list(places.values())))
    return seen


def write(folder: Path, trial: AnkleTrial, **layout: object) -> tuple[Path, Path]:
    """Write a C3D file in which the stances follow each other, a tenth of a second between them, and its layout."""
    rate_hz = trial.settings.rate_hz
    stances = [np.arange(len(trial.t_s))[trial.rows_of(c)] for c in range(len(trial.perturbation))]
    row = np.concatenate([np.concatenate((rows, np.full(BETWEEN, rows[-1]))) for rows in stances])
    points = np.concatenate(
        (markers(trial.plate_rad[row], PLATE_MARKERS), markers(trial.shank_rad[row], SHANK_MARKERS)), 1
    )
    names = [*PLATE_MARKERS, *SHANK_MARKERS]
    if trial.foot_rad is not None:
        points = np.concatenate((points, markers(trial.foot_rad[row], FOOT_MARKERS)), 1)
        names += FOOT_MARKERS
    labels, contexts, seconds, first = [], [], [], 0
    for rows in stances:
        step = (trial.stance[rows[-1]] - trial.stance[rows[0]]) / (len(rows) - 1)
        for label, share in (("Foot Strike", 0.0), ("Foot Off", 1.0)):
            labels.append(label)
            contexts.append("Right")
            seconds.append((first + (share - trial.stance[rows[0]]) / step) / rate_hz)
        first += len(rows) + BETWEEN
    lift_s = 0.0 - min(0.0, *seconds)
    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [rate_hz]
    parameters["POINT"]["UNITS"]["value"] = ["m"]
    parameters["POINT"]["LABELS"]["value"] = names
    parameters["ANALOG"]["RATE"]["value"] = [rate_hz]
    parameters["ANALOG"]["LABELS"]["value"] = list(CHANNELS)
    parameters["ANALOG"]["UNITS"]["value"] = ["N"] * 3 + ["N.m"] * 3
    file.add_parameter("EVENT", "LABELS", labels)
    file.add_parameter("EVENT", "CONTEXTS", contexts)
    times = np.vstack((np.zeros(len(seconds)), np.array(seconds) + lift_s))
    file.add_parameter("EVENT", "TIMES", times)
    file["data"]["points"] = np.concatenate((points, np.ones((*points.shape[:2], 1))), axis=2).transpose(2, 1, 0)
    file["data"]["analogs"] = trial.wrench[row].T[None]
    path = folder / "walk.c3d"
    file.write(str(path))
    document = msgspec.to_builtins(trial.settings)
    document["c3d"] = {
        "channels": list(CHANNELS),
        "side": "Right",
        "plate_markers": {name: list(place) for name, place in PLATE_MARKERS.items()},
        "shank_markers": {name: list(place) for name, place in SHANK_MARKERS.items()},
        **layout,
    }
    write_toml(folder / "layout.toml", document)
    return path, folder / "layout.toml"


def test_a_c3d_file_comes_back_as_the_trial_it_was(trial: AnkleTrial, tmp_path: Path) -> None:
    found, notes = read_c3d_trial(*write(tmp_path, trial))
    assert notes == ()
    assert found.settings == trial.settings
    assert found.perturbation == trial.perturbation
    for cycle in range(3):
        ours, theirs = found.rows_of(cycle), trial.rows_of(cycle)
        assert abs((ours.stop - ours.start) - (theirs.stop - theirs.start)) <= 2
        middle = np.linspace(0.1, 0.9, 9)
        for name in ("plate_rad", "shank_rad", "wrench"):
            seen, walked = getattr(found, name), getattr(trial, name)
            for column in range(seen.shape[1]):
                at = np.interp(middle, found.stance[ours], seen[ours, column])
                np.testing.assert_allclose(
                    at, np.interp(middle, trial.stance[theirs], walked[theirs, column]), rtol=2e-3, atol=0.02
                )


def test_what_a_trials_c3d_file_lacks_is_named(trial: AnkleTrial, tmp_path: Path) -> None:
    for layout, said in (
        (
            {"side": "Left"},
            r"no event 'Foot Strike' that 'Foot Off' follows of the side 'Left'; it holds Right Foot Off",
        ),
        ({"begin": "Heel"}, "no event 'Heel'"),
        ({"perturbation": "shaken"}, "perturbation"),
        ({"shank_markers": {}}, r"c3d\.shank_markers: three markers or more"),
    ):
        with pytest.raises(UserError, match=said) as refused:
            read_c3d_trial(*write(tmp_path, trial, **layout))
        assert "\n" not in str(refused.value)


def test_a_stance_without_a_ramp_is_unperturbed(trial: AnkleTrial, tmp_path: Path) -> None:
    found, _ = read_c3d_trial(*write(tmp_path, trial, perturbation="ramp"))
    assert found.perturbation == (Perturbation.NONE,) * 3


def test_the_foots_markers_tell_its_angle_and_when_the_heel_rises(tmp_path: Path) -> None:
    shod = walk(person(5, shod=True), [Perturbation.RANDOM, Perturbation.RANDOM], 5)
    quiet = measured(shod, AnkleNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 5)
    layout = {"foot_markers": {name: list(at) for name, at in FOOT_MARKERS.items()}, "heel_in_foot_m": list(HEEL_M)}
    found, _ = read_c3d_trial(*write(tmp_path, quiet, **layout))
    assert found.foot_rad is not None
    assert found.heel_rise_m is not None
    assert quiet.foot_rad is not None
    at = np.linspace(0.1, 0.95, 9)
    for cycle in range(2):
        ours, theirs = found.rows_of(cycle), quiet.rows_of(cycle)
        for axis in range(2):
            seen = np.interp(at, found.stance[ours], found.foot_rad[ours, axis])
            walked = np.interp(at, quiet.stance[theirs], quiet.foot_rad[theirs, axis])
            np.testing.assert_allclose(seen, walked, atol=2e-3)
        late = found.heel_rise_m[ours][found.stance[ours] > 0.9]
        early = found.heel_rise_m[ours][(found.stance[ours] > 0.1) & (found.stance[ours] < 0.45)]
        assert late.min() > 0.01
        assert np.abs(early).max() < 3e-3
