"""The court: what it asks, how it goes on after a stop, and how it judges results written by hand."""

import math
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from lab.court import run as run_module
from lab.court import score as judge
from lab.court.plan import DEVELOPMENT_SEEDS, Slot, look_alikes, slots
from lab.court.result import Errors, Result, Told, ToldCause, ToldQuantity
from lab.court.run import check_same_court, executor, results, run
from lab.court.score import score
from lab.court.smallest import smallest_found
from lab.court.tables import markdown, rate_rows
from lab.court.trial import held_out_errors
from lab.hidden.case import SHARES, Case, Kind, Sizes, TrueCause, Truth
from messages.errors import UserError


class Toy:
    """A system that can hide three effects."""

    EFFECTS = ("delay", "lag", "gain")
    OUTSIDE = tuple(f"strange_{number}" for number in range(6))
    PAIRS = (("delay", "gain"), ("lag", "gain"))
    WITHHELD = EFFECTS
    SHARES: Mapping[Kind, float] = SHARES
    SIZES: Mapping[str, Sizes] = {name: Sizes(0.1, 10.0, "ms") for name in (*EFFECTS, *OUTSIDE)}
    LOOK_ALIKES = (("delay", "lag"),)

    def write(self, case: Case, folder: Path, held_out: Path) -> Truth:
        raise AssertionError(f"{case} is planned and scored here, not written into {folder} and {held_out}")


def result(
    kind: Kind = Kind.SINGLE,
    true: tuple[str, ...] = ("delay",),
    told: tuple[str, ...] = ("delay",),
    *,
    verdict: str = "named",
    alike: Mapping[str, float | None] | None = None,
    value: tuple[float, float, float] = (2.0, 1.9, 2.1),
    size: float = 2.0,
    after: float = 0.1,
    seed: int = 5000,
) -> Result:
    """A result: `alike` are the first cause's equivalents, with what they are worse by."""
    alike = alike or {}
    quantity = ToldQuantity(*value, "ms")
    evidence = {f"worse_by.{name}": worse for name, worse in alike.items()}
    causes = [
        ToldCause(name, {"value_ms": quantity}, {} if place else evidence, [] if place else list(alike))
        for place, name in enumerate(told)
    ]
    return Result(
        truth=Truth("toy", seed, kind, tuple(TrueCause(name, {"value_ms": 2.0}, size, "ms") for name in true)),
        left_out=(),
        told=Told("toy", verdict, causes if verdict == "named" else []),
        errors=Errors(0.5, after),
        oracle=Errors(0.5, 0.1),
        seconds=1.0,
        cpu_seconds=1.0,
    )


def test_a_whole_court_asks_enough_of_everything() -> None:
    asked = slots("platform", Toy())
    counts = Counter(slot.kind for slot in asked)
    assert len(asked) >= 120
    assert counts[Kind.CLEAN] >= 17
    assert {slot.effects[0] for slot in asked if slot.kind is Kind.OUTSIDE} == set(Toy.OUTSIDE)
    singles = Counter(slot.effects[0] for slot in asked if slot.kind is Kind.SINGLE)
    assert min(singles[name] for name in Toy.EFFECTS) >= 4
    assert max(singles.values()) - min(singles.values()) <= 1
    assert len({slot.file_name for slot in asked}) == len(asked)
    assert {slot.kind for slot in asked[:40]} == set(Kind)  # a court that was stopped has seen some of each


def test_more_effects_make_a_larger_court() -> None:
    many = Toy()
    many.EFFECTS = tuple(f"effect_{number}" for number in range(30))  # type: ignore[assignment]
    singles = Counter(slot.effects[0] for slot in slots("platform", many) if slot.kind is Kind.SINGLE)
    assert min(singles[name] for name in many.EFFECTS) >= 4


def test_an_effect_is_withheld_with_all_that_looks_like_it() -> None:
    assert look_alikes(Toy(), "delay") == ("delay", "lag")
    assert look_alikes(Toy(), "gain") == ("gain",)
    assert all(
        slot.left_out == (look_alikes(Toy(), slot.effects[0]) if slot.kind is Kind.WITHHELD else ())
        for slot in slots("platform", Toy())
    )


def test_judging_seeds_are_never_those_of_development_and_never_the_same() -> None:
    slot = slots("platform", Toy(), 3)[0]
    seeds = {slot.case(development=False).seed for _ in range(50)}
    assert len(seeds) == 50
    assert not seeds & set(DEVELOPMENT_SEEDS)
    assert slot.case(development=True) == slot.case(development=True)
    assert slot.case(development=True).seed in DEVELOPMENT_SEEDS


def answered(slot: Slot, case: Case) -> Result:
    return result(slot.kind, slot.effects, slot.effects[:1], seed=case.seed)


@pytest.fixture
def toy_trials(monkeypatch: pytest.MonkeyPatch) -> Executor:
    monkeypatch.setattr(run_module, "judged", answered)
    return ThreadPoolExecutor(2)


def test_a_court_writes_one_file_a_case_and_goes_on_where_it_was(toy_trials: Executor, tmp_path: Path) -> None:
    asked = slots("platform", Toy(), 12)
    kept = result(asked[0].kind, asked[0].effects, seed=4242)
    kept.save(tmp_path / asked[0].file_name)
    told: list[Result] = []
    run(asked, tmp_path, toy_trials, development=False, tell=told.append)
    assert len(told) == 11
    assert len(list(tmp_path.glob("*.json"))) == 12
    found = results(asked, tmp_path)
    assert found[0] == kept
    assert [each.truth.kind for each in found] == [slot.kind for slot in asked]
    check_same_court(asked, tmp_path, development=False)
    with pytest.raises(UserError, match="development"):
        check_same_court(asked, tmp_path, development=True)
    with pytest.raises(UserError, match="belongs to other cases"):
        check_same_court(slots("platform", Toy(), 40), tmp_path, development=False)


def test_a_cluster_takes_the_same_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    monkeypatch.setattr(run_module, "judged", answered)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        asked = slots("platform", Toy(), 3)
        with executor(1, cluster.scheduler_address) as workers:
            run(asked, tmp_path, workers, development=True, tell=lambda _: None)
    assert len(results(asked, tmp_path)) == 3


def test_without_dask_an_address_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(UserError, match=r"gaiteyes\[cluster\]"), executor(2, "tcp://127.0.0.1:1"):
        pass


@pytest.mark.parametrize(
    ("given", "first", "two"),
    [
        (result(), 1.0, 1.0),
        (result(told=("lag",)), 0.0, 0.0),
        (result(told=("lag",), alike={"delay": 9.0}), 1.0, 1.0),
        (result(told=("lag",), alike={"delay": 11.0}), 0.0, 0.0),
        (result(told=("lag",), alike={"delay": None}), 0.0, 0.0),
        (result(told=("gain", "delay")), 0.0, 1.0),
        (result(told=("gain", "lag", "delay")), 0.0, 0.0),
        (result(verdict="unknown"), 0.0, 0.0),
    ],
)
def test_names_are_right_or_proven_look_alikes(given: Result, first: float, two: float) -> None:
    assert (judge.first_name(given), judge.first_two(given)) == (first, two)


def test_a_pair_is_exact_in_either_order_and_no_more() -> None:
    pair = (Kind.PAIR, ("delay", "gain"))
    assert judge.exact_pair(result(*pair, ("gain", "delay"))) == 1.0
    assert judge.exact_pair(result(*pair, ("lag", "gain"), alike={"delay": 3.0})) == 1.0
    assert judge.exact_pair(result(*pair, ("delay",))) == 0.0
    assert judge.exact_pair(result(*pair, ("delay", "gain", "lag"))) == 0.0
    assert judge.exact_pair(result(*pair, ("delay", "delay"))) == 0.0


def test_intervals_must_cover_and_be_narrower_than_the_value() -> None:
    wide = result(value=(2.0, -1.0, 5.0))
    assert judge.in_interval(wide) == 1.0
    assert judge.in_narrow_interval(wide) == 0.0
    assert judge.in_interval(result(value=(2.2, 2.1, 2.3))) == 0.0
    assert judge.in_narrow_interval(result()) == 1.0
    assert judge.in_interval(result(told=("lag",), alike={"delay": 1.0})) is None  # no parameter to compare


def test_each_parameter_counts_for_itself_and_one_not_told_is_wrong() -> None:
    axes = msgspec.structs.replace(
        result(),
        truth=Truth("toy", 5000, Kind.SINGLE, (TrueCause("delay", {"value_ms": 2.0, "x_ms": 1.0}, 2.0, "ms"),)),
    )
    assert judge.in_interval(axes) == 0.5
    rates = score("toy", [axes], Toy.SIZES).rates
    assert (rates["interval"].share, rates["every_interval"].share) == (0.5, 0.0)


def test_the_oracle_s_gain_is_shared_in_squares() -> None:
    assert judge.share_of_oracle(result()) == pytest.approx(1.0)
    assert judge.share_of_oracle(result(after=0.3)) == pytest.approx((0.25 - 0.09) / (0.25 - 0.01))
    assert judge.share_of_oracle(result(verdict="unknown")) == 0.0


def test_rates_are_averaged_over_effects_not_over_cases() -> None:
    many = [result() for _ in range(9)] + [result(true=("gain",), told=("lag",), size=8.0)]
    many += [result(Kind.CLEAN, (), (), verdict="nothing"), result(Kind.CLEAN, (), ("gain",))]
    many += [result(Kind.OUTSIDE, ("strange_1",), verdict="unknown"), result(Kind.WITHHELD, ("lag",), ("gain",))]
    found = score("toy", many, Toy.SIZES)
    shares = {name: rate.share for name, rate in found.rates.items()}
    assert shares["first_name"] == pytest.approx(0.5)
    assert shares["clean_nothing"] == pytest.approx(0.5)
    assert shares["outside_unknown"] == pytest.approx(0.5)
    assert shares["exact_pair"] is None
    assert found.confusion == {"delay": {"delay": 9}, "gain": {"lag": 1}}
    assert found.smallest["gain"].size is None
    assert found.smallest["delay"].size == 2.0
    assert any("50.0 % of 10" in cell for row in rate_rows([found]) for cell in row)
    page = markdown([found], {"toy": [7, 8]})
    assert "Seeds: 7 8" in page
    assert "| gain | lag 1 |" in page


def test_a_command_that_failed_is_wrong_everywhere_and_told() -> None:
    broken = Result(result().truth, (), None, None, Errors(0.5, 0.1), 1.0, 1.0, "out of memory")
    found = score("toy", [broken], Toy.SIZES)
    assert found.rates["first_name"].share == 0.0
    assert found.rates["share_of_oracle"].share == 0.0
    assert found.failures == {"toy-single-delay-5000": "out of memory"}
    assert found.confusion == {"delay": {"failed": 1}}


def test_the_smallest_size_is_where_a_rising_share_reaches_95_percent() -> None:
    random = np.random.default_rng(3)
    sizes = 10.0 ** random.uniform(-1.0, 1.0, 400)
    cases = [(size, bool(random.random() < 1.0 / (1.0 + (1.0 / size) ** 8))) for size in sizes.tolist()]
    found = smallest_found(cases, Sizes(0.1, 10.0, "ms"))
    assert found.size is not None
    assert math.log10(found.size) == pytest.approx(math.log10(19.0 ** (1 / 8)), abs=0.12)
    assert smallest_found([(1.0, False), (2.0, True)], None).size == 2.0
    assert smallest_found([(1.0, True), (2.0, False)], None).size is None


def test_errors_are_computed_anew_from_the_file(tmp_path: Path) -> None:
    measured = np.array([[1.0, 10.0], [-1.0, -10.0], [1.0, np.nan], [-1.0, 10.0]])
    base, extended = np.zeros_like(measured), 0.5 * measured
    rows = np.column_stack([np.arange(4.0), *(x[:, k] for k in (0, 1) for x in (measured, base, extended))])
    text = (
        "t_s," + ",".join(f"{side}_{name}" for name in ("a", "b") for side in ("measured", "base", "extended")) + "\n"
    )
    text += "\n".join(",".join("" if np.isnan(cell) else f"{cell}" for cell in row) for row in rows) + "\n"
    (tmp_path / "held_out.csv").write_text(text, encoding="utf-8")
    found = held_out_errors(tmp_path / "held_out.csv")
    spread = np.nanstd(measured, axis=0)
    expected = [
        math.sqrt(np.mean([np.nanmean((measured - side)[:, k] ** 2) / spread[k] ** 2 for k in (0, 1)]))
        for side in (base, extended)
    ]
    assert (found.before, found.after) == pytest.approx(tuple(expected))


def test_ranges_in_whatever_float_they_were_stated_can_be_written_down() -> None:
    found = smallest_found([(0.02, True)], Sizes(float(np.radians(0.2)), np.radians(5.0), "rad"))
    assert msgspec.json.decode(msgspec.json.encode(found))["high"] == pytest.approx(0.0872665)
