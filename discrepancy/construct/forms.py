"""The forms that a constructed term may take: what follows from one signal, or two, at a port.

A term is a sum of amounts times basis functions,

    f = Σ_i a_i φ_i(x; s)                                                                                          (1)

with one shape parameter s at most, such as a spatial frequency or a threshold. A form with a memory takes in x's place
a state z that begins at zero and follows it: by a lag, ż = (x − z) / s; behind a play of half width s, which it leaves
no further than that; or, of a velocity, as the friction of Dahl (1968) does, ż = (x − |x| z) / s, between ±1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from messages.arrays import FloatArray

WIDTH_SHARE = 0.02
"""Of a signal's root mean square: the width over which a smoothed sign changes."""
_LEAST = 1e-30
"""In place of a divisor that may be zero."""

Memory = Literal["lag", "play", "hysteresis"]
Basis = Callable[[tuple[FloatArray, ...], FloatArray, float], tuple[FloatArray, ...]]
"""Basis functions of (1) from signals, the shape parameter and the width of a smoothed sign."""


@dataclass(frozen=True)
class Shape:
    """The shape parameter of a form: its name, the power of the signal's unit that its unit is, and where it begins.

    `starts` are in units of the signal's reach, the greatest magnitude it has, or, if `of_span`, of its span beyond its
    least value; of a frequency in half turns over the span; of a time in shares of the recording's length.
    """

    name: str
    kind: Literal["level", "place", "frequency", "time"]
    starts: tuple[float, ...]


@dataclass(frozen=True)
class Form:
    """A form of (1). `powers` are those of each signal's unit by which an amount's unit is divided, one row an amount.

    `symbols` are the basis functions with {x}, {y}, {s} and {w} for signals, shape parameter and width; `words` says
    what the term is in words, with {x} and {y}. `width` tells that it has a smoothed sign, `one_signed` that it is of a
    signal that keeps its sign, as an absolute temperature does: its origin, {o}, is handed over behind it.
    """

    name: str
    amounts: tuple[str, ...]
    powers: tuple[tuple[float, ...], ...]
    basis: Basis
    symbols: tuple[str, ...]
    words: str
    shape: Shape | None = None
    memory: Memory | None = None
    width: bool = False
    one_signed: bool = False

    @property
    def arity(self) -> int:
        """Return how many signals it takes."""
        return len(self.powers[0])


def _level(starts: tuple[float, ...]) -> Shape:
    return Shape("threshold", "level", starts)


def _one(name: str, power: float, basis: Callable[[FloatArray], FloatArray], symbol: str, words: str) -> Form:
    return Form(name, ("amount",), ((power,),), lambda x, _s, _w: (basis(x[0]),), (symbol,), words)


def _shaped(
    name: str,
    power: float,
    basis: Callable[[FloatArray, FloatArray], FloatArray],
    symbol: str,
    words: str,
    shape: Shape,
) -> Form:
    return Form(name, ("amount",), ((power,),), lambda x, s, _w: (basis(x[0], s),), (symbol,), words, shape)


def _remembered(memory: Memory, symbol: str, words: str, shape: Shape, power: float) -> Form:
    return Form(memory, ("amount",), ((power,),), lambda x, _s, _w: (x[0],), (symbol,), words, shape, memory)


def _smooth_sign(x: FloatArray, width: float) -> FloatArray:
    return np.asarray(np.tanh(x / width))


def _offset(name: str, power: int, symbol: str, words: str) -> Form:
    return Form(
        name,
        ("amount", "constant"),
        ((float(power),), (0.0,)),
        lambda x, _s, _w: (x[0] ** power - x[1] ** power, np.ones(1)),
        (f"({symbol} − {symbol.replace('x', 'o')})", "1"),
        f"{words} less what it was in the beginning, beside a constant",
        one_signed=True,
    )


_FREQUENCIES = tuple(0.75 * k for k in range(1, 49))
"""Half turns over a signal's span: neighbours correlate, so that no frequency between two is missed."""
_SHORT = (0.01, 0.03, 0.1, 0.3)
_LEVELS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75)
_PLACES = tuple(0.1 * k for k in range(1, 10))
_TIMES = (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1)

_FORMS: tuple[Form, ...] = (
    Form("constant", ("amount",), ((),), lambda _x, _s, _w: (np.ones(1),), ("1",), "a constant"),
    _one("linear", 1.0, lambda x: x, "{x}", "proportional to {x}"),
    _one("square", 2.0, lambda x: x**2, "{x}²", "the square of {x}"),
    _one(
        "signed_three_halves",
        1.5,
        lambda x: np.copysign(np.abs(x) ** 1.5, x),
        "sign({x})·|{x}|^1.5",
        "the power of three halves of {x}, with its sign",
    ),
    _one("signed_square", 2.0, lambda x: np.abs(x) * x, "|{x}|·{x}", "the square of {x}, with its sign"),
    _one("cube", 3.0, lambda x: x**3, "{x}³", "the cube of {x}"),
    _one("fourth_power", 4.0, lambda x: x**4, "{x}⁴", "the fourth power of {x}"),
    _one(
        "signed_root",
        0.5,
        lambda x: np.copysign(np.sqrt(np.abs(x)), x),
        "sign({x})·√|{x}|",
        "the root of {x}, with its sign",
    ),
    _offset("square_offset", 2, "{x}²", "the square of {x}"),
    _offset("cube_offset", 3, "{x}³", "the cube of {x}"),
    _offset("fourth_power_offset", 4, "{x}⁴", "the fourth power of {x}"),
    _one("magnitude", 1.0, np.abs, "|{x}|", "the magnitude of {x}"),
    Form(
        "sign",
        ("amount",),
        ((0.0,),),
        lambda x, _s, w: (_smooth_sign(x[0], w),),
        ("tanh({x}/{w})",),
        "the sign of {x}, smoothed over {w}",
        width=True,
    ),
    Form(
        "stribeck",
        ("level", "peak"),
        ((0.0,), (0.0,)),
        lambda x, s, w: (
            _smooth_sign(x[0], w),
            _smooth_sign(x[0], w) * np.exp(-((x[0] / np.maximum(s, _LEAST)) ** 2)),
        ),
        ("tanh({x}/{w})", "tanh({x}/{w})·exp(−({x}/{s})²)"),
        "the sign of {x}, smoothed over {w}, with a peak where {x} is small",
        shape=Shape("fades_over", "level", (0.03, 0.1, 0.3)),
        width=True,
    ),
    Form(
        "wave",
        ("sine", "cosine"),
        ((0.0,), (0.0,)),
        lambda x, s, _w: (np.sin(s * x[0]), np.cos(s * x[0])),
        ("sin({s}·{x})", "cos({s}·{x})"),
        "a wave over {x}",
        shape=Shape("per_unit", "frequency", _FREQUENCIES),
    ),
    _shaped(
        "dead_band",
        1.0,
        lambda x, s: x - np.clip(x, -s, s),
        "({x} − clip({x}, ±{s}))",
        "proportional to {x} beyond a threshold on either side",
        _level(_LEVELS),
    ),
    _shaped(
        "above",
        1.0,
        lambda x, s: np.maximum(x - s, 0.0),
        "max({x} − {s}, 0)",
        "proportional to {x} above a threshold",
        Shape("threshold", "place", _PLACES),
    ),
    _shaped(
        "above_square",
        2.0,
        lambda x, s: np.maximum(x - s, 0.0) ** 2,
        "max({x} − {s}, 0)²",
        "the square of what {x} is above a threshold",
        Shape("threshold", "place", _PLACES),
    ),
    _shaped(
        "below",
        1.0,
        lambda x, s: np.minimum(x - s, 0.0),
        "min({x} − {s}, 0)",
        "proportional to {x} below a threshold",
        Shape("threshold", "place", tuple(1.0 - each for each in _PLACES)),
    ),
    _remembered("lag", "lag({x}, {s})", "{x} as it was, through a lag", Shape("lag", "time", _TIMES), 1.0),
    _remembered("play", "play({x}, ±{s})", "{x} behind a play", Shape("half_width", "level", _SHORT), 1.0),
    _remembered(
        "hysteresis",
        "hysteresis({x}, {s})",
        "a hysteresis that turns round as {x} does",
        Shape("turns_over", "level", _SHORT),
        0.0,
    ),
    Form(
        "product",
        ("amount",),
        ((1.0, 1.0),),
        lambda x, _s, _w: (x[0] * x[1],),
        ("{x}·{y}",),
        "the product of {x} and {y}",
    ),
    Form(
        "product_of_magnitude",
        ("amount",),
        ((1.0, 1.0),),
        lambda x, _s, _w: (np.abs(x[0]) * x[1],),
        ("|{x}|·{y}",),
        "the product of {y} and the magnitude of {x}",
    ),
    Form(
        "product_of_square",
        ("amount",),
        ((2.0, 1.0),),
        lambda x, _s, _w: (x[0] ** 2 * x[1],),
        ("{x}²·{y}",),
        "the product of {y} and the square of {x}",
    ),
)
FORMS: Final = {form.name: form for form in _FORMS}


LEARNED: Final = "curve"
"""The form of a learned term."""
PIECES: Final = 12
"""Cubic B-splines of a learned curve."""


def curve(low: float, high: float) -> Form:
    """Return the form of a learned curve: cubic B-splines on even knots from `low` to `high`, level beyond."""
    width = (high - low) / (PIECES - 3)

    def basis(x: tuple[FloatArray, ...], _shape: FloatArray, _width: float) -> tuple[FloatArray, ...]:
        place = (np.clip(x[0], low, high) - low) / width
        out = []
        for i in range(PIECES):
            away = np.abs(place - (i - 1))
            near, far = np.maximum(2.0 - away, 0.0), np.maximum(1.0 - away, 0.0)
            out.append((near**3 - 4.0 * far**3) / 6.0)
        return tuple(out)

    names = tuple(f"at_{i}" for i in range(1, PIECES + 1))
    symbols = tuple(f"B{i}({{x}})" for i in range(1, PIECES + 1))
    return Form(LEARNED, names, ((0.0,),) * PIECES, basis, symbols, "a smooth curve over {x}, learned from the data")


def form_of(name: str, low: float, high: float) -> Form:
    """Return a form by its name, a learned curve between `low` and `high`; raises KeyError for another name."""
    return curve(low, high) if name == LEARNED else FORMS[name]


def memory_rate(memory: Memory, z: FloatArray, x: FloatArray, shape: FloatArray, follow_s: float) -> FloatArray:
    """Return the rate of the state z of a form with a memory, `follow_s` being the time in which a play takes up what
    leaves it; of a hysteresis `x` is the velocity.
    """
    size = np.maximum(np.abs(shape), _LEAST)
    if memory == "lag":
        return np.asarray((x - z) / size)
    if memory == "play":
        return np.asarray((np.clip(z, x - size, x + size) - z) / follow_s)
    return np.asarray((x - np.abs(x) * z) / size)
