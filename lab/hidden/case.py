"""A hidden-effect case: what is hidden in a recording, drawn from one seed, and the truth, kept away from it.

A module of this package writes the cases of one system (`System` below). It imports nothing of the finder.
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from lab.hidden.json_file import read_struct, write_struct


class Kind(str, Enum):
    """What a case asks of the finder."""

    CLEAN = "clean"  # nothing is hidden: it must name nothing
    SINGLE = "single"
    PAIR = "pair"
    OUTSIDE = "outside"  # a mechanism that is in no library: it must say unknown
    WITHHELD = "withheld"  # written as a single; the finder gets the library without the effect and its look-alikes


@dataclass(frozen=True)
class Case:
    """One case. `effects` are the names hidden in it: none, one or two; of an outside case the mechanism's."""

    system: str
    seed: int
    kind: Kind
    effects: tuple[str, ...]

    def __post_init__(self) -> None:
        """Refuse a case whose number of effects contradicts its kind."""
        wanted = {Kind.CLEAN: 0, Kind.PAIR: 2}.get(self.kind, 1)
        if len(self.effects) != wanted:
            raise ValueError(f"a case of kind {self.kind.value} hides {wanted} effects, not {len(self.effects)}")

    def stream(self, purpose: str) -> np.random.Generator:
        """Return the random stream of one purpose ("noise", "held_out/motion"), independent of every other's.

        It depends on the seed and the purpose alone: a new purpose alters no other stream.
        """
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(zlib.crc32(purpose.encode()),)))


@dataclass(frozen=True)
class Sizes:
    """The stated range of an effect's size, above zero, in the unit of the parameter that it sets."""

    low: float
    high: float
    unit: str

    def __post_init__(self) -> None:
        """Refuse a range without a logarithm."""
        if not 0.0 < self.low < self.high < math.inf:
            raise ValueError("0 < low < high < ∞ is needed")

    def drawn(self, random: np.random.Generator) -> float:
        """Return a size, log-uniform in the range."""
        return log_uniform(random, self.low, self.high)


class TrueCause(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was hidden: an effect with the parameters that the verdict must tell, named and in units as there.

    `size` is the magnitude that was drawn, by which the smallest size found is told; `unit` is its unit.
    """

    name: str
    parameters: dict[str, float]
    size: float
    unit: str


class Truth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a case hides. `causes` are in falling share of the misfit; of an outside case it is the mechanism.

    `nuisance` is whatever else was drawn (foot, amplitude, noise level and colour), for a reader.
    `effect_rms_over_noise` is the RMS, over all channels, of what the causes alter in the fit recording, each channel
    divided by its noise; null where that was not measured. `chi2_beyond_base` is by how much χ² of the fit recording
    would fall if a model with its own parameters free were told the causes; null likewise.
    """

    system: str
    seed: int
    kind: Kind
    causes: tuple[TrueCause, ...]
    nuisance: dict[str, float | bool | str] = {}
    effect_rms_over_noise: float | None = None
    chi2_beyond_base: float | None = None

    @property
    def case_name(self) -> str:
        """Return the case in a word: system, kind, causes and seed."""
        return "-".join((self.system, self.kind.value, *(cause.name for cause in self.causes), str(self.seed)))

    def save(self, path: Path) -> None:
        """Write it as JSON; `path` lies outside the folders of both recordings. Raises UserError where it cannot."""
        write_struct(path, self)

    @staticmethod
    def load(path: Path) -> "Truth":
        """Read it back; raises UserError naming file and field."""
        return read_struct(path, Truth)


class System(Protocol):
    """What a module of this package offers: `lab.hidden.platform` and its fellows are such modules."""

    @property
    def EFFECTS(self) -> tuple[str, ...]:
        """The effects it can hide, by the library's names."""

    @property
    def OUTSIDE(self) -> tuple[str, ...]:
        """Mechanisms that are in no library, at least six."""

    @property
    def PAIRS(self) -> tuple[tuple[str, str], ...]:
        """Effects that can sensibly occur together."""

    @property
    def WITHHELD(self) -> tuple[str, ...]:
        """Those of EFFECTS that the finder may be left without."""

    @property
    def SHARES(self) -> Mapping[Kind, float]:
        """Of all cases, those of each kind but `Kind.SINGLE`, which are the rest."""

    @property
    def SIZES(self) -> Mapping[str, Sizes]:
        """The range of sizes of each of EFFECTS and OUTSIDE, stated before anything is judged."""

    @property
    def LOOK_ALIKES(self) -> tuple[tuple[str, ...], ...]:
        """Classes of effects that these recordings cannot, or can hardly, tell apart; one without is its own."""

    def write(self, case: Case, folder: Path, held_out: Path) -> Truth:
        """Write the recording to fit into `folder` and another into `held_out`, both made here; return the truth.

        Everything is drawn from `case` alone. The held-out one has the same causes, sizes and unit, and another
        excitation. Neither folder tells anything of the case.
        """


SHARES: Mapping[Kind, float] = {
    Kind.CLEAN: 20 / 140,
    Kind.PAIR: 12 / 140,
    Kind.OUTSIDE: 12 / 140,
    Kind.WITHHELD: 12 / 140,
}
"""As most systems are asked."""


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of `low` and `high`, both above zero."""
    return float(math.exp(random.uniform(math.log(low), math.log(high))))


def sign(random: np.random.Generator) -> float:
    """Return −1 or +1, each as often."""
    return float(random.choice((-1.0, 1.0)))
