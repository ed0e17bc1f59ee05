# SPDX-License-Identifier: GPL-3.0-or-later
"""Making a store of clean frames: each render's frames once, and taken up again where it was stopped."""

import shutil
import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.channels import in_order
from ..core.datasets.dataset_state import WORK_FOLDER
from ..core.datasets.float_files import encode_npy
from ..core.datasets.layouts import Modality
from ..core.datasets.provenance import plain_identity
from ..core.datasets.storage import (
    FolderLock,
    own_scratch,
    sha256_of_bytes,
    sha256_of_file,
    storage_errors,
    write_atomic,
)
from ..core.errors import InterruptedRunError, StorageError
from ..core.planning.estimate import size_text
from ..core.planning.exposed import open_render, render_options
from ..core.planning.plan import Plan, Render
from ..core.planning.source import PreparedSource, RenderOptions
from ..core.planning.source_paths import source_paths
from ..core.presets.preset import canonical
from ..core.progress import Progress
from ..pipeline.clean_files import frames_bytes
from ..pipeline.versions import versions_of
from .clean_store import CLEAN, FORMAT, KIND, PATH, CleanStore, read_store

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

    def make(self) -> int:
        """Make what is missing."""
        if self._out.exists() and not (self._out / CLEAN).is_file() and _holds_something(self._out):
            raise StorageError("is not empty and holds no clean frames", file=self._out, remedy=ANOTHER)
        lock = FolderLock(self._out / WORK_FOLDER / "lock")
        try:
            store = self._describe()
            missing = {
                render.name: store.files(render.name).lacking(render.frames, self._modalities(render))
                for render in self._plan.renders
            }
            self._check_space(missing)
            there = self._plan.frame_count - sum(map(len, missing.values()))
            self._progress.start("rendering", self._plan.frame_count, there)
            for scene in self._plan.scenes:
                renders = [item for item in self._plan.renders if item.scene.name == scene.name and missing[item.name]]
                if renders:
                    with scene.source.prepare(renders[0].camera, partial(self._note, scene.name)) as prepared:
                        for render in renders:
                            self._render(render, prepared, missing[render.name], store)
        finally:
            self._progress.finish()
            shutil.rmtree(own_scratch(self._out / WORK_FOLDER).parent, ignore_errors=True)
            lock.release()
        return sum(map(len, missing.values()))

    def _note(self, name: str, text: str) -> None:
        self._progress.note(f"{name}: {text}")

    # --- what it is made from ---

    def _describe(self) -> CleanStore:
        """Write what the frames are made from, and the paths that they lie on, beside what is there of others."""
        here = plain_identity(self._plan, versions_of(self._plan))
        for scene in self._plan.scenes:
            here["scenes"][scene.name]["robot_axes"] = scene.source.robot_axes
        if (self._out / CLEAN).is_file():
            there = read_store(self._out)
            self._check_same(there, here)
            for part in ("scenes", "settings", "sequences"):
                here[part] = {**there.identity[part], **here[part]}
        for scene in self._plan.scenes:
            path = scene.path
            rows = np.concatenate([path.stamps_s[:, None], path.c2w.reshape(-1, 16)], axis=1)
            self._write(self._out / scene.name / PATH, encode_npy(rows))
        self._write(self._out / CLEAN, canonical({"kind": KIND, "format": FORMAT, "identity": here}).encode())
        return CleanStore(self._out, here)

    def _check_same(self, there: CleanStore, here: dict[str, Any]) -> None:
        for name, value in (("versions", here["versions"]), ("processor", here["processor"])):
            if there.identity[name] != value:
                raise StorageError(f"was made with other {name}", file=self._out, remedy=ANOTHER)
        for folder in here["sequences"]:
            setting, scene = folder.split("/")
            known = scene in there.identity["scenes"] and setting in there.identity["settings"]
            if known and (problem := there.difference(here, scene, setting)):
                raise StorageError(f"holds frames of something else: {problem}", file=self._out, remedy=ANOTHER)

    def _check_space(self, missing: Mapping[str, list[int]]) -> None:
        needed = sum(
            frames_bytes(render.camera, len(missing[render.name]), self._modalities(render))
            for render in self._plan.renders
        )
        free = shutil.disk_usage(self._out).free
        self._progress.note(f"{sum(map(len, missing.values()))} frames, {size_text(needed)}")
        if needed > free:
            message = f"no space left: {size_text(needed)} are to be written and {size_text(free)} are free"
            raise StorageError(message, file=self._out, remedy="choose a part with --scenes, --settings or --frames")

    def _write(self, path: Path, data: bytes) -> None:
        if sha256_of_file(path) == sha256_of_bytes(data):
            return
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, own_scratch(self._out / WORK_FOLDER))

    # --- frames ---

    def _options(self, render: Render, frames: list[int]) -> RenderOptions:
        return render_options(self._plan, render, judging=render.frames[0] in frames)

    def _modalities(self, render: Render) -> tuple[Modality, ...]:
        return in_order(self._options(render, []).channels)

    def _render(self, render: Render, prepared: PreparedSource, frames: list[int], store: CleanStore) -> None:
        paths, files = source_paths(self._plan, render), store.files(render.name)
        source = open_render(prepared, render, paths, self._options(render, frames), partial(self._note, render.name))
        for frame in frames:
            if self._stop.is_set():
                raise InterruptedRunError("stopped; finished frames stay, and the same command goes on")
            files.keep(frame, source.frame(paths.request(frame)), self._modalities(render))
            self._progress.advance()


def rendered(plan: Plan) -> Plan:
    """Return the part of a plan whose scenes are rendered."""
    return replace(plan, renders=tuple(item for item in plan.renders if item.scene.source.capabilities.rendered))


def _holds_something(folder: Path) -> bool:
    return folder.is_dir() and any(item.name != WORK_FOLDER for item in folder.iterdir())
