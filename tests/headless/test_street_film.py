# SPDX-License-Identifier: GPL-3.0-or-later
"""The film of the street: as many frames as there are, the first clean, and none larger than is allowed."""

import json
import sys

import cv2
import numpy as np
import pytest
from worlds import ROOT

sys.path.append(str(ROOT / "headless"))
from pictures import film
from pictures.lit_chain import LitScene, shown
from pictures.street import LitFrame, write_frame
from pictures.street import path_c2w
from pictures.street import write_cameras

pytestmark = pytest.mark.long  # of the film set and of what is drawn once; rarely changed

SIZE = (64, 36)


def lit(number):
    """A frame with a slope of light, a lamp of 60 and void above."""
    rgb = np.zeros((SIZE[1], SIZE[0], 3), np.float32) + np.linspace(0, 0.5, SIZE[0], dtype=np.float32)[None, :, None]
    rgb[4:10, 10 + number : 16 + number] = 60
    depth_m = np.repeat(np.linspace(60, 2, SIZE[1], dtype=np.float32)[:, None], SIZE[0], axis=1)
    depth_m[:5] = 0
    return LitFrame(rgb, depth_m)


@pytest.fixture
def frames(tmp_path):
    write_cameras(tmp_path / "cameras.json", SIZE, [0, 1, 2], path_c2w(3).tolist())
    for number in range(2):  # the last is missing
        write_frame(tmp_path / f"{number:04}.exr", lit(number))
    return tmp_path


def test_a_film_has_the_frames_that_are_there_and_begins_clean(frames):
    assert film.main([str(frames / "street"), "--frames", str(frames)]) == 0
    video = cv2.VideoCapture(str(frames / "street.mp4"))
    read = [picture for there, picture in iter(video.read, (False, None)) if there]
    assert len(read) == 2
    assert video.get(cv2.CAP_PROP_FPS) == 24
    wanted = shown(lit(0).rgb)
    clean = wanted.shape[0] - film.STRIP_PX
    assert read[0].shape == wanted.shape
    (_, first), *_ = film.film(frames)
    assert np.abs(first[:clean].astype(int) - wanted[:clean]).max() <= 3
    assert np.abs(read[0][..., ::-1].astype(float) - first).mean() < 20  # H.264 halves the colours' resolution


def test_a_film_that_is_too_large_is_an_error(frames):
    picture = frames / "0000.png"
    cv2.imwrite(str(picture), shown(lit(0).rgb))
    with pytest.raises(ValueError, match="at the lowest quality; 10 are allowed"):
        film.write_video(frames / "a.mp4", [picture], 10)


def test_a_lit_scene_gives_light_and_sky_back():
    frame = lit(0)
    with LitScene(SIZE, 2, sky_m=123.0) as scene:
        scene.write([scene.rgb, scene.depth_m])
        rgb, depth_m = scene.run(frame)
    assert np.array_equal(rgb, frame.rgb)
    assert np.array_equal(depth_m[..., 0], np.where(frame.depth_m > 0, frame.depth_m, 123).astype(np.float32))


def test_cameras_are_written_as_other_programs_read_them(frames):
    cameras = json.loads((frames / "cameras.json").read_text())
    assert (cameras["width"], cameras["height"], cameras["fps"]) == (64, 36, 24)
    assert np.allclose(cameras["c2w"]["0001.exr"], path_c2w(2)[1])
    assert cameras["cx"] == 31.5
