"""Flipped bits in frames of set-points, all of them counted: which pass, under AUTOSAR profile 2 and profile 5.

The CRC is affine: what a set of flipped bits does to it does not depend on the payload, so the counts hold for every
frame. Random frames go through the receiver itself.
"""

import itertools
import math

import numpy as np

from messages.arrays import IntArray
from messages.can_frames import CanMessage, profile
from messages.e2e import COUNTERS, E2eCheck, E2eReceiver, Profile, Profile2, Profile5

RANDOM_FRAMES = 200_000


def main() -> None:
    """Print the table."""
    print("| frame | flipped bits | patterns × counters | pass the CRC |")
    print("| --- | --- | ---: | ---: |")
    for message in (CanMessage.SETPOINT, CanMessage.SETPOINT_QUALITY, CanMessage.SETPOINT_FD):
        scheme = profile(message)
        bits = 8 * scheme.length
        counter = range(8, 12) if isinstance(scheme, Profile2) else range(0)
        outside = [bit for bit in range(bits) if bit not in counter]
        for count, among, where in (
            (1, range(bits), ""),
            (2, range(bits), ""),
            (3, outside, " outside the counter" if counter else ""),
        ):
            patterns = math.comb(len(among), count)
            missed = unseen(scheme, among, count)
            rounds = COUNTERS if isinstance(scheme, Profile2) else 1
            print(f"| {message.value} | {count}{where} | {patterns * rounds:,} | {missed} |")
        passed, accepted = random_frames(scheme)
        allowed = 1.0 / 2 ** (8 if isinstance(scheme, Profile2) else 16)
        told = f"{passed} pass the CRC ({RANDOM_FRAMES * allowed:.0f} expected), {accepted} its counter too"
        print(f"| {message.value} | all, at random | {RANDOM_FRAMES:,} | {told} |")


def unseen(scheme: Profile, among: "range | list[int]", count: int) -> int:
    """Return how many patterns of `count` flipped bits leave the CRC right, over all counters."""
    if isinstance(scheme, Profile5):
        return _unseen_5(scheme, among, count)
    combinations = np.array(list(itertools.combinations(among, count)))
    of_bit, of_id = _syndromes_2()
    change = np.bitwise_xor.reduce(of_bit[combinations], axis=1)
    is_counter = (combinations >= 8) & (combinations < 12)
    in_counter = np.where(is_counter, 1 << np.clip(combinations - 8, 0, 3), 0).sum(axis=1)
    ids = np.frombuffer(scheme.data_ids, dtype=np.uint8)
    return sum(int((change == of_id[ids[c]] ^ of_id[ids[c ^ in_counter]]).sum()) for c in range(COUNTERS))


def random_frames(scheme: Profile) -> tuple[int, int]:
    """Return how many frames of random bits pass the CRC, and how many a receiver in the middle of a sequence takes."""
    rng = np.random.default_rng(1001)
    passed = accepted = 0
    for _ in range(RANDOM_FRAMES):
        data = rng.bytes(scheme.length)
        if scheme.is_intact(data):
            passed += 1
            receiver = E2eReceiver(scheme)
            receiver.check(scheme.protected(bytes(scheme.length), 0), 0)
            accepted += receiver.check(data, 1) is E2eCheck.OK
    return passed, accepted


def _syndromes_2() -> tuple[IntArray, IntArray]:
    """Return what each of the 64 bits, and each value of the Data ID, does to the difference of CRCs."""

    def crc(data: bytes, data_id: int = 0) -> int:
        one = Profile2(length=8, data_ids=bytes([data_id]) * COUNTERS, max_delta=1, cycle_s=1.0)
        return one.crc(data)

    zero = crc(bytes(8))
    of_bit = [1 << bit if bit < 8 else crc((1 << bit).to_bytes(8, "little")) ^ zero for bit in range(64)]
    return np.array(of_bit), np.array([crc(bytes(8), value) ^ zero for value in range(256)])


def _unseen_5(scheme: Profile5, among: "range | list[int]", count: int) -> int:
    def off(data: bytes) -> int:
        return int.from_bytes(data[:2], "little") ^ scheme.crc(data)

    zero = off(bytes(scheme.length))
    of_bit = np.array([off((1 << bit).to_bytes(scheme.length, "little")) ^ zero for bit in among])
    if count == 1:
        return int((of_bit == 0).sum())
    first, second = np.triu_indices(len(of_bit), 1)
    pairs = of_bit[first] ^ of_bit[second]
    if count == 2:
        return int((pairs == 0).sum())
    return sum(int((pairs[second < third] == of_bit[third]).sum()) for third in range(len(of_bit)))


if __name__ == "__main__":
    main()
