"""The libraries of all systems as a page: every effect with its parameters, what it is, and what to do about it."""

import math
from collections.abc import Iterable, Mapping

from discrepancy.simulation import Effect, Parameter

_HEADING = """\
# Effects

What a simulation may leave out, by system: the names that `verdict.json`, `extended.toml`, `--only` and `--without`
take. An effect acts through its parameters alone; "without it" is the value at which the effect does nothing.
"Formula's own error" is how far the effect's formula itself may be off, as a share of the value, measured on
development recordings whose truth is known; intervals include it. Words: [glossary](glossary.md). This page is written
by `gaiteyes explain effects --out docs/effects.md`.
"""


def libraries() -> dict[str, tuple[Effect, ...]]:
    """Return the effects by system, as a recording with a foot, a temperature and a reference has them.

    What a recording itself tells, such as where a search begins, is made up here and not shown.
    """
    from systems.imu import effects as imu
    from systems.platform import effects as platform
    from systems.platform import effects_above as above
    from systems.platform.sensor import CHANNELS
    from systems.wearable import effects as wearable

    steps, largest = {"force_n": 1.0, "torque_nm": 1.0}, dict.fromkeys(CHANNELS, 1.0)
    facts = imu.Facts(1.0, 1.0, pinned=(False, False), lag_s=0.0, lag_rate=0.0, has_temperature=True)
    return {
        "platform": (
            *platform.timing(),
            *platform.amplitudes(steps, largest),
            *platform.geometry(foot=True),
            *above.above_sensor(foot=True),
            *above.sampling(40.0, 0.0),
        ),
        "imu": imu.library(facts),
        "wearable": wearable.library(with_reference=True),
        "own simulation with ports": _ported(),
    }


def _ported() -> tuple[Effect, ...]:
    """Return the generic library at a port that moves, at one with a level, and on an input and two outputs."""
    import numpy as np

    from discrepancy.ports.declared import Port, Signal
    from discrepancy.ports.generic import terms_within
    from discrepancy.ports.ranges import PortSpan, Span, Spans
    from discrepancy.simulation import Channels

    one = Span(-1.0, 1.0, 1.0, 0.1)
    moving = Port("joint", "N", "the joint", (Signal("x", "m", "position"), Signal("v", "m/s", "velocity")))
    filled = Port("tank", "m/s", "the tank", (Signal("h", "m", "level"),))
    steps = np.repeat(np.arange(50.0) % 7.0, 4)
    outputs = ("output_m", "other_V")
    channels = Channels(np.arange(200.0), np.column_stack((steps, steps)), outputs, steps[:, None], ("input_V",))
    whole = Spans(
        (PortSpan(moving, (one, one), 1.0, 1.0), PortSpan(filled, (one,), 1.0, 1.0)),
        {"input_V": one},
        dict.fromkeys(outputs, one),
        1.0,
        1.0,
        200.0,
        dict.fromkeys(outputs, np.sin(np.arange(200.0))),
        jumps=False,
        held=True,
        bent=frozenset(outputs),
        lines=frozenset(),
    )
    return tuple(t.effect for t in terms_within(whole, channels) if not t.effect.name.endswith("_of_other_V"))


def page(by_system: Mapping[str, Iterable[Effect]]) -> str:
    """Return the page as Markdown."""
    parts = [_HEADING]
    for system, effects in by_system.items():
        parts.append(f"## {system}\n")
        parts += [_section(effect) for effect in effects]
    return "\n".join(parts)


def _section(effect: Effect) -> str:
    alike: dict[tuple[str, str, str], list[str]] = {}
    for parameter in effect.parameters:
        neutral = _neutral(parameter, alone=len(effect.parameters) == 1)
        inexact = f"{100.0 * parameter.inexact:g} %" if parameter.inexact else ""
        alike.setdefault((parameter.unit, neutral, inexact), []).append(f"`{parameter.name}`")
    rows = [f"| {', '.join(names)} | {' | '.join(rest)} |" for rest, names in alike.items()]
    return "\n".join(
        (
            f"### `{effect.name}`\n",
            f"{effect.explanation}\n",
            f"- What to do: {effect.remedy}",
            f"- What tells it apart: {effect.experiment}\n",
            "| parameter | unit | without it | formula's own error |",
            "|---|---|---|---|",
            *rows,
            "",
        )
    )


def _neutral(parameter: Parameter, *, alone: bool) -> str:
    """Return the value without the effect; beside others that are then zero or infinite it is of no matter."""
    if math.isinf(parameter.neutral):
        return "∞"
    return f"{parameter.neutral:g}" if alone or parameter.neutral == 0.0 else "no matter"
