# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes rendered with their own lights and materials: a .blend as its artist set it up, or a mesh file."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Many
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..channels.channel import Fact
from ..core.atomic_files import sha256_of_file
from ..core.file_access import ScratchFolder
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics, nearest_rotation, opencv_from_blender_c2w, pose, rotation_error
from ..core.lens import Distortion, Optics
from ..core.schema import ConfigPath
from ..core.trajectory import Axes, Trajectory
from ..preset.keys import CameraSpec, Preset
from ..render.source import (
    DRAWN,
    PERTURBED,
    Motion,
    OwnRendering,
    RenderedFrame,
    RenderOptions,
    SimpleSource,
    SourceCapabilities,
    SourceFrame,
)
from ..scenes.blend_scene import OwnScene
from ..scenes.mesh_files import imported_format
from ..scenes.polygon_mesh import SceneObject
from ..scenes.sun_air import SunAir
from .blender_process import last_words, write_lit_file
from .rendered_mesh import MeshSource
from .renderers import Beginning, beginning_of, check_beginning, check_light_lens, lens_of
from .scene_kinds import sha256_of_path

if TYPE_CHECKING:
    from ..render.own_scene import OwnSceneFile, OwnSceneSession


SEEN: frozenset[Fact] = frozenset({"normals", "objects"})  # of the surface of objects
PERTURBED_LIGHT = {PERTURBED: "before the view transform", DRAWN: 2}  # 2: fewer sheets of other particles
MOST_SHEAR = 1e-4  # of a camera's axes, as the cosine between two; float32 and deep parents stay far below
WHOLE = 1e-3  # of a frame; stamps in files are rounded, and a scene between two frames is another one


@dataclass(frozen=True)
class BlendSource(SimpleSource):
    """A scene of a .blend, with its camera's path or one of a file.

    compositor, depth_alpha: as the preset has them. found: what the scene says of itself. given: the preset's camera;
    None where the scene's own holds. path_file: of the poses, None where the scene's camera moves by itself.
    known_path, axes: what was read of it. rendering: how it is rendered. sampled: whether the preset gives the samples.
    lens_place: where the preset says the lens. sun_air: what softens its sun lamps; None where nothing does. mirrors:
    whether air is behind what surfaces mirror, too.
    """

    place: ConfigPath
    path: Path
    compositor: str
    depth_alpha: float
    found: OwnScene
    given: CameraSpec | None
    path_file: Path | None
    known_path: Trajectory | None
    axes: Axes
    rendering: OwnRendering
    sampled: bool
    lens_place: ConfigPath
    sun_air: SunAir | None = None
    mirrors: bool = False

    @property
    def location(self) -> str:
        """The .blend."""
        return str(self.path)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Rendered frames from any pose, by settings of its own."""
        own_path = self.known_path is None and self.found.camera is not None
        cuts = len(set(self._cameras)) if own_path else 1
        only = f"{cuts} cameras take turns on the way, so there is nothing between some frames" if cuts > 1 else ""
        return SourceCapabilities(
            rendered=True,
            any_pose=True,
            own=self.rendering,
            surface=SEEN,
            objects=self._objects,
            moving=True,
            instants_only=only,
            casts_rays=not (at_once := self._at_once),
            at_once=at_once,
            lit=True,
            distorts=True,
            passes=True,
        )

    @property
    def _at_once(self) -> str:
        if self.compositor == "keep":
            return "reads line after line, and the .blend's compositor is for whole frames"
        if self.mirrors:
            return "reads line after line, and what surfaces mirror (air.reflections) is told of whole frames"
        return lines_of(self.rendering.engine)

    def _objects(self) -> tuple[SceneObject, ...]:
        return self.found.objects

    @property
    def robot_axes(self) -> Axes:
        """The axes of the path's poses."""
        return self.axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, those of the scene's camera."""
        if asked is not None:
            return asked
        return self.found.camera_parameters.intrinsics

    def optics(self, camera: Intrinsics) -> Optics:
        """Return the lens that its frames show. Raises InputError where it folds over within the image."""
        return Optics(distortion=self.lens(camera))

    def lens(self, camera: Intrinsics) -> Distortion | None:
        """Return the lens that light passes. Raises InputError where it folds over, or a pinhole would be too large."""
        spec = None if self.given is None else self.given.distortion
        return None if spec is None else lens_of(spec, camera, self.lens_place, cast=False)

    def trajectory(self) -> Trajectory:
        """Return the path: the file's, or that of the scene's camera."""
        return self._path if self.known_path is None else self.known_path

    @cached_property
    def _path(self) -> Trajectory:
        sampled = self.found.camera
        assert sampled is not None, "the look has found one"
        frames = np.array(sampled.frames)
        stamps_s = (frames - frames[0]) / self.found.fps
        return Trajectory(rigid_c2w(sampled.matrices, self.place), stamps_s, shots=sampled.shots)

    @cached_property
    def scene_frames(self) -> tuple[float, ...]:
        """The scene's frame of each pose, whole or not: the first, and on by the time that has passed on the path."""
        stamps_s = self.stamps_s
        frames = self.found.first + (stamps_s - stamps_s[0]) * self.found.fps
        whole = np.round(frames)
        return tuple(np.where(np.abs(frames - whole) < WHOLE, whole, frames).tolist())

    def hashes(self) -> dict[str, Any]:
        """Return the names and hashes of the .blend, of all files that it is made of, and of the path's file."""
        files = [Path(file) for file in self.found.files]
        listed = "".join(f"{sha256_of_file(file)} {file.name}\n" for file in files)
        seen_by = "" if self.found.camera is None else ", ".join(sorted(set(self._cameras)))
        own_path = f"{seen_by} from frame {self.found.first} by {self.found.step}"
        # 1: the version of the law
        air = {} if self.sun_air is None else {"sun_air": 1, **asdict(self.sun_air)}
        air |= {"reflections": 1} if self.mirrors else {}
        return {
            "blend": self.path.name,
            "blend_sha256": sha256_of_file(self.path),
            "blend_files": ", ".join(file.name for file in files),
            "blend_files_sha256": hashlib.sha256(listed.encode(errors="surrogateescape")).hexdigest(),
            "scene": self.found.scene,
            "blend_camera": seen_by,
            "compositor": self.compositor,
            "depth_alpha": self.depth_alpha,
            "engine": self.rendering.engine,
            "samples": self.rendering.samples,
            "near_m": self.rendering.near_m,
            "far_m": self.rendering.far_m,
            "first_frame": self.found.first,
            **air,
            **PERTURBED_LIGHT,
            "trajectory": own_path if self.path_file is None else self.path_file.name,
            "trajectory_sha256": None if self.path_file is None else sha256_of_path(self.path_file),
        }

    @property
    def _cameras(self) -> tuple[str, ...]:
        assert self.found.camera is not None
        return tuple(camera.camera for camera in self.found.camera.parameters)

    @property
    def file(self) -> "OwnSceneFile":
        """What of the .blend is rendered, and how."""
        from ..render.own_scene import OwnSceneFile

        count = len(self.scene_frames)
        if self.found.camera is None:
            cameras: tuple[str | None, ...] = (None,) * count
        else:
            cameras = self._cameras if self.known_path is None else self._cameras[:1] * count
        return OwnSceneFile(
            path=self.path,
            scene=self.found.scene,
            frames=self.scene_frames,
            stamps_s=tuple(self.stamps_s.tolist()),
            fps=self.found.fps,
            cameras=cameras,
            follows=self.known_path is None,
            lens_given=self.given is not None,
            sampled=self.sampled,
            keep_compositor=self.compositor == "keep",
            depth_alpha=self.depth_alpha,
            sun_air=self.sun_air,
            mirrors=self.mirrors,
        )

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["PreparedBlend"]:
        """Prepare to render frames; the file is opened when the first path is."""
        for text in (*self.found.notes, *self.trajectory().notes):
            note(text)
        with contextlib.ExitStack() as closing:
            yield PreparedBlend(partial(self._opened, camera), self.beginning, closing)

    def _opened(
        self, camera: Intrinsics, paths: SensorPaths, options: RenderOptions, closing: contextlib.ExitStack
    ) -> "OwnSceneSession":
        from ..render.own_scene import OwnSceneSession

        closing.enter_context(last_words(self.path, "rendered it"))
        return OwnSceneSession(self.file, paths, camera, options, lens=self.lens(camera))

    def beginning(self, paths: SensorPaths, frames: tuple[int, ...]) -> Beginning | None:
        """Return what a path must not begin with, None where no frame is looked at."""
        path = f"{self.found.scene}'s camera" if self.path_file is None else self.path_file.name
        where = self.place.at("blend" if self.path_file is None else "trajectory")
        unseen = f"no surface of {self.path.name}"
        return beginning_of(paths, frames, path, unseen=unseen, place=where, remedy="look at the path")


def lines_of(engine: str) -> str:
    """Return why the lines of a scene's frames cannot be rendered each at its own moment; "" where they can."""
    return "" if engine == "cycles" else "reads line after line, which Cycles alone can render of a scene with lights"


class SceneSession(Protocol):
    """A scene in Blender along paths, as OwnSceneSession is.

    blurs, denoises: whether motion blur and denoising are set up in it.
    """

    blurs: bool
    denoises: bool

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        ...

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame."""
        ...

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return how what the colour camera sees moves between two frames; None where they show the same moment."""
        ...

    def __enter__(self) -> Any:
        """Enter it."""
        ...

    def __exit__(self, *error: object) -> None:
        """Close it."""
        ...


@dataclass
class PreparedBlend:
    """A .blend that Blender opens once, for all paths through it that the same session can serve.

    opened: returns the file opened for a path. beginning: what a path must not begin with. closing: closes the session
    in the end, and what `opened` adds to it.
    """

    opened: Callable[[SensorPaths, RenderOptions, contextlib.ExitStack], SceneSession]
    beginning: Callable[[SensorPaths, tuple[int, ...]], Beginning | None]
    closing: contextlib.ExitStack
    session: SceneSession | None = None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenBlend":
        """Return the scene ready to be rendered along the paths. Raises MissingDependencyError where it cannot be."""
        session = self.session
        if session is None or not session.serves(paths, options):
            self.session = None
            self.closing.close()
            session = self.opened(paths, options, self.closing)
            self.closing.enter_context(session)
            if options.instants and session.blurs:
                note("motion blur is set up in the .blend, and off where a setting exposes its frames itself")
            if options.read_lines and session.denoises:
                note("denoising is off where lines are read one after another, as it needs whole frames")
            self.session = session
        return OpenBlend(session, self.beginning(paths, options.first_frames))


class OpenBlend:
    """A scene in Blender with the paths of a render."""

    def __init__(self, session: SceneSession, beginning: Beginning | None) -> None:
        """Keep what frames are rendered with."""
        self._session = session
        self._beginning = beginning

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Render a frame. Raises InputError where the path begins with frames that see nothing."""
        frame = self._session.frame(request)
        if self._beginning is not None:
            check_beginning(self._beginning, request, frame, self._session.frame)
            self._beginning = None
        return frame

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return how what the colour camera sees moves between two frames; None where they show the same moment."""
        return self._session.motion(here, there)


def rigid_c2w(matrices: NDArray[np.float64], place: ConfigPath) -> NDArray[np.float64]:
    """Return matrices (N, 4, 4) of Blender's cameras as rigid poses c2w with OpenCV's axes.

    Blender renders along a camera's axes, whatever their lengths. Raises InputError where they are not at right angles,
    or mirrored: then the image is none of a pinhole camera's.
    """
    axes = matrices[:, :3, :3]
    lengths = np.linalg.norm(axes, axis=-2, keepdims=True)
    if not np.isfinite(matrices).all() or (lengths == 0.0).any():
        raise place.at("camera").error("has no size at some frame, so it has no axes", "mend its scale or its parents'")
    axes = axes / lengths
    if (rotation_error(axes) > MOST_SHEAR).any() or (np.linalg.det(axes) < 0).any():
        problem = "is sheared or mirrored by the scale of what it hangs on, so its images are no pinhole camera's"
        raise place.at("camera").error(problem, "apply the scale of its parents, or bake its motion")
    return opencv_from_blender_c2w(pose(nearest_rotation(axes), matrices[:, :3, 3]))


# The source of a mesh file rendered lit: with the file's own lights and materials, along the path of the mesh.


T = TypeVar("T")

LIT_SAMPLES = 64  # chosen: of a pixel, where the preset says none
DEPTH_ALPHA = 0.5  # what is less opaque does not stop depth, as by default of a .blend
SCENE = "Scene"  # as Blender's empty file names its scene
_ROOM_FOR_EACH_BYTE = 4  # chosen: a .blend takes more than the mesh's file


@dataclass(frozen=True, kw_only=True)
class LitMeshSource(MeshSource):
    """A mesh with a path, rendered with the lights and materials of its file."""

    rendering: OwnRendering

    @property
    def capabilities(self) -> SourceCapabilities:
        """Rendered frames from any pose, by settings of its own."""
        at_once = lines_of(self.rendering.engine)
        return replace(
            super().capabilities,
            own=self.rendering,
            casts_rays=not at_once,
            at_once=at_once,
            surface=SEEN,
            objects=lambda: self._objects,
            lit=True,
            depth_cameras=False,
        )

    @cached_property
    def _objects(self) -> tuple[SceneObject, ...]:
        """Its objects, which an importer has to tell."""
        assert self.mesh_path is not None
        scratch = _room_for(self.mesh_path)
        try:
            return write_lit_file(self.mesh_path, scratch.path / "lit.blend", self.up)[1]
        finally:
            scratch.remove()

    def hashes(self) -> dict[str, Any]:
        """Return those of the mesh and its path, and how it is rendered."""
        own = self.rendering
        how = {"engine": own.engine, "samples": own.samples, "near_m": own.near_m, "far_m": own.far_m}
        return {**super().hashes(), "light": "scene", **how, **PERTURBED_LIGHT}

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator[PreparedBlend]:
        """Prepare to render frames; the file is imported when the first path is opened."""

        lens = self.lens(camera)

        def opened(paths: SensorPaths, options: RenderOptions, closing: contextlib.ExitStack) -> "OwnSceneSession":
            from ..render.own_scene import OwnSceneFile, OwnSceneSession

            assert self.mesh_path is not None
            scratch = _room_for(self.mesh_path)
            closing.callback(scratch.remove)
            lit = scratch.path / "lit.blend"
            notes, _ = write_lit_file(self.mesh_path, lit, self.up)
            for text in (*notes, *self.trajectory().notes):
                note(text)
            file = file_of(lit, self.stamps_s.tolist(), OwnSceneFile)
            return OwnSceneSession(file, paths, camera, options, lens=lens)

        with contextlib.ExitStack() as closing:
            yield PreparedBlend(opened, self.beginning, closing)


def _room_for(mesh: Path) -> ScratchFolder:
    return ScratchFolder(_ROOM_FOR_EACH_BYTE * mesh.stat().st_size)


def file_of(lit: Path, stamps_s: Many[float], kind: Callable[..., T]) -> T:
    """Return what of the file is rendered: one frame of its scene, through plain cameras, at the path's stamps."""
    count = len(stamps_s)
    return kind(
        path=lit,
        scene=SCENE,
        frames=(1.0,) * count,
        stamps_s=tuple(stamps_s),
        fps=0.0,
        cameras=(None,) * count,
        follows=False,
        lens_given=True,
        sampled=True,
        keep_compositor=False,
        depth_alpha=DEPTH_ALPHA,
    )


def lit_mesh(preset: Preset, plain: MeshSource) -> LitMeshSource:
    """Return the source of a mesh that is rendered lit. Raises InputError where it cannot be."""
    assert plain.mesh_path is not None
    found = imported_format(plain.mesh_path)
    if found is None or found.name == "STL":
        name = "a PLY file" if found is None else "an STL file"
        raise plain.place.at("light").error(f"is scene, but {name} holds no lights", "leave it out")
    render_spec, given = preset.spec.render, preset.document.get("render") or {}
    engine = render_spec.engine if "engine" in given else "cycles"
    if engine == "embree":
        problem = "is embree, which knows no lights"
        raise preset.place("render.engine").error(problem, "leave light: scene out, or use cycles")
    camera = preset.spec.mesh_camera
    check_light_lens(preset)
    samples = render_spec.samples if "samples" in given else LIT_SAMPLES
    rendering = OwnRendering(engine, samples, camera.near_m, camera.far_m)
    return LitMeshSource(**{item.name: getattr(plain, item.name) for item in fields(plain)}, rendering=rendering)
