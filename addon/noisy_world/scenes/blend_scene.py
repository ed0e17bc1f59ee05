# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene of one's own, in a .blend, says of itself: its camera's path and lens, its settings and its files.

Plain data, which one process tells another as JSON.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import Part, from_content, to_content
from ..core.geometry import Intrinsics
from .polygon_mesh import SceneObject

BlenderEngine: TypeAlias = Literal["cycles", "eevee", "workbench"]
"""The engines that Blender has, by this project's names."""


@dataclass(frozen=True)
class CameraParameters:
    """How a camera of Blender's sees, apart from its pose.

    camera: the object's name. kind: PERSP, ORTHO, PANO or CUSTOM. near_m, far_m: its clipping.
    """

    camera: str
    kind: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    near_m: float
    far_m: float

    @property
    def intrinsics(self) -> Intrinsics:
        """Its pinhole intrinsics. Raises ValueError where it has none."""
        return Intrinsics(self.width_px, self.height_px, self.fx_px, self.fy_px, self.cx_px, self.cy_px)

    @property
    def seen(self) -> tuple[float | int, ...]:
        """What decides where in the image a point is, and whether it is seen."""
        size = (self.width_px, self.height_px)
        return (*size, self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.near_m, self.far_m)


@dataclass(frozen=True)
class SampledCamera:
    """A camera at some frames of a scene.

    frames: the scene's frames. matrices: (N, 4, 4) float64, world_from_camera with Blender's axes, as Blender has it:
    with whatever scale its parents give it. parameters: how it sees at each frame.
    """

    frames: tuple[float, ...]
    matrices: NDArray[np.float64]
    parameters: tuple[CameraParameters, ...]

    @property
    def shots(self) -> NDArray[np.int64] | None:
        """The number of the camera that takes each frame (N,), in the order of appearance; None of one camera."""
        names = [item.camera for item in self.parameters]
        seen = {name: number for number, name in enumerate(dict.fromkeys(names))}
        return np.array([seen[name] for name in names], dtype=np.int64) if len(seen) > 1 else None


@dataclass(frozen=True)
class Problem:
    """Why a scene cannot be a source: the preset's key that it is about, what is wrong, and the remedy."""

    key: str
    problem: str
    remedy: Part


@dataclass(frozen=True)
class OwnScene:
    """A scene of a .blend.

    scene: its name. engine: this project's name of the one that it is set to, None where there is none; engine_name:
    Blender's. samples: those that a pixel gets, by engine. fps: frames a second. first, last, step: its frames. camera:
    at these, or at the first where the path was not asked for; None where it has none. files: all that decide bytes
    beside the .blend, absolute, sorted. problems: why it is no source. notes: what a user should know.
    objects: those with a surface, numbered from 1.
    """

    scene: str
    engine: BlenderEngine | None
    engine_name: str
    samples: dict[str, int]
    fps: float
    first: int
    last: int
    step: int
    camera: SampledCamera | None
    files: tuple[str, ...]
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]
    objects: tuple[SceneObject, ...]

    @property
    def camera_parameters(self) -> CameraParameters:
        """How its camera sees at the first frame; there has to be one."""
        assert self.camera is not None
        return self.camera.parameters[0]

    def content(self) -> dict[str, Any]:
        """Return it as JSON values."""
        plain = asdict(replace(self, problems=()))
        plain["problems"] = [[item.key, item.problem, to_content(item.remedy)] for item in self.problems]
        if self.camera is not None:
            plain["camera"]["matrices"] = self.camera.matrices.tolist()
        return plain

    @classmethod
    def of(cls, content: dict[str, Any]) -> "OwnScene":
        """Return the scene of such values."""
        sampled = content["camera"]
        camera = None
        if sampled is not None:
            matrices = np.array(sampled["matrices"], dtype=np.float64).reshape(-1, 4, 4)
            camera = SampledCamera(
                tuple(sampled["frames"]),
                matrices,
                tuple(CameraParameters(**camera_parameters) for camera_parameters in sampled["parameters"]),
            )
        problems = tuple(Problem(key, problem, from_content(remedy)) for key, problem, remedy in content["problems"])
        lists = {"files": tuple(content["files"]), "notes": tuple(content["notes"])}
        lists["objects"] = tuple(SceneObject(**item) for item in content["objects"])
        return cls(**{**content, **lists, "camera": camera, "problems": problems})
