"""Cases of the five systems: two recordings each as CSV files, and the truth apart."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from lab.hidden.case import Case, Kind, Sizes, TrueCause, Truth
from lab.hidden.five.acting import Hidden
from lab.hidden.five.hidden import LOOK_ALIKES, NAMED, OUTSIDE, mechanisms
from lab.hidden.five.systems import SYSTEMS, Recorded, drawn

RECORDING: Final = "recording.csv"
"""Of a folder: its only file."""
_AT_PORT: Final = "_at_"
"""In the name of an effect that acts inside the system, where something may be constructed in its place."""
_SHARES: Final[Mapping[Kind, float]] = {Kind.CLEAN: 0.3, Kind.OUTSIDE: 0.16, Kind.WITHHELD: 0.14, Kind.PAIR: 0.0}
_DECLARED: Final = "noise_"
"""Before a reading's name: the column of its noise's deviation, where somebody declared it."""


@dataclass(frozen=True)
class PortedSystem:
    """One of the five, by its `name`, as `lab.hidden.case.System` asks for it."""

    name: str

    @property
    def EFFECTS(self) -> tuple[str, ...]:
        """What it can hide that a library names."""
        return tuple(NAMED[self.name])

    @property
    def OUTSIDE(self) -> tuple[str, ...]:
        """What it can hide that none names."""
        return tuple(OUTSIDE[self.name])

    @property
    def PAIRS(self) -> tuple[tuple[str, str], ...]:
        """None: one thing is hidden at a time."""
        return ()

    @property
    def WITHHELD(self) -> tuple[str, ...]:
        """Effects inside the system."""
        return tuple(name for name in self.EFFECTS if _AT_PORT in name)

    @property
    def SHARES(self) -> Mapping[Kind, float]:
        """Many clean ones, and many that no library explains."""
        return _SHARES

    @property
    def SIZES(self) -> Mapping[str, Sizes]:
        """The range of each size."""
        return {key: each.sizes for key, each in mechanisms(self.name).items()}

    @property
    def LOOK_ALIKES(self) -> tuple[tuple[str, ...], ...]:
        """Effects that imitate each other."""
        return LOOK_ALIKES.get(self.name, ())

    def write(self, case: Case, folder: Path, held_out: Path) -> Truth:
        """Write both recordings of a case and return what they hide; everything follows from the case alone."""
        hidden, causes = _hidden(case)
        declared = bool(case.stream("declared").random() < 0.5)
        first, second = (
            drawn(case.system, hidden, case.stream(f"{side}motion"), case.stream(f"{side}noise"))
            for side in ("", "held_out/")
        )
        _write(case.system, first, folder / RECORDING, declared=declared)
        _write(case.system, second, held_out / RECORDING, declared=declared)
        return Truth(
            system=case.system,
            seed=case.seed,
            kind=case.kind,
            causes=causes,
            nuisance={"noise_declared": declared, "noise_nrmse": second.noise_share},
            chi2_beyond_base=first.beyond,
        )


FIVE: Final[Mapping[str, PortedSystem]] = {name: PortedSystem(name) for name in SYSTEMS}


def _hidden(case: Case) -> tuple[Hidden, tuple[TrueCause, ...]]:
    if case.kind is Kind.CLEAN:
        return Hidden(), ()
    (name,) = case.effects
    mechanism = mechanisms(case.system)[name]
    rng = case.stream("hidden")
    size = mechanism.sizes.drawn(rng)
    constants = mechanism.draws(rng, size)
    told = dict(constants) if name in NAMED[case.system] else {}
    return mechanism.makes(constants), (TrueCause(name, told, size, mechanism.sizes.unit),)


def _write(system: str, recorded: Recorded, path: Path, *, declared: bool) -> None:
    told = SYSTEMS[system]
    columns = {"t_s": recorded.t_s, told.driven: recorded.input}
    columns |= dict(zip(told.names, recorded.readings.T, strict=True))
    if declared:
        columns |= {
            f"{_DECLARED}{name}": np.full(len(recorded.t_s), std)
            for name, std in zip(told.names, recorded.noise, strict=True)
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(
        path, np.column_stack(list(columns.values())), fmt="%.9g", delimiter=",", header=",".join(columns), comments=""
    )
