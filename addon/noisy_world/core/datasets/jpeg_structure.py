# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds damage in a JPEG without decoding it: segments that contradict the standard or one another.

ITU-T T.81, annexes B (segments), C (Huffman tables), F and G (what sequential and progressive scans may hold). Values
that any encoder could have chosen are taken as they are: steps of quantisation, what else is in a scan, what pixels do
not depend on (APPn, comments).
"""

import io
import re
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

from .image_header import DamagedImageError, UnfitImageError, read_exactly
from .jpeg_files import END_OF_IMAGE, FRAMES, RESTARTS, SIGNATURE, START_OF_SCAN, next_segment

# Chosen: libjpeg's own progressive files have 10, and each takes as long as the size in the header asks for.
MOST_SCANS = 100

_DQT, _DHT, _DRI, _ADOBE = 0xDB, 0xC4, 0xDD, 0xEE
_BASELINE, _EXTENDED, _PROGRESSIVE = 0xC0, 0xC1, 0xC2
_IN_BLOCKS = (_BASELINE, _EXTENDED, _PROGRESSIVE, 0xC9, 0xCA)  # with Huffman's codes or arithmetic ones, not lossless
_LAST = 63  # of a block's coefficients
_RUNS = (0x00, 0xF0)  # AC values without bits behind them: the end of a block, and 16 zeros
_DC_BITS, _AC_BITS = 11, 10  # of a coefficient of samples of 8 bits (F.1.2)
# In a scan, 0xFF as data is followed by 0. Spelt so, the search skips from one 0xFF to the next: a tenth of the time.
_MARKER = re.compile(rb"\xff\xff*([^\x00\xff])")

_CUT = "it is cut short"
_APART = "its parts do not follow one another"
_STEPS = "a quantisation table is none that the standard allows"
_CODES = "a Huffman table is none that the standard allows"
_FRAME = "its header contradicts itself"
_SCAN = "the header of a scan does not fit the image"


@dataclass(frozen=True, slots=True)
class _Codes:
    """A Huffman table: the fewest and the most bits that one of its values takes, with what follows it.

    size: the most bits that follow a value. in_sequence: of AC, that it has values of sequential scans alone.
    """

    fewest: int
    most: int
    size: int
    in_sequence: bool


@dataclass(frozen=True, slots=True)
class _Component:
    """A channel: its factors, horizontally and vertically, and its quantisation table."""

    wide: int
    high: int
    table: int


@dataclass
class _JpegState:
    """What is known of a JPEG up to a place in it.

    steps: the numbers of its quantisation tables. codes: by class (0 DC, 1 AC) and number. interval: MCUs from one
    restart to the next, 0 for none. bits: of progressive scans, the lowest bit that each coefficient of a component is
    known to, by both.
    """

    marker: int = 0
    size_px: tuple[int, int] = (0, 0)
    components: dict[int, _Component] = field(default_factory=dict)
    steps: set[int] = field(default_factory=set)
    codes: dict[tuple[int, int], _Codes] = field(default_factory=dict)
    interval: int = 0
    bits: dict[tuple[int, int], int] = field(default_factory=dict)
    scanned: set[int] = field(default_factory=set)
    adobe: int | None = None

    @property
    def largest(self) -> tuple[int, int]:
        """The largest factors of its components."""
        found = self.components.values()
        return max(each.wide for each in found), max(each.high for each in found)


def check_structure(data: bytes) -> None:
    """Raise DamagedImageError where a whole JPEG's file contradicts the standard, UnfitImageError where it has many
    scans. data: with the signature."""
    image, scans, stream = _JpegState(), 0, io.BytesIO(data)
    stream.seek(len(SIGNATURE))
    while True:
        marker, length = next_segment(stream)
        if marker == END_OF_IMAGE:
            break
        content = read_exactly(stream, length)
        if marker == START_OF_SCAN:
            scans += 1
            if scans > MOST_SCANS:
                raise UnfitImageError(f"has more than {MOST_SCANS} scans", "write it anew")
            chosen = _read_scan(image, content)
            stream.seek(_read_entropy_coded(image, chosen, data, stream.tell()))
        else:
            _read_segment(image, marker, content)
    if not scans or set(image.components) != image.scanned:
        raise DamagedImageError(_CUT)


def _read_segment(image: _JpegState, marker: int, content: bytes) -> None:
    """Take what a segment says that is no scan's header."""
    if marker == _DQT:
        image.steps |= _quantisation(content, wide=image.marker != _BASELINE)
    elif marker == _DHT:
        image.codes |= _huffman(content)
    elif marker == _DRI:
        if len(content) != 2:
            raise DamagedImageError(_APART)
        image.interval = int.from_bytes(content, "big")
    elif marker in FRAMES:
        _read_frame(image, marker, content)
    elif marker == _ADOBE and content.startswith(b"Adobe") and len(content) >= 12:
        image.adobe = content[11]


# --- tables ---


@lru_cache(maxsize=64)
def _quantisation(content: bytes, *, wide: bool) -> frozenset[int]:
    """Return the numbers of the tables in a segment (B.2.4.1): precision and number (1), and 64 steps, none of them 0.

    wide: whether steps may have 16 bits, which those of a baseline image have not.
    """
    numbers, at = set[int](), 0
    while at < len(content):
        precision, number = content[at] >> 4, content[at] & 15
        count = 64 * (precision + 1)
        steps = content[at + 1 : at + 1 + count]
        if precision > int(wide) or number > 3 or len(steps) != count:
            raise DamagedImageError(_STEPS)
        if 0 in (steps if precision == 0 else [int.from_bytes(steps[k : k + 2], "big") for k in range(0, count, 2)]):
            raise DamagedImageError("a quantisation table has a step of 0")
        numbers.add(number)
        at += 1 + count
    return frozenset(numbers)


def _huffman(content: bytes) -> dict[tuple[int, int], _Codes]:
    return dict(_huffman_tables(content))


@lru_cache(maxsize=64)
def _huffman_tables(content: bytes) -> tuple[tuple[tuple[int, int], _Codes], ...]:
    """Return the tables in a segment (B.2.4.2): class and number (1), how many codes of each length (16), their values.

    A table has a value once (C.2), no more codes than there are, and none of ones alone.
    """
    found, at = [], 0
    while at < len(content):
        kind, number = content[at] >> 4, content[at] & 15
        counts = content[at + 1 : at + 17]
        values = content[at + 17 : at + 17 + sum(counts)]
        if kind > 1 or number > 3 or len(counts) < 16 or not values or len(values) < sum(counts):
            raise DamagedImageError(_CODES)
        if len(set(values)) < len(values) or sum(count << (15 - k) for k, count in enumerate(counts)) >= 1 << 16:
            raise DamagedImageError(_CODES)
        lengths = [k + 1 for k, count in enumerate(counts) for _ in range(count)]
        sizes = [value if kind == 0 else value & 15 for value in values]
        costs = [length + size for length, size in zip(lengths, sizes, strict=True)]
        in_sequence = all(value & 15 or value in _RUNS for value in values)
        found.append(((kind, number), _Codes(min(costs), max(costs), max(sizes), in_sequence)))
        at += 17 + len(values)
    return tuple(found)


# --- frame and scans ---


def _read_frame(image: _JpegState, marker: int, content: bytes) -> None:
    """Take a frame's header (B.2.2); `jpeg_files` has looked at its length and size."""
    count = content[5] if len(content) > 5 else 0
    if image.components or not count or len(content) != 6 + 3 * count:
        raise DamagedImageError(_FRAME)
    image.marker = marker
    image.size_px = (int.from_bytes(content[3:5], "big"), int.from_bytes(content[1:3], "big"))
    for at in range(6, len(content), 3):
        name, factors, table = content[at : at + 3]
        wide, high = factors >> 4, factors & 15
        if name in image.components or not (1 <= wide <= 4 and 1 <= high <= 4) or table > 3:
            raise DamagedImageError(_FRAME)
        image.components[name] = _Component(wide, high, table)


def _read_scan(image: _JpegState, content: bytes) -> dict[int, tuple[int, int]]:
    """Return the DC and AC tables of the components of a scan (B.2.3), by the components' names."""
    count = content[0] if content else 0
    if not 1 <= count <= 4 or len(content) != 4 + 2 * count or not image.components:
        raise DamagedImageError(_SCAN)
    chosen = {content[at]: (content[at + 1] >> 4, content[at + 1] & 15) for at in range(1, 1 + 2 * count, 2)}
    if len(chosen) != count or not set(chosen) <= set(image.components):
        raise DamagedImageError(_SCAN)
    parts = [image.components[name] for name in chosen]
    tables = max(max(pair) for pair in chosen.values())
    if tables > (1 if image.marker == _BASELINE else 3) or not {each.table for each in parts} <= image.steps:
        raise DamagedImageError(_SCAN)
    if count > 1 and sum(each.wide * each.high for each in parts) > 10:
        raise DamagedImageError(_SCAN)
    _check_codes(image, chosen)
    if image.adobe is not None and len(image.components) == 3 and image.adobe > 1:
        raise DamagedImageError("says of its colours what the standard does not know")
    first, last, bits = content[-3:]
    if image.marker == _PROGRESSIVE:
        _read_progression(image, list(chosen), (first, last), (bits >> 4, bits & 15))
    elif image.marker in (_BASELINE, _EXTENDED) and (
        (first, last, bits) != (0, _LAST, 0) or image.scanned & set(chosen)
    ):
        raise DamagedImageError(_SCAN)
    image.scanned |= set(chosen)
    return chosen


def _check_codes(image: _JpegState, chosen: dict[int, tuple[int, int]]) -> None:
    """Check that the Huffman tables of a scan have no values that samples of 8 bits do not come to."""
    for pair in chosen.values():
        dc, ac = (image.codes.get((kind, number)) for kind, number in enumerate(pair))
        sequential = image.marker != _PROGRESSIVE
        if (dc and dc.size > _DC_BITS) or (ac and (ac.size > _AC_BITS or (sequential and not ac.in_sequence))):
            raise DamagedImageError(_CODES)


def _read_progression(image: _JpegState, names: list[int], band: tuple[int, int], bits: tuple[int, int]) -> None:
    """Check that a progressive scan goes on from those before it (G.1.1.1): each coefficient bit by bit, DC first.

    band: the first and the last of the coefficients. bits: the lowest that they are known to before and after it.
    """
    (first, last), (before, now) = band, bits
    in_band = last == 0 if first == 0 else first <= last <= _LAST and len(names) == 1
    if not in_band or now > 13 or before not in (0, now + 1):
        raise DamagedImageError(_SCAN)
    for name in names:
        if first > 0 and (name, 0) not in image.bits:
            raise DamagedImageError(_SCAN)
        for number in range(first, last + 1):
            if image.bits.get((name, number), 0) != before or (before == 0 and (name, number) in image.bits):
                raise DamagedImageError(_SCAN)
            image.bits[name, number] = now


def _read_entropy_coded(image: _JpegState, chosen: dict[int, tuple[int, int]], data: bytes, start: int) -> int:
    """Return where the data of a scan end; check that they are restarted as they should be, and can be as many."""
    restarts = []
    end = len(data)
    for found in _MARKER.finditer(data, start):
        if found[1][0] not in RESTARTS:
            end = found.start()
            break
        restarts.append(found.span())
        if found[1][0] != RESTARTS[(len(restarts) - 1) % len(RESTARTS)]:
            raise DamagedImageError("its restarts are not in their order")
    if end == len(data):
        raise DamagedImageError(_CUT)
    units = _units(image, list(chosen))
    expected = _ceiling(units, image.interval) - 1 if image.interval else 0
    if len(restarts) != expected and image.marker in _IN_BLOCKS:
        message = f"a scan has {len(restarts)} restarts, where an image of its size has {expected}"
        raise DamagedImageError(message)
    if image.marker in (_BASELINE, _EXTENDED):
        _check_amount(image, chosen, units, data[start:end], len(restarts))
    if any(stop == begin for (_, stop), (begin, _) in pairwise([(start, start), *restarts, (end, end)])):
        raise DamagedImageError("a scan lacks data between two restarts")
    return end


def _units(image: _JpegState, names: list[int]) -> int:
    """Return how many MCUs a scan of some components has (A.2)."""
    most = image.largest
    if len(names) > 1:
        sizes = [_ceiling(size, 8 * factor) for size, factor in zip(image.size_px, most, strict=True)]
    else:
        own = image.components[names[0]]
        factors = zip(image.size_px, (own.wide, own.high), most, strict=True)
        sizes = [_ceiling(_ceiling(size * factor, largest), 8) for size, factor, largest in factors]
    return sizes[0] * sizes[1]


def _ceiling(number: int, divisor: int) -> int:
    return -(-number // divisor)


def _check_amount(
    image: _JpegState, chosen: dict[int, tuple[int, int]], units: int, coded: bytes, restarts: int
) -> None:
    """Raise DamagedImageError where a scan's bytes are too few or too many for its blocks, by the lengths of its codes.

    A block has at least a code for DC and one for AC; at most one for each coefficient. Before each restart and the end
    a byte is filled up.
    """
    low = high = 0
    for name, (dc, ac) in chosen.items():
        own = image.components[name]
        codes = image.codes.get((0, dc)), image.codes.get((1, ac))
        if codes[0] is None or codes[1] is None:  # of Motion JPEG, where decoders take the standard's own
            return
        blocks = units * (own.wide * own.high if len(chosen) > 1 else 1)
        low += blocks * (codes[0].fewest + codes[1].fewest)
        high += blocks * (codes[0].most + _LAST * codes[1].most)
    most = 8 * (len(coded) - 2 * restarts)
    if low > most or (most > high + 8 * restarts + 7 and most - 8 * coded.count(b"\xff\x00") > high + 8 * restarts + 7):
        raise DamagedImageError("a scan has too few or too many bytes for an image of its size")
