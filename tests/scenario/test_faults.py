"""A few quick faults through the real running daemon: its flag, its recovery, and nothing wrong in between.

Nothing here depends on how fast the machine is: limits of time are for `gaiteyes faults` on a machine of its own.
"""

import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from cli.main import app
from lab.evaluation import busy_host
from lab.faults.campaign import Campaign, Trial
from lab.faults.catalogue import CATALOGUE
from lab.faults.claims import claims
from lab.faults.daemon_under_test import SCENARIO, DaemonUnderTest, film_of_lap
from lab.faults.report import Attempt, CampaignReport, TrialReport
from lab.faults.tables import CLAIM_COLUMNS, COLUMNS, claim_row, line, row
from lab.faults.trial import Measured
from messages import Reason
from sim_rig.camera.film import Film, film_file

pytestmark = [pytest.mark.realtime, pytest.mark.long]

FLAGS = {
    "imu-nak-eio": {Reason.NO_IMU},
    "cam-frozen": {Reason.FROZEN_FRAME, Reason.IMU_INCONSISTENT},  # the gyroscope turns, the picture does not
    "cam-both-black": {Reason.OVER_EXPOSED},
}
BUSY = {Reason.NO_FRAME, Reason.NO_IMU, Reason.LATE, Reason.UNCONFIRMED}
"""A busy machine may lose the rig's frames, or the samples' punctuality, just then."""
NAMES = (*FLAGS, "can-ankle-corrupted", "zenoh-port-taken", "file-configuration-broken")


@pytest.fixture(scope="module")
def film() -> Iterator[Film]:
    with film_file() as path:
        yield film_of_lap(1, path)


@pytest.fixture(scope="module")
def campaign(film: Film, tmp_path_factory: pytest.TempPathFactory) -> CampaignReport:
    """Run the trials; a busy machine repeats only what failed while the rig lost frames."""
    told: list[Attempt] = []
    anything = pytest.MonkeyPatch()
    for bound in ("MOST_WAITING", "MOST_LATE", "MOST_HELD_UP"):
        anything.setattr(busy_host, bound, math.inf)
    made = Campaign(1, tmp_path_factory.mktemp("faults"), told.append, patience_s=60.0, film=film)
    try:
        made.run([Trial((CATALOGUE[name],)) for name in NAMES])
    finally:
        made.close()
        anything.undo()
    return CampaignReport.of(1, SCENARIO, told)


def trial(campaign: CampaignReport, name: str) -> TrialReport:
    (found,) = [report for report in campaign.standing if report.name == name]
    return found


def seen_to_the_end(campaign: CampaignReport, name: str) -> tuple[TrialReport, Measured]:
    """Return the trial and what was heard in it; skip where each try was lost with the frames that the rig lost."""
    found = trial(campaign, name)
    ended = found.measured is not None and found.measured.recovery_s is not None
    if found.void and not ended:
        pytest.skip(f"the host is too busy for {name}: {found.void}")
    assert found.measured is not None
    return found, found.measured


@pytest.mark.parametrize("name", FLAGS)
def test_nothing_wrong_is_valid_however_busy_the_host_is(campaign: CampaignReport, name: str) -> None:
    found = [report.measured for report in campaign.trials if report.name == name and report.measured is not None]
    if not found and (void := trial(campaign, name).void):
        pytest.skip(f"the host is too busy for {name}: {void}")
    assert found
    assert not [wrong for measured in found for wrong in measured.wrong_told]
    assert sum(measured.wrong + measured.wrong_on_can + measured.wrong_attitudes for measured in found) == 0


@pytest.mark.parametrize(("name", "reasons"), FLAGS.items())
def test_a_fault_is_flagged_by_its_name_and_is_over(campaign: CampaignReport, name: str, reasons: set[Reason]) -> None:
    _, found = seen_to_the_end(campaign, name)
    assert found.flag_reason in {reason.value for reason in reasons | BUSY}
    assert found.recovery_s is not None


@pytest.mark.parametrize(
    ("name", "counter"),
    [
        ("imu-nak-eio", "imu_bus_errors"),
        ("cam-frozen", "refused.frozen_frame"),
        ("can-ankle-corrupted", "can_bus.ankle_refused"),
    ],
)
def test_what_was_injected_was_counted(campaign: CampaignReport, name: str, counter: str) -> None:
    report, _ = seen_to_the_end(campaign, name)
    assert report.counted[counter] > 0


def test_what_cannot_start_says_why_in_one_line(campaign: CampaignReport) -> None:
    taken = trial(campaign, "zenoh-port-taken")
    assert (taken.failures, taken.verdict) == ([], "pass")
    assert "address is in use" in taken.told
    broken = trial(campaign, "file-configuration-broken")
    assert broken.failures == []
    assert "gaiteyes.toml" in broken.told


def test_a_campaign_reads_as_a_table_and_as_json(campaign: CampaignReport) -> None:
    assert all(len(row(report)) == len(COLUMNS) for report in campaign.trials)
    assert "address is in use" in line(trial(campaign, "zenoh-port-taken"))
    found = {claim.claim: claim for claim in claims(campaign)}
    assert all(len(claim_row(claim)) == len(CLAIM_COLUMNS) for claim in found.values())
    assert found[f"stops that hung, of {campaign.starts} starts"].met
    # where the host or the renderer was late, there is no time that is free of faults
    disturbed = any(report.rig_late or report.void for report in campaign.trials)
    assert campaign.fault_free.frames > 0 or disturbed
    assert campaign.process is not None


def test_a_fault_may_be_there_before_the_start(film: Film, tmp_path: Path) -> None:
    with closing(DaemonUnderTest(1, tmp_path, film=film)) as daemon:
        daemon.start(msgspec.structs.replace(daemon.plan, from_start=("cam-both-black",)))
        grounds = daemon.listener.grounds
        assert daemon.listen(60.0, lambda: any(h.ground.reason is Reason.OVER_EXPOSED for h in grounds))
        assert not any(h.valid for h in grounds)


def test_the_catalogue_is_listed_and_an_unknown_name_is_one_line() -> None:
    listed = CliRunner().invoke(app, ["faults", "--list", "--only", "cam-unplugged"])
    assert listed.exit_code == 0
    assert "cam-unplugged-2s  camera, flagged ≤ 150 ms" in listed.output
    unknown = CliRunner().invoke(app, ["faults", "--only", "cam-on-fire"])
    assert "--only cam-on-fire" in str(unknown.exception)
