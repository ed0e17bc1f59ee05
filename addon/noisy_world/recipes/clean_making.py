# SPDX-License-Identifier: GPL-3.0-or-later
"""Making a store of clean frames: each render's frames once, hashed, and taken up again where it was stopped."""

import io
import json
import shutil
import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS, in_order
from ..core.datasets.dataset import Journal
from ..core.datasets.dataset_state import WORK_FOLDER
from ..core.datasets.layouts import Modality
from ..core.datasets.provenance import identity
from ..core.datasets.records import FRAMES, FrameRecord, joined_records, read_records
from ..core.datasets.storage import (
    FolderLock,
    sha256_of_bytes,
    sha256_of_regular_file,
    storage_errors,
    write_atomic,
)
from ..core.errors import InterruptedRunError, StorageError
from ..core.planning.estimate import size_text
from ..core.planning.exposed import open_render
from ..core.planning.plan import Plan, Render
from ..core.planning.source import PreparedSource, RenderOptions
from ..core.planning.source_paths import source_paths
from ..core.presets.preset import canonical
from ..core.progress import Progress
from ..pipeline.frame_maker import render_options
from ..pipeline.versions import versions_of
from .clean_store import CLEAN, FORMAT, KIND, PATH, CleanStore, image_name, read_store

ANOTHER = "choose another folder with --out"


def make_store(plan: Plan, out: Path, progress: Progress, stop: threading.Event) -> int:
    """Render the frames of a plan into a store; what is there already stays. Return how many were rendered.

    Scenes that are recordings are left out: they are their own clean frames.

    stop: when set, InterruptedRunError is raised after the current frame. Raises StorageError where the folder holds
    something else, or there is no space.
    """
    return _Making(plan, out, progress, stop).make()


class _Making:
    """One execution of a plan into a store."""

    def __init__(self, plan: Plan, out: Path, progress: Progress, stop: threading.Event) -> None:
        self._plan = rendered(plan)
        self._out = out
        self._progress = progress
        self._stop = stop
        self._scratch = out / WORK_FOLDER / "unfinished"

    def make(self) -> int:
        """Make what is missing."""
        if self._out.exists() and not (self._out / CLEAN).is_file() and _holds_something(self._out):
            raise StorageError(f"{self._out}: is not empty and holds no clean frames; {ANOTHER}")
        lock = FolderLock(self._out / WORK_FOLDER / "lock")
        try:
            with storage_errors(self._scratch):
                shutil.rmtree(self._scratch, ignore_errors=True)
                self._scratch.mkdir(parents=True)
            self._describe()
            missing = {render.name: self._missing(render) for render in self._plan.renders}
            self._check_space(missing)
            there = self._plan.frame_count - sum(map(len, missing.values()))
            self._progress.start("rendering", self._plan.frame_count, there)
            for scene in self._plan.scenes:
                renders = [item for item in self._plan.renders if item.scene.name == scene.name and missing[item.name]]
                if renders:
                    with scene.source.prepare(renders[0].camera, partial(self._note, scene.name)) as prepared:
                        for render in renders:
                            self._render(render, prepared, missing[render.name])
            shutil.rmtree(self._scratch, ignore_errors=True)
        finally:
            self._progress.finish()
            lock.release()
        return sum(map(len, missing.values()))

    def _note(self, name: str, text: str) -> None:
        self._progress.note(f"{name}: {text}")

    # --- what it is made from ---

    def _describe(self) -> None:
        """Write what the frames are made from, and the paths that they lie on, beside what is there of others."""
        here: dict[str, Any] = json.loads(canonical(identity(self._plan, versions_of(self._plan))))
        for scene in self._plan.scenes:
            here["scenes"][scene.name]["robot_axes"] = scene.source.robot_axes
        if (self._out / CLEAN).is_file():
            there = read_store(self._out)
            self._check_same(there, here)
            for part in ("scenes", "settings", "sequences"):
                here[part] = {**there.identity[part], **here[part]}
        for scene in self._plan.scenes:
            path = scene.source.trajectory()
            rows = np.concatenate([path.stamps_s[:, None], path.c2w.reshape(-1, 16)], axis=1)
            self._write(self._out / scene.name / PATH, _npy(rows))
        text = canonical({"kind": KIND, "format": FORMAT, "identity": here})
        self._write(self._out / CLEAN, text.encode())

    def _check_same(self, there: CleanStore, here: dict[str, Any]) -> None:
        for name, value in (("versions", here["versions"]), ("processor", here["processor"])):
            if there.identity[name] != value:
                raise StorageError(f"{self._out}: was made with other {name}; {ANOTHER}")
        for folder in here["sequences"]:
            setting, scene = folder.split("/")
            known = scene in there.identity["scenes"] and setting in there.identity["settings"]
            if known and (problem := there.difference(here, scene, setting)):
                raise StorageError(f"{self._out}: holds frames of something else: {problem}; {ANOTHER}")

    def _check_space(self, missing: Mapping[str, list[int]]) -> None:
        needed = sum(
            len(missing[render.name]) * render.camera.width_px * render.camera.height_px * _bytes_of(modality)
            for render in self._plan.renders
            for modality in self._modalities(render)
        )
        free = shutil.disk_usage(self._out).free
        self._progress.note(f"{sum(map(len, missing.values()))} frames, {size_text(needed)}")
        if needed > free:
            told = f"no space left: {size_text(needed)} are to be written and {size_text(free)} are free"
            raise StorageError(f"{self._out}: {told}; choose a part with --scenes, --settings or --frames")

    # --- frames ---

    def _options(self, render: Render, frames: list[int]) -> RenderOptions:
        return render_options(self._plan, render, judging=render.frames[0] in frames)

    def _modalities(self, render: Render) -> list[Modality]:
        return list(in_order(self._options(render, []).channels))

    def _missing(self, render: Render) -> list[int]:
        """Return the source frames of which a file is not there as it was written."""
        folder = self._out / render.name
        records = joined_records(read_records(folder / FRAMES))
        names = {frame: [image_name(item, frame) for item in self._modalities(render)] for frame in render.frames}
        return [
            frame
            for frame in render.frames
            if (record := records.get(frame)) is None
            or any(
                name not in record.files or sha256_of_regular_file(folder / name) != record.files[name]
                for name in names[frame]
            )
        ]

    def _render(self, render: Render, prepared: PreparedSource, frames: list[int]) -> None:
        paths = source_paths(self._plan, render)
        options = self._options(render, frames)
        source = open_render(prepared, render, paths, options, partial(self._note, render.name))
        folder = self._out / render.name
        with storage_errors(folder):
            for modality in self._modalities(render):
                (folder / modality).mkdir(parents=True, exist_ok=True)
        journal = Journal(folder / FRAMES)
        try:
            for frame in frames:
                if self._stop.is_set():
                    raise InterruptedRunError("stopped; finished frames stay, and the same command goes on")
                image = source.frame(paths.request(frame))
                images = {image_name(item, frame): image.image(item) for item in self._modalities(render)}
                files = {
                    name: self._write(folder / name, _npy(pixels))
                    for name, pixels in images.items()
                    if pixels is not None
                }
                journal.append(FrameRecord(frame, float(paths.rgb.stamps_s[frame]), files))
                self._progress.advance()
        finally:
            journal.close()

    def _write(self, path: Path, data: bytes) -> str:
        digest = sha256_of_bytes(data)
        if sha256_of_regular_file(path) != digest:
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, data, self._scratch)
        return digest


def _bytes_of(modality: Modality) -> int:
    """Return how many bytes a pixel of a channel takes in a store."""
    return CHANNELS[modality].components * np.dtype(CHANNELS[modality].dtype).itemsize


def rendered(plan: Plan) -> Plan:
    """Return the part of a plan whose scenes are rendered."""
    return replace(plan, renders=tuple(item for item in plan.renders if item.scene.source.gives.rendered))


def _npy(values: NDArray[Any]) -> bytes:
    """Return an array as the bytes of a .npy file."""
    data = io.BytesIO()
    np.save(data, np.ascontiguousarray(values), allow_pickle=False)
    return data.getvalue()


def _holds_something(folder: Path) -> bool:
    return folder.is_dir() and any(item.name != WORK_FOLDER for item in folder.iterdir())
