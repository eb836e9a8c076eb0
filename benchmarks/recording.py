"""What recording costs: the CPU time of writing two 1280×720 images at 20 fps with all that comes beside them.

    python -m benchmarks.recording [--seconds 60] [--ring S] [--folder DIR] [--noise]

The pictures are the simulated wearer's, with their sensor's noise, or nothing but noise. Frames are offered at their
real pace, so that the disk, the page cache and the allocator behave as in the daemon. What the kernel takes for the
bare writes of the same bytes at the same pace is measured beside it. MCAP's index stays in
memory until the file is closed; how it grows is measured with tiny images, written as fast as it goes.
"""

import argparse
import itertools
import os
import resource
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from daemon.recorder import Recorder, RecordingInfo
from daemon.recording_file import RecordingFile, entries_of
from lab.faults.daemon_process import resident_mb
from messages import FrameHeader, ImuSample, Source, StereoFrame, Tick
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

WIDTH_PX, HEIGHT_PX = 1280, 720
Images = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--ring", type=float, default=None, help="keep the newest S seconds instead of writing all")
    parser.add_argument("--folder", type=Path, default=None, help="disk to write to (default: the system's temporary)")
    parser.add_argument("--noise", action="store_true", help="pictures of noise, which nothing compresses")
    arguments = parser.parse_args()
    print(f"index           {index_growth_mb_per_h():.1f} MB of memory per hour of recording")
    images = _noise() if arguments.noise else _walk()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        bare = Path(folder) / "bare"
        print(f"bare writes     {100 * bare_write_share(bare, arguments.seconds):.2f} % of a core, in the kernel")
        bare.unlink()
        measure(Path(folder) / "benchmark.mcap", arguments.seconds, arguments.ring, images)


def bare_write_share(path: Path, seconds: float) -> float:
    """Return the share of a core that writing the same bytes 20 times a second takes without any recorder."""
    frames = [np.random.default_rng(k).bytes(2 * WIDTH_PX * HEIGHT_PX) for k in range(4)]
    count, spent_s, start_s = round(seconds * 20), 0.0, time.monotonic()
    with path.open("wb", buffering=0) as file:
        for k in range(count):
            time.sleep(max(0.0, start_s + 0.05 * k - time.monotonic()))
            begin_s = time.thread_time()
            file.write(frames[k % 4])
            spent_s += time.thread_time() - begin_s
    return spent_s / seconds


def index_growth_mb_per_h(hours: float = 0.5) -> float:
    """Return how much the resident memory grows in an hour of frames and samples, images apart."""
    images = np.zeros((8, 8, 8), np.uint8)
    file = RecordingFile(Path("/dev/null"), RecordingInfo("benchmark", Source.SIMULATED, "", ""))
    settled, frames = 2000, round(hours * 3600 * 20)
    settled_mb = 0.0
    for k in range(settled + frames):
        for sample in range(5 * k, 5 * k + 5):
            t_ns = 10_000_000 * sample
            file.write(entries_of(Tick(t_ns=t_ns), t_ns))
            file.write(entries_of(_sample(sample, t_ns), t_ns))
        file.write(entries_of(_frame(k, 50_000_000 * k, images), 50_000_000 * k))
        if k == settled:
            settled_mb = resident_mb(os.getpid())
    growth_mb = resident_mb(os.getpid()) - settled_mb
    file.close()
    return growth_mb / hours


def _noise() -> Images:
    return np.random.default_rng(1).integers(0, 256, (8, HEIGHT_PX, WIDTH_PX), dtype=np.uint8)


def _walk() -> Images:
    """Return pictures (8, h, w) of the simulated wearer's left eye, a fifth of a second apart."""
    wearer = SimulatedWearer(1, scenario("mixed"), 0)
    frames = (message for message in wearer.offline_inputs(3.0) if isinstance(message, StereoFrame))
    images = np.stack([frame.left for frame in itertools.islice(frames, 0, 32, 4)])
    wearer.close()
    return images


def measure(path: Path, seconds: float, ring_s: float | None, images: Images) -> None:
    before_mb = resident_mb(os.getpid())
    info = RecordingInfo("benchmark", Source.SIMULATED, "", "")
    recorder = Recorder(path, info, last_s=ring_s)
    done = threading.Event()
    spent_s: list[float] = []

    def write() -> None:
        while not (done.is_set() and recorder.idle):
            recorder.drain(timeout_s=0.1)
        spent_s.append(time.thread_time())

    writer = threading.Thread(target=write)
    writer.start()
    offer_s, start_ns = 0.0, time.monotonic_ns()
    for k in range(round(seconds * 100)):
        due_ns = start_ns + 10_000_000 * k
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        begin_s = time.thread_time()
        recorder.offer(Tick(t_ns=due_ns))
        recorder.offer(_sample(k, due_ns))
        if k % 5 == 0:
            recorder.offer(_frame(k // 5, due_ns, images))
        offer_s += time.thread_time() - begin_s
    done.set()
    writer.join()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    close_s = time.process_time()
    recorder.close()
    close_s = time.process_time() - close_s
    print(f"writer thread   {100 * spent_s[0] / seconds:.2f} % of a core")
    print(f"offer           {100 * offer_s / seconds:.2f} % of a core (making the messages included)")
    print(
        f"close           {close_s:.2f} s of CPU, file {path.stat().st_size / 1e6:.0f} MB, ring {recorder.ring_s:.1f} s"
    )
    print(f"dropped         {recorder.dropped}, peak memory {peak_mb:.0f} MB, before recording {before_mb:.0f} MB")


def _sample(seq: int, t_ns: int) -> ImuSample:
    return ImuSample(
        seq=seq,
        t_sample_ns=t_ns - 5_000_000,
        t_arrival_ns=t_ns,
        sf_B_mps2=(0.1, 0.2, 9.81),
        w_WB_B_radps=(0.01, 0.02, 0.03),
        temperature_degC=31.0,
    )


def _frame(seq: int, t_ns: int, images: Images) -> StereoFrame:
    header = FrameHeader(
        seq=seq,
        t_exposure_ns=t_ns - 40_000_000,
        t_arrival_ns=t_ns,
        exposure_s=0.004,
        width_px=images.shape[2],
        height_px=images.shape[1],
    )
    return StereoFrame(header=header, left=images[seq % 8], right=images[(seq + 1) % 8])


if __name__ == "__main__":
    main()
