"""Whether a demo's pictures are rendered before it begins: only where the host cannot do both at once."""

from pathlib import Path

import pytest

from cli.console import console
from cli.filmed import LONGEST_S, film_if_slow
from messages import UserError
from sim_rig.camera.film import Film
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

SLOW_S, FAST_S = 0.059, 0.018
RENDERED = Film(Path("walk.film"), 1, repeats=False)


class Host(SimulatedWearer):
    """One whose pictures take `takes_s` to render, onto a disk that may be `full`."""

    def __init__(self, takes_s: float, *, full: bool = False) -> None:
        super().__init__(1, scenario("level"), 0)
        self.done: list[str] = []
        self._takes_s, self._full = takes_s, full

    def rendering_s(self) -> float:
        return self._takes_s

    def film(self, seconds: float, path: Path) -> Film:
        if self._full:
            raise UserError("a film of 200 frames takes 0.4 GB, 0.1 GB are free")
        self.done.append(f"rendered {seconds:.0f} s into {path.name}")
        return RENDERED

    def asked(self, seconds: float) -> Film | None:
        return film_if_slow(self, seconds, Path("walk.film"), lambda: self.done.append("checked"))


def test_a_slow_host_renders_first_and_checks_before_it_keeps_anybody_waiting() -> None:
    host = Host(SLOW_S)
    with console.capture() as told:
        assert host.asked(10.0) is RENDERED
    assert host.done == ["checked", "rendered 13 s into walk.film"]
    assert "59 ms to render a pair" in told.get()


@pytest.mark.parametrize(("takes_s", "seconds"), [(FAST_S, 10.0), (SLOW_S, LONGEST_S + 1.0)])
def test_a_fast_host_and_a_long_walk_do_without(takes_s: float, seconds: float) -> None:
    host = Host(takes_s)
    with console.capture() as told:
        assert host.asked(seconds) is None
    assert (host.done, told.get()) == ([], "")


def test_a_full_disk_is_told_and_keeps_nobody_from_walking() -> None:
    host = Host(SLOW_S, full=True)
    with console.capture() as told:
        assert host.asked(10.0) is None
    assert "0.1 GB are free: they are rendered as they come" in told.get().replace("\n", " ")
