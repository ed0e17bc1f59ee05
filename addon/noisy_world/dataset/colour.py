# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour where the reference alone does not do: on light, by what was shown before, in Blender's compositor."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.machine import keep_freed_memory
from ..core.srgb import decoded, encoded
from ..images.pixels import rgb_bytes
from ..perturbations.execution import ColourWork, on_encoded, perturb_colour
from ..perturbations.kinds import MID_GREY, ColourPerturbation, EarlierFrame, FrameContext, ReadEarlier, earlier_than
from ..perturbations.steps import Step
from .frame import CleanFrame, CleanFrames, Frame
from .sequence import PlannedSequence

if TYPE_CHECKING:
    from ..nodes.compositor import Compositor

KEPT = 4096  # small images: 36 MiB at most, more than any frame of 60 Hz looks back; chosen

Pictures: TypeAlias = dict[str, NDArray[Any] | None]
"""By a sequence's folder, its frame's image (H, W, 3); None where it is the clean one."""

Chains: TypeAlias = Mapping[str, tuple[Step[ColourPerturbation], ...]]
"""Steps of colour by the folder of their sequence, in propagation order."""


# --- light ---


def acts_on_light(work: ColourWork) -> bool:
    """Tell whether a step acts on light, so before the view transform."""
    return any(step.perturbation.acts_on_light for step, _, _ in work.active)


def on_light(work: ColourWork, rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Do what acts on light to scene-linear light (H, W, 3), of any brightness; return light."""
    for step, context, severity in work.active:
        if step.perturbation.acts_on_light:
            rgb = perturb_light(step, rgb, severity, context)
    return rgb


def after_light(work: ColourWork, shown: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Do the rest to what the view transform has made of `on_light`: (H, W, 3), display-encoded in [0, 1]."""
    return on_encoded(tuple(item for item in work.active if not item[0].perturbation.acts_on_light), shown)


def perturb_light(
    step: Step[ColourPerturbation], light: NDArray[np.float32], severity: float | None, context: FrameContext
) -> NDArray[np.float32]:
    """Carry out one step on scene-linear light (H, W, 3) float32, of any brightness; the result is at least 0.

    Some carry out their node group. What only averages works on light itself; the others as ever, on encoded values, by
    sRGB's curve, which goes on above 1.
    """
    context = replace(context, lit=True)
    if step.perturbation.lit_by_nodes:
        from ..perturbations.as_nodes import as_nodes

        made = as_nodes(step.perturbation, light, step.parameters(severity), context)
    elif step.perturbation.averages:
        made = perturb_colour(step, light, severity, context)
    else:
        made = decoded(perturb_colour(step, encoded(light), severity, context))
    return np.maximum(made, np.float32(0))


# --- frames that were shown before ---


class EarlierFrames:
    """What the frames of one render's sequences have before them.

    stamps_s: (N,) of the sequence's frames. read: returns what a meter sees of a source frame that is not kept.
    """

    def __init__(self, stamps_s: NDArray[np.float64], read: Callable[[int], NDArray[np.float32]]) -> None:
        self._stamps_s = stamps_s
        self._read = read
        self._kept: OrderedDict[int, EarlierFrame] = OrderedDict()
        self._lock = threading.Lock()

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads the frames before one of a sequence, and what is equal where these are.

        They are looked up at once, so that later it may be called in any thread.
        """
        numbers = earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s)
        sources = tuple(int(sequence.source_frames[number]) for number in numbers)
        stamps_s = self._stamps_s
        seen = tuple(
            replace(self._frame(source), stamp_s=float(stamps_s[number]))
            for number, source in zip(numbers, sources, strict=True)
        )

        def read(span_s: float) -> tuple[EarlierFrame, ...]:
            return seen[-len(earlier_than(stamps_s, frame, span_s)) :]

        return read, (frame, sources)

    def prepare(self, sequence: PlannedSequence, frame: int) -> None:
        """Read what is before a frame of a sequence and is not kept, but for what the frame itself shows."""
        own = sequence.source_frames[frame]
        for number in earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s):
            if (source := int(sequence.source_frames[number])) != own:
                self._frame(source)

    def keep(self, source: int, light: NDArray[np.float32]) -> None:
        """Keep what a meter sees of a source frame."""
        with self._lock:
            self._kept[source] = EarlierFrame(0.0, light)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)

    def _frame(self, source: int) -> EarlierFrame:
        if (frame := self._kept.get(source)) is None:
            light = self._read(source)
            self.keep(source, light)
            frame = self._kept.get(source) or EarlierFrame(0.0, light)
        return frame


class GreyFrames(EarlierFrames):
    """What frames have before them where none are known, as in a live preview: mid-grey."""

    def __init__(self) -> None:
        super().__init__(np.zeros(0), lambda _source: MID_GREY.light)

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads a mid-grey frame."""
        del sequence, frame
        return lambda _span_s: (MID_GREY,), None


# --- Blender's compositor ---


class Compositing:
    """Steps of colour carried out by Blender's compositor, which works only in the main thread."""

    def __init__(self, compositor: "Compositor") -> None:
        """Take the compositor with a chain for each sequence's folder."""
        self._compositor = compositor

    def pictures(self, clean: CleanFrame, frames: Sequence[Frame]) -> dict[tuple[str, int], NDArray[Any] | None]:
        """Perturb all frames, several sequences in one evaluation; what several do alike is evaluated once."""
        made: dict[tuple[str, int], NDArray[Any] | None] = {}
        waiting = list(frames)
        while waiting:
            # A chain gives one image per evaluation; a sequence that shows the source frame twice takes another one.
            turn = {frame.sequence.folder: frame for frame in reversed(waiting)}
            waiting = [frame for frame in waiting if turn[frame.sequence.folder] is not frame]
            made |= {(folder, turn[folder].index): image for folder, image in self._turn(clean, turn).items()}
        return made

    def _turn(self, clean: CleanFrame, frames: Mapping[str, Frame]) -> Pictures:
        return self._perturbed(self._compositor, clean.rgb, clean, frames)

    @staticmethod
    def _perturbed(
        compositor: "Compositor", rgb: NDArray[Any], clean: CleanFrame, frames: Mapping[str, Frame]
    ) -> Pictures:
        """Return the frames' colour, rounded, after the chains of a compositor. rgb: encoded, what these are given."""
        made = compositor.perturb(rgb, *_inputs(clean, frames))
        return {folder: pixels for folder, (pixels, _) in made.items()}


class LitCompositing(Compositing):
    """The same on lit frames: on light before the view transform, and on what that shows after it.

    parts: the steps before it, and those after it. of_light: light itself is stored, so there are no steps after it.
    """

    def __init__(
        self, parts: tuple[Chains, Chains], compositors: "tuple[Compositor, Compositor]", of_light: bool
    ) -> None:
        self._of_light = of_light
        self._before, after = compositors
        super().__init__(after)
        self._early, self._late = parts

    def _turn(self, clean: CleanFrame, frames: Mapping[str, Frame]) -> Pictures:
        assert clean.light is not None, "its source is lit"
        early = {folder: frame for folder, frame in frames.items() if folder in self._early}
        lights, _ = self._before.evaluate(clean.light.rgb, *_inputs(clean, early))
        if self._of_light:
            return {folder: lights.get(folder) for folder in frames}
        shown = {id(light): clean.light.show(light) for light in lights.values() if light is not None}
        found: Pictures = {}
        for folder, frame in frames.items():
            seen = shown.get(id(lights.get(folder)))
            found[folder] = None if seen is None else rgb_bytes(seen)
            if folder in self._late:
                given = clean.rgb if seen is None else seen
                late = self._perturbed(self._compositor, given, clean, {folder: frame})[folder]
                found[folder] = found[folder] if late is None else late
        return found


def _inputs(clean: CleanFrame, frames: Mapping[str, Frame]) -> tuple[Any, ...]:
    """Return what a compositor is told of frames beside the image, by the folder of their sequence."""
    from ..nodes.chain import decided_by  # only Blender's compositor has groups

    needs_depth = any(frame.sequence.setting.needs_depth for frame in frames.values())
    return (
        {folder: (frame.index, frame.sequence.identifiers) for folder, frame in frames.items()},
        clean.read_seen_depth_m() if needs_depth else None,
        {folder: frame.motion for folder, frame in frames.items()},
        {folder: decided_by(frame.colour) for folder, frame in frames.items()},
    )


@contextmanager
def compositing(
    chains: Chains, clean: CleanFrames, size_px: tuple[int, int], *, lit: bool, of_light: bool
) -> Iterator[Compositing]:
    """Prepare Blender's compositor for some chains. clean, size_px, lit, of_light: as `colour_of` takes them."""
    from ..nodes.compositor import Compositor

    keep_freed_memory()
    known = size_px[0], clean.colour.intrinsics
    if not lit:
        with Compositor(size_px, chains, *known) as compositor:
            yield Compositing(compositor)
        return
    before, after = parts = _parted(chains)
    with Compositor(size_px, before, *known, lit=True) as of_lights, Compositor(size_px, after, *known) as of_shown:
        yield LitCompositing(parts, (of_lights, of_shown), of_light)


def _parted(chains: Chains) -> tuple[Chains, Chains]:
    """Return each chain's steps before the sensor, and the others, of chains that have any."""
    parts: tuple[dict[str, tuple[Step[ColourPerturbation], ...]], ...] = ({}, {})
    for name, steps in chains.items():
        for part, early in zip(parts, (True, False), strict=True):
            if own := tuple(step for step in steps if step.perturbation.acts_on_light == early):
                part[name] = own
    return parts[0], parts[1]
