# SPDX-License-Identifier: GPL-3.0-or-later
"""Packets of rays give what rays cast one by one do, to the bit; compiled code is kept, and what it lacks is said."""

import ctypes
import os
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytest.importorskip("numba", reason="numba is not installed: pip install '.[embree]'")

from analytic import look_at
from cases import cases
from ray_tools import OPTIONS, polygons

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.file_access import private_cache_folder
from noisy_world.scenes.polygon_mesh import Texture
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.render import ray_session, embree, packets as packet_kernel
from noisy_world.render.ray_session import RaySession

CAMERA = Intrinsics(163, 121, 81.5, 60.5, 81.0, 60.0)  # rays along axes and diagonals, and sizes that no tile divides
DICE = np.random.default_rng(3)
PACKET_SIZE = embree._packet_size
VIEWS = np.stack([look_at([0, 0, 0], [0, 1, 0]), look_at([0.1, -0.3, 0.2], [0.4, 1, 0.1], roll_deg=31)])


def walls():
    """A grid whose edges rays meet exactly, each quad twice with other colours, and so before it, slanted; rubble."""
    x, z = (values.ravel() for values in np.meshgrid(np.linspace(-1.5, 1, 6), np.linspace(-1.5, 1, 6)))
    corners = ((0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5))
    quads = np.stack([np.stack([x + right, np.full_like(x, 2), z + up], -1) for right, up in corners], 1)
    rubble = DICE.uniform(-1.5, 1.5, (300, 1, 3)) * [1, 0.8, 1] + [0, 0.9, 0] + DICE.normal(0, 0.1, (300, 3, 3))
    slanted = quads[:18] @ look_at([0, 0, 0], [0.3, 1, 0.4])[:3, :3].T * 0.5 + [0.1, 1.2, 0.1]
    faces = [*quads, *quads[:, ::-1], *slanted, *np.roll(slanted, 1, axis=1), *rubble]
    return polygons(faces, [DICE.integers(0, 256, (len(face), 3)) for face in faces])


def by_corners(mesh):
    return replace(mesh, rgb=None, corner_rgb=DICE.random((len(mesh.corner_vertices), 3), np.float32))


def textured(mesh):
    pictures = tuple(DICE.integers(0, 256, size, np.uint8) for size in ((7, 5, 3), (1, 1, 3), (64, 33, 3)))
    uv = DICE.normal(0, 3, (len(mesh.corner_vertices), 2)).astype(np.float32)
    uv[::50] *= 1e9
    shown = DICE.integers(-1, len(pictures), len(mesh.face_starts)).astype(np.int32)
    return replace(mesh, texture=Texture(("a", "b", "c"), pictures, uv, shown))


def frames(mesh, ways, **options):
    """What is seen by each way of casting, at two poses."""
    paths, seen = SensorPaths(evenly_stamped(VIEWS)), []
    for pays_from in ways:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(ray_session, "PAYS_FROM_RAYS", pays_from)
            with RaySession(mesh, paths, CAMERA, replace(OPTIONS, **options)) as session:
                seen.append([session.frame(paths.request(index)) for index in range(len(VIEWS))])
    return seen


@cases("lanes, samples", [(8, 1), (16, 1), (8, 9), (16, 16)])
@cases("dressed", [lambda mesh: mesh, by_corners, textured, lambda mesh: replace(mesh, rgb=None)])
def test_packets_and_single_rays_are_equal_to_the_bit(dressed, lanes, samples, monkeypatch):
    # Where the processor has no packets of 16, Embree takes them apart and rounds otherwise; they are not used there.
    monkeypatch.setattr(embree, "_packet_size", lambda *device: min(lanes, PACKET_SIZE(*device)))
    options = {"near_m": 0.4, "far_m": 4.0, "threads": 2, "samples": samples}
    options["channels"] = frozenset({"rgb", "depth", "normal"})
    for packets, alone in zip(*frames(dressed(walls()), (0, 10**18), **options), strict=True):
        assert 0.2 < np.mean(packets.depth_m > 0) < 1
        assert packets.colour_rays == alone.colour_rays
        for name in ("rgb", "depth", "normal"):
            assert packets.image(name).tobytes() == alone.image(name).tobytes(), name


def test_a_ray_that_meets_nothing_has_a_place_in_a_triangle():
    """Embree leaves what memory held; a texture would be looked up there."""
    held = {"primID": [-1, 4], "u": [np.nan, 0.25], "v": [3e38, 0.5], "tfar": [1e37, 2.0]}
    found = {name: np.array(values, np.int32 if name == "primID" else np.float32) for name, values in held.items()}
    triangles = object.__new__(embree.TracedTriangles)
    triangles.scene = SimpleNamespace(run=lambda *rays, output: found)
    hits = triangles.first(np.zeros((2, 3), np.float32), np.ones((2, 3), np.float32))
    assert hits.second.tolist() == [0, 0.25]
    assert hits.third.tolist() == [0, 0.5]


def test_rays_meet_ties_here():
    # Where casting a ray alone finds nothing, those that are cast so are void: many, or the test above is none.
    mesh, paths = walls(), SensorPaths(evenly_stamped(VIEWS))
    ((alone, _),) = frames(mesh, [10**18])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ray_session, "PAYS_FROM_RAYS", 0)
        with RaySession(mesh, paths, CAMERA, OPTIONS) as session:
            does_nothing = embree.embree_library().rtcGetSceneFlags
            session._caster._functions[2] = ctypes.cast(does_nothing, ctypes.c_void_p).value
            void = session.frame(paths.request(0)).depth_m == 0
    assert void[alone.depth_m > 0].mean() > 0.2
    assert not void[alone.depth_m < 1.5].all()


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_one_process_compiles_for_all(tmp_path, monkeypatch):
    import fcntl

    alone = []

    def compile_now(lanes, folder):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            alone.append(False)
        except BlockingIOError:
            alone.append(True)
        finally:
            os.close(descriptor)
        (folder / "packet_kernel._cast_band-1.nbc").touch()
        return print, 0, 1.0

    monkeypatch.setattr(packet_kernel, "_compiled", compile_now)
    for lanes in (8, 16):
        packet_kernel.compiled.__wrapped__(lanes, tmp_path)
    assert alone == [True, False]


def test_compiled_code_is_kept_and_the_seconds_are_told_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(ray_session, "PAYS_FROM_RAYS", 0)
    told = []
    for again in (False, False, True):
        if not again:
            packet_kernel.compiled.cache_clear()  # as in a new process
        with RaySession(walls(), SensorPaths(evenly_stamped(VIEWS)), CAMERA, OPTIONS) as session:
            told.append(session.notes)
    assert [len(notes) for notes in told] == [1, 0, 0]
    assert told[0][0].startswith("compiling the code that casts rays took ")
    assert told[0][0].endswith(f"; it is kept in {tmp_path / 'noisy-world'}")
    assert list((tmp_path / "noisy-world").rglob("*.nbi"))


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the folder has another name")
def test_no_cache_that_others_could_write(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "noisy-world"
    assert private_cache_folder() == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o770)
    assert private_cache_folder() is None
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert private_cache_folder() is None


@cases("module", ["numba", "noisy_world.render.packets"])
def test_without_numba_a_line_says_so(monkeypatch, module):
    for name in [name for name in sys.modules if name.startswith("noisy_world.render.packet")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(ray_session, "PAYS_FROM_RAYS", 0)
    with RaySession(walls(), SensorPaths(evenly_stamped(VIEWS)), CAMERA, OPTIONS) as session:
        (note,) = session.notes
    assert note.startswith("rays are cast one by one, which takes twice as long: ")
    assert "[embree]" in note
