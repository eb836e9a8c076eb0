"""What may be hidden in the five systems, by formulas of their own.

The parameters of those that a library may name are counted as a verdict tells them.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from lab.hidden.five.acting import Curve, Drive, Force, Hidden, Own
from messages.arrays import FloatArray

Told = Mapping[str, float]
Makes = Callable[[Told], Hidden]
"""From the constants that were drawn: what is hidden."""
_STICK = 1e-3
"""Of a unit of velocity: within it dry friction changes its sign, so that steps meet it."""


def at(port: str, force: Callable[[Told], Force], own: int = 0) -> Makes:
    """Return what acts at a port."""
    return lambda p: Hidden(port=port, force=force(p), own=own)


def plain(formula: Callable[[Sequence[float], Told], float]) -> Callable[[Told], Force]:
    """Return a force without states of its own."""

    def force(p: Told) -> Force:
        return lambda signals, _own: (formula(signals, p), ())

    return force


def _sign(v: float) -> float:
    return math.tanh(v / _STICK)


def coulomb(v: int) -> Callable[[Told], Force]:
    """Dry friction: a constant force against the motion."""
    return plain(lambda s, p: -p["value"] * _sign(s[v]))


def stribeck(v: int) -> Callable[[Told], Force]:
    """Dry friction that fades with speed."""
    return plain(lambda s, p: -p["value"] * _sign(s[v]) * math.exp(-abs(s[v]) / p["fades_at"]))


def drag(v: int) -> Callable[[Told], Force]:
    """Drag with the square of speed."""
    return plain(lambda s, p: -p["value"] * abs(s[v]) * s[v])


def hysteresis(v: int) -> Callable[[Told], Force]:
    """ż = (v − ½ |v| z − ½ v |z|) / x₀, a force of −F z."""

    def force(p: Told) -> Force:
        def acting(s: Sequence[float], own: Own) -> tuple[float, Own]:
            z = own[0]
            return -p["value"] * z, ((s[v] - 0.5 * (abs(s[v]) * z + s[v] * abs(z))) / p["within"],)

        return acting

    return force


def cubic_spring(x: int) -> Callable[[Told], Force]:
    """A spring that hardens."""
    return plain(lambda s, p: -p["value"] * s[x] ** 3)


def dead_band_spring(x: int) -> Callable[[Told], Force]:
    """A spring beyond a free play."""
    return plain(lambda s, p: -p["value"] * (s[x] - min(max(s[x], -p["gap"]), p["gap"])))


def upper_stop(x: int) -> Callable[[Told], Force]:
    """A stop above, or an overflow."""
    return plain(lambda s, p: -p["stiffness"] * max(s[x] - p["limit"], 0.0))


def lower_stop(x: int) -> Callable[[Told], Force]:
    """A stop below."""
    return plain(lambda s, p: p["stiffness"] * max(p["limit"] - s[x], 0.0))


def cogging(x: int) -> Callable[[Told], Force]:
    """A wave over the position."""

    def formula(s: Sequence[float], p: Told) -> float:
        angle = 2.0 * math.pi * p["periods"] * s[x]
        return p["sine"] * math.sin(angle) + p["cosine"] * math.cos(angle)

    return plain(formula)


def leak(x: int) -> Callable[[Told], Force]:
    """A loss with the level."""
    return plain(lambda s, p: -p["value"] * s[x])


def constant() -> Callable[[Told], Force]:
    """A constant."""
    return plain(lambda _s, p: p["value"])


def driven(change: Callable[[FloatArray, Told], FloatArray]) -> Makes:
    """Return a change of the input's held samples (n,)."""

    def makes(p: Told) -> Hidden:
        def driving(drive: Drive, t_s: FloatArray, steps: int) -> FloatArray:
            return np.repeat(change(drive(t_s), p)[:, None], steps, axis=1)

        return Hidden(driven=driving)

    return makes


def driven_late(p: Told) -> Hidden:
    """An input, held from sample to sample, that comes `value` s late: its mean over each step."""

    def driving(drive: Drive, t_s: FloatArray, steps: int) -> FloatArray:
        step_s = t_s[1] - t_s[0]
        held = drive(t_s)
        before = math.ceil(p["value"] / step_s)
        edges_s = step_s * np.arange(-before, len(t_s) + 1)
        whole = np.concatenate(([0.0], np.cumsum(np.concatenate((np.full(before, held[0]), held)) * step_s)))
        times_s = np.arange(len(t_s) * steps + 1) * (step_s / steps) - p["value"]
        driven = np.diff(np.interp(times_s, edges_s, whole)) / (step_s / steps)
        return np.asarray(driven).reshape(-1, steps)

    return Hidden(driven=driving)


def driven_slowly(p: Told) -> Hidden:
    """An input that is followed with a time constant of `value` s."""

    def driving(drive: Drive, t_s: FloatArray, steps: int) -> FloatArray:
        held = np.repeat(drive(t_s), steps)
        step = float(t_s[1] - t_s[0]) / steps / p["value"]
        begun = _follow(held, step)
        return np.asarray(held + (begun - held) * (-math.expm1(-step) / step)).reshape(-1, steps)

    return Hidden(driven=driving)


def _follow(held: FloatArray, step: float) -> FloatArray:
    """What follows an input (n,) held for steps of `step` time constants, at the beginning of each."""
    kept = math.exp(-step)
    return np.asarray(lfilter([0.0, 1.0 - kept], [1.0, -kept], held, zi=[held[0]])[0])


def play(x: FloatArray, p: Told) -> FloatArray:
    """What follows x (n,) with play of `width`."""
    half, now = 0.5 * p["width"], float(x[0])
    out = np.empty_like(x)
    for k, each in enumerate(x.tolist()):
        now = max(min(now, each + half), each - half)
        out[k] = now
    return out


def saturation(x: FloatArray, p: Told) -> FloatArray:
    """A limit above, or below."""
    return np.clip(x, p.get("lower", -np.inf), p.get("upper", np.inf))


def dead_band(x: FloatArray, p: Told) -> FloatArray:
    """What ignores small inputs."""
    return np.sign(x) * np.maximum(np.abs(x) - p["half_width"], 0.0)


def offset(x: FloatArray, p: Told) -> FloatArray:
    """Another zero."""
    return x + p["value"]


def gain(x: FloatArray, p: Told) -> FloatArray:
    """Another scale."""
    return x * (1.0 + p["share"])


def read(channel: int, change: Callable[[FloatArray, Told], FloatArray]) -> Makes:
    """Return a change of one reading's samples (n,)."""

    def makes(p: Told) -> Hidden:
        def reading(curve: Curve, _fine_s: FloatArray, t_s: FloatArray) -> FloatArray:
            out = np.array(curve(t_s))
            out[:, channel] = change(out[:, channel], p)
            return out

        return Hidden(read=reading)

    return makes


def read_with_time(channel: int, change: Callable[[Curve, FloatArray, Told], FloatArray]) -> Makes:
    """Return a change of one reading that hangs on time: of all true readings, at times (n,)."""

    def makes(p: Told) -> Hidden:
        def reading(curve: Curve, _fine_s: FloatArray, t_s: FloatArray) -> FloatArray:
            out = np.array(curve(t_s))
            out[:, channel] = change(curve, t_s, p)[:, channel]
            return out

        return Hidden(read=reading)

    return makes


def late(curve: Curve, t_s: FloatArray, p: Told) -> FloatArray:
    """Readings `value` s late."""
    return curve(np.maximum(t_s - p["value"], 0.0))


def slow_clock(curve: Curve, t_s: FloatArray, p: Told) -> FloatArray:
    """Readings of a clock that is slow by `rate`."""
    return curve(t_s * (1.0 - p["rate"]))


def drift(curve: Curve, t_s: FloatArray, p: Told) -> FloatArray:
    """A zero that drifts by `rate` a second."""
    return np.asarray(curve(t_s) + (p["rate"] * t_s)[:, None])


def tone(curve: Curve, t_s: FloatArray, p: Told) -> FloatArray:
    """A hum."""
    phase = 2.0 * np.pi * p["hz"] * t_s
    return np.asarray(curve(t_s) + (p["sine"] * np.sin(phase) + p["cosine"] * np.cos(phase))[:, None])


def read_slowly(channel: int) -> Makes:
    """A reading that follows with a time constant of `value` s."""

    def makes(p: Told) -> Hidden:
        def reading(curve: Curve, fine_s: FloatArray, t_s: FloatArray) -> FloatArray:
            out, true = np.array(curve(t_s)), curve(fine_s)[:, channel]
            middle = np.append(0.5 * (true[1:] + true[:-1]), true[-1])
            slow = _follow(middle, float(fine_s[1] - fine_s[0]) / p["value"])
            out[:, channel] = slow[:: len(fine_s) // len(t_s)]
            return out

        return Hidden(read=reading)

    return makes


def coupled(channel: int, other: int, key: str) -> Makes:
    """A reading that holds a share of another one."""

    def makes(p: Told) -> Hidden:
        def reading(curve: Curve, _fine_s: FloatArray, t_s: FloatArray) -> FloatArray:
            out = np.array(curve(t_s))
            out[:, channel] += p[key] * out[:, other]
            return out

        return Hidden(read=reading)

    return makes


def rounded(channel: int) -> Makes:
    """Readings written in whole steps."""

    def makes(p: Told) -> Hidden:
        def writing(readings: FloatArray) -> FloatArray:
            out = np.array(readings)
            out[:, channel] = np.round(out[:, channel] / p["step"]) * p["step"]
            return out

        return Hidden(written=writing)

    return makes
