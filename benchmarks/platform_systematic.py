"""Do the platform's intervals hold what a laboratory does not know? Errors of instruments, singly and together.

    python -m benchmarks.platform_systematic [--draws 40] [--seed 1000] [--seconds 60] [--only NAME] [--json FILE]

One run of the bare plate and one with the foot at 40 Hz, the thesis's noise anew for each draw. Each error has the size
that is told and a sign or direction that is drawn: all six gains, all thirty crosstalks (0.25 m between forces and
moments), the force plate's axes about a drawn direction, the joint in a drawn direction from where it is stated. Both
runs have the same errors; the plate is weighed by the fx channel. The foot is identified with the plate's run. What is
stated is what a recording states by default, and where the case says so the foot's mass, or that another scale weighed
the plate; a run whose misfit refutes it is refused, and counted. Each of the ten
95 % intervals must hold in nine of ten draws.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from cli.console import console, table, write_json
from cli.progress import progress
from impedance.body import geometry
from impedance.body.rigid_body import Inertia
from impedance.identification.considered import wrench_matrices
from impedance.identification.identification import identify
from impedance.identification.observability import NAMES, about_cog
from impedance.recording.recording import PlatformRecording, Poses
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError
from sim_rig.platform.rig import FOOT, PLATE, Rig
from sim_rig.platform.run import RunSettings, SimulatedRun, bare_plate_tare, measured, simulate

MOMENT_PER_FORCE_M = 0.25


@dataclass(frozen=True)
class Sizes:
    """How large the errors are; zero leaves one out. The foot is a `known_weight` of ± 5 g; `other_scale` weighed the
    plate to 0.1 %."""

    gain: float = 0.0
    crosstalk: float = 0.0
    delay_s: float = 0.0
    joint_m: float = 0.0
    axes_rad: float = 0.0
    common_gain: float = 0.0
    known_weight: bool = False
    other_scale: bool = False


CASES = {
    "none": Sizes(),
    "gain 0.5 %": Sizes(gain=0.005),
    "gain +0.5 %, all alike": Sizes(common_gain=0.005),
    "crosstalk 0.5 %": Sizes(crosstalk=0.005),
    "delay 0.3 ms": Sizes(delay_s=3e-4),
    "joint 3 mm": Sizes(joint_m=3e-3),
    "axes 0.3°": Sizes(axes_rad=float(np.deg2rad(0.3))),
    "all together": Sizes(0.005, 0.005, 3e-4, 3e-3, float(np.deg2rad(0.3))),
    "gain 5 %": Sizes(gain=0.05),
    "gain +5 %, all alike": Sizes(common_gain=0.05),
    "gain +5 %, all alike, a known weight": Sizes(common_gain=0.05, known_weight=True),
    "gain +5 %, all alike, another scale": Sizes(common_gain=0.05, other_scale=True),
    "gain 5 %, a known weight": Sizes(gain=0.05, known_weight=True),
    "gain 0.5 %, a known weight": Sizes(gain=0.005, known_weight=True),
    "delay 5 ms": Sizes(delay_s=5e-3),
    "joint 20 mm": Sizes(joint_m=0.02),
}


@dataclass(frozen=True)
class Drawn:
    """One laboratory's errors: `matrix` (6, 6) on the tared wrench, delay, P's origin `beside_m` (3,), scale's gain."""

    matrix: FloatArray
    delay_s: float
    beside_m: FloatArray
    weighing: float
    sizes: Sizes

    @classmethod
    def of(cls, sizes: Sizes, rng: np.random.Generator) -> "Drawn":
        """Draw signs and directions."""
        signs = rng.choice((-1.0, 1.0), 36)
        axis, place = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
        shares = signs * np.repeat((sizes.gain, sizes.crosstalk), (6, 30))
        shares[:6] += sizes.common_gain
        turned = Rotation.from_rotvec(sizes.axes_rad * axis).as_matrix().T
        gains = np.eye(6) + np.einsum("k,kij->ij", shares, wrench_matrices(MOMENT_PER_FORCE_M)[1:37])
        matrix = gains @ np.kron(np.eye(2), turned)
        late_s, weighing = (
            sizes.delay_s * float(rng.choice((-1.0, 1.0))),
            0.0 if sizes.other_scale else float(shares[0]),
        )
        return cls(matrix, late_s, sizes.joint_m * place, weighing, sizes)

    def recorded(self, run: SimulatedRun, seed: int) -> PlatformRecording:
        """Return the recording that this laboratory makes of a run, with noise of a seed."""
        rig, R_IP = run.settings.rig, geometry.rotation_IP(*run.plate.euler_rad.T)
        tare = bare_plate_tare(rig)
        wrench = run.wrench - tare
        wrench[:, 3:] -= np.cross(self.beside_m, wrench[:, :3])
        f_hz = np.fft.rfftfreq(len(wrench), float(run.t_s[1] - run.t_s[0]))
        late = np.exp(-2j * np.pi * f_hz * self.delay_s)[:, None] * np.fft.rfft(wrench, axis=0)
        wrench = np.fft.irfft(late, len(wrench), axis=0) @ self.matrix.T
        plate = Poses(run.plate.p_m + R_IP @ self.beside_m, run.plate.euler_rad)
        seen = measured(replace(run, plate=plate, wrench=wrench + tare), seed=seed)
        foot = msgspec.structs.replace(
            seen.settings.foot, origin_in_plate_m=tuple((np.array(rig.foot_origin_m) - self.beside_m).tolist())
        )
        weighed = msgspec.structs.replace(
            seen.settings.plate, mass_kg=seen.settings.plate.mass_kg * (1.0 + self.weighing)
        )
        stated = seen.settings.uncertainty
        if self.sizes.known_weight:
            foot = msgspec.structs.replace(foot, mass_kg=FOOT.mass_kg)
        if self.sizes.other_scale:
            stated = msgspec.structs.replace(stated, mass_share=0.001)
        settings = msgspec.structs.replace(seen.settings, foot=foot, plate=weighed, uncertainty=stated)
        return replace(seen, settings=settings)

    @property
    def plate(self) -> Inertia:
        """Return the plate's true inertia about this laboratory's origin."""
        return Inertia(PLATE.mass_kg, PLATE.cog_m - self.beside_m, PLATE.inertia_kgm2)


@dataclass(frozen=True)
class Judged:
    """Of one case: how many draws were refused, and of the others which (n, 20) intervals hold, plate then foot."""

    name: str
    refused: int
    holds: FloatArray
    half: FloatArray
    noise_half: FloatArray

    @property
    def covers(self) -> FloatArray:
        """Return the share (20,) of the draws in which each interval holds."""
        return np.asarray(self.holds.mean(axis=0)) if len(self.holds) else np.full(20, np.nan)

    @property
    def row(self) -> list[str]:
        """Return the case for a table."""
        if not len(self.holds):
            return [self.name, f"{self.refused}", *["-"] * 6]
        covers, half, noise = self.covers, np.median(self.half, axis=0), np.median(self.noise_half, axis=0)
        worst = [int(np.argmin(covers[k : k + 10])) for k in (0, 10)]
        return [
            self.name,
            f"{self.refused}",
            *(f"{100.0 * covers[10 * b + k]:.0f} % ({NAMES[k]})" for b, k in enumerate(worst)),
            f"± {1e3 * half[2]:.2f} ({1e3 * noise[2]:.3f}) mm",
            f"± {half[10]:.3f} ({noise[10]:.4f}) kg",
            f"± {1e3 * half[12]:.2f} ({1e3 * noise[12]:.3f}) mm",
            f"± {1e3 * half[14]:.2f} ({1e3 * noise[14]:.3f}) g m²",
        ]


def judged(name: str, sizes: Sizes, runs: tuple[SimulatedRun, SimulatedRun], draws: int, seed: int) -> Judged:
    """Return what became of `draws` laboratories whose errors have these sizes."""
    refused, holds, half, noise_half = 0, [], [], []
    for draw in progress(range(draws), name):
        errors = Drawn.of(sizes, np.random.default_rng((seed, draw)))
        plate_seen, foot_seen = (errors.recorded(run, 2 * (seed + draw) + k) for k, run in enumerate(runs))
        try:
            plate = identify(plate_seen)
            foot = identify(foot_seen, plate.known)
        except UserError as refusal:
            refused += 1
            if refused == 1:
                console.print(f"{name}: {refusal}", highlight=False, markup=False)
            continue
        truths = about_cog(errors.plate.vector), about_cog(FOOT.vector)
        inside = [
            (found.interval[:, 0] <= truth) & (truth <= found.interval[:, 1])
            for found, truth in zip((plate, foot), truths, strict=True)
        ]
        holds.append(np.concatenate(inside))
        half.append(np.concatenate([np.diff(found.interval)[:, 0] / 2.0 for found in (plate, foot)]))
        noise_half.append(np.concatenate([NORMAL_95 * found.noise_deviation for found in (plate, foot)]))
    return Judged(name, refused, np.array(holds, dtype=np.float64), np.array(half), np.array(noise_half))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--only", choices=CASES)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    plate, foot = (
        simulate(RunSettings(rig=Rig(foot=foot), duration_s=options.seconds), options.seed + k)
        for k, foot in enumerate((None, FOOT))
    )
    names = list(CASES) if options.only is None else [options.only]
    every = [judged(name, CASES[name], (plate, foot), options.draws, options.seed) for name in names]
    table(
        f"Errors of the instruments: {options.draws} draws from seed {options.seed}; in brackets: noise alone",
        [
            "error",
            "refused",
            "plate: least covered",
            "foot: least covered",
            "plate y0",
            "foot m",
            "foot y0",
            "foot Jxx",
        ],
        [each.row for each in every],
    )
    if options.json is not None:
        write_json(options.json, [{"case": e.name, "refused": e.refused, "covers": e.covers.tolist()} for e in every])


if __name__ == "__main__":
    main()
