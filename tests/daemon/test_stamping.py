"""Each topic is numbered by itself, and an age runs from the capture of the data to its publishing."""

import pytest

from daemon.stamping import Stamper
from messages import Estimate, Source
from tests.bench.can_samples import ground, health


def test_each_topic_has_its_own_numbers() -> None:
    stamper = Stamper("unit-1", "boot", Source.LIVE)
    order: list[Estimate] = [ground(), health(), ground(), ground(), health()]
    assert [stamper.stamp(message, 10**10).seq for message in order] == [0, 0, 1, 2, 1]


def test_the_age_runs_from_the_capture() -> None:
    stamper = Stamper("unit-1", "boot", Source.SIMULATED)
    sealed = stamper.stamp(ground(t_exposure_ns=1_000_000_000), 1_085_000_000)
    assert sealed.age_s == pytest.approx(0.085)
    assert stamper.stamp(health(t_ns=2_000_000_000), 2_001_000_000).age_s == pytest.approx(0.001)
    assert (sealed.device, sealed.boot_id, sealed.source) == ("unit-1", "boot", Source.SIMULATED)
    assert sealed.t_publish_ns == 1_085_000_000
