# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour where the reference alone does not do: on light, by what was shown before, in Blender's compositor."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from numpy.typing import NDArray

from ..core.machine import keep_freed_memory
from ..images.pixels import rgb_bytes
from ..perturbations.kinds import ColourPerturbation
from ..perturbations.steps import Step
from .frame import CleanFrame, CleanFrames, PlannedFrame

if TYPE_CHECKING:
    from ..nodes.compositor import Compositor

Pictures: TypeAlias = dict[str, NDArray[Any] | None]
"""By a sequence's folder, its frame's image (H, W, 3); None where it is the clean one."""

Chains: TypeAlias = Mapping[str, tuple[Step[ColourPerturbation], ...]]
"""Steps of colour by the folder of their sequence, in propagation order."""


# --- Blender's compositor ---


class Compositing:
    """Steps of colour carried out by Blender's compositor, which works only in the main thread."""

    def __init__(self, compositor: "Compositor") -> None:
        """Take the compositor with a chain for each sequence's folder."""
        self._compositor = compositor

    def pictures(self, clean: CleanFrame, frames: Sequence[PlannedFrame]) -> dict[tuple[str, int], NDArray[Any] | None]:
        """Perturb all frames, several sequences in one evaluation; what several do alike is evaluated once."""
        made: dict[tuple[str, int], NDArray[Any] | None] = {}
        waiting = list(frames)
        while waiting:
            # A chain gives one image per evaluation; a sequence that shows the source frame twice takes another one.
            turn = {frame.sequence.folder: frame for frame in reversed(waiting)}
            waiting = [frame for frame in waiting if turn[frame.sequence.folder] is not frame]
            made |= {(folder, turn[folder].index): image for folder, image in self._turn(clean, turn).items()}
        return made

    def _turn(self, clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> Pictures:
        return self._perturbed(self._compositor, clean.rgb, clean, frames)

    @staticmethod
    def _perturbed(
        compositor: "Compositor", rgb: NDArray[Any], clean: CleanFrame, frames: Mapping[str, PlannedFrame]
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

    def _turn(self, clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> Pictures:
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


def _inputs(clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> tuple[Any, ...]:
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
