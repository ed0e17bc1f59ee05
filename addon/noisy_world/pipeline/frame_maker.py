# SPDX-License-Identifier: GPL-3.0-or-later
"""Making frames: a source is opened, asked for one moment after another, and what it gives is perturbed and written."""

import contextlib
import threading
import time
from collections.abc import Hashable
from collections.abc import Sequence as Many
from dataclasses import replace
from functools import partial
from typing import Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.channels import in_order, pair_channels
from ..core.datasets.dataset import Dataset
from ..core.datasets.layouts import Modality
from ..core.errors import InterruptedRunError
from ..core.messages import Message
from ..core.planning.exposed import open_render, render_options
from ..core.planning.metering import light_seen
from ..core.planning.plan import Plan, Render
from ..core.planning.source import OpenSource, PreparedSource, RenderedFrame, SourceFrame
from ..core.planning.source_paths import source_paths
from ..core.progress import Progress
from ..core.trajectories.sensor_paths import SensorPaths
from .clean_files import CleanFiles
from .clean_frame import CleanFrame, cameras_of
from .colour import Colour, colour_of
from .completed_images import FinishedImages
from .earlier import EarlierFrames
from .frame_rates import other_rates
from .frame_writer import FrameWriter, Lost
from .pairs import OpenPairs, motion_of, view_of
from .report import Report
from .stage_timer import DECODING, LOADING, RENDERING, StageTimer

T = TypeVar("T")


class FrameMaker:
    """Makes frames of a plan, one piece after another.

    A scene stays in memory until another one is asked for, and what perturbs the colour of a render likewise. report:
    what was done since it was last replaced.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        progress: Progress,
        stop: threading.Event,
        threads: int = 0,
        scene: "KeptScene | None" = None,
        clean: CleanFiles | None = None,
    ) -> None:
        """Prepare.

        stop: when set, a piece ends after the current frame. threads: of the renderer; 0 for all. scene: what keeps
        the scene in memory, if that outlives this maker. clean: where the clean frames of the plan's only render are
        kept, if they are.
        """
        self._plan = plan
        self._progress = progress
        self._stop = stop
        self._threads = threads
        self._paths: dict[str, SensorPaths] = {}
        self._noted_lost: set[str] = set()  # the scenes that a note on lost depth has named
        self._scene = KeptScene() if scene is None else scene
        self._clean = clean
        self._render = Kept[OpenSource]()
        self._colour = Kept[Colour]()
        self._closed_at_end = (self._render, self._colour, *([self._scene] if scene is None else []))
        self.report = Report()

    def make(self, render: Render, frames: Many[int], target: Dataset, finished: FinishedImages) -> None:
        """Make the images that show some source frames of a render and are not finished, and write them to a dataset.

        Raises InterruptedRunError when stopped.
        """
        start_s, timer = time.perf_counter(), StageTimer()
        with timer.rest_on(LOADING):
            source = self._open(
                render, judging=bool(finished.sources_missing(render, self._modalities, render.frames[:1]))
            )
            colour = self._colour_of(render, frames, finished, source)  # node groups are made once, not for each frame
        loaded_s = time.perf_counter()
        self.report.loading_s += loaded_s - start_s
        with timer.rest_on(RENDERING), FrameWriter(target, render, finished, timer) as writer:
            self._write(render, frames, source, colour, writer)
        self.report.add_processor_s(timer.seconds)
        self.report.rendering_s += time.perf_counter() - loaded_s
        if self._stop.is_set():
            raise InterruptedRunError("stopped")

    def clean_frame(self, render: Render, number: int) -> CleanFrame:
        """Return a source frame of a render by its number, with the images that are written where nothing perturbs it.

        It is read where clean frames are kept and it is there, else made. Raises InterruptedRunError when stopped.
        """
        if self._stop.is_set():
            raise InterruptedRunError("stopped")
        image = self._open(render, judging=False).frame(self.paths_of(render).request(number))
        return CleanFrame.of(render, number, image, of_light=self._plan.format.of_light)

    @property
    def _modalities(self) -> tuple[Modality, ...]:
        return self._plan.format.modalities

    def paths_of(self, render: Render) -> SensorPaths:
        """Return the sensors' paths in a render; each is made once."""
        if render.name not in self._paths:
            self._paths[render.name] = source_paths(self._plan, render)
        return self._paths[render.name]

    def _open(self, render: Render, *, judging: bool) -> OpenSource:
        """Return a render's source. judging: whether a path that begins with frames that see nothing is refused."""
        if (source := self._render.of((render.name,))) is not None:
            return source
        self._colour.close()
        self._render.close()
        options = render_options(self._plan, render, judging=judging, threads=self._threads)

        def opening() -> OpenSource:
            scene = render.scene
            key = (scene.name, render.camera)
            if (prepared := self._scene.of(key)) is None:
                prepared = self._scene.keep(key, scene.source.prepare(render.camera, partial(self._note, scene.name)))
            return open_render(prepared, render, self.paths_of(render), options, partial(self._note, render.name))

        format_ = self._plan.format
        wanted, again = in_order(options.channels), render.acts_on_light or format_.of_light
        again = again or (options.depth_camera is not None and options.through_glass)
        opened = opening() if self._clean is None else self._clean.through(wanted, opening, again=again)
        if render.registration is not None and not render.registers and (render.needs_depth or render.needs_rgb):
            message = "depth has a camera of its own: it is registered into colour where a perturbation needs both"
            self._note(render.name, message)
        if render.scene.source.capabilities.lit:
            settings = (item.setting for item in render.sequences)
            for message in other_rates(settings, render.scene.source.stamps_s):
                self._note(render.name, message)
        return self._render.keep((render.name,), contextlib.nullcontext(opened))

    def _note(self, name: str, text: str) -> None:
        """Say something about a scene or a render."""
        note = Message(f"{name}: ", text)
        self.report.notes.append(note)
        self._progress.note(note)

    def _colour_of(self, render: Render, frames: Many[int], finished: FinishedImages, source: OpenSource) -> Colour:
        """Return what perturbs the colour of those sequences that lack some of it."""
        coloured = render.sequences if "rgb" in self._modalities else ()
        lacking = [item for item in coloured if item.frames and finished.lacks(item, "rgb", frames)]
        key = (render.name, *(item.folder for item in lacking))
        if (colour := self._colour.of(key)) is not None:
            return colour
        scene, seen = render.scene.source, partial(self._seen, render, source)
        looks_back = any(item.setting.looks_back for item in lacking)
        earlier = EarlierFrames(scene.stamps_s, seen) if looks_back else None
        size_px = (render.camera.width_px, render.camera.height_px)
        options = {"lit": scene.capabilities.lit, "of_light": self._plan.format.of_light}
        cameras = cameras_of(render, self.paths_of(render), earlier)
        return self._colour.keep(key, colour_of(lacking, cameras, size_px, **options))

    def _seen(self, render: Render, source: OpenSource, number: int) -> NDArray[np.float32]:
        """Return what a meter sees of a source frame that is not made now."""
        return light_seen(source.frame(replace(self.paths_of(render).request(number), channels=frozenset({"rgb"}))))

    def _write(
        self,
        render: Render,
        frames: Many[int],
        source: OpenSource,
        colour: Colour,
        writer: FrameWriter,
    ) -> None:
        paths = self.paths_of(render)
        heard = None if render.scene.source.capabilities.rendered else writer.timer
        pairs = self._pairs(render, frames, writer.finished)
        wanted = set(frames)
        for frame in sorted(wanted | pairs.sources):
            if self._stop.is_set():
                break
            start_s = time.perf_counter()
            if frame in wanted:
                colour.prepare(frame)  # before the frame: a lit one is shown until the source gives another
            with contextlib.nullcontext() if heard is None else heard.on(DECODING):
                image = source.frame(paths.request(frame))
            self._count_rays(image)
            clean = CleanFrame.of(render, frame, image, heard, of_light=self._plan.format.of_light)
            if self.report.first_frame_s is None:
                self.report.first_frame_s = time.perf_counter() - start_s
            if frame in wanted:
                self._count(writer.submit(clean, colour.frames_of(clean)), writer)
            view = partial(view_of, lambda: source, paths, clean, render.camera)
            for pair in pairs.take(frame, view, partial(motion_of, source, render, paths)):
                self._count(writer.submit_pair(pair), writer)
        self._count(writer.drain(), writer)

    def _pairs(self, render: Render, frames: Many[int], finished: FinishedImages) -> OpenPairs:
        """Return what leads from some source frames to others and is missing."""
        channels = [channel.name for channel in pair_channels(self._modalities)]
        sequences = [item for item in render.sequences if item.frames] if channels else []
        lacking = (finished.pairs(sequences, channels, frame) for frame in frames)
        return OpenPairs(set().union(*lacking), render.camera)

    def _count(self, frames: int, writer: FrameWriter) -> None:
        self._tell_lost(writer.first_lost)
        self.report.frames_rendered += frames
        if frames:
            self._progress.advance(frames)

    def _count_rays(self, image: SourceFrame) -> None:
        if isinstance(image, RenderedFrame) and image.rgb is not None and image.colour_rays is not None:
            self.report.colour_rays += image.colour_rays
            self.report.colour_pixels += image.rgb.shape[0] * image.rgb.shape[1]

    def _tell_lost(self, lost: Lost | None) -> None:
        """Say at once where depth is lost for the first time in a scene, so that nobody waits for a whole run."""
        if lost is None or lost.sequence.scene in self._noted_lost:
            return
        scene, range_ = lost.sequence.scene, self._plan.format.depth_range
        camera = self._plan.depth_cameras[scene]
        self._noted_lost.add(scene)
        message = range_.format_image_loss(lost.out_of_range, camera.width_px * camera.height_px)
        message = range_.with_remedy(message, lost.out_of_range.farthest_m)
        where = f"{scene}: frame {lost.frame} of {lost.sequence.setting.name}: "
        self._progress.note(Message(where, message), subject=scene)

    def close(self) -> None:
        """Close what is open."""
        with contextlib.ExitStack() as closing:
            for kept in self._closed_at_end:
                closing.callback(kept.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Kept(Generic[T]):
    """What a context manager gave, kept open until something else takes its place."""

    def __init__(self) -> None:
        self._key: Hashable = None
        self._value: T | None = None
        self._opened = contextlib.ExitStack()

    def of(self, key: Hashable) -> T | None:
        """Return what is kept under a key; None where something else is, or nothing."""
        return self._value if self._key == key else None

    def keep(self, key: Hashable, made: contextlib.AbstractContextManager[T]) -> T:
        """Close what was kept, and open and keep something else."""
        self.close()
        value = self._opened.enter_context(made)
        self._key, self._value = key, value
        return value

    def close(self) -> None:
        """Close what is kept."""
        self._key = self._value = None
        self._opened.close()


class KeptScene(Kept[PreparedSource]):
    """The scene that was prepared last: loading one takes longer than rendering small frames."""
