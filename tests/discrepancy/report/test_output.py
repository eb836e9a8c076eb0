"""What an explanation leaves behind: files that can be recomputed, loaded, and read by a person."""

import math
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from discrepancy.report.extended import extended_text, load_extended
from discrepancy.report.output import beside_text, write_report
from discrepancy.report.wording import number_text, quantity_text, share_text
from discrepancy.restricted import check_names, without
from discrepancy.values import predicted
from discrepancy.verdict import Quantity, from_json
from messages.errors import UserError
from tests.bench.explained import NAMES, TRUE, explanation, toy
from tests.bench.html_page import read
from tests.bench.spoilt import check_refused


def test_verdict_and_model_come_back_as_they_were(tmp_path: Path) -> None:
    held_out = toy(1)
    told = explanation(held_out)
    write_report(told, tmp_path / "out", report=False)
    assert from_json((tmp_path / "out" / "verdict.json").read_bytes()) == told.verdict
    values = load_extended(tmp_path / "out" / "extended.toml", held_out)
    assert values == TRUE
    assert np.array_equal(predicted(held_out, values), told.held_out.extended)
    assert not (tmp_path / "out" / "report.html").exists()


def test_the_gain_can_be_recomputed_from_the_held_out_file(tmp_path: Path) -> None:
    held_out = toy(2)
    told = explanation(held_out)
    path = tmp_path / "held_out.csv"
    view = told.held_out
    path.write_text(beside_text(view.channels, view.base, view.extended), encoding="utf-8")
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert header == ["t_s", *(f"{side}_{name}" for name in NAMES for side in ("measured", "base", "extended"))]
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert np.isnan(table[100:105, 4]).all()  # an empty cell is what was not measured
    assert np.allclose(table[:, 1] - table[:, 3], view.residual_after[:, 0], atol=1e-8)
    assert np.allclose(table[:, 0], held_out.channels.t_s)


@pytest.mark.parametrize(
    ("found", "written", "told"),
    [
        ('system = "toy"', 'system = "platform"', r"system is 'platform'; expected \"toy\""),
        (
            "[parameters.mass_kg]",
            "[parameters.weight_kg]",
            r"parameters\.weight_kg is unknown; .* is mass_kg",
        ),
        (
            "[effects.force_delay.value_s]",
            "[effects.late.value_s]",
            r"effects\.late is unknown; .* is tare_error",
        ),
        ("[effects.force_delay.value_s]", "[effects.force_delay.v]", r"effects\.force_delay\.v is unknown"),
        ('unit = "s"', 'unit = "ms"', r"value_s\.unit is 'ms'; expected \"s\""),
        ("value = 0.004", "value = 4.0", r"value_s\.value is 4\.0; expected -0\.05 to 0\.05"),
        ("value = 0.004", 'value = "late"', r"value_s\.value is 'late'; expected a number"),
        ("value = 0.004", "value = nan", r"value_s\.value is nan; expected a number"),
        ("value = 0.004", "values = 0.004", r"value_s\.values is unknown"),
        ("[parameters.mass_kg]", "[parameter.mass_kg]", r"parameter is unknown"),
        ("value = 0.004", "value = ", r"extended\.toml"),
    ],
)
def test_a_spoilt_model_is_refused_in_one_line(tmp_path: Path, found: str, written: str, told: str) -> None:
    held_out = toy(1)
    text = extended_text(explanation(held_out))
    check_refused(lambda path: load_extended(path, held_out), tmp_path / "extended.toml", text, found, written, told)


def test_the_report_tells_everything_on_one_page_by_itself(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    write_report(explanation(toy(1)), tmp_path)
    text = read(tmp_path / "report.html")
    for told in (
        "The simulation is missing: force delay or tare error.",
        "The force plate's samples arrive late.",
        "3.90 to 4.10",
        "Shift the force channel back.",
        "Tap the plate once",
        "All candidates, each by itself",
        "The plate was not at rest when it was tared.",
        "Five samples are missing <in tz>.",
        "the simulation as it is 1.1",  # √(4802 / 4000)
        "force delay 4 ms 0.999 0.0 named",
        "tare error fx 0.01 N ≈ 1.1 ≈ 809 no better than noise",
        "11.2 with 1 parameter.",
        "98 %",
        "noise",
    ):
        assert told in text, told
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("<svg") == 8


def test_the_report_of_an_unknown_cause_shows_its_signature(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    write_report(explanation(toy(1), named=False), tmp_path)
    text = read(tmp_path / "report.html")
    assert "Not explained: the simulation is missing something that no effect of the library describes." in text
    assert "What is not explained shows in fx, between 1 and 5 Hz, from 3.0 to 9.0 s." in text


def test_a_channel_that_was_never_measured_spoils_no_report(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    held_out = toy(1)
    held_out.channels.values[:, 1] = np.nan
    told = explanation(held_out)
    for density in (told.fit.spectrum.before, told.fit.spectrum.after, told.fit.spectrum.noise):
        density[:, 1] = np.nan
    write_report(told, tmp_path)
    assert "Channels not shown, whose error stands out of the noise least: 1." in read(tmp_path / "report.html")


def test_without_matplotlib_the_report_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UserError, match=r"needs the extra 'lab': pip install 'gaiteyes\[lab\]'"):
        write_report(explanation(toy(1)), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_library_can_be_taken_apart() -> None:
    whole = toy(1)
    less = without(whole, ["tare_error"])
    assert [effect.name for effect in less.effects] == ["force_delay"]
    assert np.array_equal(predicted(less, TRUE), predicted(whole, TRUE))
    assert without(whole, []) is whole
    with pytest.raises(UserError, match=r"--only late: not in the library of toy; expected force_delay, tare_error"):
        check_names("--only", ["late"], whole)


@pytest.mark.parametrize(
    ("quantity", "shown"),
    [
        (Quantity(0.0021, 0.00205, 0.00215, "s"), ("2.100", "2.050 to 2.150", "ms")),
        (Quantity(-0.02, -0.03, -0.01, "rad"), ("−1.15", "−1.72 to −0.57", "°")),
        (Quantity(12.3456, 12.0, 12.7, "Hz"), ("12.35", "12.00 to 12.70", "Hz")),
        (Quantity(1234.0, 1000.0, 1500.0, "N"), ("1230", "1000 to 1500", "N")),
        (Quantity(2.5e-9, 2.4e-9, 2.6e-9, "1"), ("2.50e−09", "2.40e−09 to 2.60e−09", "")),
        (Quantity(None, None, None, "m"), ("–", "–", "mm")),
        (Quantity(2.5, 2.4, 2.6, "m"), ("2.50", "2.40 to 2.60", "m")),
    ],
)
def test_numbers_have_the_digits_their_interval_justifies(quantity: Quantity, shown: tuple[str, str, str]) -> None:
    assert quantity_text(quantity) == shown


def test_shares_and_what_is_not_there() -> None:
    assert share_text(0.034) == "3.4 %"
    assert share_text(0.98) == "98 %"
    assert share_text(None) == number_text(math.nan) == "–"


def test_the_verdict_holds_no_number_that_is_none() -> None:
    told = msgspec.to_builtins(explanation(toy(1)).verdict)
    assert "NaN" not in msgspec.json.encode(told).decode()
