"""`gaiteyes evaluate attitude`: on a folder written here, whose errors are known, and on real logs where they are."""

import gzip
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cli.main import app
from lab.evaluation.hip_motion import Motion, hip_motion, with_mpu6050_noise
from messages import UserError
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from tests.bench.data_folder import shared_data

_SECONDS = 30.0
_TRUTH_HZ = 50


@dataclass(frozen=True)
class Written:
    """The numbers of one log: IMU (n, 7) and truth (m, 8), the first column in ns."""

    imu: list[list[float]]
    truth: list[list[float]]


def walk(seed: int, tilt_deg: float = 0.0, delay_ns: int = 0) -> Written:
    """Return a walk; its truth's world leans by `tilt_deg` about x, its clock is `delay_ns` behind the IMU's."""
    exact = hip_motion([(3.0, 28.0)], _SECONDS, seed)
    measured = with_mpu6050_noise(exact, seed)
    lean = Rotation.from_euler("x", tilt_deg, degrees=True)
    every = slice(None, None, 100 // _TRUTH_HZ)
    x, y, z, w = (lean * Rotation.from_matrix(exact.R_WB[every])).as_quat().T
    p_W = lean.apply(_positions(exact))[every]
    truth = np.stack((*p_W.T, w, x, y, z), axis=1).tolist()
    t_ns = exact.t_ns.tolist()
    rows = np.hstack((measured.w_B, measured.sf_B)).tolist()
    return Written(
        [[t, *row] for t, row in zip(t_ns, rows, strict=True)],
        [[t - delay_ns, *row] for t, row in zip(t_ns[every], truth, strict=True)],
    )


def _positions(motion: Motion) -> FloatArray:
    a_W = np.einsum("nij,nj->ni", motion.R_WB, motion.sf_B) - (0.0, 0.0, STANDARD_GRAVITY_MPS2)
    positions: FloatArray = np.cumsum(np.cumsum(a_W, axis=0), axis=0) * 1e-4
    return positions


def write(folder: Path, name: str, log: Written, *, zipped: bool = False) -> None:
    folder.mkdir(exist_ok=True)
    for kind, rows in (("imu", log.imu), ("truth", log.truth)):
        text = "# t_ns, numbers\n" + "".join(",".join([str(row[0]), *map(repr, row[1:])]) + "\n" for row in rows)
        path = folder / f"{name}_{kind}.csv"
        if zipped:
            path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(text.encode()))
        else:
            path.write_text(text)


def evaluate(*arguments: object) -> None:
    app(["evaluate", "attitude", *map(str, arguments)], standalone_mode=False)


def test_two_logs_are_told_for_a_person_and_for_a_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("vqf")
    write(tmp_path / "logs", "one", walk(1, delay_ns=12_000_000))
    write(tmp_path / "logs", "two", walk(2), zipped=True)
    evaluate(tmp_path / "logs", "--json", tmp_path / "facts.json")
    assert re.search(r"one .*\n.*two .*\n.*mean of the logs .*\n.*all errors", capsys.readouterr().out)
    facts = json.loads((tmp_path / "facts.json").read_bytes())
    one, two = facts["trials"]
    assert one["delay_s"] == pytest.approx(0.012, abs=0.001)
    assert abs(two["delay_s"]) < 0.001
    for each in (one, two):
        assert each["this_filter"]["rms_deg"] < 0.6 < each["vqf"]["rms_deg"]
        assert each["this_filter"]["rms_deg"] < each["this_filter"]["p99_deg"]
        assert each["coverage"] > 0.9
    together = facts["together"]
    assert together["mean_rms_deg"] == pytest.approx(np.mean([each["this_filter"]["rms_deg"] for each in (one, two)]))


def test_a_leaning_truth_is_told_from_a_tilted_estimate_only_when_levelled(tmp_path: Path) -> None:
    pytest.importorskip("vqf")
    write(tmp_path / "logs", "leaning", walk(1, tilt_deg=1.5))
    errors_deg, levelled_deg = [], []
    for options in ([], ["--level-truth"]):
        evaluate(tmp_path / "logs", "--json", tmp_path / "facts.json", *options)
        (trial,) = json.loads((tmp_path / "facts.json").read_bytes())["trials"]
        errors_deg.append(trial["this_filter"]["rms_deg"])
        levelled_deg.append(trial["levelled_deg"])
    assert errors_deg[0] > 1.2
    assert errors_deg[1] < 0.6
    assert levelled_deg == [0.0, pytest.approx(1.5, abs=0.15)]


def test_poses_about_a_gap_of_the_truth_are_left_out(tmp_path: Path) -> None:
    pytest.importorskip("vqf")
    log = walk(1)
    away = [row for row in log.truth if not 10e9 < row[0] - log.truth[0][0] < 11e9]
    away = [row if k != 900 else [row[0], *row[1:4], 0.0, 1.0, 0.0, 0.0] for k, row in enumerate(away)]  # a glitch
    write(tmp_path / "logs", "gap", Written(log.imu, away))
    evaluate(tmp_path / "logs", "--json", tmp_path / "facts.json")
    (trial,) = json.loads((tmp_path / "facts.json").read_bytes())["trials"]
    whole = _TRUTH_HZ * (_SECONDS - 3.0)
    assert whole - trial["judged"] == pytest.approx(1.6 * _TRUTH_HZ, abs=6)
    assert trial["this_filter"]["p99_deg"] < 2.0


def _no_truth(folder: Path) -> None:
    (folder / "bad_truth.csv").unlink()


def _degrees(folder: Path) -> None:
    log = walk(1)
    write(folder, "bad", Written([[row[0], *(1000.0 * v for v in row[1:4]), *row[4:]] for row in log.imu], log.truth))


def _in_g(folder: Path) -> None:
    log = walk(1)
    write(folder, "bad", Written([[*row[:4], *(v / 9.8 for v in row[4:])] for row in log.imu], log.truth))


def _short(folder: Path) -> None:
    log = walk(1)
    write(folder, "bad", Written(log.imu[:500], log.truth))


def _elsewhere(folder: Path) -> None:
    log = walk(1)
    write(folder, "bad", Written(log.imu, [[row[0] + 25_000_000_000, *row[1:]] for row in log.truth]))


def _not_a_number(folder: Path) -> None:
    path = folder / "bad_imu.csv"
    path.write_text(path.read_text().replace("\n", "\n1,x,0,0,0,0,9.8\n", 1))


def _no_unit_quaternion(folder: Path) -> None:
    log = walk(1)
    write(folder, "bad", Written(log.imu, [[*row[:4], *(2.0 * v for v in row[4:])] for row in log.truth]))


def _no_log(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (_no_log, r"logs: no log: neither NAME_imu.csv"),
        (_no_truth, r"bad_imu.csv: no truth beside it: neither bad_truth.csv nor bad_truth.csv.gz"),
        (_degrees, r"bad_imu.csv: an angular rate of \d+ rad/s, allowed up to 90; °/s\?"),
        (_in_g, r"bad_imu.csv: a specific force of 1\.\d+ m/s² at the median, allowed 5 to 20; in g"),
        (_short, r"bad_imu.csv: lasts 5.0 s, allowed 20 s or more"),
        (_elsewhere, r"bad_imu.csv: overlaps its truth for 5.0 s, allowed 10 s or more"),
        (_not_a_number, r"bad_imu.csv: line 2: could not convert string to float"),
        (_no_unit_quaternion, r"bad_truth.csv: line 2: the quaternion has the length 2, allowed 0.99 to 1.01"),
    ],
)
def test_what_is_wrong_with_a_log_is_one_line(tmp_path: Path, spoil: Callable[[Path], None], line: str) -> None:
    folder = tmp_path / "logs"
    write(folder, "bad", walk(1))
    spoil(folder)
    with pytest.raises(UserError, match=line) as told:
        evaluate(folder)
    assert "\n" not in str(told.value)


def test_no_folder_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nowhere: is no folder"):
        evaluate(tmp_path / "nowhere")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "options", "most_deg"),
    [("tumvi_rooms_imu", [], 0.52), ("euroc_flights_imu", ["--level-truth"], 0.82), ("broad", [], 0.45)],
)
def test_on_real_logs_the_filter_beats_vqf(tmp_path: Path, name: str, options: list[str], most_deg: float) -> None:
    pytest.importorskip("vqf")
    evaluate(shared_data(name), "--json", tmp_path / "facts.json", *options)
    together = json.loads((tmp_path / "facts.json").read_bytes())["together"]
    assert together["mean_rms_deg"] <= most_deg
    assert together["mean_rms_deg"] < together["vqf_mean_rms_deg"]
