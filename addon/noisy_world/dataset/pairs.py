# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean images of pairs of source frames, such as optical flow."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from ..channels.channel import View
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..render.source import Motion, OpenSource, motion_between
from .frame import CleanFrame, CleanPair
from .plan import Render
from .sequence import ShownSources


class OpenPairs:
    """The pairs that are to be made, and what is seen at those of their source frames that have been taken.

    What is seen is kept until its last pair is whole.
    """

    def __init__(self, wanted: Iterable[ShownSources], camera: Intrinsics) -> None:
        """Take the pairs; one without a next source frame is whole from its first on."""
        self._wanted = set(wanted)
        self._camera = camera
        self._views: dict[int, View] = {}

    @property
    def sources(self) -> set[int]:
        """The source frames that are still to be seen."""
        return {source for pair in self._wanted for source in pair if source is not None}

    def of(self, clean: CleanFrame, source: OpenSource, render: Render, paths: SensorPaths) -> list[CleanPair]:
        """Take a clean frame of a render, whose source is open; return the pairs that are whole now."""
        view = partial(view_of, lambda: source, paths, clean, self._camera)
        return self.take(clean.source, view, partial(motion_of, source, render, paths))

    def take(
        self, source: int, view: Callable[[], View], motion: Callable[[int, int], Motion | None]
    ) -> list[CleanPair]:
        """Take what is seen at a source frame, where a pair needs it; return the pairs that are whole now.

        motion: returns how what is seen at two source frames moves from one to the other; None where nothing moves.
        """
        if any(source in pair and None not in pair for pair in self._wanted):
            self._views[source] = view()
        made: list[CleanPair] = []
        for here, there in sorted(self._wanted, key=lambda pair: pair[0]):
            if there is None and source == here:
                made.append(CleanPair((here, there), self._camera))
            elif there is not None and {here, there} <= self._views.keys():
                views = self._views[here], self._views[there]
                if (moves := motion(here, there)) is not None:
                    views = tuple(replace(item, to_other_px=px) for item, px in zip(views, moves, strict=True))
                made.append(CleanPair((here, there), self._camera, *views))
        self._wanted.difference_update(pair.shown for pair in made)
        for done in self._views.keys() - self.sources:
            del self._views[done]
        return made


def motion_of(source: OpenSource, render: Render, paths: SensorPaths, here: int, there: int) -> Motion | None:
    """Return how what is seen at two source frames of a render moves from one to the other; None where nothing does."""
    if not render.scene.source.capabilities.moving:
        return None
    return motion_between(source, paths.request(here), paths.request(there))


def view_of(source: Callable[[], OpenSource], paths: SensorPaths, clean: CleanFrame, camera: Intrinsics) -> View:
    """Return what the colour camera sees at a source frame: where a rig has depth elsewhere, seen from colour's place.

    source: returns that of the render's frames. paths: of the render. clean: the source frame.
    """
    request = paths.request(clean.source)
    if paths.depth is None:
        return View(clean.read_depth_m(), request.rgb_c2w, camera)
    # By its time, as it is none of the frames that may be kept.
    seen = source().frame(replace(request, index=None, depth_c2w=request.rgb_c2w))
    assert seen.depth_m is not None, "depth was asked for"
    return View(seen.depth_m, request.rgb_c2w, camera)
