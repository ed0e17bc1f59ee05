# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet shows every sequence once, and of later ones what is new."""

import os

import cv2
import numpy as np

from noisy_world.dataset.completion import GAP_PX, LABEL_PX, draw_overview
from noisy_world.preset.keys import OutputSpec

FORMAT = OutputSpec("replica", "png").format
STAMPS_S = np.arange(8) / 20
NAMES = FORMAT.names(STAMPS_S)
TILE_PX = 160 + GAP_PX  # 320 x 160 tiles of 40 x 20 images


def write(out, folder, frames, grey, depth_m):
    (out / folder / "results").mkdir(parents=True)
    for frame in frames:
        image = np.full((20, 40, 3), grey, np.uint8)
        cv2.imwrite(str(out / folder / NAMES.rgb(frame)), image)
        cv2.imwrite(str(out / folder / NAMES.depth(frame)), np.full((20, 40), int(6553.5 * depth_m), np.uint16))


def draw(out, frames):
    return cv2.imdecode(
        np.frombuffer(draw_overview(out, FORMAT, frames, {"a": STAMPS_S, "b": STAMPS_S}), np.uint8), cv2.IMREAD_COLOR
    )


def test_what_a_setting_leaves_alone_is_not_shown_again(tmp_path):
    frames = range(3)
    write(tmp_path, "clean/a", frames, 200, 1.0)
    write(tmp_path, "fog/a", frames, 90, 1.0)
    write(tmp_path, "eroded/a", frames, 200, 2.0)
    write(tmp_path, "same/a", frames, 200, 1.0)
    write(tmp_path, "clean/b", frames, 200, 1.0)  # another scene, though it looks alike
    folders = ("clean/a", "fog/a", "eroded/a", "same/a", "clean/b")
    picture = draw(tmp_path, {folder: list(frames) for folder in folders})
    rows = 2 + 1 + 1 + 0 + 2
    assert picture.shape[0] == LABEL_PX + GAP_PX + 5 * LABEL_PX + rows * TILE_PX
    middle = picture[:, GAP_PX + 160].astype(int)
    assert (np.abs(middle - 90).max(axis=1) == 0).sum() == 160  # fog's colour, once
    assert (np.abs(middle - 200).max(axis=1) == 0).sum() == 2 * 160


def test_links_count_as_the_same_and_other_frames_do_not(tmp_path):
    write(tmp_path, "clean/a", range(4), 200, 1.0)
    (tmp_path / "fast/a/results").mkdir(parents=True)
    for frame in range(2):
        for name in (NAMES.rgb, NAMES.depth):
            os.link(tmp_path / "clean/a" / name(2 * frame), tmp_path / "fast/a" / name(frame))
    cv2.imwrite(str(tmp_path / "clean/a" / NAMES.rgb(1)), np.full((20, 40, 3), 7, np.uint8))
    picture = draw(tmp_path, {"clean/a": [0, 1, 2, 3], "fast/a": [0, 1]})
    # Its frame 1 is the other's frame 2, so its colour is shown; all depths are alike.
    assert picture.shape[0] == LABEL_PX + GAP_PX + 2 * LABEL_PX + 3 * TILE_PX
