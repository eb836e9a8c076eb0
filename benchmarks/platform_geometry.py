"""What the platform's identification owes to the joint, and what an error of geometry does to it.

    python -m benchmarks.platform_geometry [--seed 1000]

One run of 60 s of the bare plate and one with the foot, with the thesis's noise and instruments that are exact. The
joint's height is then stated a millimetre too large, the weighed mass is left out, and the joint is not used.
"""

import argparse
from dataclasses import replace

import msgspec
import numpy as np

from impedance.identification.identification import Identification, identify
from impedance.identification.observability import NAMES
from impedance.recording.recording import PlatformRecording
from sim_rig.platform.rig import FOOT, PLATE, Rig
from sim_rig.platform.run import RunSettings, measured, simulate

SHOWN = ("y0", "Jxx", "Jyy", "Jzz")
_TO_SHOWN = {"y0": (1e3, "mm"), "Jxx": (1e3, "g m²"), "Jyy": (1e3, "g m²"), "Jzz": (1e3, "g m²")}
ERROR_M = 1e-3


def restated(recording: PlatformRecording, joint_to_surface_m: float) -> PlatformRecording:
    """Return the recording with another stated height of the plate's surface above the joint."""
    plate = msgspec.structs.replace(recording.settings.plate, joint_to_surface_m=joint_to_surface_m)
    return replace(recording, settings=msgspec.structs.replace(recording.settings, plate=plate))


def half_interval(found: Identification, k: int) -> float:
    """Return half of the 95 % interval of one parameter."""
    lowest, highest = found.interval[k]
    return float(highest - lowest) / 2.0


def row(found: Identification) -> str:
    """Return estimates with half of their 95 % intervals."""
    cells = []
    for name in SHOWN:
        scale, unit = _TO_SHOWN[name]
        k = NAMES.index(name)
        cells.append(f"{name} {scale * found.estimate[k]:.3f} ± {scale * half_interval(found, k):.3f} {unit}")
    return ", ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1000)
    seed: int = parser.parse_args().seed
    plate = measured(simulate(RunSettings(), seed), seed=seed).exact
    height_m = plate.settings.plate.joint_to_surface_m
    plain, off = identify(plate, joint=True), identify(restated(plate, height_m + ERROR_M), joint=True)
    print(f"plate, on the joint               {row(plain)}")
    print(f"  stated mass not used            {row(identify(plate, joint=True, weighed=False))}")
    print(f"  joint stated 1 mm lower         {row(off)}")
    print(f"plate, joint not used             {row(identify(plate, joint=False))}")
    height_mm, deviation_mm = 1e3 * plain.test.seen_m[1], 1e3 * plain.test.seen_deviation_m[1]
    print(f"the markers see the joint {height_mm:.2f} mm below the surface (1 σ {deviation_mm:.3f} mm)")
    with_foot = simulate(RunSettings(rig=Rig(foot=FOOT)), seed)
    foot = identify(measured(with_foot, seed=seed, plate=PLATE).exact, joint=True)
    for found in (plain, foot):
        k = NAMES.index("Jyy")
        values = found.observability.singular_values
        share = half_interval(found, k) / found.estimate[k]
        print(
            f"{found.what}: least over greatest singular value {np.min(values) / np.max(values):.4f}, Jyy ± {share:.2%}"
        )


if __name__ == "__main__":
    main()
