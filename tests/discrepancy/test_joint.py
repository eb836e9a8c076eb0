"""Several recordings of one system: fitted jointly, judged apart, each at its own rate and length."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discrepancy import Explanation, explain
from discrepancy.evidence.gain import pooled
from discrepancy.joint import JointProblem
from discrepancy.problem import Problem
from discrepancy.recordings import Recordings, check_different
from discrepancy.report.extended import extended_text
from discrepancy.report.output import write_report
from discrepancy.report.wording import key_text
from discrepancy.search.carried import carried
from discrepancy.verdict import Gain, to_json
from messages.errors import UserError
from tests.bench.html_page import read
from tests.bench.late_sensor import DELAY, LateSensor, late_sensor

SLOW = late_sensor([1.0], 1, offset_m=0.3)
FAST = late_sensor([5.0], 2, offset_m=-2.0, rate_hz=250.0, seconds=6.0)
LATER = late_sensor([5.0], 2, offset_m=-2.0, rate_hz=250.0, seconds=6.0, delay_s=0.008)
HELD_OUT = late_sensor([2.0, 3.0], 3, offset_m=1.0, rate_hz=80.0)
OTHER = late_sensor([1.0, 4.0], 4)


def causes(found: Explanation) -> list[tuple[str, list[str]]]:
    return [(cause.name, cause.equivalents) for cause in found.verdict.causes]


@pytest.fixture(scope="module")
def both() -> Explanation:
    return explain([SLOW, FAST], [HELD_OUT, OTHER], seed=1, names=("slow", "fast", "elsewhere", "again"))


def test_two_recordings_tell_together_what_neither_tells_alone(both: Explanation) -> None:
    for alone in (SLOW, FAST):
        assert causes(explain(alone, None, seed=1)) == [("delay", ["lag"])]
    assert causes(both) == [("delay", [])]
    delay = both.verdict.causes[0].parameters["value_s"]
    assert delay.low is not None
    assert delay.high is not None
    assert delay.low < 0.004 < delay.high < delay.low + 1e-4


def test_each_recording_is_judged_by_itself(both: Explanation) -> None:
    told = both.verdict.recordings
    assert [(each.name, each.held_out) for each in told] == [
        ("slow", False),
        ("fast", False),
        ("elsewhere", True),
        ("again", True),
    ]
    for each in told:
        assert each.nrmse_before is not None
        assert each.nrmse_after is not None
        assert each.nrmse_after < 0.5 * each.nrmse_before
        assert not each.remainder.present
        assert bool(each.parameters) != each.held_out
    assert set(told[0].parameters) == {"gain", "delay.value_s"}  # what they share
    before = [each.nrmse_before for each in told if each.held_out and each.nrmse_before is not None]
    assert both.verdict.gain.held_out_nrmse_before == pytest.approx(np.sqrt(np.mean(np.square(before))))
    assert both.verdict.disagreements == []


def test_what_belongs_to_a_recording_has_a_value_for_each_and_is_fitted_elsewhere_too(both: Explanation) -> None:
    own = both.verdict.parameters_after
    for key, offset_m in (("offset_m", 0.3), ("offset_m@2", -2.0)):
        assert own[key].value == pytest.approx(offset_m, abs=1e-3)
        assert own[key].low is not None
    assert key_text("offset_m@2", ["slow", "fast"]) == "offset (fast)"
    assert "@" not in extended_text(both)
    assert "belongs to each recording has its value in the first one" in extended_text(both)
    there = carried(Problem(HELD_OUT), {"gain": 1.1, "delay.value_s": 0.004, "offset_m": 0.3, "offset_m@2": -2.0})
    assert set(there) == {"gain", "delay.value_s", "offset_m"}
    assert there["gain"] == 1.1
    assert there["offset_m"] == pytest.approx(1.0, abs=0.01)


def test_the_report_tells_each_recording(both: Explanation, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    write_report(both, tmp_path)
    text = read(tmp_path / "report.html")
    for told in (
        "Judged on recordings held out, to which no parameter that the recordings share was fitted.",
        "Each recording by itself",
        "elsewhere held out",
        "delay: value slow 4.0",
        "offset (fast)",
        f"The held-out recording with the largest error left, {both.held_out_name}",
    ):
        assert told in text, told
    assert "The recordings disagree" not in text


def test_recordings_that_disagree_are_told(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    whole = explain([SLOW, LATER], None, seed=1, names=("slow", "later"))
    write_report(whole, tmp_path)
    assert "The recordings disagree: delay: value is" in read(tmp_path / "report.html")
    assert any("left where this recording is fitted by itself" in reason for reason in whole.after.reasons)
    found = whole.verdict
    assert len(found.disagreements) == 1
    assert found.disagreements[0].startswith("delay: value is ")
    assert "ms in slow, but 8.0" in found.disagreements[0]
    assert found.disagreements[0].endswith("ms in later")
    assert found.remainder.present
    assert found.next_experiment is not None
    assert found.next_experiment.startswith("Find out what was different")
    left = {each.name: each.remainder.present for each in found.recordings}
    assert left["slow"] or left["later"]


def test_an_effect_that_one_recording_alone_refutes_does_not_hold_there() -> None:
    prompt = late_sensor([2.0], 5, delay_s=0.0)
    found = explain([SLOW, FAST], [HELD_OUT, prompt], seed=1, names=("slow", "fast", "late", "prompt")).verdict
    assert found.verdict == "unknown"
    assert found.notes == ["delay: fits the recordings best, but does not hold on those held out: prompt"]


def test_one_recording_in_a_list_is_one_recording() -> None:
    assert to_json(explain([SLOW], [HELD_OUT], seed=1).verdict) == to_json(explain(SLOW, HELD_OUT, seed=1).verdict)


def test_the_joint_problem_is_its_recordings_one_after_another() -> None:
    parts = [Problem(SLOW), Problem(FAST)]
    joint = JointProblem(parts)
    assert joint.base == ("gain", "offset_m", "offset_m@2")
    assert joint.n == 1000 + 1500
    values = {"gain": 1.2, "offset_m": 0.1, "offset_m@2": 0.7, "delay.value_s": 0.01}
    first = parts[0].predicted({"gain": 1.2, "offset_m": 0.1, "delay.value_s": 0.01})
    second = parts[1].predicted({"gain": 1.2, "offset_m": 0.7, "delay.value_s": 0.01})
    assert np.array_equal(joint.predicted(values), np.concatenate((first, second), axis=1))
    sets = [values, {**values, "offset_m@2": 0.0}, {**values, "gain": 1.0}]
    for one, each in zip(joint.predicted_many(sets), sets, strict=True):
        assert np.array_equal(one, joint.predicted(each))
    column = joint.columns([(values, joint.predicted(values), "offset_m@2")])[0]
    assert np.all(column[:, :1000] == 0.0)
    assert np.allclose(column[:, 1000:], 1e-3)


def test_nothing_reaches_across_the_end_of_a_recording() -> None:
    parts = [Problem(SLOW), Problem(FAST)]
    joint = JointProblem(parts)
    residual = joint.residual(joint.start())
    for part, (a, b) in zip(parts, ((0, 1000), (1000, 2500)), strict=True):
        assert np.array_equal(residual[:, a:b], part.residual(part.start()))
    white = joint.whitening(residual)
    apart = [part.whitening(residual[:, a:b]) for part, (a, b) in zip(parts, ((0, 1000), (1000, 2500)), strict=True)]
    assert white.count == sum(each.count for each in apart)
    assert white.log_det == sum(each.log_det for each in apart)
    assert np.array_equal(white(residual)[:, 1000:], apart[1](residual[:, 1000:]))
    lost = joint.predicted({})
    lost[:, :500] = np.nan
    assert joint.lost(lost) > 0.45  # of the first recording, not of both
    joint.narrow(np.isfinite(lost))
    assert not parts[0].valid[:, :500].any()
    assert np.array_equal(joint.valid[:, 1000:], parts[1].valid)


def test_recordings_with_the_same_inputs_tell_each_others_noise() -> None:
    tones = (1.0, 1.371)  # whose sum does not repeat itself within a recording
    first, second, third = (late_sensor(tones, seed) for seed in (1, 2, 3))
    alone = late_sensor((1.0, 1.713), 4)
    recordings = Recordings.of([first, alone, second], [third])
    known = [part.noise for part in (*recordings.fit.parts, *recordings.held_out.parts)]
    assert [noise.source if noise else None for noise in known] == ["repeats", None, "repeats", "repeats"]
    assert recordings.fit.noise is None  # of one of them it is not known
    assert recordings.fitted_names == ("recording 1", "recording 2", "recording 3")


def test_a_gain_over_recordings_that_tell_nothing_is_nothing() -> None:
    nothing = Gain(None, None, None, None)
    assert pooled([nothing, nothing]) == nothing
    assert pooled([Gain(0.3, 0.1, 0.1, 1.0), Gain(0.4, 0.1, 0.1, 1.0)]).share_of_excess_removed == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (replace(FAST, system="another"), r"fast: the system is not those of the first \(another, late sensor\)"),
        (replace(FAST, effects=(DELAY,)), r"fast: the effects are not those of the first \(lag\.value_s\)"),
        (replace(FAST, parameters=FAST.parameters[:1]), r"fast: the parameters are not those .*\(offset_m\)"),
    ],
)
def test_recordings_of_different_systems_are_refused(other: LateSensor, told: str) -> None:
    with pytest.raises(UserError, match=told):
        explain([SLOW, other], None, seed=1, names=("slow", "fast"))


def test_mistakes_are_one_line() -> None:
    with pytest.raises(UserError, match="no recording to fit"):
        explain([], None, seed=1)
    with pytest.raises(UserError, match="1 names; expected one for each of 2 recordings"):
        explain([SLOW, FAST], None, seed=1, names=("slow",))
    with pytest.raises(UserError, match=r"b/\.\./a\.csv: given twice") as refused:
        check_different([Path("b/../a.csv"), Path("a.csv")])
    assert "\n" not in str(refused.value)
    short = late_sensor([1.0], 6, seconds=2.0)
    with pytest.raises(UserError, match=r"short, its end: y_m: too few samples|short: .*too few samples"):
        explain([SLOW, short], None, seed=1, names=("slow", "short"))
