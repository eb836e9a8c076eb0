"""The rows of a campaign: each wrong estimate stands in one of them, and what is void judges nothing."""

import re

from hypothesis import given
from hypothesis import strategies as st

from lab.faults.claims import Claim, claims
from lab.faults.criteria import Wrong
from lab.faults.fault import Expect
from lab.faults.report import Attempt, CampaignReport, FaultFree
from tests.lab.faults.made_up import attempt

WRONG = "wrong and marked valid: "
COUNTS = st.builds(Wrong, *(st.integers(0, 300),) * 3)
FREE = st.builds(FaultFree, **{name: st.integers(0, 5) for name in ("wrong", "wrong_on_can", "wrong_attitudes")})
ATTEMPTS = st.lists(
    st.builds(
        attempt,
        st.sampled_from(["a", "b", "c"]),
        faults=st.sampled_from([1, 2]),
        expect=st.sampled_from([Expect.FLAGGED, Expect.HONEST, Expect.UNDETECTABLE]),
        void=st.sampled_from(["", "the host was busy"]),
        wrong=COUNTS,
        free=FREE,
        elsewhere=COUNTS,
    ),
    max_size=12,
)


def rows(*attempts: Attempt) -> dict[str, Claim]:
    return {row.claim: row for row in claims(CampaignReport.of(1, "ramps", attempts))}


def wrong_rows(found: dict[str, Claim]) -> dict[str, Wrong]:
    """Return the counts that the rows about wrong estimates tell, by the place of each."""
    told: dict[str, Wrong] = {}
    for row in found.values():
        if row.claim.startswith(WRONG):
            counts = re.match(r"(\d+) grounds, (\d+) on CAN, (\d+) attitudes", row.figure)
            assert counts is not None, row.figure
            told[row.claim.removeprefix(WRONG)] = Wrong(*map(int, counts.groups()))
    return told


@given(ATTEMPTS)
def test_the_rows_about_wrong_estimates_add_up_to_all_of_them(attempts: list[Attempt]) -> None:
    told = wrong_rows(rows(*attempts))
    heard = Wrong()
    for made in attempts:
        heard = heard + made.trial.wrong + made.fault_free.all_wrong() + made.elsewhere
    assert told.pop("all of these") == heard
    assert sum(told.values(), Wrong()) == heard


def test_the_undetectable_have_a_row_of_their_own_with_counts_and_errors() -> None:
    listed = attempt("cam-x", expect=Expect.UNDETECTABLE, wrong=Wrong(79, 75, 1), failures=[])
    found = rows(listed, attempt())
    row = found[WRONG + "undetectable faults"]
    assert row.figure == "79 grounds, 75 on CAN, 1 attitudes; 1 of 1 trials, largest errors 4.5°, 12 mm (cam-x)"
    assert row.met is None
    assert wrong_rows(found)["single faults that can be detected"] == Wrong()


def test_a_wrong_plane_misses_its_goal_and_names_the_trial() -> None:
    row = rows(attempt("cam-y", wrong=Wrong(zenoh=1)))[WRONG + "single faults that can be detected"]
    assert row.met is False
    assert "(cam-y)" in row.figure


def test_a_void_trial_judges_nothing_but_what_was_wrong_in_it_is_counted() -> None:
    late = attempt("cam-z", flag_s=2.0, failures=["flagged after 2000 ms"], void="busy", wrong=Wrong(zenoh=3))
    report = CampaignReport.of(1, "ramps", [late])
    found = rows(late)
    assert found["flagged after: missing, frozen, black, late frames"].met is None
    assert found["trials, seed 1, 0.1 min"].figure == "1: 0 passed, 0 failed, 0 undetectable, 1 void"
    assert wrong_rows(found)["void trials and the time about them"] == Wrong(zenoh=3)
    assert report.passed
    assert report.void == ["cam-z"]


def test_disturbed_time_without_a_fault_is_void_unless_some_of_it_was_sound() -> None:
    def void(*free: FaultFree) -> list[str]:
        return CampaignReport.of(1, "ramps", [attempt(free=each) for each in free]).void

    assert void(FaultFree(left_out_s=3.0)) == ["the time without a fault"]
    assert not void(FaultFree(left_out_s=3.0), FaultFree(seconds=3.0, frames=60))
    assert not void(FaultFree())


def test_the_last_attempt_at_a_trial_stands() -> None:
    report = CampaignReport.of(1, "ramps", [attempt(void="busy"), attempt(failures=["did not recover"])])
    assert [trial.verdict for trial in report.standing] == ["FAIL"]
    assert not report.passed
    assert not report.void


def test_what_never_came_is_not_within() -> None:
    row = rows(attempt(flag_s=0.05), attempt("b", flag_s=None))["flagged after: missing, frozen, black, late frames"]
    assert (row.figure, row.met) == ("50 ms to 50 ms, median 50 ms; 1 of 2 within (b)", False)


def test_valid_without_a_fault_is_judged_away_from_edges() -> None:
    free = FaultFree(frames=1000, valid=980, away=900, away_valid=899)
    row = rows(attempt(free=free))["valid without a fault, away from edges"]
    assert (row.figure, row.met) == ("99.89 % of 900 frames; of all 1000 98.00 %", True)
    assert rows(attempt())["valid without a fault, away from edges"].met is None
