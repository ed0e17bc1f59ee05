# SPDX-License-Identifier: GPL-3.0-or-later
"""Embree through embreex: which triangle each ray meets first, where in it, and how far away."""

import ctypes
import importlib
import importlib.util
import sys
import weakref
from ctypes import c_char_p, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import Message, MissingDependencyError, NoisyWorldError, PresetKey, either
from ..core.packages import install_command, unavailable


@dataclass(frozen=True)
class Hits:
    """What N rays meet first.

    triangles: (N,) int32; -1 where a ray meets nothing. second, third: (N,) float32, the weights of a triangle's second
    and third corner. lengths: (N,) float32, in lengths of the ray's direction.
    """

    triangles: NDArray[np.int32]
    second: NDArray[np.float32]
    third: NDArray[np.float32]
    lengths: NDArray[np.float32]


class TracedTriangles:
    """Triangles in Embree, seen from both sides. Rays can be cast in several threads at once. scene: embreex's."""

    def __init__(self, vertices_m: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        """Copy the vertices (V, 3) and the vertices of triangles (T, 3), and build the tree.

        Raises MissingDependencyError where embreex cannot be imported.
        """
        scenes, meshes = _embreex()
        # Robust: no ray slips through between two triangles. It is no slower.
        self.scene = scenes.EmbreeScene(robust=True)
        self._mesh = meshes.TriangleMesh(self.scene, np.ascontiguousarray(vertices_m), np.ascontiguousarray(triangles))
        nothing = np.zeros((1, 3), np.float32)
        self.scene.run(nothing, nothing + 1, output=True)  # the first call builds the tree, before threads begin

    def first(self, origins_m: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """Cast rays from origins (N, 3) along directions (N, 3), which may have any length. Lets other threads run."""
        found = self.scene.run(origins_m, directions, output=True)
        missed = found["primID"] < 0
        found["u"][missed] = found["v"][missed] = 0  # Embree leaves there what memory held, which may be no number
        return Hits(found["primID"], found["u"], found["v"], found["tfar"])


def embree_version() -> dict[str, str]:
    """Return the version of what decides rendered bytes. Raises MissingDependencyError where embreex is missing."""
    check_embree()
    return {"embreex": version("embreex")}


def check_embree() -> None:
    """Raise MissingDependencyError where embreex cannot be imported."""
    _embreex()


def _embreex() -> tuple[Any, Any]:
    """Return embreex's modules of scenes and of meshes."""
    try:
        return importlib.import_module("embreex.rtcore_scene"), importlib.import_module("embreex.mesh_construction")
    except ImportError as error:
        python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
        missing = isinstance(error, ModuleNotFoundError)
        problem = f"is missing in this {python}" if missing else f"cannot be imported: {error}"
        instead = Message("use ", PresetKey("render.engine", "cycles"))
        if missing and (where := unavailable("embreex")):
            message = Message(PresetKey("render.engine"), f" is embree, but embreex has no package for {where}")
            raise MissingDependencyError(message, remedy=instead) from error
        message = Message(PresetKey("render.engine"), f" is embree, but embreex {problem}")
        remedy = either(f"run: {install_command('embree')}", instead)
        raise MissingDependencyError(message, remedy=remedy) from error


# The Embree library that embreex ships, called directly: triangles handed over whole, and functions for packets.
#
# embreex itself copies triangle by triangle and casts ray by ray.


# rtcore_*.h of Embree 4.
_MAJOR = 4
_PROPERTY_MAJOR, _PROPERTY_PACKETS_OF_16 = 1, 34
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003
_ROBUST, _FILTER_IN_ARGUMENTS = 1 << 2, 1 << 3

_FUNCTIONS = {
    "rtcNewDevice": (c_void_p, [c_char_p]),
    "rtcGetDeviceProperty": (c_ssize_t, [c_void_p, c_int]),
    "rtcGetDeviceError": (c_int, [c_void_p]),
    "rtcNewScene": (c_void_p, [c_void_p]),
    "rtcSetSceneFlags": (None, [c_void_p, c_int]),
    "rtcNewGeometry": (c_void_p, [c_void_p, c_int]),
    "rtcSetNewGeometryBuffer": (c_void_p, [c_void_p, c_int, c_uint, c_int, c_size_t, c_size_t]),
    "rtcCommitGeometry": (None, [c_void_p]),
    "rtcAttachGeometry": (c_uint, [c_void_p, c_void_p]),
    "rtcReleaseGeometry": (None, [c_void_p]),
    "rtcCommitScene": (None, [c_void_p]),
    "rtcReleaseScene": (None, [c_void_p]),
    "rtcReleaseDevice": (None, [c_void_p]),
}
_INTERSECTORS = {1: "rtcIntersect1", 8: "rtcIntersect8", 16: "rtcIntersect16"}


class LibraryError(Exception):
    """The library is not where embreex has it, or is not the one that is known here."""


@cache
def embree_library() -> ctypes.CDLL:
    """Return the library, with its functions declared. Raises LibraryError."""
    spec = importlib.util.find_spec("embreex")
    if spec is None or not spec.submodule_search_locations:
        raise LibraryError("embreex is missing")
    package = Path(spec.submodule_search_locations[0])
    folder = package / ".dylibs" if sys.platform == "darwin" else package.parent / "embreex.libs"
    found = sorted(folder.glob("*embree4*"))
    if len(found) != 1:
        raise LibraryError(f"{folder} holds {len(found)} Embree libraries, not one")
    try:
        library = ctypes.CDLL(str(found[0]))
        for name, (result, arguments) in _FUNCTIONS.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise LibraryError(f"{found[0].name} cannot be used: {error}") from error
    return library


class PacketScene:
    """Triangles in Embree, seen from both sides, for rays in packets.

    address: of Embree's scene. lanes: how many rays a packet has, 8, or 16 where the processor casts so many at once.
    """

    def __init__(self, vertices_m: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        """Copy the vertices (V, 3) and the vertices of triangles (T, 3), and build the tree.

        Raises LibraryError, and NoisyWorldError where Embree refuses them or has no memory.
        """
        library = self._library = embree_library()
        device = library.rtcNewDevice(None)
        if device is None:
            raise LibraryError(f"Embree does not start: error {library.rtcGetDeviceError(None)}")
        self.address: int = library.rtcNewScene(device)
        self._release = weakref.finalize(self, _release, library, self.address, device)
        if (major := library.rtcGetDeviceProperty(device, _PROPERTY_MAJOR)) != _MAJOR:
            raise LibraryError(f"embreex brings Embree {major}, not {_MAJOR}")
        self.lanes = _packet_size(library, device)
        # Robust, as embreex has it: no ray slips through between two triangles.
        library.rtcSetSceneFlags(self.address, _ROBUST | _FILTER_IN_ARGUMENTS)
        geometry = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, values in ((_VERTEX, _FLOAT3, vertices_m), (_INDEX, _UINT3, triangles)):
            whole = np.ascontiguousarray(values)
            if place := library.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(whole)):
                ctypes.memmove(place, whole.ctypes.data, whole.nbytes)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self.address, geometry)
        library.rtcReleaseGeometry(geometry)  # the scene holds it
        library.rtcCommitScene(self.address)
        if problem := library.rtcGetDeviceError(device):
            self.close()
            raise NoisyWorldError(f"Embree cannot take {len(triangles):,} triangles: error {problem} of rtcore.h")

    def intersector(self, lanes: int) -> int:
        """Return the address of the function that casts a packet of so many rays, or 1."""
        return ctypes.cast(getattr(self._library, _INTERSECTORS[lanes]), c_void_p).value or 0

    def close(self) -> None:
        """Free the triangles."""
        self._release()


def _packet_size(library: ctypes.CDLL, device: int) -> int:
    return 16 if library.rtcGetDeviceProperty(device, _PROPERTY_PACKETS_OF_16) else 8


def _release(library: ctypes.CDLL, scene: int, device: int) -> None:
    library.rtcReleaseScene(scene)
    library.rtcReleaseDevice(device)
