"""The noise of a real force plate at rest: `python -m benchmarks.force_plate_noise`.

The model is fitted to the first half of the minute and judged on the second, whose lines are not taken out.
"""

import numpy as np

from impedance.recording.force_noise import ChannelNoise, fit_force_noise
from lab.evaluation.measured.data_folder import data_folder
from lab.evaluation.measured.force_plate import WRENCH, innovation_ratio, resting_plates


def main() -> None:
    t_s, plates = resting_plates(data_folder("force_plate_at_rest"))
    half = len(t_s) // 2
    for plate, wrench in plates.items():
        whole, first = fit_force_noise(t_s, wrench, WRENCH), fit_force_noise(t_s[:half], wrench[:half], WRENCH)
        print(f"{plate}: {len(t_s)} samples at {whole.rate_hz:.2f} Hz")
        for channel in whole.channels:
            print(f"  {described(channel, whole.rate_hz)}")
        pairs = zip(first.channels, wrench[half:].T, strict=True)
        held_out = ", ".join(f"{innovation_ratio(channel, column):.2f}" for channel, column in pairs)
        drawn = whole.generate(len(t_s), np.random.default_rng(1)).std(axis=0) / wrench.std(axis=0)
        for line in whole.lines:
            mains = f", mains {line.mains_hz:g} Hz" if line.mains_hz else ""
            sizes = ", ".join(f"{amplitude:.2f}" for amplitude in line.amplitude)
            print(f"  line at {line.f_hz:.2f} Hz{mains}: {sizes} (N, N m)")
        print(f"  innovations of the held-out half over the model's: {held_out}")
        print(f"  drawn anew, deviation over measured: {', '.join(f'{ratio:.2f}' for ratio in drawn)}")


def described(channel: ChannelNoise, rate_hz: float) -> str:
    unit = "N" if channel.name.startswith("For") else "N m"
    parts = (
        f"offset {channel.offset:+.3f} ± {channel.offset_deviation:.3f} {unit}",
        f"drift {60 * channel.drift_per_s:+.3f} ± {60 * channel.drift_deviation:.3f} {unit}/min",
        f"sample {channel.deviation:.3f}",
        f"mean of 1 s ± {channel.deviation_of_mean(1.0, rate_hz):.3f}",
        f"walk {channel.walk_per_root_s:.4f} {unit}/√s",
        f"order {len(channel.autoregression)}",
    )
    return f"{channel.name}: {', '.join(parts)}"


if __name__ == "__main__":
    main()
