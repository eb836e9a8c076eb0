"""A trial that the host holds up is void and is repeated, and the command says so; no daemon runs here."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.main import app
from lab.evaluation.busy_host import Burden
from lab.faults import campaign as module
from lab.faults import daemon_under_test
from lab.faults.campaign import Campaign, Trial
from lab.faults.catalogue import CATALOGUE
from lab.faults.criteria import Wrong
from lab.faults.report import Attempt, CampaignReport, TrialReport
from tests.lab.faults.made_up import attempt

FINE = Burden(waiting=0.2, frames=200, heard=1000)
ONE_LATE = Burden(waiting=0.2, frames=200, frames_late=1, heard=1000)
STARVED = Burden(waiting=0.9, frames=200, frames_late=60, heard=1000)


def verdict(burden: Burden, *, failed: bool, wrong: bool = False) -> bool:
    measured = attempt(wrong=Wrong(zenoh=int(wrong))).trial.measured
    assert measured is not None
    return bool(module._void(burden, measured, ["never flagged"] if failed else []))


def test_a_busy_host_makes_a_trial_void_and_a_lost_frame_one_that_failed() -> None:
    assert not verdict(FINE, failed=True)
    assert not verdict(ONE_LATE, failed=False)
    assert verdict(ONE_LATE, failed=True)
    assert verdict(STARVED, failed=False)
    assert verdict(STARVED, failed=True)


def test_a_lost_frame_does_not_excuse_a_wrong_plane() -> None:
    assert not verdict(ONE_LATE, failed=True, wrong=True)


def reports(monkeypatch: pytest.MonkeyPatch, *attempts: Attempt) -> None:
    """Let the campaign's next attempts end so; nothing is rendered for them."""
    endings: Iterator[Attempt] = iter(attempts)

    def once(_self: Campaign, trial: Trial) -> TrialReport:
        return next(endings).trial

    monkeypatch.setattr(Campaign, "_once", once)
    monkeypatch.setattr(daemon_under_test, "film_of_lap", lambda _seed, _folder: None)


@pytest.mark.parametrize(
    ("busy", "attempts"), [([], 1), (["busy"], 2), (["busy", "busy"], 3), (["busy", "busy", "busy"], 3)]
)
def test_a_void_trial_is_repeated_twice_at_most(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, busy: list[str], attempts: int
) -> None:
    reports(monkeypatch, *(attempt(void=why) for why in busy), attempt())
    told: list[Attempt] = []
    campaign = Campaign(1, tmp_path, told.append)
    campaign.run([Trial((CATALOGUE["cam-frozen"],))])
    campaign.close()
    assert [bool(made.trial.void) for made in told] == [*([True] * len(busy)), False][:attempts]


def faults(tmp_path: Path, *more: object) -> tuple[int, str, dict[str, object]]:
    path = tmp_path / "facts.json"
    command = ["faults", "--only", "cam-frozen,cam-silent", "--json", path, *more]
    done = CliRunner().invoke(app, [str(word) for word in command])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output, json.loads(path.read_bytes())


def test_the_exit_code_tells_failed_from_void(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    names = ("cam-frozen", "cam-frozen-noisy", "cam-silent")
    sound = [attempt(name) for name in names]
    reports(monkeypatch, *sound)
    assert faults(tmp_path)[0] == 0
    reports(monkeypatch, *sound[:2], *[attempt(names[2], failures=["never flagged"], void="busy")] * 3)
    code, output, facts = faults(tmp_path)
    assert code == 4
    assert "Void, the host was too busy: cam-silent." in output
    assert facts["void"] == ["cam-silent"]
    reports(monkeypatch, attempt(names[0], failures=["never flagged"]), sound[1], *[attempt(names[2], void="busy")] * 3)
    assert faults(tmp_path)[0] == 1


def test_a_campaign_goes_on_from_its_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "campaign.jsonl"
    reports(monkeypatch, attempt("cam-frozen"), *[attempt("cam-frozen-noisy", void="busy")] * 3, attempt("cam-silent"))
    assert faults(tmp_path, "--file", file)[0] == 4
    reports(monkeypatch, attempt("cam-frozen-noisy"))  # no more is asked for
    code, output, facts = faults(tmp_path, "--file", file)
    assert code == 0
    assert "1 of 3 trials to run" in output
    assert isinstance(facts["trials"], list)
    assert [trial["name"] for trial in facts["trials"]].count("cam-frozen-noisy") == 4


def test_what_was_wrong_outside_the_trial_is_counted_elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def once(campaign: Campaign, _trial: Trial) -> TrialReport:
        campaign._daemon.listener.wrong += Wrong(5, 3, 1)
        return attempt(wrong=Wrong(2, 1, 0)).trial

    monkeypatch.setattr(Campaign, "_once", once)
    told: list[Attempt] = []
    campaign = Campaign(1, tmp_path, told.append)
    campaign.run([Trial((CATALOGUE[name],)) for name in ("cam-frozen", "cam-silent")])
    campaign.close()
    assert [made.elsewhere for made in told] == [Wrong(3, 2, 1)] * 2
    assert CampaignReport.of(1, "ramps", told).all_wrong() == campaign._daemon.listener.wrong == Wrong(10, 6, 2)
