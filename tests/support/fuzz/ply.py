# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files to begin with, and small changes of them that a damaged disk, a careless program or an attacker makes."""

import itertools

from ply_files import ENCODINGS, INDICES, MIXED, NORMAL, POINTS, QUADS, RGB, TRIANGLES, XYZ, ply, vertex

TYPES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double", "int8", "uint16", "float64", "quad")
COUNTS = ("0", "1", "2", "3", "5", "7", "255", "65536", "999999999999", "-1", "1e3", "9" * 40, "")
NAMES = (
    "x", "y", "z", "red", "green", "blue", "alpha", "r", "g", "b", "s", "t", "u", "v", "texture_u", "texture_v",
    "color", "vertex_indices", "vertex_index", "texcoord", "texnumber", "nx", "vertex", "face", "edge",
    "multi_texture_face",
)  # fmt: skip
TEXTURES = (
    "a.png",
    "b.png",
    "gone.png",
    "../a.png",
    "/etc/passwd",
    "C:\\a.png",
    "",
    " ",
    ".",
    "a" * 300,
    "\xe4.png",
    "a b.png",
)
NUMBERS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1",
    b"2",
    b"3",
    b"4",
    b"255",
    b"256",
    b"1e39",
    b"1e400",
    b"-0.0",
    b"0x1",
    b"1.5",
    b"x",
)
PATTERNS = (
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\0\0\xc0\x7f",
    b"\x7f\xc0\0\0",
    b"\3",
)
FULL_HEADER = b"end_header\n"


def seeds():
    """Whole files of every dialect, small enough that most changes hit something."""
    files = []
    for encoding, faces in itertools.product(ENCODINGS, (TRIANGLES, QUADS, MIXED)):
        uv = [tuple(k / 8 for k in range(2 * len(f))) for f in faces]
        colours = [(k * 40, 255 - k, 7) for k in range(len(faces))]
        bare = vertex(XYZ, list(POINTS))
        files += [
            ply(encoding, vertex(), ("face", INDICES, [(f,) for f in faces])),
            ply(encoding, bare, ("face", (*INDICES, *RGB), [(f, *c) for f, c in zip(faces, colours, strict=True)])),
            ply(
                encoding, vertex((*XYZ, *NORMAL, *RGB), [(*p, 0.0, 0.0, 1.0, 9, 8, 7) for p in POINTS]),
                ("face", (*INDICES, "list uchar float texcoord", "int texnumber"),
                 [(f, t, k % 3 - 1) for k, (f, t) in enumerate(zip(faces, uv, strict=True))]),
                extra=("comment TextureFile a.png", "comment TextureFile b.png"),
            ),
            ply(
                encoding, vertex((*XYZ, "float s", "float t"), [(*p, 0.25, 0.75) for p in POINTS]),
                ("face", ("uchar flags", *INDICES), [(1, f) for f in faces]), extra=("comment TextureFile a.png",),
            ),
            ply(
                encoding, ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)]),
                vertex((*XYZ, "float red", "float green", "float blue", "list uchar short tags"),
                       [(*p, 0.25, 0.5, 1.0, (k,) * (k % 2)) for k, p in enumerate(POINTS)]),
                ("face", ("float red", "float green", "float blue", "list uchar int vertex_index"),
                 [(0.5, 0.25, 0.0, f) for f in faces]),
            ),
        ]  # fmt: skip
    return files


def mutate(data, rng):
    """Return a file with one to four changes; rng: a random.Random."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        data = rng.choice(CHANGES)(data, rng)
    return data


def _split(data):
    head, mark, body = data.partition(FULL_HEADER)
    return head.split(b"\n")[:-1], mark, body


def _in_header(change):
    def changed(data, rng):
        lines, mark, body = _split(data)
        if not mark or not lines:
            return data
        change(lines, rng)
        return b"".join(line + b"\n" for line in lines) + mark + body

    return changed


def _in_body(change):
    def changed(data, rng):
        head, mark, body = data.partition(FULL_HEADER)
        return head + mark + bytes(change(bytearray(body), rng)) if body else data

    return changed


def _words(kind, choices):
    """Change a word of the lines that begin with `kind` to one of the choices."""

    def change(lines, rng):
        places = [(i, j) for i, line in enumerate(lines) if line.startswith(kind) for j in range(1, len(line.split()))]
        if places:
            at, word = rng.choice(places)
            words = lines[at].split()
            words[word] = rng.choice(choices).encode("latin-1")
            lines[at] = b" ".join(words)

    return _in_header(change)


def _drop_line(lines, rng):
    del lines[rng.randrange(len(lines))]


def _repeat_line(lines, rng):
    lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines))


def _swap_lines(lines, rng):
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]


def _add_property(lines, rng):
    kind = rng.choice((f"{rng.choice(TYPES)}", f"list {rng.choice(TYPES)} {rng.choice(TYPES)}"))
    lines.insert(rng.randrange(1, len(lines) + 1), f"property {kind} {rng.choice(NAMES)}".encode())


def _add_texture(lines, rng):
    name = rng.choice(TEXTURES).encode(rng.choice(("latin-1", "utf-8")))
    lines.insert(rng.randrange(1, len(lines) + 1), b"comment TextureFile " + name)


def _other_count(lines, rng):
    at = [i for i, line in enumerate(lines) if line.startswith(b"element")]
    if at:
        i = rng.choice(at)
        words = lines[i].split()
        near = int(words[2]) + rng.choice((-2, -1, 1, 2)) if len(words) == 3 and words[2].isdigit() else 1
        lines[i] = b" ".join([*words[:2], rng.choice((str(near), rng.choice(COUNTS))).encode()])


def _other_format(lines, rng):
    lines[:] = [
        f"format {rng.choice(ENCODINGS)} {rng.choice(('1.0', '1.0', '1.0', '1.1', ''))}".encode()
        if line.startswith(b"format") else line
        for line in lines
    ]  # fmt: skip


def _flip(body, rng):
    body[rng.randrange(len(body))] ^= 1 << rng.randrange(8)
    return body


def _replace(body, rng):
    body[rng.randrange(len(body))] = rng.choice((0, 1, 3, 4, 6, 127, 128, 255, rng.randrange(256)))
    return body


def _overwrite(body, rng):
    at, pattern = rng.randrange(len(body)), rng.choice(PATTERNS)
    body[at : at + len(pattern)] = pattern
    return body


def _insert(body, rng):
    at = rng.randrange(len(body) + 1)
    body[at:at] = rng.choice((b"\0", b" ", b"\n", b" 7 ", rng.choice(PATTERNS), rng.randbytes(rng.randrange(1, 40))))
    return body


def _cut_out(body, rng):
    at = rng.randrange(len(body))
    del body[at : at + rng.choice((1, 1, 2, 4, 12, 40))]
    return body


def _number(body, rng):
    """Change a word of a text body."""
    words = bytes(body).split(b" ")
    words[rng.randrange(len(words))] = rng.choice(NUMBERS)
    return b" ".join(words)


def _truncate(data, rng):
    return data[: rng.randrange(len(data) + 1)]


def _line_ends(data, rng):
    lines, mark, body = _split(data)
    end = rng.choice((b"\r\n", b"\r", b" \n", b"\n\n"))
    return b"".join(line + end for line in lines) + mark.strip() + rng.choice((b"\n", end)) + body


def _anywhere(data, rng):
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


CHANGES = (
    _words(b"property", TYPES), _words(b"property", NAMES), _words(b"element", NAMES), _words(b"comment", TEXTURES),
    _in_header(_drop_line), _in_header(_repeat_line), _in_header(_swap_lines), _in_header(_add_property),
    _in_header(_add_texture), _in_header(_other_count), _in_header(_other_count), _in_header(_other_format),
    *map(_in_body, (_flip, _replace, _overwrite, _insert, _cut_out, _number, _flip, _replace, _number)),
    _truncate, _line_ends, _anywhere,
)  # fmt: skip
