"""The service and a virtual prosthesis in a process of its own on one bus: each hears the other, faults and all."""

import json
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli import filmed
from cli.console import VOID
from cli.main import app
from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.service import Devices, Service
from daemon.stamping import Stamper
from drivers.can.link import CanLink
from drivers.can.settings import CanInterface, CanSettings
from drivers.zenoh.settings import SOCKET
from impedance.modulation.modulator import Modulator
from impedance.modulation.table import published
from messages import Side, Source, UserError
from messages.e2e import E2eCheck
from messages.refusal import Refusal
from perception.ground.foothold import FootholdSettings
from sim_rig.can.slcan_hub import open_hub
from sim_rig.prosthesis.bus_faults import BusFaults
from sim_rig.prosthesis.process import ProsthesisProcess, Worn
from sim_rig.unit import draw_unit
from sim_rig.walk.scenario import scenario
from tests.bench.quiet_devices import GreyCamera, QuietImu

pytestmark = pytest.mark.realtime

BUS = CanSettings(interface=CanInterface.UDP_MULTICAST, channel="239.74.163.79")
MASS_KG = 75.0


def worn(name: str = "level") -> Worn:
    return Worn(1, scenario(name), time.monotonic_ns(), Side.RIGHT, MASS_KG)


@pytest.fixture
def link() -> Iterator[CanLink]:
    with closing(CanLink(BUS)) as opened:
        yield opened


def test_each_hears_the_other_on_a_bus_that_loses_delays_and_babbles(link: CanLink) -> None:
    publisher = CanPublisher(link)
    service = Service(
        Pipeline(draw_unit(1).exact_calibration(), FootholdSettings(), setpoints=Modulator(published(), MASS_KG)),
        Devices(imu=QuietImu(), camera=GreyCamera(), ankle=link),
        [publisher],
        Stamper("test", "boot", Source.SIMULATED),
        background={"can": publisher.drain},
    )
    process = ProsthesisProcess(worn(), BUS, BusFaults(loss=0.05, delay_s=0.02, babble_hz=200.0))
    counters = link.counters

    def stop_when_heard() -> None:
        babble = counters.ankle_refused.get(E2eCheck.WRONG_CRC, 0)
        service.stop() if counters.ankle_states > 60 and babble > 10 and publisher.sent > 400 else None

    service.run(60.0, each_s=0.05, status=stop_when_heard)
    facts = process.close()
    assert counters.ankle_states > 60, counters
    assert facts is not None
    assert facts.states > 60
    assert facts.lost_frames > 0
    assert facts.refused[Refusal.NOT_VALID] > 10  # a camera that sees fog gives no set-point, and says so
    assert facts.refused[Refusal.WRONG_CRC] > 10  # the babbler's
    assert facts.followed == 0
    assert facts.stumbles == 0


def test_a_walk_or_a_bus_that_it_cannot_have_is_refused_in_one_line() -> None:
    with pytest.raises(UserError, match="turns or rides"):
        ProsthesisProcess(worn("turns"), BUS, BusFaults())
    with pytest.raises(UserError, match="ends with this process"):
        ProsthesisProcess(worn(), CanSettings(), BusFaults())


@pytest.mark.long
def test_the_demo_tells_what_its_prosthesis_did(tmp_path: Path) -> None:
    file, zenoh = tmp_path / "facts.json", f"{SOCKET}{tmp_path / 'z.sock'}"
    command = ["demo", "--prosthesis", "--seconds", "6", "--zenoh", zenoh, "--can", BUS.name, "--json", str(file)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code in (0, VOID)
    assert "contacts, of them on a set-point" in done.output
    assert json.loads(file.read_bytes())["prosthesis"]["states"] > 0


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--bus-faults", "loss=0.1"], "add --prosthesis"),
        (["--prosthesis", "--bus-faults", "loss=2"], "bus faults: 'loss=2'"),
        (["--prosthesis", "--can", "virtual:x"], "ends with this process"),
        (["--prosthesis", "--scenario", "bus"], "turns or rides"),
    ],
)
@pytest.mark.parametrize("most_rendering", [0.0, 1000.0], ids=["slow host", "fast host"])
def test_options_that_do_not_fit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_rendering: float, more: list[str], why: str
) -> None:
    monkeypatch.setattr(filmed, "MOST_RENDERING", most_rendering)
    done = CliRunner().invoke(app, ["demo", "--zenoh", f"{SOCKET}{tmp_path / 'z'}", *more])
    assert isinstance(done.exception, UserError)
    assert why in str(done.exception)
    open_hub().close()  # the simulated bus is not left open
