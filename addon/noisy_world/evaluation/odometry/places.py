# SPDX-License-Identifier: GPL-3.0-or-later
"""Place recognition: keyframes in which views are found again, after tracking was lost and for loops."""

from collections.abc import Callable, Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import invert_pose
from .agreement import Agreement, agreement
from .alignment import Aligner, RgbdView
from .features import Landmarks, Recogniser
from .frames import FrameEntry
from .pictures import Pictures

Float64: TypeAlias = NDArray[np.float64]

THUMBNAIL_PX = (16, 12)
ALIKE = 10  # keyframes that look most alike, which a lost view is compared with


class Places:
    """The keyframes so far: their features and a thumbnail each. Their images are read again when they are needed."""

    def __init__(self, aligner: Aligner, pictures: Pictures) -> None:
        self.aligner = aligner
        self._pictures = pictures
        self._recogniser = Recogniser(aligner.camera)
        self.entries: list[FrameEntry] = []
        self.landmarks: list[Landmarks] = []
        self._thumbnails: list[Float64] = []

    def forget(self) -> None:
        """Begin anew."""
        self.entries, self.landmarks, self._thumbnails = [], [], []

    def remember(self, entry: FrameEntry, view: RgbdView) -> None:
        """Take in the next keyframe."""
        self.entries.append(entry)
        self.landmarks.append(self._recogniser.landmarks(view))
        self._thumbnails.append(_thumbnail(view))

    def view(self, number: int) -> RgbdView:
        """Read a keyframe's images again."""
        return self.aligner.view(*self._pictures.read(self.entries[number]))

    def found(self, view: RgbdView, fits: Callable[[Agreement], bool]) -> tuple[int, Float64, Agreement] | None:
        """Return a keyframe that a lost view fits, the view's place in it (4, 4), and how well they agree."""
        landmarks = self._recogniser.landmarks(view)
        for number in self._alike(view):
            guess = self._recogniser.motion(self.landmarks[number], landmarks)
            if guess is None:
                continue
            placed = self.placed(self.view(number), view, guess, fits)
            if placed is not None:
                return number, *placed
        return None

    def recognised(self, source: int, target: int) -> Float64 | None:
        """Return target_from_source (4, 4) of two keyframes by their features, None where these do not tell."""
        return self._recogniser.motion(self.landmarks[source], self.landmarks[target])

    def placed(
        self, source: RgbdView, target: RgbdView, guess: Float64, fits: Callable[[Agreement], bool]
    ) -> tuple[Float64, Agreement] | None:
        """Return source_from_target (4, 4), found from a guess of its inverse, if the two views fit."""
        motion = self.aligner.refined(source, target, guess)
        if motion is None:
            return None
        seen = agreement(self.aligner.camera, source, target, motion)
        return (invert_pose(motion), seen) if fits(seen) else None

    def _alike(self, view: RgbdView) -> Iterable[int]:
        """Return the keyframes that look most like a view, by the correlation of their thumbnails, the best first."""
        if not self._thumbnails:
            return []
        likeness = np.stack(self._thumbnails) @ _thumbnail(view)
        return np.argsort(-likeness, kind="stable")[:ALIKE].tolist()


def _thumbnail(view: RgbdView) -> Float64:
    """Return a small picture as a vector of mean 0 and length 1 (0 if it is uniform)."""
    import cv2

    small = np.asarray(cv2.resize(view.grey, THUMBNAIL_PX, interpolation=cv2.INTER_AREA), np.float64).ravel()
    small -= small.mean()
    length = float(np.linalg.norm(small))
    return small / length if length > 0.0 else small
