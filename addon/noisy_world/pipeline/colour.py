# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbed colour, by Blender's compositor or by the reference, behind one interface."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.images import rgb_bytes
from ..core.datasets.records import COMPLETED
from ..core.machine import keep_freed_memory
from ..core.node_graphs.chain import Decided, capacity_of, decided_by
from ..core.perturbing.contexts import Identifiers
from ..core.perturbing.execution import ColourWork, Notes
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.perturbing.steps import Step
from ..core.planning.sequence import Sequence
from ..core.trajectories.motion import CameraMotion
from .clean_frame import Camera, CleanFrame
from .earlier import EarlierFrames

if TYPE_CHECKING:
    from ..blender.compositor import Compositor

T = TypeVar("T")


@dataclass(frozen=True)
class PerturbedImage:
    """Colour or depth of a frame that shows a clean one perturbed.

    key: equal for equal work on a clean frame, in whatever sequences. notes: what is done, for frames.jsonl. pixels:
    makes it: (H, W, 3) uint8, or float32 light, or (H, W) float32 metres; None where it is the clean image. camera:
    what the camera's automatics decided, by name, for frames.jsonl too. completed: what of the depth that it was made
    by was not measured, likewise.
    """

    key: Hashable
    notes: Notes
    pixels: Callable[[], NDArray[Any] | None]
    camera: Mapping[str, float] = field(default_factory=dict[str, float])
    completed: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def decided(self) -> dict[str, Any]:
        """What frames.jsonl has of it beside its steps, by name."""
        found = {"camera": dict(self.camera), COMPLETED: dict(self.completed)}
        return {name: values for name, values in found.items() if values}


_Frames: TypeAlias = Mapping[str, tuple[int, Identifiers]]
_Motions: TypeAlias = Mapping[str, CameraMotion | None]
_Pictures: TypeAlias = Mapping[str, tuple[NDArray[Any] | None, Notes]]
Chains: TypeAlias = Mapping[str, tuple[Step[ColourPerturbation], ...]]
"""Steps of colour by the folder of their sequence, in propagation order."""

Colours: TypeAlias = Mapping[tuple[str, int], Callable[[], PerturbedImage]]
"""By a sequence's folder and a frame's number: a function that returns its colour; called once, in any thread."""


class ColourExecutor(Protocol):
    """Carries out the perturbations of colour."""

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Perturb a clean frame for each pair of a sequence and a frame of it that shows the clean one."""
        ...


class ReferenceColour:
    """numpy and OpenCV. The work is done when the result is asked for, in the writer's threads beside the rendering."""

    def __init__(self, camera: Camera) -> None:
        """Keep the camera."""
        self._camera = camera

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Return for each frame a function that perturbs it."""
        return {
            (sequence.folder, frame): partial(self._one, clean, sequence, self._camera.context(sequence, frame, clean))
            for sequence, frame in asked
        }

    def _one(self, clean: CleanFrame, sequence: Sequence, where: FrameContext) -> PerturbedImage:
        work = ColourWork.of(sequence.setting.rgb, where)
        completed = clean.completed(work)
        return PerturbedImage(
            ("reference", work.key), work.notes, lambda: clean.perturbed_rgb(work), work.decided, completed
        )


class ReferenceLight:
    """numpy and OpenCV on lit frames. The work is done at once, as Blender alone knows the view transform."""

    def __init__(self, camera: Camera) -> None:
        """Keep the camera."""
        self._camera = camera

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Perturb all frames; what several do alike is done once."""
        made: dict[tuple[str, int], Callable[[], PerturbedImage]] = {}
        pictures: dict[Hashable, NDArray[Any] | None] = {}
        for sequence, frame in asked:
            work = ColourWork.of(sequence.setting.rgb, self._camera.context(sequence, frame, clean))
            if work.key not in pictures:
                pictures[work.key] = clean.perturbed_rgb(work)
            image = PerturbedImage(
                *(("reference", work.key), work.notes, partial(_given, pictures[work.key])),
                *(work.decided, clean.completed(work)),
            )
            made[sequence.folder, frame] = partial(_given, image)
        return made


class CompositorColour:
    """Blender's compositor, which works only in the main thread, so the work is done at once."""

    def __init__(self, compositor: "Compositor", camera: Camera) -> None:
        """Take the compositor with a chain for each sequence's folder."""
        self._compositor = compositor
        self._camera = camera

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Perturb all frames, several sequences in one evaluation; what several do alike is evaluated once."""
        made: dict[tuple[str, int], Callable[[], PerturbedImage]] = {}
        waiting = asked
        while waiting:
            # A chain gives one image per evaluation; a sequence that shows the source frame twice takes another one.
            turn = {sequence.folder: (sequence, frame) for sequence, frame in reversed(waiting)}
            waiting = [item for item in waiting if item not in turn.values()]
            frames = {folder: (frame, sequence.identifiers) for folder, (sequence, frame) in turn.items()}
            needs_depth = any(sequence.setting.needs_depth for sequence, _ in turn.values())
            depth_m = clean.read_seen_depth_m() if needs_depth else None
            contexts = {
                folder: self._camera.context(sequence, frame, clean) for folder, (sequence, frame) in turn.items()
            }
            motions = {folder: context.motion for folder, context in contexts.items()}
            works = {
                folder: ColourWork.of(sequence.setting.rgb, contexts[folder]) for folder, (sequence, _) in turn.items()
            }
            decided = {folder: decided_by(work) for folder, work in works.items()}
            pictures = self._pictures(clean, frames, depth_m, motions, decided)
            for folder, (_, frame) in turn.items():
                (pixels, notes), work = pictures[folder], works[folder]
                image = PerturbedImage(
                    self._key(work), notes, partial(_given, pixels), work.decided, clean.completed(work)
                )
                made[folder, frame] = partial(_given, image)
        return made

    def _pictures(
        self,
        clean: CleanFrame,
        frames: _Frames,
        depth_m: NDArray[np.float32] | None,
        motions: _Motions,
        decided: Decided,
    ) -> _Pictures:
        """Return each sequence's image (H, W, 3), None where it is the clean one, and what is done."""
        return self._compositor.perturb(clean.rgb, frames, depth_m, motions, decided)

    def _key(self, work: ColourWork) -> Hashable:
        """Return what of the work decides the image: groups that serve more than by default are others, too."""
        return "compositor", work.key, tuple(tuple(capacity_of(step).items()) for step, _, _ in work.active)


class CompositorLight(CompositorColour):
    """Blender's compositor on lit frames: on light before the view transform, and on what that shows after it."""

    def __init__(
        self,
        parts: tuple[Chains, Chains],
        compositors: "tuple[Compositor, Compositor]",
        camera: Camera,
        of_light: bool = False,
    ) -> None:
        """Take the steps before it, and those after it, with a compositor for each of the two.

        of_light: light itself is stored, so there are no steps after it.
        """
        self._of_light = of_light
        self._before, after = compositors
        super().__init__(after, camera)
        self._early, self._late = parts

    def _pictures(
        self,
        clean: CleanFrame,
        frames: _Frames,
        depth_m: NDArray[np.float32] | None,
        motions: _Motions,
        decided: Decided,
    ) -> _Pictures:
        assert clean.light is not None, "its source is lit"
        early = {folder: frames[folder] for folder in frames if folder in self._early}
        lights, notes = self._before.evaluate(clean.light.rgb, early, depth_m, motions, decided)
        if self._of_light:
            return {folder: (lights.get(folder), notes.get(folder, [])) for folder in frames}
        shown = {id(light): clean.light.show(light) for light in lights.values() if light is not None}
        found: dict[str, tuple[NDArray[np.uint8] | None, Notes]] = {}
        for folder, frame in frames.items():
            seen = shown.get(id(lights.get(folder)))
            pixels, done = None if seen is None else rgb_bytes(seen), notes.get(folder, [])
            if folder in self._late:
                given = clean.rgb if seen is None else seen
                late, more = self._compositor.perturb(given, {folder: frame}, depth_m, motions, decided)[folder]
                pixels, done = pixels if late is None else late, done + more
            found[folder] = pixels, done
        return found


def _given(value: T) -> T:
    return value


class Colour:
    """The colour of every sequence of a render, each by the executor that its setting names."""

    def __init__(
        self, executors: Mapping[ColourExecutor, list[Sequence]], earlier: EarlierFrames | None = None
    ) -> None:
        """Take the executors, each with its sequences. earlier: what these showed before a frame, if one asks."""
        self._executors = executors
        self._earlier = earlier

    def prepare(self, source: int) -> None:
        """Read what steps look back at for the frames that show a source frame. Call it before that frame is made."""
        if self._earlier is None:
            return
        for sequence in (item for sequences in self._executors.values() for item in sequences):
            for frame in sequence.showing("rgb", source) if sequence.setting.looks_back else ():
                self._earlier.prepare(sequence, frame)

    def of(self, clean: CleanFrame) -> Colours:
        """Return a function for the colour of each frame that shows the clean one perturbed."""
        if self._earlier is not None:
            self._earlier.keep(clean.source, clean.light_seen)
        colours: dict[tuple[str, int], Callable[[], PerturbedImage]] = {}
        for executor, sequences in self._executors.items():
            asked = [(sequence, frame) for sequence in sequences for frame in sequence.showing("rgb", clean.source)]
            if asked:
                colours |= executor.perturb(clean, asked)
        return colours


@contextmanager
def colour_of(
    sequences: Iterable[Sequence],
    camera: Camera,
    size_px: tuple[int, int],
    *,
    lit: bool = False,
    of_light: bool = False,
) -> Iterator[Colour]:
    """Prepare the executors that sequences need.

    size_px: width and height of the frames; parameters in pixels refer to this width. lit: clean frames have light
    before a view transform. of_light: that is what is stored.
    """
    perturbed = [item for item in sequences if item.frames and item.setting.rgb]
    composited = [item for item in perturbed if item.setting.composited]
    on_arrays = ReferenceLight(camera) if lit else ReferenceColour(camera)
    executors: dict[ColourExecutor, list[Sequence]] = {
        on_arrays: [item for item in perturbed if not item.setting.composited]
    }
    if not composited:
        yield Colour(executors, camera.earlier)
        return
    from ..blender.compositor import Compositor

    keep_freed_memory()
    with ExitStack() as opened:

        def compositor(chains: Chains, *, lit: bool = False) -> Compositor:
            return opened.enter_context(Compositor(size_px, chains, size_px[0], camera.intrinsics, lit=lit))

        chains = {item.folder: item.setting.rgb for item in composited}
        if lit:
            before, after = parts = _parted(chains)
            by_nodes = CompositorLight(parts, (compositor(before, lit=True), compositor(after)), camera, of_light)
        else:
            by_nodes = CompositorColour(compositor(chains), camera)
        yield Colour({**executors, by_nodes: composited}, camera.earlier)


def _parted(chains: Chains) -> tuple[Chains, Chains]:
    """Return each chain's steps before the sensor, and the others, of chains that have any."""
    parts: tuple[dict[str, tuple[Step[ColourPerturbation], ...]], ...] = ({}, {})
    for name, steps in chains.items():
        for part, early in zip(parts, (True, False), strict=True):
            if own := tuple(step for step in steps if step.perturbation.acts_on_light == early):
                part[name] = own
    return parts[0], parts[1]
