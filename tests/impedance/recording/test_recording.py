"""Recordings of the platform as laboratories spoil them: each damage is named in one line, or lived with and noted."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from impedance.recording.recording import (
    FORCE_FILE,
    MOTION_FILE,
    SETTINGS_FILE,
    PlatformRecording,
    Poses,
    read_truth,
)
from impedance.recording.resampling import resampled
from impedance.recording.synchronous import synchronous
from messages.arrays import FloatArray
from messages.errors import UserError

pytest.importorskip("mujoco")

from sim_rig.platform.rig import FOOT, PLATE, THESIS_NOISE, Rig
from sim_rig.platform.run import RunSettings, measured, simulate

X, Y, Z, PSI, THETA, PHI = range(6)


@pytest.fixture(scope="module", params=["plate", "plate and foot"])
def recording(request: pytest.FixtureRequest) -> PlatformRecording:
    foot = FOOT if "foot" in request.param else None
    return measured(
        simulate(RunSettings(rig=Rig(foot=foot), duration_s=6.0), seed=7), THESIS_NOISE, seed=7, plate=PLATE
    )


def with_plate(recording: PlatformRecording, change: Callable[[FloatArray], None]) -> PlatformRecording:
    columns = recording.plate.columns.copy()
    change(columns)
    return replace(recording, plate=Poses.from_columns(columns))


def with_wrench(recording: PlatformRecording, change: Callable[[FloatArray], None]) -> PlatformRecording:
    wrench = recording.wrench.copy()
    change(wrench)
    return replace(recording, wrench=wrench)


def reloaded(recording: PlatformRecording, folder: Path) -> PlatformRecording:
    recording.save(folder)
    return PlatformRecording.load(folder)


def refusal(recording: PlatformRecording, folder: Path) -> str:
    with pytest.raises(UserError) as refused:
        reloaded(recording, folder)
    line = str(refused.value)
    assert "\n" not in line
    return line


def exchanged(*columns: int) -> Callable[[FloatArray], None]:
    def change(values: FloatArray) -> None:
        values[:, list(columns)] = values[:, list(reversed(columns))]

    return change


def scaled(factor: float, *columns: int) -> Callable[[FloatArray], None]:
    def change(values: FloatArray) -> None:
        values[:, list(columns)] *= factor

    return change


def test_a_sound_recording_passes_without_a_note(recording: PlatformRecording, tmp_path: Path) -> None:
    assert reloaded(recording, tmp_path).notes == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (exchanged(X, Z), "swapped axes"),
        (exchanged(Y, Z), "swapped axes: the plate lies 0.12 m from the joint along z, but y must point up"),
        (exchanged(THETA, PHI), "plate_theta_rad"),
        (exchanged(PSI, THETA), "plate_psi_rad"),
        (scaled(-1.0, X), "reversed sign: plate_x_m"),
        (scaled(-1.0, PHI), "reversed sign: plate_phi_rad"),
        (scaled(1000.0, X, Y, Z), "wrong unit, like millimetres for metres"),
        (scaled(100.0, X, Y, Z), "wrong unit, like centimetres for metres"),
        (scaled(1000.0, X), "wrong unit"),
        (scaled(57.3, PSI, THETA, PHI), "wrong unit"),
        (scaled(1000.0, PSI, THETA, PHI), "wrong unit"),
    ],
)
def test_spoilt_motion_is_named(
    recording: PlatformRecording, tmp_path: Path, change: Callable[[FloatArray], None], said: str
) -> None:
    line = refusal(with_plate(recording, change), tmp_path)
    assert MOTION_FILE in line
    assert said in line


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (exchanged(X, Z), "swapped axes: fz_n is what fx_n should be, fx_n is what fz_n should be"),
        (exchanged(X, Y), "swapped axes"),
        (exchanged(3, 5), "swapped axes: tz_nm is what tx_nm should be, tx_nm is what tz_nm should be"),
        (scaled(-1.0, 0, 1, 2), "reversed sign: fx_n, fz_n"),
        (scaled(-1.0, 3, 4, 5), "reversed sign: tx_nm, tz_nm"),
        (scaled(-1.0, *range(6)), "reversed sign: fx_n, fz_n; moments alike"),
        (
            lambda wrench: exchanged(0, 2)(wrench) or exchanged(3, 5)(wrench),
            "fx_n is what fz_n should be; moments alike",
        ),
        (scaled(1000.0, 3, 4, 5), "wrong unit, like N mm for N m"),
        (scaled(0.001, 0, 1, 2), "wrong unit, like kN for N"),
    ],
)
def test_spoilt_wrench_is_named(
    recording: PlatformRecording, tmp_path: Path, change: Callable[[FloatArray], None], said: str
) -> None:
    line = refusal(with_wrench(recording, change), tmp_path)
    assert FORCE_FILE in line
    assert said in line


@pytest.mark.parametrize("turn", [THETA, PHI])
@pytest.mark.parametrize(
    "moment",
    [
        lambda angle, _: 1000.0 * angle,
        lambda _, rate: 20.0 * rate,
        lambda _, rate: 5.0 * np.sign(rate),
    ],
    ids=["spring", "damper", "friction"],
)
def test_a_strap_that_is_stronger_than_inertia_is_no_exchange(
    recording: PlatformRecording, tmp_path: Path, turn: int, moment: Callable[[FloatArray, FloatArray], FloatArray]
) -> None:
    angle = recording.plate.columns[:, turn]

    def change(wrench: FloatArray) -> None:
        wrench[:, {THETA: 5, PHI: 3}[turn]] += moment(angle, np.gradient(angle, recording.t_s))

    assert reloaded(with_wrench(recording, change), tmp_path).notes == ()


def test_a_foot_in_millimetres_is_named(recording: PlatformRecording, tmp_path: Path) -> None:
    if recording.foot is None:
        pytest.skip("needs a foot")
    spoilt = replace(recording, foot=Poses(1000.0 * recording.foot.p_m, recording.foot.euler_rad))
    line = refusal(spoilt, tmp_path)
    assert "foot_x_m" in line
    assert "millimetres" in line


def test_nan_is_kept_as_missing_and_noted(recording: PlatformRecording, tmp_path: Path) -> None:
    def change(columns: FloatArray) -> None:
        columns[700:735, X] = np.nan

    loaded = reloaded(with_plate(recording, change), tmp_path)
    assert loaded.notes == (f"{tmp_path / MOTION_FILE}: plate_x_m is NaN in 35 rows, first at 2.000 s: left out",)
    valid = synchronous(loaded).valid
    assert not valid[700:735].any()
    assert valid.sum() == len(valid) - 35


def test_empty_cells_count_as_nan(recording: PlatformRecording, tmp_path: Path) -> None:
    recording.save(tmp_path)
    lines = (tmp_path / FORCE_FILE).read_text().splitlines()
    lines[100] = ",".join([*lines[100].split(",")[:-1], ""])
    (tmp_path / FORCE_FILE).write_text("\n".join(lines))
    (note,) = PlatformRecording.load(tmp_path).notes
    assert "tz_nm is NaN in 1 row," in note


def test_a_gap_is_found_from_the_stamps_and_noted(recording: PlatformRecording, tmp_path: Path) -> None:
    kept = np.r_[0:500, 570 : len(recording.t_s)]
    cut = replace(recording, force_t_s=recording.force_t_s[kept], wrench=recording.wrench[kept])
    loaded = reloaded(cut, tmp_path)
    (note,) = loaded.notes
    assert "1 gap, 70 samples missing, the longest from 1.429 to 1.626 s" in note
    streams = synchronous(loaded)
    assert len(streams.t_s) == len(recording.t_s)
    np.testing.assert_array_equal(np.flatnonzero(~streams.valid), np.arange(500, 570))
    np.testing.assert_allclose(streams.wrench[570:], recording.wrench[570:], atol=1e-8)


def test_streams_of_unequal_rates_are_brought_together(recording: PlatformRecording, tmp_path: Path) -> None:
    fast_s = np.arange(round(5.9 * 1000)) / 1000.0
    wrench = resampled(recording.force_t_s, recording.wrench, fast_s)
    whole = np.isfinite(wrench).all(axis=1)
    rates = msgspec.structs.replace(recording.settings.rates, force_hz=1000.0)
    settings = msgspec.structs.replace(recording.settings, rates=rates)
    loaded = reloaded(replace(recording, settings=settings, force_t_s=fast_s[whole], wrench=wrench[whole]), tmp_path)
    (note,) = loaded.notes
    assert "1000 Hz, the motion 350 Hz: unequal rates, resampled" in note
    streams = synchronous(loaded)
    assert streams.rate_hz == pytest.approx(350.0)
    first = int(np.searchsorted(recording.t_s, streams.t_s[0] - 1e-9))
    same = slice(first + 100, first + 1600)
    valid = streams.valid[100:1600]
    assert valid.all()
    left = streams.wrench[100:1600] - recording.wrench[same]
    allowed = 0.5 * np.repeat((0.1, 0.05), 3) + 1e-3 * recording.wrench.std(axis=0)  # a tenth of the band is cut off
    assert (np.sqrt((left**2).mean(axis=0)) < allowed).all()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t: np.r_[t[:10], t[9], t[11:]], "row 12: t_s does not increase"),
        (lambda t: np.r_[t[:10], np.nan, t[11:]], "row 12: t_s is not a number"),
        (lambda t: t * 350.0 / 120.0, "its stamps run at 120 Hz, rates.motion_hz is 350: unequal rates"),
        (lambda t: t * 1.005, "unequal rates"),
        (lambda t: np.r_[t[:10], t[10] + 0.4 / 350.0, t[11:]], "row 12: t_s lies 0.40 samples off the grid"),
        (lambda t: t + 100.0, "overlaps"),
    ],
)
def test_spoilt_stamps_are_named(
    recording: PlatformRecording, tmp_path: Path, spoil: Callable[[FloatArray], FloatArray], said: str
) -> None:
    assert said in refusal(replace(recording, t_s=spoil(recording.t_s)), tmp_path)


def test_too_much_missing_is_refused(recording: PlatformRecording, tmp_path: Path) -> None:
    def change(columns: FloatArray) -> None:
        columns[: 6 * len(columns) // 10] = np.nan

    assert "60 % of the samples are missing, allowed 50 %" in refusal(with_plate(recording, change), tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "joint_to_surface_m = 0.12",
            "joint_to_surface_m = 120.0",
            "plate.joint_to_surface_m is 120.0, allowed a number",
        ),
        (
            "motion_hz = 350.0",
            "motion_hz = 350.0\nmotoin_hz = 1.0",
            "rates.motoin_hz is not a known field; did you mean",
        ),
        ("at_rest = true", 'at_rest = "yes"', "tare.at_rest is 'yes', allowed true or false"),
        (
            "at_rest = true",
            "at_rest = true\nforce_n = [0.0, 45.5, 0.0]",
            "tare.force_n and tare.moment_nm must be left out",
        ),
        ("0.0404,", "0.4404,", "plate.inertia_kgm2: no rigid body has it"),
        ("[rates]", "[rates", SETTINGS_FILE),
    ],
)
def test_spoilt_settings_are_named(recording: PlatformRecording, tmp_path: Path, old: str, new: str, said: str) -> None:
    recording.save(tmp_path)
    path = tmp_path / SETTINGS_FILE
    lines = [line for line in path.read_text().splitlines() if not line.startswith(("force_n = [", "moment_nm"))]
    text = "\n".join(lines)
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(UserError) as refused:
        PlatformRecording.load(tmp_path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_spoilt_cells_and_columns_are_named(recording: PlatformRecording, tmp_path: Path) -> None:
    recording.save(tmp_path)
    path = tmp_path / FORCE_FILE
    text = path.read_text()
    for spoilt, said in (
        (text.replace("fy_n", "force_y", 1), "column fy_n is missing; expected t_s, fx_n"),
        (text.replace("\n", "\n0,1,2,3,4,5,abc\n", 1), "row 2: tz_nm is 'abc', allowed a number"),
        (text.replace("\n", "\n0,1,2\n", 1), "row 2 has 3 cells, the header 7"),
        ("t_s,fx_n", "column fy_n is missing"),
        ("", "column t_s is missing"),
    ):
        path.write_text(spoilt)
        with pytest.raises(UserError) as refused:
            PlatformRecording.load(tmp_path)
        assert said in str(refused.value)
    path.unlink()
    with pytest.raises(UserError, match="No such file"):
        PlatformRecording.load(tmp_path)


def test_truth_is_asked_for_by_name(recording: PlatformRecording, tmp_path: Path) -> None:
    recording.save(tmp_path)
    with pytest.raises(UserError, match=r"has no table \[truth\]"):
        read_truth(tmp_path)
