"""The contract of every stereo source, on v4l2loopback and on vivid."""

import time
from collections.abc import Iterator

import pytest

from tests.drivers.camera import test_stereo_source_contract as test_stereo_source
from tests.drivers.camera.test_stereo_source_contract import POOL_FRAMES, Bench
from tests.kernel import loopback, vivid
from tests.kernel.contract import contract_tests

globals().update(contract_tests(test_stereo_source, "bench"))


@pytest.fixture(params=["loopback", "vivid"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    if request.param == "loopback":
        fed = loopback.FedLoopback()
        source = fed.camera(pool_frames=POOL_FRAMES)
        yield Bench(source, loopback.EYE_PX, time.sleep)
        source.close()
        fed.unplug()
    else:
        camera = vivid.Vivid()
        source = camera.camera(pool_frames=POOL_FRAMES)
        yield Bench(source, vivid.EYE_PX, time.sleep, camera.unplug, camera.plug_in)
        source.close()
        camera.plug_in()
