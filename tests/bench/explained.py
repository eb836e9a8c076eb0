"""A toy system, and what was found on it, written by hand: for whatever shows, writes or loads an explanation."""

from dataclasses import dataclass

import numpy as np

from discrepancy.explanation import Adequacy, Evidence, Explanation, Misfit, Spectrum, View
from discrepancy.simulation import Channels, Effect, Parameter, Values
from discrepancy.values import predicted
from discrepancy.verdict import Cause, Gain, Quantity, Remainder, Signature, Verdict
from messages.arrays import FloatArray

RATE_HZ = 100.0
NAMES = ("fx_n", "tz_nm")
DELAY = Effect(
    "force_delay",
    (Parameter("value_s", "s", 0.0, -0.05, 0.05, 1e-4),),
    "The force plate's samples arrive late.",
    "Shift the force channel back.",
    "Tap the plate once: the blow must be seen by both at the same time.",
)
OFFSET = Effect(
    "tare_error",
    (Parameter("fx_n", "N", 0.0, -50.0, 50.0, 0.1), Parameter("tz_nm", "N·m", 0.0, -50.0, 50.0, 0.1)),
    "The plate was not at rest when it was tared.",
    "Tare again.",
    "Let it stand still for a minute.",
)
MASS = Parameter("mass_kg", "kg", 2.0, 0.1, 10.0, 0.01)


@dataclass(frozen=True)
class Toy:
    """A mass that is shaken: fx = m a and tz = 0.3 m a, seen late, with an offset."""

    channels: Channels
    system: str = "toy"
    parameters: tuple[Parameter, ...] = (MASS,)
    effects: tuple[Effect, ...] = (DELAY, OFFSET)

    def predicted(self, values: Values) -> FloatArray:
        """Return force and moment, (n, 2)."""
        t_s, acceleration = self.channels.t_s, self.channels.inputs[:, 0]
        late = np.interp(t_s - values["force_delay.value_s"], t_s, acceleration)
        force = values["mass_kg"] * late
        offsets = np.array([values[f"tare_error.{name}"] for name in NAMES])
        return np.asarray(np.column_stack((force, 0.3 * force)) + offsets, dtype=np.float64)


def toy(seed: int, seconds: float = 20.0) -> Toy:
    """Return a recording with a delay of 4 ms, a mass of 2.2 kg and white noise."""
    random = np.random.default_rng(seed)
    t_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    acceleration = sum(np.sin(2.0 * np.pi * f_hz * t_s + random.uniform(0.0, 6.0)) for f_hz in (0.7, 2.1, 4.3))
    empty = Toy(Channels(t_s, np.zeros((len(t_s), 2)), NAMES, np.column_stack((acceleration,)), ("a_mps2",)))
    measured = predicted(empty, TRUE) + 0.05 * random.standard_normal((len(t_s), 2))
    measured[100:105, 1] = np.nan
    return Toy(Channels(t_s, measured, NAMES, empty.channels.inputs, ("a_mps2",)))


TRUE = {"mass_kg": 2.2, "force_delay.value_s": 0.004}


def explanation(held_out: Toy, *, named: bool = True) -> Explanation:
    """Return what a finder would tell: the delay, with the offset as a look-alike; or an unknown cause."""
    before, after = {"mass_kg": 2.19}, dict(TRUE) if named else {"mass_kg": 2.19}
    base, extended = predicted(held_out, before), predicted(held_out, after)
    view = View(held_out.channels, base, extended, _spectrum(held_out.channels.values, base, extended))
    delay = Quantity(0.004, 0.0039, 0.0041, "s")
    cause = Cause(
        "force_delay",
        {"value_s": delay},
        {"chi2": 812.0, "parameters": 1.0, "threshold": 11.2, "chance": 0.002, "rival_chi2": None},
        ["tare_error"],
    )
    signature = Signature(["fx_n"], (1.0, 5.0), (3.0, 9.0))
    verdict = Verdict(
        "toy",
        "named" if named else "unknown",
        [cause] if named else [],
        Remainder(not named, 0.01 if named else 0.9, signature),
        Gain(0.08, 0.02, 0.018, 0.98) if named else Gain(0.08, 0.08, 0.018, 0.0),
        {"mass_kg": Quantity(2.19, 2.18, 2.2, "kg")},
        {"mass_kg": Quantity(after["mass_kg"], 2.195, 2.205, "kg")},
        DELAY.experiment if named else None,
    )
    good = Adequacy(True, 0.4, np.zeros(2), np.full(2, np.nan), np.array([0.02, 0.03]), np.zeros(2), ())
    bad = Adequacy(False, 0.005, np.array([0.4, 0.1]), np.ones(2), np.ones(2), np.zeros(2), ("fx follows a_mps2",))
    return Explanation(
        verdict=verdict,
        fit=view,
        held_out=view,
        held_out_is_own=False,
        evidence=(
            Evidence(
                "force_delay", ("value_s",), 812.0, 11.2, 0.002, True, "accepted", {"value_s": 0.004}, ("s",), 3990.0
            ),
            Evidence("tare_error", ("fx_n",), 3.0, 11.2, 0.9, False, "rejected", {"fx_n": 0.01}, ("N",), 4799.0),
        ),
        misfit=Misfit(4802.0, 3990.0, 4000),
        before=bad,
        after=good if named else bad,
        values_before=before,
        values_after=after,
        quantities_after={"force_delay.value_s": delay} if named else {},
        causes=(DELAY,) if named else (),
        rivals={"tare_error": OFFSET} if named else {},
        notes=("Five samples are missing <in tz>.",),
        seed=7,
    )


def _spectrum(measured: FloatArray, base: FloatArray, extended: FloatArray) -> Spectrum:
    count = 128
    f_hz = np.arange(count // 2 + 1) * RATE_HZ / count

    def density(residual: FloatArray) -> FloatArray:
        segments = np.nan_to_num(residual)[: len(residual) // count * count].reshape(-1, count, residual.shape[1])
        power = np.abs(np.fft.rfft(segments, axis=1)) ** 2
        return np.asarray(2.0 * power.mean(axis=0) / (count * RATE_HZ), dtype=np.float64)

    noise = np.full((len(f_hz), measured.shape[1]), 2.0 * 0.05**2 / RATE_HZ)
    return Spectrum(f_hz, density(measured - base), density(measured - extended), noise, np.zeros_like(noise))
