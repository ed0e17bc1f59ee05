# SPDX-License-Identifier: GPL-3.0-or-later
"""Training the vocabulary of ORB-SLAM3 on pictures of an embedded room.

ORB-SLAM3 finds places again by words of its own descriptors. What its authors give away is 145 MB of words of
photographs; this one is a tree of the same format (DBoW2's text, as ORB-SLAM2 reads and writes it), trained on frames
of a room that belongs to no study. Its tree is made by k-means with medians of bits, from a fixed seed.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.planning.exposed import render_options
from ...core.planning.source_paths import source_paths
from ...core.presets.preset import read_preset
from ...core.scenes.embedded import room_mesh
from ...core.shipped import shipped
from ...pipeline.clean_frame import CleanFrame
from ...planning import make_plan

Bits: TypeAlias = NDArray[np.uint8]
"""(N, 256): descriptors, a bit in each."""

ROOM = 7
FRAMES, RATE_HZ = 60, 1
FEATURES = 1500  # of a frame
BRANCHES, DEPTH = 10, 6  # of the tree, as the authors' has them; ORB-SLAM looks four levels above its words
WORD = 8  # chosen: descriptors of a word, about; words of single ones would match nothing again
ROUNDS = 8
TF_IDF_L1 = "0 0"  # weighting and score of DBoW2


def train(frames: int = FRAMES) -> str:
    """Return the vocabulary, trained on so many pictures, as DBoW2's text. It is the same each time."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return vocabulary_text([descriptors(frame) for frame in rendered(frames)])
    finally:
        cv2.setNumThreads(threads)


def rendered(frames: int) -> list[NDArray[np.uint8]]:
    """Return frames (480, 640, 3) of the room's path, RGB."""
    overrides = [
        "settings=[{name: clean}]",
        f"scenes.0.mesh={room_mesh(ROOM)}",
        f"scenes.0.trajectory={{handheld: {{frames: {frames}, rate_hz: {RATE_HZ}}}}}",
        "camera={width: 640, height: 480, fx: 600, fy: 600, cx: 319.5, cy: 239.5}",
    ]
    plan = make_plan(read_preset(shipped("presets/demo.yaml"), overrides))
    render = plan.renders[0]
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan, render), print)
        requests = [paths.request(number) for number in range(frames)]
        return [CleanFrame(request.frame, source.frame(request)).byte_rgb for request in requests]


def descriptors(rgb: NDArray[np.uint8]) -> Bits:
    """Return the ORB descriptors of a picture (H, W, 3)."""
    import cv2

    detector = cv2.ORB.create(nfeatures=FEATURES)
    _, found = detector.detectAndCompute(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), None)
    return np.unpackbits(np.asarray(found, np.uint8), axis=1)


def vocabulary_text(pictures: list[Bits]) -> str:
    """Return a vocabulary in DBoW2's text format, trained on the descriptors of pictures.

    The first line is branches, levels, weighting and score; then a line a node, numbered from 1: its parent, whether it
    is a word, the 32 bytes of its descriptor, and its weight. A word's weight is ln(pictures / pictures with it).
    """
    tree = Tree(np.concatenate(pictures))
    of_picture = np.repeat(np.arange(len(pictures)), [len(bits) for bits in pictures])
    lines = [f"{BRANCHES} {DEPTH} {TF_IDF_L1}"]
    for parent, members, bits, is_word in tree.nodes:
        with_it = len(np.unique(of_picture[members]))
        weight = float(np.log(len(pictures) / with_it)) if is_word else 0.0
        numbers = " ".join(map(str, np.packbits(bits).tolist()))
        lines.append(f"{parent} {int(is_word)} {numbers} {weight:.9g}")
    return "\n".join(lines)  # no line feed at the end: ORB-SLAM3 would read a node more


class Tree:
    """Descriptors divided again and again by k-means.

    nodes: of each its parent's number (0 is the root), the rows of its descriptors, its own descriptor (256,) and
    whether it is a word; the i-th has the number i + 1, and parents come before children.
    """

    def __init__(self, bits: Bits) -> None:
        self.nodes: list[tuple[int, NDArray[np.int64], Bits, bool]] = []
        self._bits = bits
        self._signs = bits.astype(np.float32) * 2.0 - 1.0  # products of signs are 256 - 2 x Hamming distance, exactly
        self._random = np.random.default_rng(0)
        self._divide(0, np.arange(len(bits)), 1)

    def _divide(self, parent: int, members: NDArray[np.int64], level: int) -> None:
        for group, centre in self._groups(members):
            is_word = level == DEPTH or len(group) < 2 * WORD
            self.nodes.append((parent, group, centre, is_word))
            if not is_word:
                self._divide(len(self.nodes), group, level + 1)

    def _groups(self, members: NDArray[np.int64]) -> list[tuple[NDArray[np.int64], Bits]]:
        """Return rows in up to BRANCHES groups, each with its median descriptor."""
        signs = self._signs[members]
        centres = self._seeds(signs, min(BRANCHES, max(2, len(members) // WORD)))
        nearest = np.argmax(signs @ centres.T, axis=1)
        for _ in range(ROUNDS):
            centres = np.stack(
                [np.where(signs[nearest == k].sum(axis=0) > 0, 1.0, -1.0) for k in np.unique(nearest)]
            ).astype(np.float32)
            moved = np.argmax(signs @ centres.T, axis=1)
            if np.array_equal(moved, nearest):
                break
            nearest = moved
        return [(members[nearest == k], (centres[k] > 0).astype(np.uint8)) for k in np.unique(nearest)]

    def _seeds(self, signs: NDArray[np.float32], most: int) -> NDArray[np.float32]:
        """Return up to so many different descriptors, far ones preferred (k-means++)."""
        chosen = [signs[self._random.integers(len(signs))]]
        apart = np.full(len(signs), np.inf)
        while len(chosen) < most:
            apart = np.minimum(apart, (256.0 - signs @ chosen[-1]) / 2.0)
            total = np.cumsum(apart.astype(np.float64) ** 2)
            if total[-1] == 0.0:
                break
            chosen.append(signs[np.searchsorted(total, self._random.random() * total[-1], side="right")])
        return np.stack(chosen)
