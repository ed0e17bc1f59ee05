# SPDX-License-Identifier: GPL-3.0-or-later
"""A store of clean frames: what perturbations take, before it is rounded, with the paths that the frames lie on.

It holds, for each scene, `SCENE/path.npy`, and for each render `RENDER/rgb/000012.npy` and `RENDER/depth/000012.npy`,
float32, one file a source frame, with `RENDER/frames.jsonl` for their hashes. `clean.json` is written first: what they
were made from. Uncompressed, since reading counts: 2 ms for the colour of 1200 x 680 pixels, where OpenEXR's fastest
compression takes 18 ms, longer than most perturbations, for 0.6 of the bytes.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS
from ..core.datasets.dataset_state import identity_problem
from ..core.datasets.differences import COMMON, first_difference
from ..core.datasets.json_text import read_json
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.provenance import FORMAT as IDENTITY_FORMAT
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.optics import PINHOLE, Optics
from ..core.planning.source import ColourAndDepth, Gives, PreparedSource
from ..core.regular_files import read_array
from ..core.trajectories.stamps import FrameStamps
from ..core.trajectories.trajectory import Axes, Trajectory
from .inputs import different_input

CLEAN = "clean.json"
PATH = "path.npy"
KIND = "clean frames of Noisy World"
FORMAT = 1  # version of the store; raised when its files change
AGAIN = "run 'noisy-world render-clean' again: it makes what is missing or damaged"


def image_name(modality: Modality, source: int) -> str:
    """Return the name of an image in the folder of its render."""
    return f"{modality}/{source:06d}.npy"


@dataclass(frozen=True)
class CleanStore:
    """A store of clean frames. identity: what they were made from, as in a dataset's manifest, and robot_axes."""

    folder: Path
    identity: Mapping[str, Any]

    def has_scene(self, scene: str) -> bool:
        """Tell whether it holds the path of a scene."""
        return scene in self.identity["scenes"] and (self.folder / scene / PATH).is_file()

    def frame(self, render: str, source: int) -> "StoredClean | None":
        """Return a source frame of a render; None where it holds none of its images."""
        frame = StoredClean(self.folder / render, source)
        return frame if any(frame.path(name).is_file() for name in CHANNELS) else None

    def source(self, scene: str) -> "StoredScene":
        """Return what is known of a scene, as a source. Raises InputError where its path is damaged."""
        path = self.folder / scene / PATH
        rows = _array(path)
        if rows.ndim != 2 or rows.shape[1] != 17 or rows.dtype != np.float64 or not len(rows):
            raise InputError(path, f"is {rows.dtype} {rows.shape}, but a path is float64 (N, 17)", remedy=AGAIN)
        known = self.identity["scenes"][scene]
        axes = known.get("robot_axes")
        return StoredScene(self.folder / scene, Trajectory(rows[:, 1:].reshape(-1, 4, 4), rows[:, 0]), axes, known)

    def check(self, wanted: Mapping[str, Any], scene: str, setting: str) -> None:
        """Raise InputError where its frames of a scene are not those of a recipe; see `difference`."""
        if problem := self.difference(wanted, scene, setting):
            remedy = "take the clean frames that were made from this recipe"
            raise InputError(self.folder, f"holds frames of another recipe: {problem}", remedy=remedy)

    def difference(self, wanted: Mapping[str, Any], scene: str, setting: str) -> str:
        """Return why its frames of a scene are not those of a recipe, or "".

        wanted: the recipe's identity. setting: whose render is asked for.
        """
        here = self.identity
        for key in COMMON:
            if key != "output" and wanted[key] != here[key]:
                return first_difference(wanted[key], here[key], key) or key
        left, right = wanted["scenes"][scene], here["scenes"][scene]
        if found := different_input(left["inputs"], right["inputs"]):
            return f"{scene}: {found[0]} {found[1]}"
        for key in ("camera", "path"):
            if left[key] != right[key]:
                return f"{scene}: {first_difference(left[key], right[key], key)}"
        steps = [identity["settings"].get(setting) for identity in (wanted, here)]
        if (self.folder / f"{scene}@{setting}").is_dir() and steps[0] != steps[1]:
            return f"settings: {setting}: {first_difference(steps[0], steps[1]) or 'other steps'}"
        return ""


def read_store(folder: Path) -> CleanStore:
    """Open a store. Raises InputError where the folder is none."""
    path = folder / CLEAN
    try:
        content = read_json(path)
    except FileNotFoundError as error:
        problem = "is no folder of clean frames" if folder.is_dir() else "no such folder"
        raise InputError(folder, problem, remedy="'noisy-world render-clean RECIPE --out DIR' makes one") from error
    except ValueError as error:
        raise InputError(path, str(error), remedy=AGAIN) from error
    identity: Any = content.get("identity") if isinstance(content, dict) else None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(path, "does not tell of clean frames", remedy=AGAIN)
    if content.get("format") != FORMAT or not isinstance(identity, dict) or identity.get("format") != IDENTITY_FORMAT:
        raise InputError(path, "was written by another version of Noisy World", remedy="make the frames again")
    if problem := identity_problem(identity):
        raise InputError(path, problem, remedy=AGAIN)
    return CleanStore(folder, identity)


def _array(path: Path) -> NDArray[Any]:
    try:
        return read_array(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(path, "is damaged or cannot be read", remedy=AGAIN) from error


@dataclass(frozen=True)
class StoredClean(ColourAndDepth):
    """A clean frame in a store. folder: of the render."""

    folder: Path
    source: int

    def path(self, modality: Modality) -> Path:
        """Return the file of an image."""
        return self.folder / image_name(modality, self.source)

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Colour (H, W, 3), float32 in [0, 1]. Raises InputError where the file is damaged."""
        return self._image("rgb", 3)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres; 0 = void. Raises InputError where the file is damaged."""
        return self._image("depth", 2)

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of any channel. Raises InputError where the file is damaged."""
        return self._image(modality, 2 if CHANNELS[modality].components == 1 else 3)

    def _image(self, modality: Modality, axes: int) -> NDArray[Any]:
        image = _array(self.path(modality))
        if image.dtype != CHANNELS[modality].dtype or image.ndim != axes:
            raise InputError(self.path(modality), f"is {image.dtype} {image.shape}, no clean image", remedy=AGAIN)
        return image

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: no file here is a dataset's."""
        del modality, written


@dataclass(frozen=True)
class StoredScene:
    """A scene of a store as a source: its path is known, and its frames are those that the store holds."""

    folder: Path
    path: Trajectory
    axes: Axes | None
    known: Mapping[str, Any]

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.folder)

    @property
    def gives(self) -> Gives:
        """Frames that nobody renders, from paths that may deviate."""
        return Gives(rendered=False, any_pose=True)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.path.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the path: colour and depth are rendered at one moment."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        return FrameStamps.of(self.path.stamps_s)

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses."""
        return self.axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics asked for; that they are the frames' own has been checked."""
        return asked

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        del camera
        return PINHOLE

    def trajectory(self) -> Trajectory:
        """Return the path."""
        return self.path

    @property
    def mesh(self) -> None:
        """None: frames were rendered."""
        return None

    def hashes(self) -> dict[str, Any]:
        """Return the inputs that the frames were made from."""
        return dict(self.known["inputs"])

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Raise InputError: there are no frames but those that the store holds."""
        del camera, note
        raise InputError(self.folder, "does not hold this frame", remedy=AGAIN)
