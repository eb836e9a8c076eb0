"""Tables of other programs: their names, units, times and separators are understood, and what is assumed is told."""

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.imu.log import ImuLog, Units, read_logs
from messages import UserError
from messages.constants import STANDARD_GRAVITY_MPS2

N = 120
T_S = 0.01 * np.arange(N)
RNG = np.random.default_rng(4)
SF = np.array((0.3, -0.2, 9.8)) + RNG.normal(0.0, 0.02, (N, 3))
W = np.radians(60.0) * np.sin(T_S[:, None] + np.arange(3.0))
DEG = math.degrees(1.0)
G = STANDARD_GRAVITY_MPS2


def written(path: Path, head: str, columns: tuple[NDArray[Any], ...], delimiter: str = ",", decimal: str = ".") -> Path:
    rows = (delimiter.join(f"{value:.12g}".replace(".", decimal) for value in row) for row in np.column_stack(columns))
    data = "\n".join([*([head] if head else []), *rows]).encode("cp1252" if "°" in head else "utf-8")
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


def read(path: Path) -> ImuLog:
    (log,) = read_logs([path], Units())
    np.testing.assert_allclose(log.t_s - log.t_s[0], T_S, atol=1e-6)
    np.testing.assert_allclose(log.sf, SF, atol=1e-6)
    np.testing.assert_allclose(log.w, W, atol=1e-6)
    return log


def test_units_in_brackets_and_behind_names(tmp_path: Path) -> None:
    head = "Time (s),Accel X (m/s^2),Accel Y (m/s^2),Accel Z (m/s^2),Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)"
    assert read(written(tmp_path / "a.csv", head, (T_S, SF, DEG * W))).notes == ()
    head = "t_ms,ax [mg],ay [mg],az [mg],gx [°/s],gy [°/s],gz [°/s]"
    assert read(written(tmp_path / "b.csv", head, (1e3 * T_S, 1e3 * SF / G, DEG * W))).notes == ()
    head = "#timestamp [ns]," + ",".join(f"{kind}_RS_S_{axis}" for kind in ("w", "a") for axis in "xyz")
    head = head.replace("w_RS_S_x", "w_RS_S_x [rad s^-1]").replace("w_RS_S_y", "w_RS_S_y [rad s^-1]")
    log = read(written(tmp_path / "c.csv.gz", head, (1e9 * T_S, W, SF)))
    assert [note[:27] for note in log.notes] == ["no unit is told: ax, ay, az", "no unit is told: gx, gy, gz"]


def test_separators_remarks_words_and_other_columns(tmp_path: Path) -> None:
    head = "# of a logger\n\ntimestamp;accX;accY;accZ;gyrX;gyrY;gyrZ"
    log = read(written(tmp_path / "a.csv", head, (1e6 * T_S, SF / G, DEG * W), ";", ","))
    assert log.notes[0] == "column timestamp tells no unit: it is taken for µs, as its steps are 1e+04"
    assert "taken for °/s" in log.notes[2]
    head = "time_us\tmag_x\tax_g\tay_g\taz_g\tgx_radps\tgy_radps\tgz_radps"
    path = written(tmp_path / "b.tsv", head, (1e6 * T_S, SF[:, 0], SF / G, W), "\t")
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([lines[0] + "\tnote", *(line + "\tok" for line in lines[1:])]), encoding="utf-8")
    assert read(path).notes == ()
    assert "no line of names: taken for t, ax" in read(written(tmp_path / "c.txt", "", (T_S, SF, W), " ")).notes[0]


def test_arrays_under_other_names_and_lying_otherwise(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=T_S, accel=SF, gyro=W)
    np.savez(tmp_path / "b.npz", t_ns=1e9 * T_S, linear_acceleration=SF.T, angular_velocity=W.T)
    for name in ("a.npz", "b.npz"):
        read(tmp_path / name)


def test_counts_stay_counts(tmp_path: Path) -> None:
    head = "t_s,ax,ay,az,gx,gy,gz"
    path = written(tmp_path / "a.csv", head, (T_S, np.rint(SF / G * 16384.0), np.rint(DEG * W * 131.0)))
    (log,) = read_logs([path], Units())
    assert not log.acc_is_scaled
    assert not log.gyro_is_scaled
    assert log.notes == ()
    (log,) = read_logs([path], Units(acc_per_g=16384.0, gyro_per_dps=131.0))
    np.testing.assert_allclose(log.sf, SF, atol=1e-3)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "no table of numbers: it is empty"),
        ("hello\nworld\n", "no table of numbers: no row of four numbers and more"),
        ("t_s,ax,ay,az\n0,1,2,3\n0,1,2\n", "no table of numbers"),
        ("t_s,ax,ay\n0,1,2,3\n", "its line of names has 3, its rows 4 numbers"),
        ("0,1,2,3,4\n", "5 columns without a line of names; write one: t_s,ax,ay,az,gx,gy,gz"),
        ("date,ax,ay,az,gx\nMonday,1,2,3,4\n", "column t_s is missing; there are ax, ay, az, gx"),
    ],
)
def test_what_is_no_table_is_one_line(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=problem):
        read_logs([path], Units())
