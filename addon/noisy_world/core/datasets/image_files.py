# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the file of an image is whole: decoders fill in what is lost, and take a length that is wrong at its word."""

import zlib

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9


def damage(data: bytes) -> str:
    """Return what shows that a PNG or JPEG is damaged, "" where nothing does, and for files of other kinds.

    PNG: every chunk lies in the file and has its checksum, up to IEND. JPEG: segments follow one another up to the
    scans, and there is an end; the scans themselves have no checksum.
    """
    if data.startswith(_PNG):
        return _png_damage(data)
    return _jpeg_damage(data) if data.startswith(_JPEG) else ""


def _png_damage(data: bytes) -> str:
    """Walk the chunks: length (4), name (4), content, CRC of name and content (4); ISO/IEC 15948, 5.3."""
    at = len(_PNG)
    while at + 12 <= len(data):
        name, end = data[at + 4 : at + 8], at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            break
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return f"the checksum of its part {name.decode('latin-1')!a} is wrong"
        if name == b"IEND":
            return ""
        at = end + 4
    return "it is cut short"


def _jpeg_damage(data: bytes) -> str:
    """Walk the segments before the first scan: marker (2), length with itself (2), content; ITU-T T.81, B.1."""
    at = len(_JPEG)
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return "its parts do not follow one another"
        marker = data[at + 1]
        if marker == 0xFF:  # fill bytes may stand before a marker
            at += 1
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == _END_OF_IMAGE or length < 2:
            return "its parts do not follow one another"
        at += 2 + length
        if marker == _START_OF_SCAN:  # in scans 0xFF is followed by 0, so this can only be the end
            return "" if data.find(bytes((0xFF, _END_OF_IMAGE)), at) >= 0 else "it is cut short"
    return "it is cut short"
