"""What `gaiteyes view` costs the service: processor time of its pictures, and delays with and without who looks.

    python -m benchmarks.view_cost [--pictures 200] [--runs 2] [--seconds 30]

First, of rendered frames of a walk: the processor time that the pipeline's thread spends on each frame while somebody
looks (it hands over a reference), and that the pictures' own thread spends on one picture (scaled, packed, sent), as a
share of a core at ten a second. Processor time does not depend on what else the host does. Then `gaiteyes demo`, by
turns alone and with a reader of pictures and of all topics beside it: frame arrival to publication, and the service's
share of a core. With --runs 0 there is no demo; where the host was too busy for one, its row says void.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import cv2

from daemon.pictures import Greeting, Pictures
from drivers.picture_socket import PictureReader
from drivers.zenoh.device_listener import DeviceListener
from messages import TOPICS, Reason, Side, Source, Terrain, UserError
from perception.terrain.surfaces import PathSurfaces, Surface
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

_FRAMES = 20


class _Reader:
    """Somebody who looks, and reads what comes."""

    is_watched = True

    def __init__(self) -> None:
        self.bytes = 0

    def welcome(self, greeting: bytes) -> None:
        self.bytes += len(greeting)

    def send(self, packet: bytes) -> None:
        self.bytes += len(packet)

    def close(self) -> None:
        self.is_watched = False


def processor_time(pictures: int) -> None:
    """Print what one frame and one picture cost."""
    wearer = SimulatedWearer(1001, scenario("stairs"), 10_000_000_000)
    frames = [frame for frame, _ in wearer.frames(_FRAMES, 60)]
    surfaces = PathSurfaces([Surface(0.3 * k, 0.3 * k + 0.3, 0.3 * k, -0.9, 0.0, 0.001, 0.001) for k in range(8)], 0.0)
    reader = _Reader()
    told = Pictures(
        reader, Greeting(source=Source.SIMULATED, calibration_text="", configuration_text=""), lambda: surfaces
    )
    handing_s = making_s = 0.0
    for k in range(pictures):
        frame = frames[(2 * k) % _FRAMES]
        terrain = Terrain.invalid(
            t_exposure_ns=0,
            frame_seq=frame.header.seq,
            reason=Reason.LOW_TEXTURE,
            side=Side.RIGHT,
            calibration_id="",
        )
        begun_s = time.thread_time()
        told.add_frame(frame)
        told.add_estimate(terrain, None)
        handed_s = time.thread_time()
        told.serve(0.0)
        handing_s += handed_s - begun_s
        making_s += time.thread_time() - handed_s
    each_s = making_s / pictures
    rate_hz = TOPICS["frame"].rate_hz / 2
    print(f"handing one frame over, in the pipeline's thread: {1e6 * handing_s / pictures:.1f} µs")
    print(f"one picture, in a thread of its own: {1e3 * each_s:.2f} ms, {reader.bytes / pictures / 1e3:.0f} kB")
    print(f"share of a core at {rate_hz:g} a second: {100.0 * each_s * rate_hz:.2f} %")


def demo(seconds: float, *, watched: bool) -> None:
    """Run the simulated wearer, and print a row."""
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        command = [sys.executable, "-m", "cli.main", "demo", "--seconds", str(seconds), "--json", str(summary)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        read = [0]
        if watched:
            threading.Thread(target=_read, args=(process, read), daemon=True).start()
        process.wait()
        facts = json.loads(summary.read_text(encoding="utf-8"))
    latency = facts["run"]["latency"]["arrival_to_publish"]
    print(
        f"{'watched' if watched else 'alone':8} arrival to publication {latency['p50_ms']:5.1f}, 99 % "
        f"{latency['p99_ms']:5.1f} ms; {100 * facts['run']['cpu_share']:3.0f} % of a core; {read[0]} pictures"
        + (f"   void: {facts['void']}" if facts["void"] else "")
    )


def _read(process: subprocess.Popen[bytes], read: list[int]) -> None:
    reader, listener = None, None
    while process.poll() is None and listener is None:
        time.sleep(0.2)
        with suppress(UserError):  # it is not up yet
            reader = PictureReader("demo")
            listener = DeviceListener("demo")
    try:
        while reader is not None and listener is not None:
            read[0] += reader.receive(0.05) is not None
            listener.take(timeout_s=0.0)
    except EOFError:
        return


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=200)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    processor_time(options.pictures)
    for _ in range(options.runs):
        demo(options.seconds, watched=False)
        demo(options.seconds, watched=True)


if __name__ == "__main__":
    main()
