"""The court of systems with ports: what it asks, what it scores, and one case through the whole command."""

from collections import Counter

import pytest

from lab.court.plan import PORTED, Slot, hidden_system, slots
from lab.court.ported import counts, gained
from lab.court.result import Errors, Result, Told, ToldCause
from lab.court.tables import count_rows
from lab.court.trial import judged
from lab.hidden.case import Kind, TrueCause, Truth

NOISE = 0.002


def result(
    kind: Kind, verdict: str, *, told: str = "", true: str = "drag", beyond: float = 1e4, after: float = NOISE
) -> Result:
    causes = [ToldCause(told, {}, {}, [])] if told else []
    return Result(
        truth=Truth(
            "motor",
            5000,
            kind,
            () if kind is Kind.CLEAN else (TrueCause(true, {}, 1.0, "N"),),
            nuisance={"noise_nrmse": NOISE},
            chi2_beyond_base=beyond,
        ),
        left_out=(),
        told=Told("motor", verdict, causes),
        errors=Errors(0.05 if kind is not Kind.CLEAN else NOISE, after),
        oracle=None,
        seconds=1.0,
        cpu_seconds=1.0,
    )


def test_each_system_is_asked_as_often_as_the_goals_need() -> None:
    asked = Counter(slot.kind for name in PORTED for slot in slots(name, hidden_system(name)))
    assert asked[Kind.CLEAN] >= 60
    assert asked[Kind.OUTSIDE] + asked[Kind.WITHHELD] >= 60
    assert sum(asked.values()) >= 200
    assert asked[Kind.PAIR] == 0
    for name in PORTED:
        for slot in slots(name, hidden_system(name)):
            assert slot.kind is not Kind.WITHHELD or slot.effects[0] in slot.left_out


def test_counts_take_what_can_be_found_and_no_more() -> None:
    found = {
        each.words: each
        for each in counts(
            [
                result(Kind.SINGLE, "named", told="drag"),
                result(Kind.SINGLE, "named", told="friction"),
                result(Kind.SINGLE, "nothing", beyond=20.0),
                result(Kind.CLEAN, "nothing"),
                result(Kind.CLEAN, "named", told="drag"),
                result(Kind.OUTSIDE, "constructed"),
                result(Kind.WITHHELD, "constructed", after=0.03),
                result(Kind.WITHHELD, "cannot_tell"),
            ]
        )
    }
    first = found["the first name is right"]
    assert (first.k, first.n, first.reached) == (1, 2, False)
    false = found["nothing hidden: something is named or constructed"]
    assert (false.k, false.n, false.reached) == (1, 2, False)
    made = found["not in the library: constructed"]
    assert (made.k, made.n, made.reached) == (2, 3, True)
    assert found["of these, 80 % of what there is to be gained"].k == 1
    assert found["cannot tell"].k == 1
    assert ["the first name is right", "≥ 90 %", "1 of 2 (50.0 %)"] in count_rows(list(found.values()))
    assert counts([]) == []


def test_the_gain_is_counted_above_the_noise() -> None:
    assert gained(result(Kind.OUTSIDE, "constructed")) == pytest.approx(1.0)
    assert gained(result(Kind.OUTSIDE, "constructed", after=0.05)) == 0.0


@pytest.mark.long
def test_a_case_goes_through_the_command_as_a_user_s_own() -> None:
    slot = Slot("motor", 3, Kind.SINGLE, ("coulomb_friction_at_shaft",), ())
    found = judged(slot, slot.case(development=True))
    assert not found.failure
    assert found.told is not None
    assert [cause.name for cause in found.told.causes] == ["coulomb_friction_at_shaft"]
    assert found.oracle is None
    assert gained(found) > 0.99
