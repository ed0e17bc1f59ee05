# SPDX-License-Identifier: GPL-3.0-or-later
"""Videos as scenes, and datasets as videos."""

import json

import cv2
import numpy as np
import pytest
from written import run

from noisy_world.cli.command import main
from noisy_world.core.datasets.layouts import find_sequence
from noisy_world.core.datasets.video_files import VideoReader, read_video, write_video
from noisy_world.core.errors import InputError
from noisy_world.core.presets.preset import read_preset
from noisy_world.planning import make_plan

COUNT = 7


def film(path, count=COUNT):
    """Write a video of even greys, each frame its own, by OpenCV."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for n in range(count):
        writer.write(np.full((48, 64, 3), 20 * n + 40, np.uint8))
    writer.release()
    return path


def preset_of(folder, **keys):
    document = {
        "seed": 3,
        "scenes": [{"video": "walk.avi"}],
        "render": {"backend": "reference"},
        "settings": [{"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 2}}]}],
        "output": {"modalities": ["rgb"], "layout": "tum"},
        **keys,
    }
    path = folder / "preset.json"
    path.write_text(json.dumps(document))
    return path


def test_frames_are_counted_and_read_in_any_order(tmp_path):
    video = read_video(film(tmp_path / "walk.avi"))
    assert (len(video), video.size_px) == (COUNT, (64, 48))
    assert np.allclose(video.stamps_s, np.arange(COUNT) / 25, atol=1e-9)
    reader = VideoReader(video)
    for n in (0, 1, 4, 2, 6, 6, 0):
        assert np.abs(reader.rgb(n).astype(int) - (20 * n + 40)).max() <= 2
    reader.close()
    with pytest.raises(InputError, match="frame 7 cannot be decoded"):
        reader.rgb(COUNT)


def test_what_is_no_video_is_one_line(tmp_path):
    with pytest.raises(InputError, match="no such video"):
        read_video(tmp_path / "walk.avi")
    (tmp_path / "walk.avi").write_bytes(b"RIFF and nothing else" * 20)
    with pytest.raises(InputError, match=r"walk\.avi: (is no video|holds no frame)"):
        read_video(tmp_path / "walk.avi")
    whole = film(tmp_path / "whole.avi").read_bytes()
    (tmp_path / "short.avi").write_bytes(whole[: len(whole) // 3])
    with pytest.raises(InputError, match=r"short\.avi: is no video that OpenCV can read"):
        read_video(tmp_path / "short.avi")


def test_a_video_is_a_scene(tmp_path, capfd):
    film(tmp_path / "walk.avi")
    path = preset_of(tmp_path)
    run(path, tmp_path / "out")
    folder = tmp_path / "out/noisy/walk"
    assert sorted(item.name for item in folder.iterdir()) == ["frames.jsonl", "rgb", "rgb.txt"]
    assert len(list((folder / "rgb").iterdir())) == COUNT
    told = json.loads((tmp_path / "out/noisy/cam_params.json").read_text())["camera"]
    assert (told["fx"], told["cx"], told["cy"]) == (pytest.approx(76.8), 31.5, 23.5)
    report = json.loads((tmp_path / "out/run.json").read_text())
    assert any("nothing says its camera" in note for note in report["notes"])
    for change, words in (
        ("output.modalities=[rgb, depth]", "a video has no depth, but output.modalities asks for it"),
        ("settings=[{name: a, perturb: [{fog_depth: {severity: 1}}]}]", "a needs depth, and a video has none"),
        ("settings=[{name: a, perturb: [{motion_deviation: {rotation_deg: 1}}]}]", "cannot be seen from elsewhere"),
        ("camera={width: 8, height: 6, fx: 4, fy: 4, cx: 3, cy: 2}", "its frames are 64 x 48"),
        ("scenes.0.poses=keep", "goes with sequence"),
        ("scenes.0.video=other.avi", "other.avi"),
    ):
        with pytest.raises(InputError, match=words):
            make_plan(read_preset(path, [change]))
    assert main(["generate", str(path), "--out", f"file://{tmp_path}/packed"]) != 0
    assert "frames without a pose cannot be at an address" in capfd.readouterr().err
    # The same as a video to look at, and the colour of any dataset.
    capfd.readouterr()
    assert main(["generate", str(path), "--out", str(tmp_path / "noisy.avi")]) == 0
    out = capfd.readouterr().out
    assert f"wrote {tmp_path}/noisy.avi" in out
    assert "decoding" in out
    seen = read_video(tmp_path / "noisy.avi")
    assert (len(seen), seen.size_px) == (COUNT, (64, 48))
    assert VideoReader(seen).rgb(3).std() > 5
    assert main(["generate", str(path), "--out", str(tmp_path / "noisy.avi")]) != 0
    assert "is there already; --overwrite replaces it" in capfd.readouterr().err
    assert sorted(item.name for item in tmp_path.iterdir()) == ["noisy.avi", "out", "preset.json", "walk.avi"]


def test_a_video_of_nothing_is_none(tmp_path):
    assert write_video(tmp_path / "a.avi", [], 25.0) == 0
    with pytest.raises(InputError, match="is no sequence"):
        find_sequence(tmp_path)
