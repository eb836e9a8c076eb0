"""What an estimator of the ground ahead is asked to say: the fields of a terrain message, whoever makes it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from messages import Input

KINDS = ("level", "ramp_up", "ramp_down", "stairs_up", "stairs_down", "step_up", "step_down", "rough")
"""The kinds of ground that truth knows; an estimator may say "unknown" besides."""


class EdgeSaid(Protocol):
    """An edge across the path, `distance_m` along x of H from below the left optical centre; `rise_m` > 0 up.

    With `bound_only` the ground falls by |`rise_m`| at least.
    """

    @property
    def distance_m(self) -> float:
        """Return the distance to the border of the upper surface."""

    @property
    def rise_m(self) -> float:
        """Return how much higher the ground behind it is."""

    @property
    def bound_only(self) -> bool:
        """Return whether the rise is only a bound."""


class FootholdSaid(Protocol):
    """Where the next foot lands, `ahead_m` and `left_m` in H, and the ground there, below the left optical centre.

    Each standard deviation is that of the field of like name. NaN is what is not known.
    """

    @property
    def ahead_m(self) -> float:
        """Return the place along x of H."""

    @property
    def left_m(self) -> float:
        """Return the place along y of H."""

    @property
    def height_m(self) -> float:
        """Return the vertical distance from the left optical centre down to the ground there."""

    @property
    def height_sd_m(self) -> float:
        """Return its standard deviation."""

    @property
    def slope_sagittal_rad(self) -> float:
        """Return the slope ahead, > 0 uphill."""

    @property
    def slope_sagittal_sd_rad(self) -> float:
        """Return its standard deviation."""

    @property
    def slope_frontal_rad(self) -> float:
        """Return the slope to the left, > 0 uphill."""

    @property
    def slope_frontal_sd_rad(self) -> float:
        """Return its standard deviation."""

    @property
    def time_to_contact_s(self) -> float:
        """Return how long after the exposure the foot lands."""


class TerrainSaid(Protocol):
    """What is said of the frame exposed at `t_exposure_ns`; edges in any order, `kind` of `KINDS` or "unknown"."""

    @property
    def t_exposure_ns(self) -> int:
        """Return the frame's stamp."""

    @property
    def kind(self) -> str:
        """Return the kind of most of the path from 0.3 to 1.0 m."""

    @property
    def edges(self) -> Sequence[EdgeSaid]:
        """Return the edges on the path."""

    @property
    def foothold(self) -> FootholdSaid | None:
        """Return the next foothold, None where it is not said."""


class TerrainEstimator(Protocol):
    """Takes what the pipeline takes, in the same order, and says something of each frame that it can measure."""

    def step(self, message: Input) -> Iterable[TerrainSaid]:
        """Take one input and return what it completes."""


@dataclass(frozen=True)
class Edge:
    """An `EdgeSaid` with no more than its fields."""

    distance_m: float
    distance_sd_m: float
    rise_m: float
    rise_sd_m: float
    bound_only: bool = False
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Foothold:
    """A `FootholdSaid` with no more than its fields."""

    ahead_m: float
    left_m: float
    height_m: float
    height_sd_m: float
    slope_sagittal_rad: float
    slope_sagittal_sd_rad: float
    slope_frontal_rad: float
    slope_frontal_sd_rad: float
    time_to_contact_s: float


@dataclass(frozen=True)
class Terrain:
    """A `TerrainSaid` with no more than its fields."""

    t_exposure_ns: int
    kind: str
    edges: Sequence[EdgeSaid] = ()
    foothold: Foothold | None = None
