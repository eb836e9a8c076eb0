"""The stamp a published estimate carries, made once for all publishers."""

from pathlib import Path

from messages import TOPIC_OF, Attitude, Estimate, GroundPlane, Source, Stamp

_BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


def read_boot_id(file: Path = _BOOT_ID_FILE) -> str:
    """Return the identity of this run of the kernel: monotonic times compare only between equal ones."""
    return file.read_text(encoding="ascii").strip()


def capture_ns(estimate: Estimate) -> int:
    """Return the CLOCK_MONOTONIC instant for which `estimate` stands."""
    if isinstance(estimate, GroundPlane):
        return estimate.t_exposure_ns
    return estimate.t_sample_ns if isinstance(estimate, Attitude) else estimate.t_ns


class Stamper:
    """Numbers the estimates of each topic from 0 and tells how old each is when it leaves."""

    def __init__(self, device: str, boot_id: str, source: Source) -> None:
        self._device = device
        self._boot_id = boot_id
        self._source = source
        self._next_seq: dict[str, int] = {}

    def stamp(self, estimate: Estimate, t_publish_ns: int) -> Stamp:
        """Return the stamp of `estimate`, published at `t_publish_ns` on the clock of its capture time."""
        topic = TOPIC_OF[type(estimate)].name
        seq = self._next_seq.get(topic, 0)
        self._next_seq[topic] = seq + 1
        return Stamp(
            device=self._device,
            boot_id=self._boot_id,
            source=self._source,
            seq=seq,
            t_publish_ns=t_publish_ns,
            age_s=1e-9 * (t_publish_ns - capture_ns(estimate)),
        )
