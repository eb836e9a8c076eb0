"""What `gaiteyes demo` renders before it begins, on a host that cannot render and run the service at once."""

from collections.abc import Callable
from pathlib import Path

from cli.console import console
from messages import TOPICS, UserError
from sim_rig.camera.film import Film
from sim_rig.wearer import SimulatedWearer

MOST_RENDERING = 0.6
"""Of a frame's time, beside other work: a renderer that takes more loses frames now and then."""
LONGEST_S = 120.0
"""A longer walk is rendered as it goes: 4.4 GB, and more than two minutes to wait for on two slow cores."""
_SPARE_S = 3.0  # the service may take so long to start


def film_if_slow(wearer: SimulatedWearer, seconds: float, path: Path, check: Callable[[], None]) -> Film | None:
    """Return a film of the walk's first `seconds`, in the file at `path`, if this host cannot do without.

    None, too, where the walk is too long for that, or the disk too full, which is told. `check` is called before the
    wait: it tells what would fail after it.
    """
    rendering_s = wearer.rendering_s()
    if rendering_s < MOST_RENDERING / TOPICS["frame"].rate_hz or seconds > LONGEST_S:
        return None
    check()
    console.print(
        f"this host takes {1e3 * rendering_s:.0f} ms to render a pair of pictures beside other work: {seconds:g} s of "
        "them are rendered first, which takes as long or longer",
        soft_wrap=True,
    )
    try:
        return wearer.film(seconds + _SPARE_S, path)
    except UserError as refusal:
        console.print(f"{refusal}: they are rendered as they come", soft_wrap=True)
        return None
