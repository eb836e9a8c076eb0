"""The contract of every CAN link, on a virtual link and between two controllers on one bus."""

from collections.abc import Iterator

import pytest

from drivers.can.settings import CanInterface, CanSettings
from tests.drivers.can import test_link_contract as test_can_link
from tests.drivers.can.test_link_contract import Wire, joined
from tests.kernel import can_links
from tests.kernel.contract import contract_tests

globals().update(contract_tests(test_can_link, "wire"))


@pytest.fixture(params=["vcan", "controllers"])
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    if request.param == "vcan":
        can_links.make_vcan("vcan0")
        yield from joined(CanSettings(interface=CanInterface.SOCKETCAN, channel="vcan0"), {"channel": "vcan0"})
        can_links.remove("vcan0")
    else:
        can_links.start_controllers()
        ours, other = can_links.CONTROLLERS
        yield from joined(CanSettings(interface=CanInterface.SOCKETCAN, channel=ours), {"channel": other})
