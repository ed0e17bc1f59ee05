# SPDX-License-Identifier: GPL-3.0-or-later
"""The moving picture of the README: a film's frames, fewer and smaller, at the film's pace."""

import sys

import cv2
import numpy as np
import pytest
from worlds import ROOT

sys.path.insert(0, str(ROOT / "headless"))

from pictures import moving_picture


def test_a_film_becomes_a_moving_picture(tmp_path):
    film = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 32))
    for level in (0, 60, 120, 180, 240):
        film.write(np.full((32, 64, 3), level, np.uint8))
    film.release()
    out = tmp_path / "film.webp"
    assert moving_picture.main([str(tmp_path / "film.avi"), str(out), "--width", "32", "--every", "2"]) == 0
    read, animation = cv2.imreadanimation(str(out))
    assert read
    assert [frame.shape[:2] for frame in animation.frames] == [(16, 32)] * 3
    assert np.allclose([frame[..., :3].mean() for frame in animation.frames], [0, 120, 240], atol=4)
    assert set(animation.durations) == {200}
    with pytest.raises(SystemExit, match="no film that OpenCV reads"):
        moving_picture.main([str(out.with_name("none.avi")), str(out)])
