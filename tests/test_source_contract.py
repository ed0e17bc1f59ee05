# SPDX-License-Identifier: GPL-3.0-or-later
"""Our sources keep the contract that authors test theirs with; what breaks a rule is told which."""

import itertools
import shutil
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import recorded_layouts
from worlds import write_world

from noisy_world import testing
from noisy_world.core.atomic_files import sha256_of_file
from noisy_world.core.errors import InputError
from noisy_world.extend import (
    ComputedSource,
    RenderedFrame,
    SceneKeys,
    SourceCapabilities,
    SingleSceneKind,
    Trajectory,
    key,
)
from noisy_world.sources import SOURCES
from noisy_world.sources.scene_kinds import located_path

# --- ours: for each source what its scene says, and its files ---


def mesh(folder):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    write_world(folder)
    return {"mesh": "mesh.ply", "trajectory": "traj.txt"}


def replica(folder):
    mesh(folder)
    (folder / "room0").mkdir()
    shutil.move(folder / "mesh.ply", folder / "room0_mesh.ply")
    shutil.move(folder / "traj.txt", folder / "room0/traj.txt")
    return {"replica": "room0"}


def sequence(folder):
    (folder / "recorded").mkdir()
    recorded_layouts.tum(folder / "recorded")
    return {"sequence": "recorded"}


def video(folder):
    writer = cv2.VideoWriter(str(folder / "walk.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    (folder / "depth").mkdir()
    for n in range(4):
        writer.write(np.full((48, 64, 3), 40 + 20 * n, np.uint8))
        cv2.imwrite(str(folder / f"depth/{n:04d}.png"), np.full((48, 64), 1000 + n, np.uint16))
    writer.release()
    return {"video": "walk.avi", "depth": "depth"}


def blend(folder):
    pytest.importorskip("bpy", reason="Blender's package is not installed")
    from own_scenes import new_scene, save

    new_scene(samples=1)
    save(folder)
    return {"blend": "hall.blend", "frames": "1:2"}


@pytest.mark.parametrize("name", list(SOURCES))
def test_sources_keep_theirs(name, tmp_path):
    testing.check_source(SOURCES[name], globals()[name](tmp_path), tmp_path)


# --- what breaks a rule ---


@dataclass(frozen=True, kw_only=True)
class WallKeys(SceneKeys):
    wall: str = key("a file that says how far it is")


@dataclass(frozen=True)
class Wall(ComputedSource):
    """A wall across z, as far as a file says, as seen along x."""

    file: object
    location = "a wall"

    def trajectory(self):
        c2w = np.tile(np.eye(4), (4, 1, 1))
        c2w[:, 0, 3] = 0.1 * np.arange(4)
        return Trajectory(c2w, np.arange(4) / 20)

    def hashes(self):
        return {"wall": self.file.name, "wall_sha256": sha256_of_file(self.file)}

    def frame(self, request, camera):
        shape = (camera.height_px, camera.width_px)
        depth_m = np.full(shape, float(self.file.read_text()) - request.depth_c2w[2, 3], np.float32)
        return RenderedFrame(np.full((*shape, 3), abs(request.rgb_c2w[0, 3]) % 1, np.float32), depth_m)


class WallKind(SingleSceneKind):
    name, label, meaning, keys = "wall", "Wall", "a wall", WallKeys

    def __init__(self, source=Wall):
        self.source = source

    def open(self, entry):
        return self.source(located_path(entry.preset, entry.source_place, entry.keys.wall))


class Unseeded(Wall):
    def frame(self, request, camera):
        found = super().frame(request, camera)
        noise = np.random.default_rng().random(found.rgb.shape)
        return RenderedFrame(noise.astype(np.float32), found.depth_m)


class Counting(Wall):
    """What it shows depends on what was asked before, in one session."""

    def frame(self, request, camera):
        asked = self.__dict__.setdefault("asked", itertools.count())
        return RenderedFrame(super().frame(request, camera).rgb, np.full((36, 48), 1 + next(asked), np.float32))


class Painted(Wall):
    def frame(self, request, camera):
        found = super().frame(request, camera)
        return RenderedFrame(np.zeros_like(found.rgb), np.full_like(found.depth_m, float(self.file.read_text())))


class Instants(Wall):
    capabilities = SourceCapabilities(rendered=False, any_pose=True, instants_only="it was recorded")


class Refusing(Wall):
    def frame(self, request, camera):
        return super().frame(request, camera) if request.frame >= 0 else None


class Flat(Wall):
    capabilities = SourceCapabilities(rendered=False, any_pose=True, depth=False)


class Behind(Wall):
    def frame(self, request, camera):
        found = super().frame(request, camera)
        return RenderedFrame(found.rgb, -found.depth_m)


class Bright(Wall):
    def frame(self, request, camera):
        found = super().frame(request, camera)
        return RenderedFrame(255 * found.rgb, found.depth_m)


class Wide(Wall):
    def frame(self, request, camera):
        found = super().frame(request, camera)
        return RenderedFrame(found.rgb[:, ::2], found.depth_m)


class Unhashed(Wall):
    def hashes(self):
        return {"wall": self.file.name}


class Changing(Wall):
    def hashes(self):
        return {"wall": self.__dict__.setdefault("asked", itertools.count()).__next__()}


class Leaving(Wall):
    def trajectory(self):
        self.__dict__.setdefault("opened", self.file.open())
        return super().trajectory()


class Still(Wall):
    stamps_s = np.zeros(4)


class Nameless(WallKind):
    def open(self, entry):
        if not (entry.preset.folder / entry.keys.wall).is_file():
            raise InputError(entry.keys.wall, "is not there")
        return super().open(entry)


class Careless(WallKind):
    def open(self, entry):
        return self.source(entry.preset.folder / entry.keys.wall)


def test_a_source_of_ones_own_keeps_its_contract(tmp_path):
    (tmp_path / "wall.txt").write_text("3")
    testing.check_source(WallKind(), {"wall": "wall.txt"}, tmp_path)


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (WallKind(Unseeded), "is another when it is asked for in another order"),
        (WallKind(Counting), "is another when it is asked for in another order"),
        (WallKind(Painted), "says any_pose, but shows the same from elsewhere"),
        (WallKind(Instants), "says instants_only, but answers between its frames"),
        (WallKind(Refusing), "refuses what is between its frames (there is no frame at 0.025 s"),
        (WallKind(Flat), "says depth=False, but frame 0 has some"),
        (WallKind(Behind), "gives depth that is negative or not finite"),
        (WallKind(Bright), "gives colour that is not in [0, 1]"),
        (WallKind(Wide), "colour of frame 0 is float32 (36, 24, 3), but has to be (H, W, 3) of (36, 48)"),
        (WallKind(Unhashed), "has the same hashes for another wall; hash it"),
        (WallKind(Changing), "has other hashes the second time"),
        (WallKind(Leaving), "wall.txt'] open when its context ends"),
        (WallKind(Still), "has stamps that do not increase"),
        (Nameless(), "does not name the key wall where its file is not there, but says: no_such_file: is not there"),
        (Careless(), "takes a wall that is not there; raise InputError that names the key"),
        (WallKeys(wall="a"), "is a WallKeys, no source"),
    ],
)
def test_a_broken_source_is_told_its_rule(broken, told, tmp_path):
    (tmp_path / "wall.txt").write_text("3")
    with pytest.raises(AssertionError) as raised:
        testing.check_source(broken, {"wall": "wall.txt"}, tmp_path)
    assert told in str(raised.value)
