"""How something hidden acts in a system: at a port, on what drives it, on what is read, on what is written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

Own = tuple[float, ...]
Force = Callable[[Sequence[float], Own], tuple[float, Own]]
"""From a port's signals and the states of its own: what is added there, and these states' rates."""
Drive = Callable[[FloatArray], FloatArray]
"""An input as a function of time."""
Driving = Callable[[Drive, FloatArray, int], FloatArray]
"""From an input, the samples' times (n,) and the steps in a sample: what drives the system in each step, (n, steps)."""
Curve = Callable[[FloatArray], FloatArray]
"""True readings (…, c) as a function of time."""
Reading = Callable[[Curve, FloatArray, FloatArray], FloatArray]
"""From true readings, all steps' times and the samples' times (n,): what a sensor gives at the samples, (n, c)."""
Writing = Callable[[FloatArray], FloatArray]
"""From readings with noise (n, c): what is written down of them."""


def _held(drive: Drive, t_s: FloatArray, steps: int) -> FloatArray:
    return np.repeat(drive(t_s)[:, None], steps, axis=1)


def _as_it_is(curve: Curve, _fine_s: FloatArray, t_s: FloatArray) -> FloatArray:
    return curve(t_s)


def _all(readings: FloatArray) -> FloatArray:
    return readings


@dataclass(frozen=True)
class Hidden:
    """What is hidden in a system: a `force` at a `port` with `own` states that begin at zero, another way in which the
    input drives it, in which a sensor reads, or in which readings are written. By default nothing.
    """

    port: str = ""
    force: Force | None = None
    own: int = 0
    driven: Driving = _held
    read: Reading = _as_it_is
    written: Writing = _all


class Acting:
    """What a system asks at its ports while it is integrated."""

    def __init__(self, hidden: Hidden) -> None:
        self._port, self._force = hidden.port, hidden.force
        self.own: Own = ()
        self.own_rates: Own = ()

    def __call__(self, port: str, *signals: float) -> float:
        """Return what is added at a port."""
        if self._force is None or port != self._port:
            return 0.0
        added, self.own_rates = self._force(signals, self.own)
        return added
