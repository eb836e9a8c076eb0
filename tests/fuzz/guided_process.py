"""One decoder fuzzed in this process, guided by coverage: `python -m tests.fuzz.guided_process NAME DIR SECONDS`.

Apart from `tests.fuzz.guided`, because code is instrumented while it is imported: nothing of the project may be before.
"""

import hashlib
import sys
import tempfile
import warnings
from pathlib import Path

import atheris

PACKAGES = ["messages", "calib", "daemon", "discrepancy", "drivers", "impedance", "perception", "yaml", "tomli"]

with atheris.instrument_imports(include=PACKAGES):
    from tests.fuzz.campaign import longest_s
    from tests.fuzz.damage import FRAGMENTS, LONGEST_BYTES
    from tests.fuzz.decoders import chosen_decoders, outcome

_LONGEST_WORD = 64
"""libFuzzer takes no longer word into its dictionary."""


def main(name: str, folder: Path, seconds: int) -> None:
    """Never returns: the library ends the process."""
    decoder = next(each for each in chosen_decoders(name) if each.name == name)
    corpus, words = folder / "corpus", folder / "words.txt"
    corpus.mkdir(exist_ok=True)
    for sample in decoder.samples():
        (corpus / hashlib.sha256(sample).hexdigest()).write_bytes(sample)
    short = [each for each in FRAGMENTS if len(each) <= _LONGEST_WORD]
    words.write_text("".join(f'"{_escaped(each)}"\n' for each in short))
    options = {
        "max_total_time": seconds,
        "timeout": longest_s(decoder),
        "max_len": min(LONGEST_BYTES, 4 * max(len(each) for each in decoder.samples())),
        "rss_limit_mb": 4096,
        "artifact_prefix": f"{folder}/",
        "dict": words,
        "print_final_stats": 1,
    }
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as place:

        def feed(data: bytes) -> None:
            outcome(decoder, data, Path(place))

        atheris.Setup([sys.argv[0], *(f"-{key}={value}" for key, value in options.items()), str(corpus)], feed)
        atheris.Fuzz()


def _escaped(word: bytes) -> str:
    return "".join(f"\\x{each:02x}" for each in word)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
