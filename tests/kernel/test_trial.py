import time
from tests.kernel import loopback
from tests.kernel.loopback import FedLoopback

def test_trial() -> None:
    with open("/results/trial.txt", "w", buffering=1) as out:
        for hz in (20, 25, 30):
            loopback.FEED_HZ = hz
            f = FedLoopback(); c = f.camera()
            print(hz, c.camera_rate_hz, file=out)
            t0=time.monotonic()
            got=[c.read(1.0) for _ in range(12)]
            print([(g.header.seq, g.header.t_exposure_ns//1000%100000000) for g in got], c.dropped, time.monotonic()-t0, file=out)
            c.close(); f.unplug()
