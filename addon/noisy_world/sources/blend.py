# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of a scene of one's own: a .blend, rendered as its artist set it up."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.storage import sha256_of_file
from ..core.geometry import Intrinsics, nearest_rotation, opencv_from_blender_c2w, pose, rotation_error
from ..core.optics import PINHOLE, Optics
from ..core.planning.source import Gives, OwnRendering, RenderOptions, SourceFrame
from ..core.presets.frame_range import LAST_POSSIBLE
from ..core.presets.preset import CameraSpec, Preset
from ..core.presets.scene_keys import SceneSpec
from ..core.scenes.own_scene import OwnScene
from ..core.schema import Place
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.stamps import FrameStamps
from ..core.trajectories.trajectory import Axes, Trajectory
from .beginning import Beginning, check_beginning
from .blend_look import look_at
from .mesh import read_path, sha256_of_path
from .mesh_files import path_file_of

if TYPE_CHECKING:
    from ..blender.own_scene import OwnSceneFile, OwnSceneSession

MOST_SHEAR = 1e-4  # of a camera's axes, as the cosine between two; float32 and deep parents stay far below
WHOLE = 1e-3  # of a frame; stamps in files are rounded, and a scene between two frames is another one


@dataclass(frozen=True)
class BlendSource:
    """A scene of a .blend, with its camera's path or one of a file.

    found: what the scene says of itself. given: the preset's camera; None where the scene's own holds. path_file: of
    the poses, None where the scene's camera moves by itself. known_path, axes: what was read of it. rendering: how it
    is rendered. sampled: whether the preset gives the samples.
    """

    place: Place
    path: Path
    spec: SceneSpec
    found: OwnScene
    given: CameraSpec | None
    path_file: Path | None
    known_path: Trajectory | None
    axes: Axes
    rendering: OwnRendering
    sampled: bool

    @property
    def location(self) -> str:
        """The .blend."""
        return str(self.path)

    @property
    def gives(self) -> Gives:
        """Rendered frames from any pose, by settings of its own."""
        own_path = self.known_path is None and self.found.camera is not None
        cuts = len(set(self._cameras)) if own_path else 1
        only = f"{cuts} cameras take turns on the way, so there is nothing between some frames" if cuts > 1 else ""
        return Gives(rendered=True, any_pose=True, own=self.rendering, instants_only=only, key="blend")

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path in seconds: those of its file, or of the scene's frames from the first on."""
        return self.trajectory().stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the path: colour and depth are rendered at one moment."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        return FrameStamps.of(self.stamps_s)

    @property
    def robot_axes(self) -> Axes:
        """The axes of the path's poses."""
        return self.axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, those of the scene's camera."""
        if asked is not None:
            return asked
        return self.found.sight.intrinsics

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        del camera
        return PINHOLE

    def trajectory(self) -> Trajectory:
        """Return the path: the file's, or that of the scene's camera."""
        return self._path if self.known_path is None else self.known_path

    @cached_property
    def _path(self) -> Trajectory:
        sampled = self.found.camera
        assert sampled is not None, "the look has found one"
        frames = np.array(sampled.frames)
        return Trajectory(rigid_c2w(sampled.matrices, self.place), (frames - frames[0]) / self.found.fps)

    @cached_property
    def scene_frames(self) -> tuple[float, ...]:
        """The scene's frame of each pose, whole or not: the first, and on by the time that has passed on the path."""
        stamps_s = self.stamps_s
        frames = self.found.first + (stamps_s - stamps_s[0]) * self.found.fps
        whole = np.round(frames)
        return tuple(np.where(np.abs(frames - whole) < WHOLE, whole, frames).tolist())

    @property
    def mesh(self) -> None:
        """None: objects of a scene move, and are more than a mesh."""
        return None

    def hashes(self) -> dict[str, Any]:
        """Return the names and hashes of the .blend, of all files that it is made of, and of the path's file."""
        files = [Path(file) for file in self.found.files]
        listed = "".join(f"{sha256_of_file(file)} {file.name}\n" for file in files)
        seen_by = "" if self.found.camera is None else ", ".join(sorted(set(self._cameras)))
        own_path = f"{seen_by} from frame {self.found.first} by {self.found.step}"
        return {
            "blend": self.path.name,
            "blend_sha256": sha256_of_file(self.path),
            "blend_files": ", ".join(file.name for file in files),
            "blend_files_sha256": hashlib.sha256(listed.encode(errors="surrogateescape")).hexdigest(),
            "scene": self.found.scene,
            "blend_camera": seen_by,
            "compositor": self.spec.compositor,
            "depth_alpha": self.spec.depth_alpha,
            "engine": self.rendering.engine,
            "samples": self.rendering.samples,
            "near_m": self.rendering.near_m,
            "far_m": self.rendering.far_m,
            "first_frame": self.found.first,
            "trajectory": own_path if self.path_file is None else self.path_file.name,
            "trajectory_sha256": None if self.path_file is None else sha256_of_path(self.path_file),
        }

    @property
    def _cameras(self) -> tuple[str, ...]:
        assert self.found.camera is not None
        return tuple(sight.camera for sight in self.found.camera.sights)

    @property
    def file(self) -> "OwnSceneFile":
        """What of the .blend is rendered, and how."""
        from ..blender.own_scene import OwnSceneFile

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
            riding=self.known_path is None,
            lens_given=self.given is not None,
            sampled=self.sampled,
            keep_compositor=self.spec.compositor == "keep",
            depth_alpha=self.spec.depth_alpha,
        )

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["PreparedBlend"]:
        """Prepare to render frames; the file is opened when the first path is."""
        for text in (*self.found.notes, *self.trajectory().notes):
            note(text)
        with contextlib.ExitStack() as closing:
            yield PreparedBlend(self, camera, closing)

    def beginning(self, paths: SensorPaths, frames: tuple[int, ...]) -> Beginning | None:
        """Return what a path must not begin with, None where no frame is looked at."""
        if not frames:
            return None
        those = f"frame {frames[0]}" if len(frames) == 1 else f"frames {frames[0]} to {frames[-1]}"
        path = f"{self.found.scene}'s camera" if self.path_file is None else self.path_file.name
        problem = f"{those} of {path} see{'s' * (len(frames) == 1)} no surface of {self.path.name}"
        key = "blend" if self.path_file is None else "trajectory"
        error = self.place.at(key).error(problem, "look at the path, or go on with render.allow_empty: true")
        return Beginning(tuple(map(paths.request, frames)), error)


class PreparedBlend:
    """A .blend that Blender opens once, for all paths through it that the same session can serve."""

    def __init__(self, source: BlendSource, camera: Intrinsics, closing: contextlib.ExitStack) -> None:
        """Keep what is needed to open it. closing: closes the session in the end."""
        self._source = source
        self._camera = camera
        self._closing = closing
        self._session: OwnSceneSession | None = None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenBlend":
        """Return the scene ready to be rendered along the paths. Raises MissingDependencyError where it cannot be."""
        del note  # all is said already
        from ..blender.own_scene import OwnSceneSession

        if self._session is None or not self._session.serves(paths, options):
            self._closing.close()
            session = OwnSceneSession(self._source.file, paths, self._camera, options)
            self._session = self._closing.enter_context(session)
        return OpenBlend(self._session, self._source.beginning(paths, options.first_frames))


class OpenBlend:
    """A scene in Blender with the paths of a render."""

    def __init__(self, session: "OwnSceneSession", beginning: Beginning | None) -> None:
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


def blend_scene(
    preset: Preset, place: Place, spec: SceneSpec, path: Path, *, parts: tuple[str, ...] = ()
) -> BlendSource:
    """Return the source of a .blend. parts: what the entry's wildcards matched.

    Raises InputError where a file is missing or wrong, MissingDependencyError where there is no Blender.
    """
    given = preset.spec.camera
    found = look_at(
        path,
        place,
        scene=spec.scene,
        camera=spec.camera,
        frames=spec.frame_range,
        needs_path=spec.trajectory is None,
        lens_given=given is not None,
    )
    rendering, sampled = _rendering(preset, place, found, given)
    path_file, known, axes = None, None, None
    if spec.trajectory is not None:
        where = place.at("trajectory")
        path_file = path_file_of(preset, where, spec.trajectory, parts)
        seen_with = found.sight.intrinsics if given is None else given.intrinsics
        known, read_as = read_path(path_file, spec.trajectory, where, seen_with)
        axes = None if read_as.axes == "auto" else read_as.axes
    source = BlendSource(place, path, spec, found, given, path_file, known, axes or "opencv", rendering, sampled)
    if max(abs(source.scene_frames[0]), abs(source.scene_frames[-1])) > LAST_POSSIBLE:
        span_s = float(source.stamps_s[-1] - source.stamps_s[0])
        problem = f"lasts {span_s:.6g} s, at {found.fps:g} frames a second longer than a scene of Blender's"
        raise place.at("trajectory").error(problem, "is its stamp_unit right? Or choose poses with start and stop")
    source.trajectory()  # its errors need not wait
    return source


def _rendering(preset: Preset, place: Place, found: OwnScene, given: CameraSpec | None) -> tuple[OwnRendering, bool]:
    """Return how a scene is rendered, and whether the preset gives the samples: what it gives holds, else the file."""
    render = preset.document.get("render") or {}
    told = preset.spec.render
    engine = told.engine if "engine" in render else found.engine
    if engine == "embree":
        problem = "is embree, which knows no lights or materials of a .blend"
        raise preset.place("render.engine").error(problem, "leave it out for the file's own, or use cycles")
    if engine is None:
        problem = f"{found.scene} is rendered by {found.engine_name}, which is not supported"
        raise place.at("blend").error(problem, "set render.engine: cycles or eevee")
    sampled = "samples" in render
    if told.device == "gpu" and engine != "cycles":
        problem = f"is gpu, but {engine} renders with GL, on whatever GL finds"
        raise preset.place("render.device").error(problem, "leave it out, or set render.engine: cycles")
    samples = told.samples if sampled else found.samples[engine]
    near_m, far_m = (found.sight.near_m, found.sight.far_m) if given is None else (given.near_m, given.far_m)
    return OwnRendering(engine, samples, near_m, far_m), sampled


def rigid_c2w(matrices: NDArray[np.float64], place: Place) -> NDArray[np.float64]:
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
