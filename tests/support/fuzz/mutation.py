# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutations of bytes and of text, drawn from a numpy generator."""

import re

NUMBERS = (
    "0", "-0", "1", "-1", "2", "255", "256", "65536", "2147483648", "4294967296", "9223372036854775808",
    "1e-3", "1e-300", "1e300", "1e999", "-1e999", "0.5", ".5", "5.", "1e", "0x10", "0b1", "010", "1_000", "1:30",
    "nan", "inf", "-inf", ".nan", ".inf", "-.inf", "1" + "0" * 400, "9" * 5000, "0.1e-400", "1403636579763555584",
    "\uff11\uff12", "+1", "--1", "1,5", "true",
)  # fmt: skip
BYTES = (
    b"\0", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\n", b"\t", b" ", b"\x1a", b"\xc3\xa9", b"\x85",
    b"\xe2\x80\xa8", b"\xed\xa0\x80", b"#", b",", b":", b"-", b"{", b"}", b"[", b"]", b'"', b"'", b"&a ", b"*a",
)  # fmt: skip
TIMES = (0, 1, 1, 1, 1, 2, 2, 3)

_TOKEN = re.compile(r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?|\w+|\s+|[^\w\s]", re.ASCII)
_NUMBER = re.compile(r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?", re.ASCII)


def pick(rng, items):
    """Return one of a sequence."""
    return items[int(rng.integers(len(items)))]


def mutate_bytes(data, rng):
    """Return bytes after a few flips, deletions, insertions, repetitions, exchanges and cuts."""
    data = bytearray(data)
    for _ in range(pick(rng, TIMES)):
        at = int(rng.integers(len(data) + 1))
        span = int(rng.integers(1, 1 + max(1, min(len(data), int(2 ** rng.integers(0, 9))))))
        match int(rng.integers(8)):
            case 0 if data:
                data[at % len(data)] ^= 1 << int(rng.integers(8))
            case 1:
                del data[at : at + span]
            case 2:
                data[at:at] = pick(rng, BYTES)
            case 3:
                data[at:at] = data[at : at + span] * int(rng.integers(1, 4))
            case 4:
                del data[at:]
            case 5 if data:
                other = int(rng.integers(len(data)))
                data[at : at + span], data[other : other + span] = data[other : other + span], data[at : at + span]
            case 6:
                data[at : at + span] = rng.bytes(span)
            case _:
                data[at : at + span] = pick(rng, NUMBERS).encode()
    return bytes(data)


def mutate_text(text, rng, words):
    """Return text after a few changes of its tokens. words: texts that mean something in this language."""
    tokens = _TOKEN.findall(text)
    for _ in range(pick(rng, TIMES)):
        if not tokens:
            return pick(rng, words)
        at = int(rng.integers(len(tokens)))
        match int(rng.integers(9)):
            case 0:
                tokens[at] = pick(rng, words)
            case 1:
                tokens.insert(at, pick(rng, words))
            case 2:
                del tokens[at]
            case 3:
                numbers = [k for k, token in enumerate(tokens) if _NUMBER.fullmatch(token)]
                at = pick(rng, numbers) if numbers else at
                is_count = re.fullmatch("[0-9]{1,9}", tokens[at])
                near = [str(int(tokens[at]) + step) for step in (-1, 1)] * 5 if is_count else []
                tokens[at] = pick(rng, [*near, *NUMBERS])
            case 4:
                other = int(rng.integers(len(tokens)))
                tokens[at], tokens[other] = tokens[other], tokens[at]
            case 5:
                end = at + int(rng.integers(1, 30))
                tokens[at:at] = tokens[at:end]
            case 6:
                del tokens[at : at + int(rng.integers(1, 30))]
            case 7:
                tokens[at] = tokens[at].upper() if rng.integers(2) else tokens[at] * int(rng.integers(2, 5))
            case _:
                lines = "".join(tokens).split("\n")
                line = int(rng.integers(len(lines)))
                lines.insert(int(rng.integers(len(lines) + 1)), lines.pop(line) if rng.integers(2) else lines[line])
                tokens = _TOKEN.findall("\n".join(lines))
    return "".join(tokens)


def mutate_mixed(text, rng, words):
    """Return bytes: the text after changes of its tokens or, for a third of the cases, of its bytes."""
    if rng.integers(3) == 0:
        return mutate_bytes(text.encode(), rng)
    return mutate_text(text, rng, words).encode("utf-8", "surrogatepass")
