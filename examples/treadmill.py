"""Your own simulation against your own data: why does the force plate under an empty moving belt read a moment?

The simulation says zero. The finder fits on the first half of the trial and is judged on the second, each low-passed by
itself, beside a filter of 31 taps on the belt's speed. R² leaves the mean out, which is a tare.
"""

import argparse
import gzip
import sys
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gaiteyes import (
    Channels,
    Effect,
    FloatArray,
    OwnSimulation,
    Parameter,
    UserError,
    Values,
    explain,
    headline,
    quantity_text,
    write_report,
)

RATE_HZ, CUTOFF_HZ, EVERY, TAPS = 100.0, 6.0, 4, 31
MATTERS_NM = 0.5
EXPERIMENT = "Run the empty belt at steady speeds, then at varying ones."


def number(name: str, unit: str, typical: float) -> Parameter:
    """Return a parameter that is zero without its effect and matters from where it makes half a newton metre.

    `typical` is what the parameter is multiplied with: an acceleration of 2 m/s², a speed of 2 m/s or its square.
    """
    return Parameter(name, unit, 0.0, -1e3, 1e3, MATTERS_NM / typical)


EFFECTS = (
    Effect(
        "belt_acceleration",
        (number("inertia_kgm", "kg·m", 2.0),),
        "Belt and rollers are accelerated on top of the force plate, which measures the reaction.",
        "Subtract the inertia times the belt's acceleration.",
        EXPERIMENT,
    ),
    Effect(
        "roller_imbalance",
        (
            number("cosine_kg", "kg", 4.0),  # with the sine: how large, and where it was when the trial began
            number("sine_kg", "kg", 4.0),
            Parameter("circumference_m", "m", 0.632, 0.627, 0.637, 1e-4),
        ),
        "A roller is out of balance: it pulls once a turn, with the square of the belt's speed.",
        "Balance the roller, or subtract what turns with it.",
        EXPERIMENT,
        # A tape tells the circumference to ± 3 mm; over hundreds of metres of belt a fit reaches half a millimetre.
        starts=tuple({"circumference_m": length} for length in np.arange(0.6290, 0.6355, 0.0005).tolist()),
    ),
    Effect(
        "belt_speed",
        (number("friction_ns", "N·s", 2.0),),
        "Friction under the belt grows with its speed.",
        "Clean and lubricate the deck.",
        EXPERIMENT,
    ),
    Effect(
        "offset",
        (number("moment_nm", "N·m", 1.0),),
        "The plate was not at rest when it was tared.",
        "Tare again.",
        EXPERIMENT,
    ),
)


def low_passed(values: FloatArray) -> FloatArray:
    """Return `values` (n,) below 6 Hz, not delayed."""
    return np.asarray(sosfiltfilt(butter(2, CUTOFF_HZ, fs=RATE_HZ, output="sos"), values))


def simulation(trial: FloatArray, part: slice) -> OwnSimulation:
    """Return the simulation of a part of a trial (n, 3: time, moment, speed): no moment, but for the effects."""
    travel_m = np.cumsum(trial[:, 2])[part] / RATE_HZ
    raw_mps = trial[part, 2]
    speed_mps = low_passed(raw_mps)
    acceleration_mps2 = np.gradient(speed_mps, 1.0 / RATE_HZ)

    def moment(values: Values) -> FloatArray:
        found = values["belt_acceleration.inertia_kgm"] * acceleration_mps2
        found += values["belt_speed.friction_ns"] * speed_mps + values["offset.moment_nm"]
        cosine, sine = values["roller_imbalance.cosine_kg"], values["roller_imbalance.sine_kg"]
        if cosine or sine:
            turn = 2.0 * np.pi / values["roller_imbalance.circumference_m"] * travel_m
            found += low_passed(raw_mps**2 * (cosine * np.cos(turn) + sine * np.sin(turn)))
        return found[::EVERY, None]

    channels = Channels(
        t_s=np.arange(len(trial))[part][::EVERY] / RATE_HZ,
        values=low_passed(trial[part, 1])[::EVERY, None],
        names=("pitch_moment_nm",),
        inputs=np.column_stack((speed_mps, acceleration_mps2))[::EVERY],
        input_names=("speed_mps", "acceleration_mps2"),
    )
    return OwnSimulation("treadmill", channels, moment, EFFECTS)


def r2(measured: FloatArray, predicted: FloatArray) -> float:
    """Return the explained share of the variance."""
    return float(1.0 - np.var(measured - predicted) / np.var(measured))


def taps_r2(trial: FloatArray, fit: slice, judged: slice) -> float:
    """Return R² of the best linear filter of the belt's speed, 31 taps around each sample and a constant."""
    sides = []
    for part in (fit, judged):
        padded = np.pad(low_passed(trial[part, 2]), TAPS // 2, mode="edge")
        lags = np.lib.stride_tricks.sliding_window_view(padded, TAPS)
        sides.append((np.column_stack((lags, np.ones(len(lags)))), low_passed(trial[part, 1])))
    (lags, moment), (lags_judged, moment_judged) = sides
    weights = np.linalg.lstsq(lags, moment, rcond=None)[0]
    return r2(moment_judged, lags_judged @ weights)


def main() -> None:
    """Read the trial, explain it, and print what each cause alone is worth."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("trial", type=Path, help="gzipped text of time, moment and belt speed, as RandomFastSpeed1")
    arguments.add_argument("--out", type=Path, help="folder for report.html and its fellows")
    options = arguments.parse_args()
    try:
        with gzip.open(options.trial, "rt") as file:
            trial = np.genfromtxt(file, skip_header=1)
    except (OSError, EOFError, ValueError) as error:
        arguments.exit(2, f"{options.trial}: {error}\n")
    first, second = slice(0, len(trial) // 2), slice(len(trial) // 2, len(trial))
    fit, judged = simulation(trial, first), simulation(trial, second)
    found = explain(fit, judged, seed=1)
    print(headline(found.verdict))
    for cause in found.verdict.causes:
        for name, quantity in cause.parameters.items():
            print(f"  {cause.name}.{name}: {' | '.join(quantity_text(quantity))}")
    measured = judged.channels.values
    print(f"R² all named causes {r2(measured, found.held_out.extended):.4f}")
    for names in (*((effect.name,) for effect in EFFECTS), ("belt_acceleration", "roller_imbalance")):
        alone = explain(fit, judged, seed=1, only=names)
        print(f"R² {' + '.join(names)} {r2(measured, alone.held_out.extended):.4f}")
    print(f"R² {TAPS}-tap filter {taps_r2(trial, first, second):.4f}")
    if options.out is not None:
        write_report(found, options.out, files=[options.trial])


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
