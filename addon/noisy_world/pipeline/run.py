# SPDX-License-Identifier: GPL-3.0-or-later
"""A run: it renders a plan's frames once, writes them for every setting, and completes the dataset."""

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.datasets.dataset import Dataset
from ..core.datasets.depth_range import RangeLoss, range_loss
from ..core.datasets.differences import why_not
from ..core.datasets.layouts import SequenceFacts
from ..core.datasets.overview import draw_overview
from ..core.datasets.provenance import cameras_agree, cameras_of, identity, manifest, render_seed
from ..core.datasets.records import FrameRecord
from ..core.datasets.standing import OVERVIEW, RUN
from ..core.errors import InterruptedRunError, StorageError
from ..core.machine import available_threads, peak_memory_bytes
from ..core.planning.estimate import image_bytes, size_text
from ..core.planning.motion_record import motion_of_frames
from ..core.planning.plan import Plan, Render, source_paths
from ..core.planning.sequence import Sequence, written_paths
from ..core.planning.source import OpenSource, PreparedSource, RenderOptions
from ..core.presets.preset import canonical
from ..core.progress import Progress
from ..core.trajectories.sensor_paths import SensorPaths
from .clean_frame import Camera, CleanFrame
from .colour import colour_of
from .frame_writer import FrameWriter, Lost
from .report import Report
from .stock import take_stock

FIRST_FRAMES = 3  # a path whose first three frames see nothing is taken for a mistake; chosen

type Work = dict[str, list[int]]
"""The source frames to render, by the name of the render."""

type Workers = Callable[[list[Work], Progress], Report]
"""A function that carries out each of several pieces of work in its own process, and returns when all are done."""


class Run:
    """A run: one execution of a plan into a folder."""

    def __init__(
        self,
        plan: Plan,
        out: Path,
        *,
        progress: Progress,
        stop: threading.Event,
        overwrite: bool = False,
        jobs: int = 1,
        workers: Workers | None = None,
    ) -> None:
        """Prepare a run.

        stop: when set, the run ends after the current frame. workers: what starts the processes where there are
        several.
        """
        self._plan = plan
        self._progress = progress
        self._stop = stop
        self._overwrite = overwrite
        self._jobs = jobs
        self._workers = workers
        self._dataset = Dataset(out, plan.format)
        self._paths: dict[str, SensorPaths] = {}
        self._told_lost: set[str] = set()  # the scenes that a note on lost depth has named
        self.report = Report(jobs=jobs)

    def make_dataset(self) -> Report:
        """Make the dataset, or the part of it that is missing.

        Raises InterruptedRunError when stopped, StorageError when the disk cannot be written. Finished frames stay, and
        another run of the same plan continues from there.
        """
        start_s = time.perf_counter()
        self._open()
        try:
            if self._dataset.holds_frames():
                self._progress.note("checking the frames that are there")
            work, needed_bytes = self._missing()
            self._check_space(needed_bytes)
            self._progress.start("rendering", self._plan.frame_count, self.report.frames_kept)
            if self._plan.format.note:
                self._progress.note(self._plan.format.note)
            if self._jobs > 1 and self._workers is not None and work:
                self.report.merge(self._workers(split_work(work, self._jobs), self._progress))
            else:
                self._render(work, worker=0)
            self._progress.finish()
            self._finish()
            self.report.total_s = time.perf_counter() - start_s
            self.report.merge(Report(peak_memory_bytes=peak_memory_bytes()))
            self._dataset.write_text(RUN, canonical(self.report.content()))
            self._dataset.seal()
        finally:
            self._progress.finish()
            self._dataset.close()
        return self.report

    def take_part(self, work: Work, worker: int) -> Report:
        """Render a part of the work of a run that another process has opened.

        Raises StorageError where that run was opened with other inputs or versions than this process finds.
        """
        self._dataset.join(self._identity(paths=False))
        self._render(work, worker)
        return self.report

    def _open(self) -> None:
        """Take the folder, where what it holds can grow into the plan."""
        made_from = self._identity(paths=True)

        def refusal(there: dict[str, Any]) -> str | None:
            return why_not(there, made_from, self._plan)

        self._dataset.open(made_from, refusal, overwrite=self._overwrite)
        for text in self._dataset.notes:
            self._note(text)

    def _identity(self, *, paths: bool) -> dict[str, Any]:
        # Through JSON, as the file is that it is compared with.
        return json.loads(canonical(identity(self._plan, versions_of(self._plan), paths=paths)))

    def _missing(self) -> tuple[Work, int]:
        """Find what is to be rendered: the source frames that a sequence needs for a missing file.

        Returns that, and roughly how many bytes the missing files will have.
        """
        work: Work = {}
        needed_bytes = 0
        for render in self._plan.renders:
            lacking = take_stock(self._dataset, self._plan, render)
            needed_bytes += lacking.bytes_to_write
            self.report.frames_kept += len(render.frames) - len(lacking.sources)
            if lacking.sources:
                work[render.name] = lacking.sources
        return work, needed_bytes

    def _check_space(self, needed_bytes: int) -> None:
        """Say where the disk is too small; raise StorageError where not even a frame fits. The sizes are rough."""
        out, free_bytes = self._dataset.out, shutil.disk_usage(self._dataset.out).free
        if needed_bytes <= free_bytes:
            return
        told = f"about {size_text(needed_bytes)} are to be written and {size_text(free_bytes)} are free"
        render = self._plan.renders[0]
        frame_bytes = sum(image_bytes(self._plan, render, modality) for modality in self._plan.format.modalities)
        if free_bytes < min(needed_bytes, frame_bytes):
            remedy = "make room there and run the same command again, or choose another folder with --out"
            raise StorageError(f"{out}: no space left: {told}; {remedy}")
        self._note(f"this will hardly fit: {told} in {out}; a run that fills the disk goes on once there is room")

    def _note(self, text: str) -> None:
        self.report.notes.append(text)
        self._progress.note(text)

    # --- frames ---

    def _render(self, work: Work, worker: int) -> None:
        """Render the work scene by scene: each is in memory once for all its renders."""
        for scene in self._plan.scenes:
            renders = [item for item in self._plan.renders if item.scene.name == scene.name and work.get(item.name)]
            if not renders:
                continue
            start_s = time.perf_counter()
            with scene.source.prepare(renders[0].camera, partial(self._note_on, scene.name)) as prepared:
                self.report.loading_s += time.perf_counter() - start_s
                for render in renders:
                    self._render_one(render, prepared, work[render.name], worker)

    def _render_one(self, render: Render, prepared: PreparedSource, frames: list[int], worker: int) -> None:
        start_s = time.perf_counter()
        options = render_options(self._plan, render, frames, self._jobs)
        source = prepared.open(self._paths_of(render), options, partial(self._note_on, render.name))
        opened_s = time.perf_counter()
        self.report.loading_s += opened_s - start_s
        self._write_frames(render, frames, worker, source)
        self.report.rendering_s += time.perf_counter() - opened_s
        if self._stop.is_set():
            raise InterruptedRunError("stopped")

    def _note_on(self, name: str, text: str) -> None:
        """Say something about a scene or a render."""
        self._note(f"{name}: {text}")

    def _write_frames(self, render: Render, frames: list[int], worker: int, source: OpenSource) -> None:
        paths = self._paths_of(render)
        coloured = render.sequences if "rgb" in self._plan.format.modalities else ()
        camera = Camera(render.camera, render.scene.source.stamps_s)
        size_px = (render.camera.width_px, render.camera.height_px)
        with (
            FrameWriter(self._dataset, render, worker) as writer,
            colour_of(writer.lacking_colour(coloured, frames), camera, size_px) as colour,
        ):
            for frame in frames:
                if self._stop.is_set():
                    break
                start_s = time.perf_counter()
                clean = CleanFrame(frame, source.frame(paths.moment(frame)))
                if self.report.first_frame_s is None:
                    self.report.first_frame_s = time.perf_counter() - start_s
                self._count(writer.submit(clean, colour.of(clean)), writer)
            self._count(writer.drain(), writer)

    def _tell_lost(self, lost: Lost | None) -> None:
        """Say at once where depth is lost for the first time in a scene, so that nobody waits for a whole run."""
        if lost is None or lost.sequence.scene in self._told_lost:
            return
        scene, range_ = lost.sequence.scene, self._plan.format.depth_range
        self._told_lost.add(scene)
        told = range_.told_of_image(lost.out_of_range, self._pixels(scene))
        told = range_.with_remedy(told, lost.out_of_range.farthest_m)
        self._progress.note(f"{scene}: frame {lost.frame} of {lost.sequence.setting.name}: {told}", subject=scene)

    def _pixels(self, scene: str) -> int:
        """Return how many pixels a frame of a scene has."""
        (camera,) = {render.camera for render in self._plan.renders if render.scene.name == scene}
        return camera.width_px * camera.height_px

    def _count(self, frames: int, writer: FrameWriter) -> None:
        self._tell_lost(writer.first_lost)
        self.report.frames_rendered += frames
        if frames:
            self._progress.advance(frames)

    def _paths_of(self, render: Render) -> SensorPaths:
        """Return the sensors' paths in a render; each is made once."""
        if render.name not in self._paths:
            self._paths[render.name] = source_paths(self._plan, render)
        return self._paths[render.name]

    # --- text files ---

    def _finish(self) -> None:
        """Write the text files beside the images, and the manifest."""
        files: dict[str, object] = {}
        counts: dict[str, int] = {}
        pictured: dict[str, list[int]] = {}
        losses: dict[str, RangeLoss] = {}
        format_ = self._plan.format
        one_camera = cameras_agree(self._dataset.identity)
        for render in self._plan.renders:
            for sequence in render.sequences:
                records = self._finished_frames(render, sequence)
                if not records:
                    continue  # --frames chose none of it
                if motion := motion_of_frames(render, sequence, self._paths_of(render)):
                    records = {frame: record.with_motion(motion[frame]) for frame, record in records.items()}
                paths = written_paths(sequence, self._paths_of(render))
                stamps = render.scene.source.frame_stamps
                facts = SequenceFacts(format_, render.camera, self._plan.rig, tuple(records), paths, stamps)
                texts = format_.layout.sequence_texts(facts)
                if not one_camera:
                    texts |= format_.setting_texts(render.camera)
                files[sequence.folder] = self._dataset.finish_sequence(sequence.folder, texts, records.values())
                counts[sequence.folder] = len(records)
                pictured[sequence.folder] = list(records)
                images = (record.out_of_range for record in records.values())
                if loss := range_loss(images, self._pixels(sequence.scene)):
                    losses[sequence.folder] = loss
        files |= {} if one_camera else self._texts_beside()
        of_setting = format_.setting_texts(self._plan.renders[0].camera) if one_camera else {}
        for setting in {folder.split("/")[0]: None for folder in counts}:
            for name, text in of_setting.items():
                path = f"{setting}/{name}"
                files[path] = self._dataset.write_text(path, text)
        if self._plan.preset.spec.output.overview:
            stamps_of = {scene.name: scene.source.frame_stamps for scene in self._plan.scenes}
            picture = draw_overview(self._dataset.out, format_, pictured, stamps_of)
            files[OVERVIEW] = self._dataset.write_bytes(OVERVIEW, picture)
        self._dataset.write_manifest(manifest(self._plan, self._dataset.identity, files, counts, losses))
        self._note_losses(losses, counts)

    def _note_losses(self, losses: dict[str, RangeLoss], counts: dict[str, int]) -> None:
        """Say in a note for each scene how much of its depth is lost, and what keeps it."""
        for scene in self._plan.scenes:
            of_scene = [sequence for sequence in self._plan.sequences if sequence.scene == scene.name]
            lost = {item.setting.name: losses[item.folder] for item in of_scene if item.folder in losses}
            frames = {item.setting.name: counts[item.folder] for item in of_scene if item.folder in losses}
            if lost:
                self._note(f"{scene.name}: {self._plan.format.depth_range.told_of_scene(lost, frames)}")

    def _texts_beside(self) -> dict[str, object]:
        """Write the intrinsics of the sequences that stay beside the plan's: their settings' files no longer say them.

        Returns the files of these sequences by folder.
        """
        cameras = cameras_of(self._dataset.identity)
        files: dict[str, object] = {}
        for folder, there in self._dataset.kept.items():
            texts = self._plan.format.setting_texts(cameras[folder.split("/")[1]])
            written = {name: self._dataset.write_text(f"{folder}/{name}", text) for name, text in texts.items()}
            files[folder] = there | written
        return files

    def _finished_frames(self, render: Render, sequence: Sequence) -> dict[int, FrameRecord]:
        """Return the complete frames of a sequence, including those of earlier runs, and remove incomplete ones."""
        names = self._dataset.format.names(render.scene.source.frame_stamps)
        records = self._dataset.records(sequence.folder)
        whole = {frame: record for frame, record in records.items() if set(record.files) >= names.of(frame)}
        if lost := [frame for frame in sequence.frames if frame not in whole]:
            raise RuntimeError(f"{sequence.folder}: {len(lost)} frames were not made, {lost[0]} the first")
        self._dataset.drop_frames(sequence.folder, [records[frame] for frame in records.keys() - whole.keys()])
        return whole


def versions_of(plan: Plan) -> dict[str, str]:
    """Return the versions of Blender and of what else renders the plan."""
    if not plan.needs_blender:
        return {}
    if not plan.renders_anything:
        from ..blender.session import blender_version

        return blender_version()
    from ..blender.session import renderer_versions

    return renderer_versions(plan.preset.spec.render.engine, plan.preset.spec.render.device)


def render_options(plan: Plan, render: Render, frames: Iterable[int] = (), jobs: int = 1) -> RenderOptions:
    """Return how frames of a render are made, in one of `jobs` processes that share the machine.

    A process that makes the first of them, or shares the render with one that does, looks at the first ones.
    """
    spec = plan.preset.spec
    judging = not spec.render.allow_empty and (jobs > 1 or not set(render.frames[:1]).isdisjoint(frames))
    return RenderOptions(
        near_m=spec.mesh_camera.near_m,
        far_m=spec.mesh_camera.far_m,
        samples=spec.render.samples,
        seed=render_seed(spec.seed),
        engine=spec.render.engine,
        device=spec.render.device,
        rgb="rgb" in plan.format.modalities or render.needs_rgb,
        depth="depth" in plan.format.modalities or render.needs_depth,
        threads=max(1, available_threads() // jobs) if jobs > 1 else 0,
        first_frames=render.frames[:FIRST_FRAMES] if judging else (),
    )


def split_work(work: Work, parts: int) -> list[Work]:
    """Divide the frames into ranges of neighbours, so that each part loads as few scenes as possible."""
    flat = [(scene, frame) for scene, frames in work.items() for frame in frames]
    pieces: list[Work] = []
    for chunk in np.array_split(np.arange(len(flat)), min(parts, len(flat))):
        piece: Work = {}
        for index in chunk:
            scene, frame = flat[index]
            piece.setdefault(scene, []).append(frame)
        pieces.append(piece)
    return pieces
