"""A case of a court with the baselines beside the finder: what each removes of the held-out excess.

The share of the excess removed is the finder's, (before² − after²) / (before² − floor²), with one floor for all: the
least that the declared noise, the oracle, any method, or the finder's own rule on any residual tells.
"""

import tempfile
import time
from importlib import import_module
from pathlib import Path

import msgspec
import numpy as np

from discrepancy.evidence.gain import gain, nrmse
from discrepancy.evidence.probe import Probe
from discrepancy.evidence.whitening import whitening
from discrepancy.problem import Problem
from lab.baselines.models import BASELINES, Case
from lab.court.plan import hidden_system
from lab.court.result import Result
from lab.hidden import case as hidden
from lab.hidden.case import Kind

FINDER = "finder"
_LEAST_EXCESS = 0.05  # of before²: below, there is nothing to remove
_PROBE_SEED = 1


class JudgedCase(msgspec.Struct, frozen=True):
    """One case: held-out NRMSE of the base model, its floor, and after each method; seconds; what each said."""

    system: str
    kind: Kind
    effects: tuple[str, ...]
    seed: int
    before: float
    floor: float
    after: dict[str, float]
    seconds: dict[str, float]
    says: dict[str, str]

    @property
    def has_excess(self) -> bool:
        """Tell whether there is anything to remove."""
        return self.before**2 - self.floor**2 > _LEAST_EXCESS * self.before**2

    def share(self, method: str) -> float:
        """Return the share of the excess that a method removes, −1 for all that is worse than doubling it."""
        removed = (self.before**2 - self.after[method] ** 2) / (self.before**2 - self.floor**2)
        return float(np.clip(removed, -1.0, 1.0))


def judged(result: Result) -> JudgedCase:
    """Return a case of the court with all baselines; its recordings are drawn again from its seed."""
    truth = result.truth
    case = hidden.Case(truth.system, truth.seed, truth.kind, _as_drawn(result))
    with tempfile.TemporaryDirectory(prefix="gaiteyes-baselines-") as name:
        fit, held_out = Path(name) / "fit", Path(name) / "held_out"
        hidden_system(truth.system).write(case, fit, held_out)
        load = import_module(f"systems.{truth.system}").load
        began_s = time.monotonic()
        both = Case.of(Problem(load(fit)), Problem(load(held_out)))
        seconds = {"base model": time.monotonic() - began_s}
        after, says = {}, {}
        before = nrmse(both.held, both.residual_held)
        floors = [_floor(both, both.predicted_held)]
        for baseline in BASELINES:
            began_s = time.monotonic()
            told = baseline.told(both)
            seconds[baseline.name] = time.monotonic() - began_s
            after[baseline.name] = nrmse(both.held, both.held.difference(told.predicted))
            says[baseline.name] = told.says
            floors.append(_floor(both, told.predicted))
    told_names = [cause.name for cause in result.told.causes] if result.told is not None else []
    errors, oracle = result.errors, result.oracle
    share_left = errors.after / errors.before if errors is not None and errors.before and errors.after else 1.0
    after[FINDER] = before * share_left
    if oracle is not None and oracle.before and oracle.after:
        floors.append(before * oracle.after / oracle.before)
    seconds[FINDER] = result.seconds
    says[FINDER] = ", ".join(told_names) or ("failed" if result.told is None else result.told.verdict)
    return JudgedCase(
        truth.system,
        truth.kind,
        tuple(cause.name for cause in truth.causes),
        truth.seed,
        before,
        min(*floors, *after.values()),
        after,
        seconds,
        says,
    )


def _as_drawn(result: Result) -> tuple[str, ...]:
    """Return a case's effects in the order in which it was drawn; a truth tells them strongest first."""
    effects = tuple(cause.name for cause in result.truth.causes)
    if result.truth.kind is not Kind.PAIR:
        return effects
    pairs = hidden_system(result.truth.system).PAIRS
    return next((pair for pair in pairs if set(pair) == set(effects)), effects)


def _floor(case: Case, predicted: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Return the noise floor that the finder would tell of the held-out residual."""
    residual = case.held.difference(predicted)
    probe = Probe(case.held, whitening(residual, case.held.valid), case.predicted_held, residual, _PROBE_SEED)
    signal = probe.predictable(residual).signal
    floor = gain(case.held, case.residual_held, residual, signal, True).noise_floor_nrmse
    return np.inf if floor is None else floor
