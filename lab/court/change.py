"""Verdicts on a recording before and after something was planted into it: has what was planted been told as the change?

A real recording has effects of its own. So a cause counts as named where it is told anew, or where one that was told
before has changed by the planted size. Most parameters add up. Of two low passes in a row what is told is where both
together have fallen by 3 dB; of two limits the lower one.
"""

from collections.abc import Mapping

import msgspec
import numpy as np
from scipy.optimize import brentq

from lab.court.result import Told, ToldCause
from lab.court.score import names
from lab.hidden.case import TrueCause
from messages.constants import STANDARD_GRAVITY_MPS2

_DAMPING = float(np.sqrt(0.5))
_HIGHEST_HZ = 1e4
_HALF_POWER = 0.5


class Change(msgspec.Struct, frozen=True):
    """How a planted cause was told.

    `named` by its name or by a look-alike that is proven to fit as well, and anew or with another size; `own_name`
    tells which. `in_interval` is whether every planted parameter's change lies in its 95 % interval, its size before
    being that of the verdict before; `like_for_like` the same with the size before that the causes told after have in
    the recording without the planted one. `beside` are causes told anew that were not planted.
    """

    named: bool
    own_name: bool
    in_interval: bool
    like_for_like: bool
    beside: tuple[str, ...]


def change(planted: TrueCause, before: Told, after: Told, same_causes: Mapping[str, float]) -> Change:
    """Return how a cause was told: `same_causes` holds the parameters, as `effect.parameter`, of what was told after,
    fitted to the recording before.
    """
    told_before = {cause.name: cause for cause in _causes(before)}
    by_likeness = [cause for cause in _causes(after) if planted.name in names(cause)]
    told = next((cause for cause in by_likeness if set(planted.parameters) <= set(cause.parameters)), None)
    name = planted.name if told is None else told.name
    there = told_before.get(name)
    own_before = {} if there is None else {name: q.value for name, q in there.parameters.items() if q.value is not None}
    like_before = {key.split(".", 1)[1]: value for key, value in same_causes.items() if key.split(".", 1)[0] == name}
    in_interval = told is not None and _holds(planted, told, own_before)
    like_for_like = told is not None and _holds(planted, told, like_before)
    anew = [cause for cause in by_likeness if cause.name not in told_before and planted.name not in told_before]
    return Change(
        named=bool(anew) or in_interval or like_for_like,
        own_name=name == planted.name and told is not None,
        in_interval=in_interval,
        like_for_like=like_for_like,
        beside=tuple(cause.name for cause in _causes(after) if cause.name not in {*told_before, planted.name}),
    )


def expected(planted: TrueCause, before: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that a verdict must tell where it told `before` without what was planted."""
    return {name: _together(planted.name, name, value, before) for name, value in planted.parameters.items()}


def _holds(planted: TrueCause, told: ToldCause, before: Mapping[str, float]) -> bool:
    for name, value in expected(planted, before).items():
        quantity = told.parameters.get(name)
        if quantity is None or quantity.low is None or quantity.high is None:
            return False
        if not quantity.low <= value <= quantity.high:
            return False
    return True


def _together(effect: str, name: str, planted: float, before: Mapping[str, float]) -> float:
    there = before.get(name)
    if effect == "low_pass":
        zeta = before.get("zeta", _DAMPING)
        return planted if there is None else _both_hz((planted, _DAMPING), (there, zeta))
    if effect == "clipping":
        return planted if there is None else min(planted, there)
    if effect == "vibration":
        return planted
    if effect == "gravity_magnitude":
        return planted + (STANDARD_GRAVITY_MPS2 if there is None else there)
    if effect in ("gyro_scale", "acc_scale") and there is not None:
        return (1.0 + planted) * (1.0 + there) - 1.0
    return planted + (there or 0.0)


def _both_hz(*filters: tuple[float, float]) -> float:
    """Return where second-order low passes in a row, each of a cut-off at −3 dB and a damping, have fallen by 3 dB."""

    def power(f_hz: float) -> float:
        product = 1.0
        for cut_off_hz, zeta in filters:
            lean = 2.0 * zeta**2 - 1.0
            square = (f_hz / cut_off_hz) ** 2 / (lean + np.sqrt(lean**2 + 1.0))
            product /= (1.0 - square) ** 2 + 4.0 * zeta**2 * square
        return product - _HALF_POWER

    found: float = brentq(power, 1e-3, _HIGHEST_HZ)
    return found


def _causes(told: Told) -> list[ToldCause]:
    return told.causes if told.verdict == "named" else []
