"""The contract of every IMU source, on a real I2C adapter."""

from collections.abc import Iterator

import pytest

from tests.drivers.imu import test_imu_source_contract as test_imu_source
from tests.drivers.imu.test_imu_source_contract import ImuRig
from tests.kernel.contract import contract_tests
from tests.kernel.imu_bench import kernel_imu

globals().update(contract_tests(test_imu_source, "rig"))


@pytest.fixture(params=["polled", "data_ready"])
def rig(request: pytest.FixtureRequest) -> Iterator[ImuRig]:
    with kernel_imu(with_line=request.param == "data_ready") as bench:
        yield bench
