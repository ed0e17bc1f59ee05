# SPDX-License-Identifier: GPL-3.0-or-later
"""Casting rays in packets: triangles in Embree's own library, and one compiled loop from directions to colours."""

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba.core.config
import numpy as np
from llvmlite import ir
from numba import cfunc, njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from ..core.file_access import alone_in, read_text
from ..scenes.polygon_mesh import NEUTRAL_GREY
from .embree import PacketScene
from .triangles import BYTE, TILE_PX, CastImages, CastMesh, LineView, View, triangle_faces

# What numba lacks for packets of rays: C functions called by address, bytes at addresses, and vectors.


WORD = 4  # bytes


def _called(_typing: Any, address: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        words = cgutils.unpack_tuple(builder, values[1], arguments.count)
        kind = ir.FunctionType(ir.VoidType(), [word.type for word in words])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), words)
        return context.get_dummy_value()

    return types.void(address, arguments), generate


call: Any = intrinsic(_called)
"""Call a C function at an address with a tuple of words of 64 bits."""


def _loaded(_typing: Any, address: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.load(builder.inttoptr(values[0], ir.IntType(8).as_pointer()))

    return types.uint8(address), generate


byte_at: Any = intrinsic(_loaded)
"""Return the byte at an address."""


SLACK = 2.0**-20  # of a length; Embree compares and divides within a few units of 2^-24


def tie_marker(lanes: int) -> Any:
    """Return what marks the rays of a packet that meet two triangles at nearly one length.

    It is given addresses: which rays meet a triangle; at which lengths, which it makes longer by SLACK, so that Embree
    goes on to what is as near; the last lengths, which it replaces; and the marks. In vectors: ray by ray it takes a
    fifth of Embree's own time.
    """
    numbers, masks = ir.VectorType(ir.FloatType(), lanes), ir.VectorType(ir.IntType(32), lanes)

    def mark(_typing: Any, valid: Any, now: Any, last: Any, tied: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            kinds = (masks, numbers, numbers, masks)
            places = [builder.inttoptr(value, kind.as_pointer()) for value, kind in zip(values, kinds, strict=True)]
            meets, lengths, last_lengths, marked = (builder.load(place, align=WORD) for place in places)
            there = builder.icmp_signed("!=", meets, ir.Constant(masks, [0] * lanes))
            slack = builder.fmul(lengths, ir.Constant(numbers, [SLACK] * lanes))
            longer = builder.fadd(lengths, slack)
            near = builder.and_(
                builder.fcmp_ordered("<=", builder.fsub(lengths, slack), last_lengths),
                builder.fcmp_ordered("<=", last_lengths, longer),
            )
            marks = builder.or_(marked, builder.and_(builder.sext(near, masks), meets))
            for place, value in zip(
                places[1:],
                (builder.select(there, longer, lengths), builder.select(there, lengths, last_lengths), marks),
                strict=True,
            ):
                builder.store(value, place, align=WORD)
            return context.get_dummy_value()

        return types.void(valid, now, last, tied), generate

    return intrinsic(mark)


# Rays in packets, and the colours of what they meet, in one loop that numba compiles; imported where numba is.
#
# Neighbouring rays share their way through Embree's tree. But which of two triangles counts that a ray meets at
# nearly one length, at an edge between them or where faces coincide, then hangs on the other rays of the packet. Such
# rays are cast again alone, so that every value is that of a ray cast by itself. Nothing is contracted or reordered
# (no fastmath): colours are those of `colours`, to the bit.


# ruff: noqa: ANN001, ANN202, PLR0917 - numba calls by position and finds the types, from _SIGNATURE


# A packet as Embree 4 has it (RTCRayHit8, RTCRayHit16): of each kind a word of 32 bits for each ray.
_DIRECTION, _LENGTH, _MASK, _SECOND, _THIRD, _TRIANGLE, _GEOMETRY, _INSTANCE = 4, 8, 9, 15, 16, 17, 18, 19
_ACROSS = 4  # rays beside each other; the others are in the rows below

# A thread's words for Embree: what functions are given, aligned as packets of 16 have to be, and then the packet.
_ALIGNED, _MOST_LANES = 64, 16
_VALID = 0
_ARGUMENTS = _VALID + _MOST_LANES
_CONTEXT = _ARGUMENTS + 16
_LAST = _CONTEXT + 16  # at which lengths rays have met something, and then which of them did so twice
_TIED = _LAST + _MOST_LANES
_ALONE = _TIED + _MOST_LANES  # a single ray
_PACKET = _ALONE + 32
_WORDS = _PACKET + 22 * _MOST_LANES

_NOTHING = np.uint32(0xFFFFFFFF)
_ANY_LENGTH = np.float32(1e37)
_COHERENT, _WITH_FILTER = np.uint32(1 << 16), np.uint32(1 << 1)
_HALF, _GREY = np.float32(0.5), np.float32(NEUTRAL_GREY)


_settings: Any = numba.core.config
_mark_8, _mark_16 = tie_marker(8), tie_marker(16)


def _filter_of_8(pointers):
    """Mark ties; Embree calls it (RTCFilterFunctionN) with pointers: valid, user data, context, rays, hits."""
    last = pointers[2] + WORD * (_LAST - _CONTEXT)  # our words lie behind the context's
    _mark_8(pointers[0], pointers[3] + WORD * 8 * _LENGTH, last, last + WORD * (_TIED - _LAST))


def _filter_of_16(pointers):
    """Mark ties of packets of 16."""
    last = pointers[2] + WORD * (_LAST - _CONTEXT)
    _mark_16(pointers[0], pointers[3] + WORD * 16 * _LENGTH, last, last + WORD * (_TIED - _LAST))


@njit
def _workspace(lanes, marker):
    """Return a thread's words, with all that stays as it is for each packet."""
    raw = np.zeros(_WORDS + _ALIGNED // WORD, np.uint32)
    words = raw[(-np.int64(raw.ctypes.data) % _ALIGNED) // WORD :]
    words[_VALID:_ARGUMENTS] = _NOTHING
    words[_ARGUMENTS], words[_ARGUMENTS + 1] = _COHERENT | _WITH_FILTER, _NOTHING  # any feature
    pointers = words[_ARGUMENTS + 2 : _ARGUMENTS + 6].view(np.int64)
    pointers[0], pointers[1] = np.int64(words.ctypes.data) + WORD * _CONTEXT, marker
    words[_CONTEXT:_LAST] = _NOTHING
    words[_ALONE + _MASK] = _NOTHING
    words[_PACKET + _MASK * lanes : _PACKET + (_MASK + 1) * lanes] = _NOTHING
    return words


@njit
def _cast_alone(intersect, scene, words, floats, lanes, lane, x_m, y_m, z_m):
    """Cast one of a packet's rays by itself, from a point."""
    floats[_ALONE], floats[_ALONE + 1], floats[_ALONE + 2] = x_m, y_m, z_m
    for axis in range(3):
        floats[_ALONE + _DIRECTION + axis] = floats[_PACKET + (_DIRECTION + axis) * lanes + lane]
    floats[_ALONE + _LENGTH] = _ANY_LENGTH
    words[_ALONE + _GEOMETRY], words[_ALONE + _INSTANCE] = _NOTHING, _NOTHING
    call(intersect, (scene, np.int64(words.ctypes.data) + WORD * _ALONE, np.int64(0)))
    for kind in (_LENGTH, _SECOND, _THIRD, _TRIANGLE, _GEOMETRY):
        words[_PACKET + kind * lanes + lane] = words[_ALONE + kind]


@njit
def _cast_packet(functions, words, floats, lanes, starts_m, near_m):
    """Cast a packet's rays, and those again alone that met two triangles so, or something too near."""
    scene, intersect, intersect_alone = functions[0], functions[1], functions[2]
    length, direction = _PACKET + _LENGTH * lanes, _PACKET + _DIRECTION * lanes
    for lane in range(lanes):
        floats[length + lane] = _ANY_LENGTH
        words[_PACKET + _GEOMETRY * lanes + lane] = _NOTHING
        floats[_LAST + lane] = np.float32(-1)
        words[_TIED + lane] = np.uint32(0)
    data = np.int64(words.ctypes.data)
    call(intersect, (data + WORD * _VALID, scene, data + WORD * _PACKET, data + WORD * _ARGUMENTS))
    for lane in range(lanes):
        if words[_PACKET + _GEOMETRY * lanes + lane] != _NOTHING:
            floats[length + lane] = floats[_LAST + lane]
        if words[_TIED + lane] != 0:
            x_m, y_m, z_m = floats[_PACKET + lane], floats[_PACKET + lanes + lane], floats[_PACKET + 2 * lanes + lane]
            _cast_alone(intersect_alone, scene, words, floats, lanes, lane, x_m, y_m, z_m)
        if floats[length + lane] < near_m:
            x_m = np.float32(starts_m[lane, 0] + near_m * floats[direction + lane])
            y_m = np.float32(starts_m[lane, 1] + near_m * floats[direction + lanes + lane])
            z_m = np.float32(starts_m[lane, 2] + near_m * floats[direction + 2 * lanes + lane])
            _cast_alone(intersect_alone, scene, words, floats, lanes, lane, x_m, y_m, z_m)
            floats[length + lane] += near_m


@njit
def _between_three(first, at_second, at_third, second, third):
    """Interpolate between the values of a triangle's corners."""
    return (first + (at_second - first) * second) + (at_third - first) * third


@njit
def _neighbours(coordinate, size):
    """Return the texels before and after a coordinate, and how far it is from the first to the second."""
    texel = coordinate * np.float32(size) - _HALF
    floor = np.floor(texel)
    place = np.fmod(floor, np.float32(size))
    if place < np.float32(0):
        place += np.float32(size)
    before = np.int64(place) if place >= np.float32(0) else np.int64(0)
    return before, np.int64(0) if before == size - 1 else before + 1, texel - floor


@njit
def _between_four(low_left, low_right, high_left, high_right, to_right, to_above):
    """Interpolate between the bytes at four addresses."""
    lower, upper = np.float32(byte_at(low_left)), np.float32(byte_at(high_left))
    lower += (np.float32(byte_at(low_right)) - lower) * to_right
    upper += (np.float32(byte_at(high_right)) - upper) * to_right
    return (lower + (upper - lower) * to_above) * BYTE


@njit
def _between_texels(address, width, height, right, up):
    """Interpolate a picture (height, width, 3) at an address; return red, green and blue."""
    column, beside, to_right = _neighbours(right, width)
    row, above, to_above = _neighbours(up, height)
    low, high = address + 3 * width * (height - 1 - row), address + 3 * width * (height - 1 - above)
    a, b, c, d = low + 3 * column, low + 3 * beside, high + 3 * column, high + 3 * beside
    red = _between_four(a, b, c, d, to_right, to_above)
    green = _between_four(a + 1, b + 1, c + 1, d + 1, to_right, to_above)
    return red, green, _between_four(a + 2, b + 2, c + 2, d + 2, to_right, to_above)


def _cast_band(  # noqa: C901, PLR0912 - for numba, a function that is given arrays takes longer than a pixel
    functions, lanes, origins_m, across, down, bent, near_m, far_m, top, bottom,
    colours, corners, uv, uv_corners, shown, pictures, rgb, depth_m, triangles,
):  # fmt: skip
    """Fill in the rows from top to bottom of the images that are not empty, tile by tile; see `Packets.cast`."""
    words = _workspace(lanes, functions[3])
    floats = words.view(np.float32)
    starts_m = np.empty((lanes, 3))
    straight = bent.shape[0] == 0
    last_start_row, last_start_column = origins_m.shape[0] - 1, origins_m.shape[1] - 1
    textured, coloured = shown.shape[0] > 0, corners.shape[0] > 0
    last_column = (across.shape[1] if straight else bent.shape[1]) - 1
    last_row = (down.shape[1] if straight else top + bent.shape[0]) - 1
    for left in range(0, last_column + 1, TILE_PX):
        for y in range(top, bottom, lanes // _ACROSS):
            for x in range(left, min(left + TILE_PX, last_column + 1), _ACROSS):
                for lane in range(lanes):  # beyond the image's edges its last pixels are cast again
                    column, row = min(x + (lane & 3), last_column), min(y + (lane >> 2), last_row)
                    for axis in range(3):
                        at = _PACKET + (_DIRECTION + axis) * lanes + lane
                        if straight:
                            floats[at] = np.float32(across[axis, column] + down[axis, row])
                        else:
                            floats[at] = bent[row - top, column, axis]
                        start_m = origins_m[min(row - top, last_start_row), min(column, last_start_column), axis]
                        starts_m[lane, axis], floats[_PACKET + axis * lanes + lane] = start_m, np.float32(start_m)
                _cast_packet(functions, words, floats, lanes, starts_m, near_m)
                for lane in range(lanes):
                    column, row = min(x + (lane & 3), last_column), min(y + (lane >> 2), last_row)
                    length_m = floats[_PACKET + _LENGTH * lanes + lane]
                    seen = words[_PACKET + _GEOMETRY * lanes + lane] != _NOTHING and length_m <= far_m
                    triangle = np.int64(words[_PACKET + _TRIANGLE * lanes + lane])
                    if depth_m.shape[0] > 0:
                        depth_m[row, column] = length_m if seen else np.float32(0)
                    if triangles.shape[0] > 0:
                        triangles[row, column] = triangle if seen else -1
                    if rgb.shape[0] == 0:
                        continue
                    second = floats[_PACKET + _SECOND * lanes + lane]
                    third = floats[_PACKET + _THIRD * lanes + lane]
                    if seen and textured and shown[triangle] >= 0:
                        shows = shown[triangle]
                        a, b, c = uv_corners[triangle, 0], uv_corners[triangle, 1], uv_corners[triangle, 2]
                        right = _between_three(uv[a, 0], uv[b, 0], uv[c, 0], second, third)
                        up = _between_three(uv[a, 1], uv[b, 1], uv[c, 1], second, third)
                        texels = _between_texels(pictures[shows, 0], pictures[shows, 1], pictures[shows, 2], right, up)
                        rgb[row, column, 0], rgb[row, column, 1], rgb[row, column, 2] = texels
                    elif seen and coloured:
                        a, b, c = corners[triangle, 0], corners[triangle, 1], corners[triangle, 2]
                        for kind in range(3):
                            three = colours[a, kind], colours[b, kind], colours[c, kind]
                            rgb[row, column, kind] = _between_three(*three, second, third)
                    else:
                        for kind in range(3):
                            rgb[row, column, kind] = _GREY if seen else np.float32(0)


def _read(kind: Any, dimensions: int) -> Any:
    return types.Array(kind, dimensions, "C", readonly=True)


_SIGNATURE = types.void(
    *(_read(types.int64, 1), types.int64, _read(types.float64, 3), _read(types.float64, 2), _read(types.float64, 2)),
    *(_read(types.float32, 3), types.float32, types.float32, types.int64, types.int64),
    *(_read(types.float32, 2), _read(types.int32, 2)),
    *(_read(types.float32, 2), _read(types.int32, 2), _read(types.int32, 1), _read(types.int64, 2)),
    *(types.float32[:, :, ::1], types.float32[:, ::1], types.int32[:, ::1]),
)


@cache
def compiled(lanes: int, folder: Path | None) -> tuple[Callable[..., None], int, float]:
    """Return what casts bands in packets of 8 or 16, the address of their filter, and how many seconds compiling took.

    folder: where compiled code is kept and looked for; None for nowhere. Raises ImportError where numba is told to
    compile nothing.
    """
    if _settings.DISABLE_JIT:
        raise ImportError("NUMBA_DISABLE_JIT is set")
    if folder is None:
        return _compiled(lanes, None)
    folder = folder / f"rays-{_digest()}"  # numba itself looks at this file's age, and at the processor
    folder.mkdir(exist_ok=True)
    if not _is_kept(folder):  # of several workers one compiles
        with alone_in(folder):
            if not _is_kept(folder):
                return _compiled(lanes, folder)
    return _compiled(lanes, folder)


def _compiled(lanes: int, folder: Path | None) -> tuple[Callable[..., None], int, float]:
    began_s = time.perf_counter()
    keep = {"cache": folder is not None, "error_model": "numpy"}
    filters = {8: _filter_of_8, 16: _filter_of_16}
    with _kept_in(folder):
        marker: Any = cfunc(types.void(types.CPointer(types.int64)), **keep)(filters[lanes])
        kernel: Any = njit(_SIGNATURE, nogil=True, **keep)(_cast_band)
    found = folder is not None and kernel.stats.cache_hits
    return kernel, marker.address, 0.0 if found else time.perf_counter() - began_s


def _is_kept(folder: Path) -> bool:
    return any(folder.rglob(f"*{_cast_band.__name__}*.nbc"))


def _digest() -> str:
    """Return what stands for all that the compiled code is made of."""
    lines = [read_text(Path(__file__)), numba.__version__, llvmlite.__version__, TILE_PX, BYTE, NEUTRAL_GREY]
    return hashlib.sha256(repr(lines).encode()).hexdigest()[:16]


@contextmanager
def _kept_in(folder: Path | None) -> Iterator[None]:
    """Let numba keep compiled code in a folder, and what others compile where it did."""
    before = _settings.CACHE_DIR
    _settings.CACHE_DIR = "" if folder is None else str(folder)
    try:
        yield
    finally:
        _settings.CACHE_DIR = before


class Packets:
    """Triangles that rays are cast at in packets. compiling_s: the seconds that compiling its code took, if it did."""

    def __init__(self, cast: CastMesh, kept_in: Path | None) -> None:
        """Copy the mesh; its colours are not copied.

        kept_in: the folder of compiled code; None for none. Raises LibraryError where Embree's library is another, and
        ImportError where numba compiles nothing.
        """
        mesh, corners, coloured = cast.mesh, cast.corners, cast.coloured
        vertices = mesh.corner_vertices[corners]
        self._scene = scene = PacketScene(cast.vertices_m, vertices)
        known = compiled.cache_info().misses
        self._kernel, marker, seconds = compiled(scene.lanes, kept_in)
        self.compiling_s = seconds if compiled.cache_info().misses > known else 0.0
        addresses = [scene.address, scene.intersector(scene.lanes), scene.intersector(1), marker]
        self._functions = np.array(addresses, dtype=np.int64)
        self._near_m, self._far_m = np.float32(cast.near_m), np.float32(cast.far_m)
        self._colours, self._colour_corners = _EMPTY_VALUES, _EMPTY_CORNERS
        self._uv, self._uv_corners, self._shown = _EMPTY_VALUES, _EMPTY_CORNERS, np.empty(0, np.int32)
        self._pictures: list[NDArray[np.uint8]] = []
        if coloured and mesh.corner_rgb is not None:
            self._colours, self._colour_corners = np.ascontiguousarray(mesh.corner_rgb), corners
        elif coloured and mesh.rgb is not None:
            self._colours, self._colour_corners = np.ascontiguousarray(mesh.rgb), vertices
        if coloured and (texture := mesh.texture) is not None:
            self._uv, self._uv_corners = np.ascontiguousarray(texture.corner_uv), corners
            self._shown = texture.face_pictures[triangle_faces(mesh)]
            self._pictures = [np.ascontiguousarray(picture) for picture in texture.pictures]
        lines = [(picture.ctypes.data, picture.shape[1], picture.shape[0]) for picture in self._pictures]
        self._told_pictures = np.array(lines, dtype=np.int64).reshape(-1, 3)

    def cast(self, view: View, rows: slice, images: CastImages) -> None:
        """Fill in some rows of the images, without Python's lock. The first row is a multiple of TILE_PX."""
        if isinstance(view, LineView):
            bent = view.directions(rows).reshape(rows.stop - rows.start, -1, 3)
            across, down = _NO_LINES, _NO_LINES
        else:
            bent, across, down = _EMPTY_RGB, view.across, view.down
        self._kernel(
            *(self._functions, self._scene.lanes, view.origins_m(rows), across, down, bent),
            *(self._near_m, self._far_m, rows.start, rows.stop),
            *(self._colours, self._colour_corners),
            *(self._uv, self._uv_corners, self._shown, self._told_pictures),
            _EMPTY_RGB if images.rgb is None else images.rgb,
            _EMPTY_DEPTH if images.depth_m is None else images.depth_m,
            _EMPTY_CORNERS if images.triangles is None else images.triangles,
        )

    def close(self) -> None:
        """Free the triangles."""
        self._scene.close()


_NO_LINES = np.empty((3, 0))
_EMPTY_RGB, _EMPTY_DEPTH = np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.float32)
_EMPTY_VALUES, _EMPTY_CORNERS = np.empty((0, 3), np.float32), np.empty((0, 3), np.int32)
