# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh read from any file, in a renderer, along a path that was read or is made."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..channels.channel import Fact
from ..core.atomic_files import sha256_of_file
from ..core.errors import NoisyWorldError
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics, invert_pose
from ..core.lens import PINHOLE, WIDEST_DEG, Distortion, Optics, projected
from ..core.schema import ConfigPath
from ..core.trajectory import Axes, Trajectory, evenly_stamped
from ..preset.keys import Preset
from ..preset.scene_keys import BodySpec, HandheldSpec, TrajectorySpec
from ..preset.sensor_keys import DistortionSpec
from ..render.source import PreparedSource, RenderOptions, SimpleSource, SourceCapabilities, SourceFrame
from ..scenes.mesh_files import check_mesh, imported_format, referenced_files
from ..scenes.ply import read_ply
from ..scenes.polygon_mesh import Mesh, Up, room_mesh, turned
from ..trajectories.bodies import BODIES, embodied
from .renderers import (
    Beginning,
    Rectification,
    RenderSession,
    beginning_of,
    check_beginning,
    lens_of,
    open_session,
    undistorted,
)
from .scene_kinds import path_file_of, read_path, selected_poses, sha256_of_path

# Checking a rendered frame against the mesh, the pose and the intrinsics, without any renderer.
#
# Users of such datasets lose most time with pose conventions. If axes, principal point, focal lengths, scale or pose
# went wrong on the way through the renderer, vertices appear in front of the surface that was rendered.


# Chosen: an error of a convention moves nearly all vertices, a correct frame none but the exceptions named here.
SAMPLES = 20_000  # face corners, so that the check takes milliseconds
TOLERANCE = 0.03  # of the depth: a slanted surface comes nearer between the pixels' centres
ALLOWED = 0.02  # of the vertices: those of things so thin that they meet no pixel's centre
SIDEWAYS = float(np.cos(np.radians(WIDEST_DEG - 1.0)))  # of a vertex's distance: beyond, pixels may have no depth
LEAST = 200  # vertices in view: the share of fewer is too uncertain


def share_in_front(
    mesh: Mesh, c2w: ArrayLike, camera: Intrinsics, depth_m: NDArray[np.float32], lens: Distortion | None = None
) -> float | None:
    """Return the share of vertices in view that are nearer than all depths rendered in the 3 x 3 pixels around them.

    c2w: (4, 4) with OpenCV axes, metres. depth_m: (H, W) planar depth, 0 = void. lens: that distorts; None for a
    pinhole. None where too few are in view.
    """
    used = mesh.corner_vertices[:: max(1, len(mesh.corner_vertices) // SAMPLES)]
    w2c = invert_pose(c2w)
    points_m = mesh.vertices_m[used] @ w2c[:3, :3].T + w2c[:3, 3]
    points_m = points_m[points_m[:, 2] > 0.1]
    if lens is not None:  # which may see farther round than there is a planar depth
        points_m = points_m[points_m[:, 2] > SIDEWAYS * np.linalg.norm(points_m, axis=1)]
    column, row = map(np.rint, projected(points_m, camera, lens))
    inside = (column >= 1) & (column < camera.width_px - 1) & (row >= 1) & (row < camera.height_px - 1)
    if np.count_nonzero(inside) < LEAST:
        return None
    column, row = column[inside].astype(int), row[inside].astype(int)
    around_m = np.stack([depth_m[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    nearest_m = np.where(around_m > 0, around_m, np.inf).min(axis=0)
    return float(np.mean(points_m[inside, 2] < nearest_m * (1 - TOLERANCE)))


def reprojection_problem(
    mesh: Mesh, c2w: ArrayLike, camera: Intrinsics, depth_m: NDArray[np.float32], lens: Distortion | None = None
) -> str | None:
    """Return what is wrong with a rendered depth as a sentence, or None. lens: that distorts; None for a pinhole."""
    share = share_in_front(mesh, c2w, camera, depth_m, lens)
    if share is None or share <= ALLOWED:
        return None
    return f"{share:.0%} of the mesh in view lies in front of the rendered depth: pose or intrinsics went wrong"


# The path of a body's camera, as a preset's `trajectory.body` says, and whether the mesh leaves it room.


def carried_path(route: Trajectory, spec: BodySpec, seed: int, place: ConfigPath) -> Trajectory:
    """Return the path of a body's camera along a route. Raises InputError where no body can follow it."""
    try:
        return embodied(route, spec.kind, seed=seed, motion=spec.motion)
    except NoisyWorldError as error:
        raise place.error(str(error)) from error


def check_room(mesh: Mesh, path: Trajectory, spec: BodySpec, place: ConfigPath) -> None:
    """Refuse a path of a body's camera on which the mesh is too near. Raises InputError."""
    from ..trajectories.room_map import first_narrow

    body = BODIES[spec.kind]
    try:
        narrow = first_narrow(mesh, path, body)
    except NoisyWorldError as error:
        raise place.error(str(error)) from error
    if narrow is not None:
        where = ", ".join(f"{value:.2f}" for value in narrow.place_m)
        raise place.error(
            f"a {spec.kind} cannot go this way: at {narrow.time_s:.2f} s, at ({where}) m, the mesh is "
            f"{narrow.gap_m:.2f} m away, and it needs {body.radius_m} m",
            "take another path, or another body",
        )


# Reading the mesh of any file: PLY by our own reader, other formats by Blender's importers.


def read_mesh(path: Path, up: Up | None = None) -> Mesh:
    """Read a mesh, Z up. up: the axis of the file that points up; None is what it declares, or Z.

    Raises InputError where the file is missing, damaged or no mesh, and where its textures are;
    MissingDependencyError where it takes Blender and there is none.
    """
    return _read(path, up, changed_ns(path))


def forget_meshes() -> None:
    """Keep no mesh in memory."""
    _read.cache_clear()


@lru_cache(maxsize=1)
def _read(path: Path, up: Up | None, changed: tuple[int, ...]) -> Mesh:
    if imported_format(path) is None:
        return turned(read_ply(path), "z", up or "z")
    from .blender_process import import_mesh

    imported = import_mesh(path, up)
    _beside[path, changed] = imported.beside
    return imported.mesh


_beside: dict[tuple[Path, tuple[int, ...]], tuple[Path, ...]] = {}
"""The files that only an importer knows, of meshes that were read: found once, they are not imported again for that."""


def changed_ns(path: Path) -> tuple[int, ...]:
    """Return when a mesh and the files beside it that it is made of were changed last."""
    return tuple(file.stat().st_mtime_ns for file in (path, *referenced_files(path)))


def files_of_mesh(path: Path) -> list[Path]:
    """Return the files beside a mesh that it is made of, those that are there.

    Those of USD are known only once it is imported. Raises as read_mesh does.
    """
    found = imported_format(path)
    if found is None or not found.refers:
        return referenced_files(path)
    known = (path, changed_ns(path))
    if known not in _beside:
        read_mesh(path)
    return list(_beside[known])


SURFACE_FACTS: frozenset[Fact] = frozenset({"normals", "faces", "objects"})  # of its surface


@dataclass(frozen=True)
class MeshSource(SimpleSource):
    """A mesh with a path through it.

    name: of the scene. mesh_path: None is an embedded room. path_file: None where the path is generated in the mesh.
    known_path: the path that was read. seed: of a generated path that has no seed of its own. room: which embedded
    room it is. up: the axis of the mesh's file that points up; None is what the file declares. casts_rays: whether its
    frames are made of rays, as embree's are. distortion: of the lens that it is seen through; None for a pinhole.
    lens_place: where the preset says that.
    """

    name: str
    place: ConfigPath
    mesh_path: Path | None
    spec: TrajectorySpec
    path_file: Path | None
    known_path: Trajectory | None
    seed: int
    room: int = 0
    up: Up | None = None
    casts_rays: bool = False
    distortion: DistortionSpec | None = None
    lens_place: ConfigPath | None = None

    @property
    def location(self) -> str:
        """The mesh."""
        return room_mesh(self.room) if self.mesh_path is None else str(self.mesh_path)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Rendered frames from any pose."""
        return self._capabilities

    @cached_property
    def _capabilities(self) -> SourceCapabilities:
        imported = self.mesh_path is not None and imported_format(self.mesh_path) is not None
        return SourceCapabilities(
            rendered=True,
            any_pose=True,
            imported=imported,
            surface=SURFACE_FACTS,
            casts_rays=self.casts_rays,
            distorts=True,
            depth_cameras=True,
        )

    def optics(self, camera: Intrinsics) -> Optics:
        """Return the lens that its frames show. Raises InputError where it folds over within the image."""
        return PINHOLE if self.distortion is None or self.lens(camera) is None else self.distortion.left

    def lens(self, camera: Intrinsics) -> Distortion | None:
        """Return the lens that rays pass. Raises InputError where it folds over within the image."""
        place = self.lens_place or self.place
        return None if self.distortion is None else lens_of(self.distortion, camera, place, cast=self.casts_rays)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path in seconds; those of a path that is not generated yet follow from its rate."""
        return self._stamps_s

    @cached_property
    def _stamps_s(self) -> NDArray[np.float64]:
        if self.known_path is not None:
            return self.known_path.stamps_s
        from ..trajectories.handheld import walk_problem

        handheld = self._handheld
        if problem := walk_problem(handheld.frames, handheld.rate_hz, handheld.speed_m_s):
            raise self.place.at("trajectory").at("handheld").error(problem)
        still = evenly_stamped(np.broadcast_to(np.eye(4), (handheld.frames, 4, 4)), handheld.rate_hz)
        return selected_poses(still, self.spec, self.place.at("trajectory")).stamps_s

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses: the preset's, or else those of the file."""
        return "opencv" if self.spec.axes == "auto" else self.spec.axes

    @property
    def _handheld(self) -> HandheldSpec:
        assert self.spec.handheld is not None, "a preset has either file or handheld"
        return self.spec.handheld

    def trajectory(self) -> Trajectory:
        """Return the path that was read, or generate one through the mesh; of a body, where it is carried along it."""
        if self.spec.body is not None:
            return self._carried_path
        return self.known_path if self.known_path is not None else self._made_path

    @cached_property
    def _carried_path(self) -> Trajectory:
        assert self.spec.body is not None, "is asked for where there is a body"
        route = self.known_path if self.known_path is not None else self._made_path
        path = carried_path(route, self.spec.body, self.path_seed, self.place.at("trajectory").at("body"))
        self.check_room(path)
        return path

    def check_room(self, path: Trajectory) -> None:
        """Refuse a path of the body's camera on which the mesh is too near. Raises InputError."""
        assert self.spec.body is not None, "is asked for where there is a body"
        mesh = load_mesh(self.mesh_path, self.room, self.up)
        check_room(mesh, path, self.spec.body, self.place.at("trajectory").at("body"))

    @property
    def path_seed(self) -> int:
        """The seed of what is random in the path."""
        handheld = self.spec.handheld
        return self.seed if handheld is None or handheld.seed is None else handheld.seed

    @cached_property
    def _made_path(self) -> Trajectory:
        from ..trajectories.handheld import handheld_path

        spec = self._handheld
        body = None if self.spec.body is None else BODIES[self.spec.body.kind]
        carried = {} if body is None else body.route
        try:
            path = handheld_path(
                load_mesh(self.mesh_path, self.room, self.up),
                seed=self.path_seed,
                frames=spec.frames,
                rate_hz=spec.rate_hz,
                speed_m_s=spec.speed_m_s,
                clearance_m=spec.clearance_m,
                revisit=spec.revisit,
                wander_m=spec.wander_m,
                **carried,
            )
        except NoisyWorldError as error:
            raise self.place.at("trajectory").at("handheld").error(str(error)) from error
        return selected_poses(path, self.spec, self.place.at("trajectory"))

    @property
    def mesh(self) -> Callable[[], Mesh]:
        """Returns the mesh: it is read, or built."""
        return partial(load_mesh, self.mesh_path, self.room, self.up)

    def hashes(self) -> dict[str, Any]:
        """Return the names and hashes of the mesh, of the files beside it that it needs, and of the path's file."""
        beside = [] if self.mesh_path is None else files_of_mesh(self.mesh_path)
        digests = "".join(sha256_of_file(file) or "" for file in beside)
        what = "mesh_files" if self.capabilities.imported else "mesh_textures"
        beside_hashes = {
            what: ", ".join(file.name for file in beside),
            f"{what}_sha256": hashlib.sha256(digests.encode()).hexdigest(),
        }
        return {
            "mesh": room_mesh(self.room) if self.mesh_path is None else self.mesh_path.name,
            "mesh_sha256": None if self.mesh_path is None else sha256_of_file(self.mesh_path),
            "trajectory": "handheld" if self.path_file is None else self.path_file.name,
            "trajectory_sha256": None if self.path_file is None else sha256_of_path(self.path_file),
            **(beside_hashes if beside else {}),
            **({} if self.up is None else {"mesh_up": self.up}),
        }

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator[PreparedSource]:
        """Prepare to render frames; the mesh is read when the first path is opened."""
        with contextlib.ExitStack() as closing:
            yield PreparedMesh(self, camera, note, closing)

    def beginning(self, paths: SensorPaths, frames: tuple[int, ...]) -> Beginning | None:
        """Return what a path of the mesh must not begin with, None where no frame is looked at."""
        unseen, where = f"nothing of {Path(self.location).name}", self.place.at("trajectory")
        if self.path_file is None:
            return beginning_of(
                paths, frames, "the hand-held path", unseen=unseen, place=where, remedy="look at the mesh"
            )
        declared = f"pose ({self.spec.pose}) and axes ({self.spec.axes}) as the file has them"
        remedy = f"is it this mesh's path? Declare {declared}"
        return beginning_of(paths, frames, self.path_file.name, unseen=unseen, place=where, remedy=remedy)


class PreparedMesh:
    """A mesh that a renderer takes in once, for all paths through it that the same session can serve."""

    def __init__(
        self, source: MeshSource, camera: Intrinsics, note: Callable[[str], None], closing: contextlib.ExitStack
    ) -> None:
        """Keep what is needed to build it. closing: closes the session in the end."""
        self._source = source
        self._camera = camera
        self._note = note
        self._noted: set[str] = set()
        self._closing = closing
        self._session: RenderSession | None = None
        self._unchecked: list[Mesh] = []
        self._lens = source.lens(camera)
        again = source.distortion is not None and source.distortion.undistort
        self._rectified = Rectification(camera, Optics(distortion=self._lens), undistort=True) if again else None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenMesh":
        """Return the mesh ready to be rendered along the paths.

        Only where these lie around another point, far from the origin, or need other images is it built again.
        """
        session = self._session
        if session is None or not session.serves(paths, options):
            session = self._build(paths, options)
        beginning = self._source.beginning(paths, options.first_frames)
        lens, seen = (self._lens, self._camera) if options.depth_camera is None else (None, options.depth_camera)
        own = options.depth_camera is not None
        return OpenMesh(
            *(session, self._unchecked, seen, note, beginning), lens=lens, rectified=self._rectified, own_depth=own
        )

    def _build(self, paths: SensorPaths, options: RenderOptions) -> RenderSession:
        self._closing.close()
        self._unchecked.clear()
        mesh = load_mesh(self._source.mesh_path, self._source.room, self._source.up)
        for text in (*mesh.notes, *self._source.trajectory().notes):
            self._tell(text)
        if options.engine == "workbench" and mesh.texture is not None and (mesh.texture.face_pictures < 0).any():
            self._tell("Workbench shows a texture or other colours: faces without a texture are grey")
        opened = open_session(mesh, self._source.name, paths, self._camera, options, lens=self._lens)
        session = self._closing.enter_context(opened)
        for text in session.notes:
            self._tell(text)
        if session.origin_m.any():
            where = ", ".join(f"{value:g}" for value in session.origin_m)
            self._tell(f"far from the origin, so rendered around ({where}) m; poses stay as given")
        self._unchecked.append(mesh)
        self._session = session
        return session

    def _tell(self, text: str) -> None:
        """Say what has not been said of the scene."""
        if text not in self._noted:
            self._noted.add(text)
            self._note(text)


class OpenMesh:
    """A mesh in a renderer with the paths of a render.

    The first frame that is rendered is checked against the mesh, which is then released.
    """

    def __init__(
        self,
        session: RenderSession,
        unchecked: list[Mesh],
        camera: Intrinsics,
        note: Callable[[str], None],
        beginning: Beginning | None = None,
        *,
        lens: Distortion | None = None,
        rectified: Rectification | None = None,
        own_depth: bool = False,
    ) -> None:
        """Keep what frames are rendered with. unchecked: the mesh, until a frame has been checked; then emptied.

        camera, lens: those of depth; own_depth: whether they are its own. rectified: what makes a pinhole's frames of
        them; None leaves them as they are.
        """
        self._session = session
        self._unchecked = unchecked
        self._camera = camera
        self._note = note
        self._beginning = beginning
        self._lens = lens
        self._rectified = rectified
        self._own_depth = own_depth
        self._first = True

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Render a frame. Raises InputError where the path begins with frames that see nothing."""
        frame = self._session.frame(request)
        if self._beginning is not None:
            check_beginning(self._beginning, request, frame, self._session.frame)
        if self._first and frame.depth_m is not None:
            self._check(request, frame.depth_m)
        self._first, self._beginning = False, None
        if self._unchecked:
            self._unchecked.clear()
            forget_rooms_and_meshes()
        return frame if self._rectified is None else undistorted(frame, self._rectified, own_depth=self._own_depth)

    def _check(self, request: FrameRequest, depth_m: NDArray[np.float32]) -> None:
        """Note what looks wrong with the first frame, early enough to stop the run."""
        where = f"{request.time_s:g} s" if request.index is None else f"frame {request.index}"
        if not depth_m.any():
            declared = "is the trajectory of this mesh, and are its pose and axes declared as the file has them?"
            self._note(f"{where} sees nothing; {declared}")
            return
        if request.rays.readout is not None and request.rays.depth_rolls:
            return  # each line is of a pose of its own
        for mesh in self._unchecked:
            if problem := reprojection_problem(mesh, request.depth_c2w, self._camera, depth_m, self._lens):
                self._note(f"{where}: {problem}")


def load_mesh(path: Path | None, room: int = 0, up: Up | None = None) -> Mesh:
    """Read a mesh, or build an embedded room where there is no path; the last ones are cached.

    up: the axis of the file that points up; None is what it declares, or Z. Raises InputError, and
    MissingDependencyError where it takes Blender's importers and there are none.
    """
    return _room(room) if path is None else read_mesh(path, up)


@lru_cache(maxsize=1)
def _room(seed: int) -> Mesh:
    from ..rooms import kept_room

    return kept_room(seed)  # in memory too: a path may need it before the renderer does


def forget_rooms_and_meshes() -> None:
    """Keep no mesh in memory."""
    _room.cache_clear()
    forget_meshes()


def mesh_scene(
    preset: Preset,
    place: ConfigPath,
    name: str,
    mesh_path: Path | None,
    spec: TrajectorySpec,
    *,
    parts: tuple[str, ...] = (),
    path_file: Path | None = None,
    room: int = 0,
    up: Up | None = None,
) -> MeshSource:
    """Return the source of a mesh and its path.

    mesh_path: None is the embedded room of the number `room`. spec: of the path. parts: what the entry's wildcards
    matched. path_file: that of the path, where the entry does not name it. Raises InputError where a file is missing or
    wrong.
    """
    if mesh_path is not None:
        check_mesh(mesh_path)  # the header only: its errors need not wait until earlier scenes are rendered
    seed, where = preset.spec.seed, place.at("trajectory")
    rays = preset.spec.render.engine == "embree"
    lens = preset.spec.mesh_camera.distortion, preset.place("camera").at("distortion")
    if path_file is None and spec.file is None:
        return MeshSource(name, place, mesh_path, spec, None, None, seed, room, up, rays, *lens)
    path = path_file or path_file_of(preset, where, spec, parts)
    chosen, read_as = read_path(path, spec, where, preset.spec.mesh_camera.intrinsics)
    return MeshSource(name, place, mesh_path, read_as, path, chosen, seed, room, up, rays, *lens)
