"""The user's table and function: what is wrong with either is told in one line."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from messages.errors import UserError
from systems.own.function import function_of, simulation_of
from systems.own.table import Table

USER = """
import numpy as np
import gaiteyes

def by_table(table):
    model = lambda values: table["drive"][:, None]
    return gaiteyes.OwnSimulation("mine", table.channels(["seen"], ["drive"]), model, ())

def by_columns(t_s, drive, seen):
    channels = gaiteyes.Channels(t_s, seen[:, None], ("seen",), drive[:, None], ("drive",))
    return gaiteyes.OwnSimulation("mine", channels, lambda values: drive[:, None], ())

def asks(t_s, sene):
    return None

def fails(table):
    return table["seen"] @ np.zeros(3)

def number(table):
    return 3
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"user_{abs(hash(str(tmp_path)))}"
    (tmp_path / f"{name}.py").write_text(USER)
    (tmp_path / f"{name}_broken.py").write_text("import numpy\n1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    rows = np.column_stack((np.arange(300) * 0.01, np.sin(np.arange(300)), np.cos(np.arange(300))))
    np.savetxt(tmp_path / "data.csv", rows, delimiter=",", header="t_s,drive,seen", comments="")
    return name


@pytest.mark.parametrize("function", ["by_table", "by_columns"])
def test_a_function_gets_the_table_or_its_columns(module: str, function: str) -> None:
    found = simulation_of(function_of(f"{module}:{function}"), Path("data.csv"))
    assert found.channels.names == ("seen",)
    assert found.channels.values.shape == (300, 1)


@pytest.mark.parametrize(
    ("function", "line"),
    [
        ("asks", "column sene is unknown; the nearest known is seen"),
        ("fails", r"fails: failed on data.csv: ValueError: .*\(user_\d+.py, line 17\)"),
        ("number", "number: returned int; expected a simulation"),
        ("by_tabel", "function by_tabel is unknown; the nearest known is by_table"),
    ],
)
def test_what_is_wrong_with_a_function_is_told(module: str, function: str, line: str) -> None:
    with pytest.raises(UserError, match=line):
        simulation_of(function_of(f"{module}:{function}"), Path("data.csv"))


def test_what_is_wrong_with_a_module_is_told(module: str) -> None:
    for text, line in (
        ("nowhere:f", "nowhere: no module of this name"),
        (f"{module}", "expected MODULE:FUNCTION"),
        (
            f"{module}_broken:f",
            r"cannot be imported: ZeroDivisionError: division by zero \(user_\d+_broken.py, line 2\)",
        ),
    ):
        with pytest.raises(UserError, match=line):
            function_of(text)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "is empty; expected the columns' names"),
        ("t_s,a\n0,1\n0,2\n", "t_s: expected times that increase"),
        ("t_s,a\n0,1\n1,2\n3,4\n", "t_s: row 2 is 1 s before the next, others 1.5 s"),
        ("t_s,a\n0,1\n1,x\n2,4\n", "row 3: a is 'x', allowed a number"),
        ("t_s,aa\n0,1\n1,2\n2,3\n", "column a is unknown; the nearest known is aa"),
        ("t_s,a\n0,1\n1,\n2,3\n", "a: row 3 is no number"),
    ],
)
def test_what_is_wrong_with_a_table_is_told(tmp_path: Path, text: str, line: str) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=line):
        Table.load(path).channels(["a"], ["a"])


def test_a_table_is_read_gzipped_and_thinned_to_means(tmp_path: Path) -> None:
    path = tmp_path / "data.csv.gz"
    path.write_bytes(gzip.compress(b"t_s,a\n0,1\n1,3\n2,5\n3,7\n4,9\n"))
    thin = Table.load(str(path)).thinned(2)
    assert thin["a"].tolist() == [2.0, 6.0]
    assert thin["t_s"].tolist() == [0.5, 2.5]
    with pytest.raises(UserError, match="thinned by 0; expected 1 or more"):
        thin.thinned(0)
    path.write_bytes(b"no gzip")
    with pytest.raises(UserError, match="not a whole gzip file"):
        Table.load(path)


def test_what_is_not_possible_is_refused_with_its_share(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t_s,torque\n" + "".join(f"{0.1 * k},{30.0 if k % 4 == 0 else 1.0}\n" for k in range(20)))
    table = Table.load(path)
    with pytest.raises(UserError, match=r"torque: 25 % of the rows are impossible, from 1 to 30; expected -18 to 18"):
        table.channels(["torque"], possible={"torque": (-18.0, 18.0)})
    assert len(table.rows(1, 3).channels(["torque"], possible={"torque": (-18.0, 18.0)}).t_s) == 2
