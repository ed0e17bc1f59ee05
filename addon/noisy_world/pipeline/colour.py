# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbed colour, by Blender's compositor or by the reference: both are asked here, in the same words."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Protocol

from ..core.machine import keep_freed_memory
from ..core.perturbing.execution import perturb_rgb
from ..core.planning.sequence import Sequence
from .clean_frame import Camera, CleanFrame, Perturbed

if TYPE_CHECKING:
    from ..blender.compositor import Compositor

type Colours = Mapping[tuple[str, int], Callable[[], Perturbed]]
"""By a sequence's folder and the number of its frame: what gives its colour. Called once, in any thread."""


class ColourExecutor(Protocol):
    """Carries out the perturbations of colour."""

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Perturb a clean frame for each sequence and frame of it that shows it."""
        ...


class ReferenceColour:
    """numpy and OpenCV. The work is done where the result is asked for, beside the rendering."""

    def __init__(self, camera: Camera) -> None:
        """Take what is known of the camera."""
        self._camera = camera

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Return what perturbs each frame when it is called."""
        return {(sequence.folder, frame): partial(self._one, clean, sequence, frame) for sequence, frame in asked}

    def _one(self, clean: CleanFrame, sequence: Sequence, frame: int) -> Perturbed:
        return perturb_rgb(sequence.setting.rgb, clean.rgb, self._camera.context(sequence, frame, clean))


class CompositorColour:
    """Blender's compositor, which works in the main thread alone: the work is done at once."""

    def __init__(self, compositor: "Compositor") -> None:
        """Take the compositor with a chain for each sequence's folder."""
        self._compositor = compositor

    def perturb(self, clean: CleanFrame, asked: list[tuple[Sequence, int]]) -> Colours:
        """Perturb all frames, several sequences in one evaluation."""
        made: dict[tuple[str, int], Callable[[], Perturbed]] = {}
        waiting = list(asked)
        while waiting:
            # A chain gives one picture an evaluation; a sequence that shows the source frame twice waits its turn.
            turn = {sequence.folder: (sequence, frame) for sequence, frame in reversed(waiting)}
            waiting = [item for item in waiting if item not in turn.values()]
            frames = {folder: (frame, sequence.identifiers) for folder, (sequence, frame) in turn.items()}
            needs_depth = any(sequence.setting.needs_depth for sequence, _ in turn.values())
            pictures = self._compositor.perturb(clean.rgb, frames, clean.depth_m if needs_depth else None)
            made |= {(folder, frames[folder][0]): partial(_given, picture) for folder, picture in pictures.items()}
        return made


def _given(perturbed: Perturbed) -> Perturbed:
    return perturbed


class Colour:
    """The colour of every sequence of a render, each by the executor that its setting names."""

    def __init__(self, executors: Mapping[ColourExecutor, list[Sequence]]) -> None:
        """Take the executors, each with its sequences."""
        self._executors = executors

    def of(self, clean: CleanFrame) -> Colours:
        """Return what gives the colour of each frame that shows a clean one perturbed."""
        colours: dict[tuple[str, int], Callable[[], Perturbed]] = {}
        for executor, sequences in self._executors.items():
            asked = [(sequence, frame) for sequence in sequences for frame in sequence.showing("rgb", clean.source)]
            if asked:
                colours |= executor.perturb(clean, asked)
        return colours


@contextmanager
def colour_of(sequences: Iterable[Sequence], camera: Camera, size_px: tuple[int, int]) -> Iterator[Colour]:
    """Prepare the executors that sequences need.

    size_px: width and height of the frames; the width is the one that sizes in pixels are meant at.
    """
    perturbed = [item for item in sequences if item.frames and item.setting.rgb]
    composited = [item for item in perturbed if item.setting.composited]
    executors: dict[ColourExecutor, list[Sequence]] = {
        ReferenceColour(camera): [item for item in perturbed if not item.setting.composited]
    }
    if not composited:
        yield Colour(executors)
        return
    from ..blender.compositor import Compositor

    keep_freed_memory()
    chains = {item.folder: item.setting.rgb for item in composited}
    with Compositor(size_px, chains, size_px[0]) as compositor:
        yield Colour({**executors, CompositorColour(compositor): composited})
