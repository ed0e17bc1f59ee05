# SPDX-License-Identifier: GPL-3.0-or-later
"""Making frames: a source is opened, asked for one moment after another, and what it gives is perturbed and written."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, in_order, pair_channels
from ..core.atomic_files import sha256_of_bytes
from ..core.depth_range import OutOfRange
from ..core.errors import InterruptedRunError, Message, NoisyWorldError, PresetKey
from ..core.frame_request import SensorPaths
from ..core.frame_table import FrameRecord
from ..core.machine import COMPOSITING, DECODING, LOADING, RENDERING, StageTimer
from ..core.progress import Progress
from ..layouts import Modality, OutputFormat
from ..perturbations.clipping import Clipping, clipping
from ..perturbations.steps import Setting
from ..render.source import OpenSource, PreparedSource, RenderedFrame, SourceFrame, light_seen
from .dataset_folder import Dataset, FinishedImages
from .frame import CleanFrame, CleanFrames, PlannedFrame, cameras_of, clean_frames_of
from .plan import Plan, Render
from .rendering import open_render, render_options, source_paths
from .sequence import PlannedSequence

if TYPE_CHECKING:
    from .clean_store import CleanFiles
    from .frame import CleanPair, Compositing, EarlierFrames, OpenPairs

FrameOf: TypeAlias = Callable[[PlannedSequence, int], PlannedFrame]
"""A sequence and a frame's number -> that frame, of which one image at least shows the clean frame at hand."""

# Whether what drifts from frame to frame moves as fast as the frames that it is seen in follow one another.


RATE = "frame_rate_hz"
SAME = 1e-2  # of a rate: a difference that nobody sees


def other_rates(settings: Iterator[Setting], stamps_s: NDArray[np.float64]) -> list[Message]:
    """Return a note for each step that drifts by another rate of frames than that of their time stamps (N,), seconds.

    The rate is that of the median step between two stamps; of fewer than two nothing is said.
    """
    if len(stamps_s) < 2 or (step_s := float(np.median(np.diff(stamps_s)))) <= 0:
        return []
    rate_hz, found = 1 / step_s, []
    for setting in settings:
        for step in setting.rgb:
            given_hz = step.given.get(RATE, getattr(step.perturbation.parameters, RATE, None))
            if step.temporal != "drift" or given_hz is None or abs(given_hz - rate_hz) <= SAME * rate_hz:
                continue
            times = f"{rate_hz / given_hz:.3g} times as fast as in the scene, whose frames are {rate_hz:.4g} a second"
            text = f"{setting.name}: {step.perturbation.name} moves {times}; set "
            found.append(Message(text, PresetKey(RATE, f"{rate_hz:.4g}")))
    return found


# Writing a frame that was rendered or read into the files of every sequence that shows it.


# Chosen: 3 waiting frames keep two encoders busy beside the rendering, and memory does not grow with frames.
WAITING_FRAMES = 3
ENCODERS = 2
Encoder: TypeAlias = Callable[[NDArray[Any], OutputFormat], bytes]
"""Makes the file of an image."""


class Colour:
    """The colour of the sequences of a render, for one clean frame after another."""

    def __init__(
        self,
        sequences: Sequence[PlannedSequence],
        clean: CleanFrames,
        compositing: "Compositing | None" = None,
        *,
        lit: bool,
    ) -> None:
        """Take the sequences whose colour is perturbed. lit: clean frames have light before a view transform."""
        self._sequences = sequences
        self._from = clean
        self._compositing = compositing
        self._lit = lit

    @property
    def composites(self) -> bool:
        """Whether Blender's compositor perturbs some of it."""
        return self._compositing is not None

    def prepare(self, source: int) -> None:
        """Read what steps look back at for the frames that show a source frame. Call it before that frame is made."""
        earlier = self._from.colour.earlier
        if earlier is None:
            return
        for sequence in self._sequences:
            for frame in sequence.showing("rgb", source) if sequence.setting.looks_back else ():
                earlier.prepare(sequence, frame)

    def frames_of(self, clean: CleanFrame) -> FrameOf:
        """Return what gives the frames that show a clean one. Their images may be made in any thread."""
        earlier = self._from.colour.earlier
        if earlier is not None:
            earlier.keep(clean.source, clean.light_seen)
        pictures: dict[tuple[str, int], NDArray[Any] | None] = {}
        clean_frames = replace(
            self._from.of_one(clean), composited=lambda frame: pictures[frame.sequence.folder, frame.index]
        )
        coloured = [
            PlannedFrame(sequence, index, clean_frames)
            for sequence in self._sequences
            for index in sequence.showing("rgb", clean.source)
        ]
        composited = [frame for frame in coloured if frame.sequence.setting.composited]
        if composited:
            assert self._compositing is not None, "it was prepared for them"
            pictures |= self._compositing.pictures(clean, composited)
        for frame in coloured:
            if self._lit:
                frame.changed("rgb")  # at once, as Blender alone knows the view transform
            elif frame.sequence.setting.looks_back:
                _ = frame.colour  # reads the frames before it
        known = {(frame.sequence.folder, frame.index): frame for frame in coloured}
        return partial(_frame_of, known, clean_frames)


def _frame_of(
    known: Mapping[tuple[str, int], PlannedFrame], clean: CleanFrames, sequence: PlannedSequence, index: int
) -> PlannedFrame:
    return known.get((sequence.folder, index)) or PlannedFrame(sequence, index, clean)


@contextlib.contextmanager
def colour_of(
    sequences: Iterable[PlannedSequence],
    clean: CleanFrames,
    size_px: tuple[int, int],
    *,
    lit: bool = False,
    of_light: bool = False,
    device: Literal["cpu", "gpu"] = "cpu",
    reference_width_px: int | None = None,
) -> Iterator[Colour]:
    """Prepare to perturb the colour of sequences.

    clean: the cameras of the render. size_px: width and height of the frames. reference_width_px: to which
    parameters in pixels refer, by default that width; another one takes Blender's compositor.
    lit: clean frames have light before a view transform. of_light: that is what is stored. device: what Blender's
    compositor runs on.
    """
    perturbed = [item for item in sequences if item.frames and item.setting.rgb]
    chains = {item.folder: item.setting.rgb for item in perturbed if item.setting.composited}
    if not chains:
        yield Colour(perturbed, clean, lit=lit)
        return
    from .frame import compositing

    options: dict[str, Any] = {"device": device, "reference_width_px": reference_width_px}
    with compositing(chains, clean, size_px, lit=lit, of_light=of_light, **options) as carried_out:
        yield Colour(perturbed, clean, carried_out, lit=lit)


@dataclass(frozen=True)
class WrittenImage:
    """An image's file in the dataset, and its SHA-256. out_of_range: the depth that it cannot hold, None for none."""

    path: Path
    sha256: str
    out_of_range: OutOfRange | None = None


@dataclass(frozen=True)
class Lost:
    """A frame of a sequence some of whose depth its image cannot hold."""

    sequence: PlannedSequence
    frame: int
    out_of_range: OutOfRange


class FrameWriter:
    """Perturbs, encodes and writes frames in threads beside the rendering, for every sequence that shows them.

    An image that several sequences share is written once and linked. finished: what is not to be written again.
    first_lost: the first frame that was written whose depth 16 bits do not hold, None while there is none. clipped: by
    setting, what its steps make white or black of a sequence's first frame, where that is much.
    """

    def __init__(self, dataset: Dataset, render: Render, finished: FinishedImages, timer: StageTimer) -> None:
        """Open the journals. finished: what is not to be written again. timer: hears how long what took."""
        self._dataset = dataset
        self.scene = render.scene.name
        self.timer = self._timer = timer
        self._stamps = render.scene.source.frame_stamps
        self._names = dataset.format.names(self._stamps)
        self._sequences = [sequence for sequence in render.sequences if sequence.frames]
        self._channels = [name for name in in_order(dataset.format.modalities) if not CHANNELS[name].pairs]
        self.finished = finished
        for sequence in self._sequences:
            dataset.begin(sequence.folder)
        self._pool = ThreadPoolExecutor(ENCODERS, thread_name_prefix="encoder")
        self._waiting: deque[tuple[Future[Lost | None], int]] = deque()  # and how many frames are finished with it
        self.first_lost: Lost | None = None
        self.clipped: dict[str, Clipping] = {}

    def submit(self, clean: CleanFrame, frames: FrameOf) -> int:
        """Queue a clean frame; block while too many are queued. Return how many were finished meanwhile.

        frames: gives the frames that show it.

        Raises the error of an earlier frame, if there was one.
        """
        return self._queue(self._pool.submit(self._write, clean, frames), 1)

    def submit_pair(self, pair: "CleanPair") -> int:
        """Queue what leads from a clean frame to another, as `submit`."""
        return self._queue(self._pool.submit(self._write_pair, pair), 0)

    def _queue(self, writing: Future[Lost | None], frames: int) -> int:
        self._waiting.append((writing, frames))
        finished = 0
        while len(self._waiting) > WAITING_FRAMES or (self._waiting and self._waiting[0][0].done()):
            finished += self._take_next()
        return finished

    def drain(self) -> int:
        """Wait for all queued frames; return how many were finished."""
        return sum(self._take_next() for _ in range(len(self._waiting)))

    def _take_next(self) -> int:
        # In the frames' order, so that the first to lose depth is the same in every run.
        writing, frames = self._waiting.popleft()
        lost = writing.result()
        self.first_lost = self.first_lost or lost
        return frames

    def _write(self, clean: CleanFrame, frames: FrameOf) -> Lost | None:
        """Write all that shows a clean frame; return the first frame whose image does not hold its depth."""
        lost = None
        files = FrameFiles(self._dataset, clean, self.finished, self._timer)
        for sequence in self._sequences:
            records = [
                record
                for modality in self._channels
                for record in self._write_images(modality, sequence, clean, files, frames)
            ]
            self._append(sequence, records)
            for record in records:
                if lost is None and record.out_of_range is not None:
                    lost = Lost(sequence, record.frame, record.out_of_range)
        return lost

    def _write_pair(self, pair: "CleanPair") -> None:
        """Write all that leads from one clean frame to another."""
        files = FrameFiles(self._dataset, pair, self.finished, self._timer)
        for sequence in self._sequences:
            for channel in pair_channels(self._dataset.format.modalities):
                with self._timer.on(f"making {channel.spoken}"):
                    written = list(self._write_images(channel.name, sequence, pair, files, PlannedFrame))
                self._append(sequence, written)

    def _append(self, sequence: PlannedSequence, records: list[FrameRecord]) -> None:
        with self._timer.on("journals"):
            self._dataset.append(sequence.folder, records)

    def _write_images(
        self,
        modality: Modality,
        sequence: PlannedSequence,
        clean: "CleanFrame | CleanPair",
        files: "FrameFiles",
        frames: FrameOf,
    ) -> Iterator[FrameRecord]:
        """Write the images of a channel that show a clean frame, or lead from one to another."""
        for index in self.finished.missing(sequence, modality, clean.shown[0]):
            if sequence.shows(modality, index) != clean.shown:
                continue
            frame, name = frames(sequence, index), self._names.image(modality, index)
            written = files.put(modality, frame, name)
            if files.clipped is not None:
                self.clipped[sequence.setting.name] = files.clipped
            done = frame.record((modality,), self._dataset.format.modalities)
            yield self._record(index, {name: written.sha256}, done, written.out_of_range)

    def _record(
        self, frame: int, files: dict[str, str], done: dict[str, Any], lost: OutOfRange | None = None
    ) -> FrameRecord:
        time_s, depth_time_s = self._stamps.frame_times(frame)
        return FrameRecord(frame, time_s, files, done, lost, depth_time_s)

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(self, *_: object) -> None:
        # After an error, queued frames are dropped; the next run makes them.
        self._pool.shutdown(wait=True, cancel_futures=True)


class FrameFiles:
    """The images of one frame that several sequences may show, each written when it is first needed and linked later.

    A clean one that a sequence of the dataset has already is linked too. clipped: what the steps of the image that was
    put last clip of it, where it is a sequence's first frame and that is much.
    """

    def __init__(
        self, dataset: Dataset, clean: "CleanFrame | CleanPair", finished: FinishedImages, timer: StageTimer
    ) -> None:
        self._dataset = dataset
        self._timer = timer
        self._clean = clean
        self._finished = finished
        self._written: dict[Modality, WrittenImage] = {}
        self._perturbed: dict[Hashable, WrittenImage] = {}  # by the key of the frame's image
        self.clipped: Clipping | None = None

    def put(self, modality: Modality, frame: PlannedFrame, name: str) -> WrittenImage:
        """Put a frame's image under a name into its sequence; return the file that it was first written to."""
        folder, steps = frame.sequence.folder, frame.sequence.setting.on(modality)
        self.clipped = None
        if not steps:
            return self._put_clean(modality, folder, name)
        key = frame.key(modality)
        if (there := self._perturbed.get(key)) is not None:
            return self._linked(there, folder, name)
        with self._timer.on(f"perturbing: {' + '.join(step.perturbation.name for step in steps)}"):
            pixels = frame.taken(modality)
        if pixels is None:
            return self._put_clean(modality, folder, name)
        if modality == "rgb" and frame.index == 0 and pixels.dtype == np.uint8 and isinstance(self._clean, CleanFrame):
            self.clipped = clipping(frame.colour.active, self._clean.byte_rgb, pixels)
        written = self._put_image(modality, pixels, CHANNELS[modality].encode, folder, name)
        self._perturbed[key] = written
        return written

    def _put_clean(self, modality: Modality, folder: str, name: str) -> WrittenImage:
        """Put the clean image under a name into a sequence; return the file that it was first written to."""
        if modality not in self._written and (there := self._existing(modality)) is not None:
            self._linked(there, folder, name)
            # From now on this name is linked: where the existing file is on another disk, it is copied once.
            self._written[modality] = replace(there, path=self._dataset.out / folder / name)
        elif modality in self._written:
            self._linked(self._written[modality], folder, name)
        else:
            pixels, encode = self._clean.image(modality), CHANNELS[modality].encode_clean
            self._written[modality] = self._put_image(modality, pixels, encode, folder, name)
        return self._written[modality]

    def _existing(self, modality: Modality) -> WrittenImage | None:
        """Return the source's own file that holds the image, or one that is finished; None where there is none."""
        if whole := self._clean.file_as(modality, self._dataset.format):
            return WrittenImage(whole.path, whole.sha256)
        found = self._finished.clean_image(modality, self._clean.shown)
        return None if found is None else WrittenImage(found[0], found[1], out_of_range=found[2])

    def _put_image(
        self, modality: Modality, pixels: NDArray[Any], encode: Encoder, folder: str, name: str
    ) -> WrittenImage:
        """Write an image of a channel under a name into a sequence."""
        channel, format_ = CHANNELS[modality], self._dataset.format
        with self._timer.on(f"encoding {channel.spoken}"):
            try:
                data = encode(pixels, format_)
            except NoisyWorldError as error:
                raise NoisyWorldError(f"{folder}/{name}: {error}") from error
            lost = channel.lost(pixels, format_)
        return replace(self._put(folder, name, data), out_of_range=lost)

    def _put(self, folder: str, name: str, data: bytes) -> WrittenImage:
        with self._timer.on("hashing"):
            digest = sha256_of_bytes(data)
        with self._timer.on("writing"):
            self._dataset.write_file(folder, name, data)
        return WrittenImage(self._dataset.out / folder / name, digest)

    def _linked(self, there: WrittenImage, folder: str, name: str) -> WrittenImage:
        """Give a file that is written a name in a sequence; return the file."""
        with self._timer.on("linking"):
            self._dataset.link_file(there.path, folder, name)
        return there


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
        clean: "CleanFiles | None" = None,
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
        self._noted_clipped: set[str] = set()  # the settings that a note on clipping has named
        self._scene = KeptScene() if scene is None else scene
        self._clean = clean
        self._render = Kept[OpenSource]()
        self._colour = Kept[Colour]()
        self._closed_at_end = (self._render, self._colour, *([self._scene] if scene is None else []))
        self.report = Report()

    def make(self, render: Render, frames: Sequence[int], target: Dataset, finished: FinishedImages) -> None:
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
        return clean_frames_of(render, of_light=self._plan.format.of_light)(number, image)

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

    def _colour_of(self, render: Render, frames: Sequence[int], finished: FinishedImages, source: OpenSource) -> Colour:
        """Return what perturbs the colour of those sequences that lack some of it."""
        coloured = render.sequences if "rgb" in self._modalities else ()
        lacking = [item for item in coloured if item.frames and finished.lacks(item, "rgb", frames)]
        key = (render.name, *(item.folder for item in lacking))
        if (colour := self._colour.of(key)) is not None:
            return colour
        scene, seen = render.scene.source, partial(self._seen, render, source)
        looks_back = any(item.setting.looks_back for item in lacking)
        earlier = _earlier_frames(scene.stamps_s, seen) if looks_back else None
        size_px = (render.camera.width_px, render.camera.height_px)
        device = self._plan.preset.spec.render.compositor_device
        options = {"lit": scene.capabilities.lit, "of_light": self._plan.format.of_light, "device": device}
        cameras = cameras_of(render, self.paths_of(render), earlier)
        return self._colour.keep(key, colour_of(lacking, cameras, size_px, **options))

    def _seen(self, render: Render, source: OpenSource, number: int) -> NDArray[np.float32]:
        """Return what a meter sees of a source frame that is not made now."""
        return light_seen(source.frame(replace(self.paths_of(render).request(number), channels=frozenset({"rgb"}))))

    def _write(
        self,
        render: Render,
        frames: Sequence[int],
        source: OpenSource,
        colour: Colour,
        writer: FrameWriter,
    ) -> None:
        paths = self.paths_of(render)
        heard = None if render.scene.source.capabilities.rendered else writer.timer
        clean_of = clean_frames_of(render, heard, of_light=self._plan.format.of_light)
        pairs = self._pairs(render, frames, writer.finished)
        wanted = set(frames)
        for frame in sorted(wanted if pairs is None else wanted | pairs.sources):
            if self._stop.is_set():
                break
            start_s = time.perf_counter()
            if frame in wanted:
                colour.prepare(frame)  # before the frame: a lit one is shown until the source gives another
            with contextlib.nullcontext() if heard is None else heard.on(DECODING):
                image = source.frame(paths.request(frame))
            self._count_rays(image)
            clean = clean_of(frame, image)
            if self.report.first_frame_s is None:
                self.report.first_frame_s = time.perf_counter() - start_s
            if frame in wanted:
                with writer.timer.rest_on(COMPOSITING) if colour.composites else contextlib.nullcontext():
                    frame_of = colour.frames_of(clean)
                self._count(writer.submit(clean, frame_of), writer)
            for pair in () if pairs is None else pairs.of(clean, source, render, paths):
                self._count(writer.submit_pair(pair), writer)
        self._count(writer.drain(), writer)

    def _pairs(self, render: Render, frames: Sequence[int], finished: FinishedImages) -> "OpenPairs | None":
        """Return what leads from some source frames to others and is missing; None where no channel does."""
        channels = [channel.name for channel in pair_channels(self._modalities)]
        if not channels:
            return None
        from .frame import OpenPairs

        sequences = [item for item in render.sequences if item.frames]
        lacking = (finished.pairs(sequences, channels, frame) for frame in frames)
        return OpenPairs(set().union(*lacking), render.camera)

    def _count(self, frames: int, writer: FrameWriter) -> None:
        self._tell_lost(writer.first_lost)
        for setting, found in sorted(writer.clipped.items()):
            if setting not in self._noted_clipped:
                self._noted_clipped.add(setting)
                self._note(writer.scene, found.note(setting))
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


def _earlier_frames(stamps_s: NDArray[np.float64], seen: Callable[[int], NDArray[np.float32]]) -> "EarlierFrames":
    from .frame import EarlierFrames

    return EarlierFrames(stamps_s, seen)


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


# The report of a run: what it did, and how fast.


@dataclass
class Report:
    """What a run did, for run.json and for the user. refused: why sequences were left out, by their folders.

    processor_s: seconds of processors by stage, over all threads and processes. processors: those that shards were made
    on, where they are unlike, each with its shards. colour_rays, colour_pixels: of frames whose renderer chose by what
    it saw how many rays each pixel of colour took: all their rays and pixels.
    """

    frames_rendered: int = 0
    frames_kept: int = 0
    loading_s: float = 0.0
    first_frame_s: float | None = None
    rendering_s: float = 0.0
    total_s: float = 0.0
    peak_memory_bytes: int | None = None
    jobs: int = 1
    notes: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    processor_s: dict[str, float] = field(default_factory=dict)
    processors: list[dict[str, Any]] = field(default_factory=list)
    colour_rays: int = 0
    colour_pixels: int = 0

    @property
    def frames_per_s(self) -> float | None:
        """Frames per second from the first frame on, without loading."""
        return self.frames_rendered / self.rendering_s if self.frames_rendered and self.rendering_s > 0 else None

    @property
    def decoding_share(self) -> float | None:
        """The share of the processor's time in which images of recordings were decoded; None where none was."""
        decoding_s = self.processor_s.get(DECODING)
        return None if decoding_s is None else decoding_s / sum(self.processor_s.values())

    @property
    def rays_per_px(self) -> float | None:
        """The mean number of rays that a pixel of colour took; None where it was not the renderer that chose it."""
        return self.colour_rays / self.colour_pixels if self.colour_pixels else None

    def merge(self, other: "Report") -> None:
        """Add what another process did at the same time."""
        self.frames_rendered += other.frames_rendered
        self.loading_s = max(self.loading_s, other.loading_s)
        self.rendering_s = max(self.rendering_s, other.rendering_s)
        first = [value for value in (self.first_frame_s, other.first_frame_s) if value is not None]
        self.first_frame_s = min(first) if first else None
        self.peak_memory_bytes = (self.peak_memory_bytes or 0) + (other.peak_memory_bytes or 0) or None
        self.colour_rays += other.colour_rays
        self.colour_pixels += other.colour_pixels
        self.notes += [note for note in other.notes if note not in self.notes]
        self.add_processor_s(other.processor_s)

    def add(self, content: Mapping[str, Any]) -> None:
        """Add what was done at another time, by the content of its report."""
        self.frames_rendered += content["frames_rendered"]
        self.loading_s += content["loading_s"]
        self.rendering_s += content["rendering_s"]
        self.first_frame_s = content["first_frame_s"] if self.first_frame_s is None else self.first_frame_s
        peaks = [peak for peak in (self.peak_memory_bytes, content["peak_memory_bytes"]) if peak is not None]
        self.peak_memory_bytes = max(peaks, default=None)
        self.colour_rays += content.get("colour_rays", 0)
        self.colour_pixels += content.get("colour_pixels", 0)
        self.notes += [note for note in content["notes"] if note not in self.notes]
        self.add_processor_s(content["processor_s"])

    def add_processor_s(self, seconds: Mapping[str, float]) -> None:
        """Add seconds of processors by stage."""
        for stage, value in seconds.items():
            self.processor_s[stage] = self.processor_s.get(stage, 0.0) + value

    def content(self) -> dict[str, object]:
        """Return the content of run.json."""
        rate, rays_per_px = self.frames_per_s, self.rays_per_px
        rays = {"colour_rays": self.colour_rays, "colour_pixels": self.colour_pixels}
        return {
            "frames_rendered": self.frames_rendered,
            "frames_kept": self.frames_kept,
            "frames_per_s": None if rate is None else round(rate, 3),
            "loading_s": round(self.loading_s, 3),
            "first_frame_s": None if self.first_frame_s is None else round(self.first_frame_s, 3),
            "rendering_s": round(self.rendering_s, 3),
            "total_s": round(self.total_s, 3),
            "processor_s": {stage: round(value, 3) for stage, value in sorted(self.processor_s.items())},
            "peak_memory_bytes": self.peak_memory_bytes,
            "jobs": self.jobs,
            "notes": self.notes,
            **({"refused": self.refused} if self.refused else {}),
            **({} if rays_per_px is None else {"rays_per_px": round(rays_per_px, 3), **rays}),
            **({"processors": self.processors} if self.processors else {}),
        }


def processors_of(shards: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the processors that shards were made on, each with the names of its shards; none where all are alike."""
    found: list[dict[str, Any]] = []
    for shard in shards:
        same = [item for item in found if item["processor"] == shard["processor"]]
        if not same:
            found.append({"processor": shard["processor"], "shards": []})
        (same[0] if same else found[-1])["shards"].append(shard["shard"])
    return found if len(found) > 1 else []
