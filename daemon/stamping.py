"""The stamp a published estimate carries, made once for all publishers."""

from messages import TOPIC_OF, Estimate, Source, Stamp, capture_ns


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
