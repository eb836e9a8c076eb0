"""What a unit has learnt of its own sensors in use. It completes the unit's calibration and never changes it.

Time is time of use: seconds in which something could be learnt, summed over all runs. No clock outlives a power-off.
"""

from itertools import pairwise
from typing import Annotated

import msgspec

from messages.calibration import NonNegative, short_hash
from messages.inputs import Vec3

DIE_TEMPERATURES_DEGC = (-40.0, 85.0)
"""The range in which the IMU's maker states anything."""

_DieTemperature = Annotated[float, msgspec.Meta(ge=DIE_TEMPERATURES_DEGC[0], le=DIE_TEMPERATURES_DEGC[1])]


_LARGEST = 1e3
"""rad/s or m/s²: beyond the range of any IMU; squares of it are far from overflowing."""


class BiasAtTemperature(msgspec.Struct, frozen=True, kw_only=True):
    """What the calibration leaves of both biases of the IMU, in B, at one die temperature, with one standard deviation
    on each axis. `seen_s` is the time of use when that was last measured.

    Raises ValueError for what is not finite, for a negative deviation and for what no IMU can measure.
    """

    temperature_degC: _DieTemperature
    gyro_bias_radps: Vec3
    gyro_std_radps: Vec3
    sf_bias_mps2: Vec3
    sf_std_mps2: Vec3
    seen_s: NonNegative

    def __post_init__(self) -> None:
        """Refuse what is no measurement."""
        for name in ("gyro_bias_radps", "gyro_std_radps", "sf_bias_mps2", "sf_std_mps2"):
            axes: Vec3 = getattr(self, name)
            lowest = 0.0 if "_std_" in name else -_LARGEST
            if not all(lowest <= each <= _LARGEST for each in axes):  # so written, NaN is refused too
                raise ValueError(f"{name} is {axes}, allowed three numbers from {lowest:g} to {_LARGEST:g}")


class DepthScale(msgspec.Struct, frozen=True, kw_only=True):
    """The camera's distances are (1 + `scale`) times the true ones; `std` is one standard deviation."""

    scale: Annotated[float, msgspec.Meta(gt=-0.5, lt=0.5)]
    std: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
    seen_s: NonNegative


class Learnt(msgspec.Struct, frozen=True, kw_only=True):
    """All that one unit has learnt, beside the calibration whose id is `calibration_id`, in `used_s` of use.

    `biases` are in the order of their temperatures. `depth_scale` is None until it is known.
    Raises ValueError for biases out of order.
    """

    calibration_id: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{8}$")]
    used_s: NonNegative = 0.0
    biases: Annotated[tuple[BiasAtTemperature, ...], msgspec.Meta(max_length=256)] = ()
    depth_scale: DepthScale | None = None

    def __post_init__(self) -> None:
        """Refuse biases out of order."""
        temperatures = [each.temperature_degC for each in self.biases]
        if any(after <= before for before, after in pairwise(temperatures)):
            raise ValueError(f"biases at {temperatures} °C, allowed rising temperatures only")

    @property
    def id(self) -> str:
        """Eight hexadecimal digits that change whenever any value does."""
        return short_hash(self)

    @property
    def is_empty(self) -> bool:
        """Return whether nothing has been learnt yet."""
        return not self.biases and self.depth_scale is None
