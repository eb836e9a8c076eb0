"""Hypothesis strategies for hostile input: a sound document of a decoder, damaged in a few places."""

import re

from hypothesis import strategies as st

LONGEST_BYTES = 1 << 20

_TOKEN = re.compile(rb"[^\s,:=\[\]{}\"']+")
_WORDS = (
    b"nan",
    b"-inf",
    b"1e999",
    b"1e-999",
    b"-1",
    b"0",
    b"1e300",
    b"9" * 25,
    b"9" * 5000,
    b"0x" + b"f" * 5000,
    b"0x_",
    b"0b_",
    b"1:30",
    b"1_000",
    b"2020-99-99",
    b"2020-01-01T99:99:99Z",
    b"true",
    b"null",
    b"''",
    b'"',
    b"x" * 5000,
    b"\xc3\xa4\xe2\x82\xac",
    "٣".encode(),
    b"\xff\xfe",
    b"\xed\xa0\x80",
    b"\x00",
    b"\x1b[31m",
    b"\xe2\x80\xa8",
    b"\\u0000",
    b"\r",
)
FRAGMENTS = (
    *_WORDS,
    b"\n",
    b"\n\n",
    b",",
    b",,,,",
    b"[" * 400,
    b"{" * 400,
    b"[" * 20_000,
    b'{"a":' * 400,
    b"{a: " * 400,
    b"\na = " + b"[" * 390 + b"]" * 390 + b"\n",
    b"- " * 500,
    b"a." * 400 + b"b = 1\n",
    b"\n[" + b"a." * 400 + b"b]\n",
    b"!!int x",
    b"!!bool x",
    b"!!timestamp x",
    b"!!float ''",
    b"!!binary x",
    b"!!set {a}",
    b"!!omap [a: 1]",
    b"!!python/object:os.system x",
    b"!<tag:yaml.org,2002:int> y",
    b"! x",
    b"&a [*a, *a]",
    b"*a",
    b"<<: {a: 1}",
    b"<<: 5",
    b"? [a]\n: b\n",
    b"{[1]: 2}",
    b"\n---\n",
    b"\n...\n",
    b"%YAML 9.9\n",
    b"%TAG ! x\n",
    b"|\n  x",
    b">",
    b"=",
    b"\xef\xbb\xbf",
    b"#",
    b"'''",
    b'"""',
    b"[[x]]\n",
    b"[x]\n[x]\n",
    b"\n  continued\n",
    b"key\n",
    b"; comment\n",
    b"%(a)s",
)


@st.composite
def damaged_text(draw: st.DrawFn, samples: tuple[bytes, ...]) -> bytes:
    """A text in which words are replaced, fragments put in, pieces left out or repeated, or bytes flipped."""
    data = draw(st.sampled_from(samples))
    for _ in range(draw(st.integers(1, 3))):
        how = draw(st.sampled_from(("word", "word", "fragment", "cut", "repeat", "byte")))
        if how == "word":
            tokens = list(_TOKEN.finditer(data))
            if tokens:
                token = tokens[draw(st.integers(0, len(tokens) - 1))]
                data = data[: token.start()] + draw(st.sampled_from(_WORDS)) + data[token.end() :]
        elif how == "fragment":
            place = draw(st.integers(0, len(data)))
            data = data[:place] + draw(st.sampled_from(FRAGMENTS)) + data[place:]
        else:
            data = _cut_repeated_or_flipped(draw, data, how)
    return data[:LONGEST_BYTES]


@st.composite
def damaged_bytes(draw: st.DrawFn, samples: tuple[bytes, ...]) -> bytes:
    """A binary file in which numbers are overwritten, pieces left out or repeated, bytes flipped, or the end cut."""
    data = draw(st.sampled_from(samples))
    for _ in range(draw(st.integers(1, 4))):
        how = draw(st.sampled_from(("number", "number", "cut", "repeat", "byte", "end")))
        if how == "number":
            place, width = draw(st.integers(0, len(data))), draw(st.sampled_from((1, 2, 4, 8)))
            value = draw(st.sampled_from((0, 1, 255, 2**15, 2**31, 2**32 - 1, 2**63, 2**64 - 1))) % 256**width
            data = data[:place] + value.to_bytes(width, "little") + data[place + width :]
        elif how == "end":
            data = data[: draw(st.integers(0, len(data)))]
        else:
            data = _cut_repeated_or_flipped(draw, data, how)
    return data[:LONGEST_BYTES]


def _cut_repeated_or_flipped(draw: st.DrawFn, data: bytes, how: str) -> bytes:
    if not data:
        return data
    first = draw(st.integers(0, len(data) - 1))
    if how == "byte":
        return data[:first] + bytes([draw(st.integers(0, 255))]) + data[first + 1 :]
    end = min(len(data), first + draw(st.integers(1, 60)))
    return data[:first] + data[end:] if how == "cut" else data[:end] + data[first:]
