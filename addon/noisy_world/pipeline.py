# SPDX-License-Identifier: GPL-3.0-or-later
"""Plan -> render once -> write for every setting -> dataset: the only orchestration there is."""

import shutil
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .core.datasets.dataset import OVERVIEW, RUN, Dataset, FrameRecord
from .core.datasets.overview import draw_overview
from .core.datasets.provenance import identity, manifest, render_seed
from .core.errors import InterruptedRunError
from .core.machine import available_threads, keep_freed_memory, peak_memory_bytes
from .core.planning.plan import (
    Plan,
    Render,
    Sequence,
    estimate,
    load_trajectory,
    render_trajectories,
    written_trajectories,
)
from .core.planning.scenes import Scene, load_mesh
from .core.presets.preset import canonical
from .core.progress import Progress
from .core.scenes.mesh import Mesh
from .core.scenes.selfcheck import reprojection_problem
from .core.trajectories.trajectory import Trajectory
from .frame_writer import Composited, FrameWriter, SourceFrame

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from .blender.compositor import Compositor
    from .blender.session import RenderOptions


@dataclass
class Report:
    """What a run did, and how fast: what goes to run.json and to the user."""

    frames_rendered: int = 0
    frames_kept: int = 0
    loading_s: float = 0.0
    first_frame_s: float | None = None
    rendering_s: float = 0.0
    total_s: float = 0.0
    peak_memory_bytes: int | None = None
    jobs: int = 1
    notes: list[str] = field(default_factory=list)

    @property
    def frames_per_s(self) -> float | None:
        """Frames a second from the first frame on, loading not counted."""
        return self.frames_rendered / self.rendering_s if self.frames_rendered and self.rendering_s > 0 else None

    def merge(self, other: "Report") -> None:
        """Add what another process did at the same time."""
        self.frames_rendered += other.frames_rendered
        self.loading_s = max(self.loading_s, other.loading_s)
        self.rendering_s = max(self.rendering_s, other.rendering_s)
        first = [value for value in (self.first_frame_s, other.first_frame_s) if value is not None]
        self.first_frame_s = min(first) if first else None
        self.peak_memory_bytes = (self.peak_memory_bytes or 0) + (other.peak_memory_bytes or 0) or None
        self.notes += [note for note in other.notes if note not in self.notes]


type Work = dict[str, list[int]]
"""Frames to be rendered, by the name of the render."""

type Workers = Callable[[list[Work], Progress], Report]
"""Runs each of several pieces of work in a process of its own and returns when all are done."""


class Run:
    """One run of a plan into a folder."""

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

        stop: when set, the run ends after the frame in hand. workers: what runs the jobs where there are several.
        """
        self._plan = plan
        self._progress = progress
        self._stop = stop
        self._overwrite = overwrite
        self._jobs = jobs
        self._workers = workers
        self._dataset = Dataset(out, plan.layout)
        self._trajectories: dict[str, Mapping[str, Trajectory]] = {}
        self._nominals: dict[str, Trajectory] = {}
        self.report = Report(jobs=jobs)

    def __call__(self) -> Report:
        """Make the dataset, or what is missing of it.

        Raises InterruptedRunError when stopped, StorageError when the disk refuses; what is finished stays, and the
        same run again goes on from there.
        """
        start_s = time.perf_counter()
        who = identity(self._plan, self._renderer_versions())
        self._dataset.open(who, overwrite=self._overwrite)
        try:
            if self._dataset.holds_frames():
                self._progress.note("checking the frames that are there")
            work = self._missing()
            self._warn_of_space(sum(map(len, work.values())))
            self._progress.start("rendering", self._plan.frame_count, self.report.frames_kept)
            if self._jobs > 1 and self._workers is not None and work:
                self.report.merge(self._workers(split_work(work, self._jobs), self._progress))
            else:
                self._render(work, worker=0)
            self._progress.finish()
            self._finish(who)
            self.report.total_s = time.perf_counter() - start_s
            self.report.merge(Report(peak_memory_bytes=peak_memory_bytes()))
            self._dataset.write_text(RUN, canonical(run_content(self.report)))
            self._dataset.seal()
        finally:
            self._progress.finish()
            self._dataset.close()
        return self.report

    def _renderer_versions(self) -> dict[str, str]:
        """Ask Blender for its versions, where anything is rendered."""
        if not self._plan.needs_blender:
            return {}
        if not self._plan.renders_anything:
            from .blender.session import blender_version

            return blender_version()
        from .blender.session import renderer_versions

        render = self._plan.preset.spec.render
        return renderer_versions(render.engine, render.device)

    def take_part(self, work: Work, worker: int) -> Report:
        """Render a piece of the work of a run that another process has opened."""
        self._dataset.join()
        self._render(work, worker)
        return self.report

    def _missing(self) -> Work:
        """Find what is to be rendered: frames that some sequence needs for a file it does not have."""
        work: Work = {}
        layout = self._dataset.layout
        for render in self._plan.renders:
            missing: set[int] = set()
            for sequence in render.sequences:
                there = self._dataset.take_stock(sequence.folder)
                for frame in sequence.frames:
                    lacking = layout.names(frame) - there.get(frame, set())
                    if layout.rgb_name(frame) in lacking:
                        missing.add(sequence.rgb_source(frame))
                    if layout.depth_name(frame) in lacking:
                        missing.add(sequence.depth_source(frame))
            self.report.frames_kept += len(render.frames) - len(missing)
            if missing:
                work[render.name] = sorted(missing)
        return work

    def _warn_of_space(self, missing_frames: int) -> None:
        needed = estimate(self._plan).bytes_written * missing_frames / max(self._plan.frame_count, 1)
        free = shutil.disk_usage(self._dataset.out).free
        if needed > free:
            self._note(f"about {needed / 1e9:.1f} GB are to be written and {free / 1e9:.1f} GB are free")

    def _note(self, text: str) -> None:
        self.report.notes.append(text)
        self._progress.note(text)

    # --- rendering ---

    def _render(self, work: Work, worker: int) -> None:
        for render in self._plan.renders:
            frames = work.get(render.name)
            if not frames:
                continue
            if render.scene.existing is not None:
                self._read_sequence(render, frames, worker)
            else:
                self._render_scene(render, frames, worker)

    def _render_scene(self, render: Render, frames: list[int], worker: int) -> None:
        from .blender.session import Session

        start_s = time.perf_counter()
        name = render.name
        mesh = load_mesh(render.scene)
        for note in mesh.notes:
            self._note(f"{render.scene.name}: {note}")
        trajectories = render_trajectories(self._plan, render, self._nominal(render.scene, mesh))
        self._trajectories[name] = trajectories
        options = render_options(self._plan, self._jobs)
        with Session(mesh, render.scene.name, trajectories, self._plan.camera, options) as session:
            if session.origin_m.any():
                where = ", ".join(f"{value:g}" for value in session.origin_m)
                self._note(f"{name}: far from the origin, so rendered around ({where}) m; poses stay as given")
            loaded_s = time.perf_counter()
            self.report.loading_s += loaded_s - start_s
            first = session.render(frames[0])
            if self.report.first_frame_s is None:
                self.report.first_frame_s = time.perf_counter() - loaded_s
            eye = trajectories.get("depth", trajectories[""])
            if first.depth_m is not None:
                self._check_first_frame(f"{name}: frame {frames[0]}", mesh, eye.c2w[frames[0]], first.depth_m)
            del mesh  # one frame tells, and the memory is free
            self._write_frames(
                render, frames, worker, lambda frame: first if frame == frames[0] else session.render(frame)
            )
            self.report.rendering_s += time.perf_counter() - loaded_s
        if self._stop.is_set():
            raise InterruptedRunError("stopped")

    def _read_sequence(self, render: Render, frames: list[int], worker: int) -> None:
        """Take the frames of a sequence that exists."""
        assert render.scene.existing is not None
        start_s = time.perf_counter()
        self._write_frames(render, frames, worker, render.scene.existing.frame)
        self.report.rendering_s += time.perf_counter() - start_s
        if self._stop.is_set():
            raise InterruptedRunError("stopped")

    def _write_frames(
        self, render: Render, frames: list[int], worker: int, source: Callable[[int], SourceFrame]
    ) -> None:
        stamps_s = self._trajectories_of(render)[""].stamps_s
        with (
            FrameWriter(self._dataset, render.sequences, worker, stamps_s, self._plan.camera) as writer,
            self._compositor(render) as compositor,
        ):
            for frame in frames:
                if self._stop.is_set():
                    break
                image = source(frame)
                self._count(writer.submit(frame, image, _composited(compositor, render, frame, image)))
            self._count(writer.drain())

    def _compositor(self, render: Render) -> "AbstractContextManager[Compositor | None]":
        """Make the node groups of the settings that show a render, where they are to be had from the compositor."""
        chains = {item.folder: item.setting.rgb for item in render.sequences if item.frames and item.setting.composited}
        if not chains or "rgb" not in self._plan.layout.modalities:
            return nullcontext()
        from .blender.compositor import Compositor

        keep_freed_memory()
        camera = self._plan.camera
        return Compositor((camera.width_px, camera.height_px), chains, camera.width_px)

    def _check_first_frame(self, where: str, mesh: Mesh, c2w: np.ndarray, depth_m: np.ndarray) -> None:
        """Say what looks wrong with the first frame, while there is time to stop."""
        if not depth_m.any():
            declared = "is the trajectory of this mesh, and are its pose and axes declared as the file has them?"
            self._note(f"{where} sees nothing; {declared}")
        elif problem := reprojection_problem(mesh, c2w, self._plan.camera, depth_m):
            self._note(f"{where}: {problem}")

    def _count(self, frames: int) -> None:
        self.report.frames_rendered += frames
        if frames:
            self._progress.advance(frames)

    # --- papers ---

    def _finish(self, who: dict[str, object]) -> None:
        files: dict[str, object] = {}
        counts: dict[str, int] = {}
        pictured: dict[str, list[int]] = {}
        with_overview = self._plan.preset.spec.output.overview
        for render in self._plan.renders:
            for sequence in render.sequences:
                records = self._finished_frames(sequence)
                if not records:
                    continue  # --frames chose none of it
                trajectories = self._trajectories_of(render)
                written = written_trajectories(self._plan, render, sequence, trajectories, self._nominal(render.scene))
                texts = self._plan.layout.sequence_texts(list(records), written)
                files[sequence.folder] = self._dataset.finish_sequence(sequence.folder, texts, records.values())
                counts[sequence.folder] = len(records)
                if with_overview:
                    pictured[sequence.folder] = list(records)
        for setting in {folder.split("/")[0]: None for folder in counts}:
            for name, text in self._plan.layout.setting_texts(self._plan.camera).items():
                path = f"{setting}/{name}"
                files[path] = self._dataset.write_text(path, text)
        if with_overview:
            picture = draw_overview(self._dataset.out, self._plan.layout, pictured)
            files[OVERVIEW] = self._dataset.write_bytes(OVERVIEW, picture)
        self._dataset.write_text("manifest.json", canonical(manifest(self._plan, who, files, counts)))

    def _finished_frames(self, sequence: Sequence) -> dict[int, FrameRecord]:
        """Return the whole frames of a sequence, those of earlier runs too, and remove what is there in part."""
        layout = self._plan.layout
        records = self._dataset.records(sequence.folder)
        whole = {frame: record for frame, record in records.items() if set(record.files) >= layout.names(frame)}
        if lost := [frame for frame in sequence.frames if frame not in whole]:
            raise RuntimeError(f"{sequence.folder}: {len(lost)} frames were not made, {lost[0]} the first")
        self._dataset.drop_frames(sequence.folder, [records[frame] for frame in records.keys() - whole.keys()])
        return whole

    def _nominal(self, scene: Scene, mesh: Mesh | None = None) -> Trajectory:
        """Return a scene's own trajectory, made once: in a mesh that takes seconds."""
        if scene.name not in self._nominals:
            self._nominals[scene.name] = load_trajectory(self._plan, scene, mesh)
        return self._nominals[scene.name]

    def _trajectories_of(self, render: Render) -> Mapping[str, Trajectory]:
        if render.name not in self._trajectories:
            self._trajectories[render.name] = render_trajectories(self._plan, render, self._nominal(render.scene))
        return self._trajectories[render.name]


def _composited(compositor: "Compositor | None", render: Render, source: int, image: SourceFrame) -> Composited:
    """Perturb a frame in the compositor for every sequence that shows it."""
    if compositor is None or image.rgb is None:
        return {}
    shown = [item for item in render.sequences if item.setting.composited and source in item.rgb_shown_by]
    needs_depth = any(item.setting.needs_depth for item in render.sequences)
    made: dict[tuple[str, int], Any] = {}
    # A chain makes one picture at a time: of a sequence that shows the frame several times, one after another.
    for turn in range(max((len(item.rgb_shown_by[source]) for item in shown), default=0)):
        frames = {
            item.folder: (item.rgb_shown_by[source][turn], item.identifiers)
            for item in shown
            if turn < len(item.rgb_shown_by[source])
        }
        pictures = compositor.perturb(image.rgb, frames, image.depth_m if needs_depth else None)
        made |= {(folder, frames[folder][0]): picture for folder, picture in pictures.items()}
    return made


def render_options(plan: Plan, jobs: int = 1) -> "RenderOptions":
    """Return how a plan's frames are rendered, in one of `jobs` processes that share the machine."""
    from .blender.session import RenderOptions

    spec = plan.preset.spec
    return RenderOptions(
        near_m=spec.camera.near_m,
        far_m=spec.camera.far_m,
        samples=spec.render.samples,
        seed=render_seed(spec.seed),
        engine=spec.render.engine,
        device=spec.render.device,
        rgb="rgb" in spec.output.modalities or any(setting.needs_rgb for setting in plan.settings),
        depth="depth" in spec.output.modalities or any(setting.needs_depth for setting in plan.settings),
        threads=max(1, available_threads() // jobs) if jobs > 1 else 0,
    )


def split_work(work: Work, parts: int) -> list[Work]:
    """Share the frames out in runs of neighbours, so that each part loads as few scenes as can be."""
    flat = [(scene, frame) for scene, frames in work.items() for frame in frames]
    pieces: list[Work] = []
    for chunk in np.array_split(np.arange(len(flat)), min(parts, len(flat))):
        piece: Work = {}
        for index in chunk:
            scene, frame = flat[index]
            piece.setdefault(scene, []).append(frame)
        pieces.append(piece)
    return pieces


def run_content(report: Report) -> dict[str, object]:
    """Return what run.json says."""
    rate = report.frames_per_s
    return {
        "frames_rendered": report.frames_rendered,
        "frames_kept": report.frames_kept,
        "frames_per_s": None if rate is None else round(rate, 3),
        "loading_s": round(report.loading_s, 3),
        "first_frame_s": None if report.first_frame_s is None else round(report.first_frame_s, 3),
        "rendering_s": round(report.rendering_s, 3),
        "total_s": round(report.total_s, 3),
        "peak_memory_bytes": report.peak_memory_bytes,
        "jobs": report.jobs,
        "notes": report.notes,
    }
