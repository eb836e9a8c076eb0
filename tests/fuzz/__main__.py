"""Fuzzes every decoder: `make fuzz`, or `python -m tests.fuzz [--inputs 200000] [--seed 1] [--only NAME] [--keep DIR]`.

The inputs are shared out by what one costs, and drawn in batches, each with a seed of its own. What breaks a decoder is
written to DIR, and the exit code is 1.
"""

import argparse
import hashlib
import math
import sys
import time
from pathlib import Path

from tests.fuzz.campaign import Tally, run
from tests.fuzz.decoders import Decoder, chosen_decoders

BATCH = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="names that begin so")
    parser.add_argument("--keep", type=Path, default=Path("build/fuzz"), help="where to put what breaks a decoder")
    arguments = parser.parse_args()
    chosen = chosen_decoders(arguments.only)
    shares = [1.0 / each.costs for each in chosen]
    print(f"{'decoder':28}{'inputs':>9}{'taken':>9}{'refused':>9}{'faults':>8}{'s':>8}", flush=True)
    total = faults = 0
    for decoder, share in zip(chosen, shares, strict=True):
        start_s = time.monotonic()
        tally = _in_batches(decoder, math.ceil(arguments.inputs * share / sum(shares)), arguments.seed)
        total, faults = total + tally.inputs, faults + len(tally.faults)
        print(
            f"{decoder.name:28}{tally.inputs:9}{tally.taken:9}{tally.refused:9}{len(tally.faults):8}"
            f"{time.monotonic() - start_s:8.0f}",
            flush=True,
        )
        for words, data in tally.faults.items():
            arguments.keep.mkdir(parents=True, exist_ok=True)
            path = arguments.keep / f"{decoder.name.replace(' ', '-')}-{hashlib.sha256(data).hexdigest()[:8]}"
            path.write_bytes(data)
            print(f"    {words}\n    {path}", flush=True)
    print(f"{'all':28}{total:9}{'':18}{faults:8}")
    sys.exit(1 if faults else 0)


def _in_batches(decoder: Decoder, count: int, seed: int) -> Tally:
    whole = Tally()
    for batch, first in enumerate(range(0, count, BATCH)):
        part = run(decoder, min(BATCH, count - first), seed * 1_000_000 + batch)
        whole.taken, whole.refused = whole.taken + part.taken, whole.refused + part.refused
        whole.faults = part.faults | whole.faults
    return whole


if __name__ == "__main__":
    main()
