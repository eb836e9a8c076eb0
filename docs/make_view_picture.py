"""The README's picture of `gaiteyes view`: `python docs/make_view_picture.py [FILE]` makes it anew.

A simulated walk up a flight of stairs goes through the pipeline and onto the page; a headless Chromium takes the
picture when it has been drawn. Nothing in it is made up: it is what the page shows at that moment.
"""

import sys
import threading
from pathlib import Path

from cli.viewer.board import Board
from cli.viewer.played import Player
from cli.viewer.server import ViewServer
from daemon.config import Configuration
from daemon.pipeline import NO_FRAME_SEQ
from daemon.replay_source import ReplaySource
from messages import GroundPlane, GroundTruth, Input
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.bench.browser import browser, chromium

PICTURE = Path(__file__).parent / "pictures" / "view.jpg"
SIZE_PX = (1280, 900)
SEED, SCENARIO, SECONDS = 1001, "stairs", 7.4


class Unhurried:
    """Every message's time has come: the walk is rendered slower than it is walked."""

    def wait_for(self, _message: Input) -> float:
        """Return at once."""
        return 0.0


def make(path: Path, program: str, seconds: float = SECONDS) -> None:
    """Write the picture after `seconds` of the walk, taken with the browser `program`."""
    wearer = SimulatedWearer(SEED, scenario(SCENARIO), start_ns=10_000_000_000)
    source = ReplaySource(
        title=SCENARIO,
        calibration=wearer.calibration,
        configuration=Configuration(),
        inputs=lambda: wearer.offline_inputs(seconds),
    )

    def truth(ground: GroundPlane) -> GroundTruth | None:
        return None if ground.frame_seq == NO_FRAME_SEQ else wearer.truth_of(ground)

    board = Board(f"{SCENARIO}, simulated")
    player = Player(source, board, Unhurried, truth)
    with ViewServer(board, 0, player.command) as server, browser(program) as page:
        threading.Thread(target=player.play, daemon=True).start()
        page.resize(*SIZE_PX)
        page.open(server.url)
        page.wait_until("document.getElementById('state').textContent.startsWith('the end')")
        page.wait_until("Number(document.getElementById('picture').dataset.drawn) > 0")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(page.screenshot())


if __name__ == "__main__":
    found = chromium()
    if found is None:
        sys.exit("no Chromium on this machine: apt install chromium")
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE, found)
