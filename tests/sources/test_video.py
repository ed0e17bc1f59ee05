# SPDX-License-Identifier: GPL-3.0-or-later
"""Videos as scenes, and datasets as videos."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusals import refused
from worlds import ROOT
from runs import run

from noisy_world.cli.command import main
from noisy_world.layouts import find_sequence
from noisy_world.images.video_files import VideoFile, VideoReader, read_video, write_video
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.sources import read_scenes

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
    refused(reader.rgb, COUNT, names=("walk.avi: ", "frame 7"))


def test_what_is_no_video_is_one_line(tmp_path):
    path = tmp_path / "walk.avi"
    whole = film(path).read_bytes()
    path.unlink()
    refused(read_video, path, names=("walk.avi: ", "no such video"))
    for data in (b"RIFF and nothing else" * 20, whole[: len(whole) // 3]):
        path.write_bytes(data)
        refused(read_video, path, names="walk.avi: is no video that OpenCV can read")


def test_what_ffmpeg_says_does_not_stand_beside_the_line(tmp_path):
    (tmp_path / "junk.mp4").write_bytes(b"x" * 999)
    preset = {"scenes": [{"video": "junk.mp4"}], "settings": [{"name": "clean"}], "output": {"modalities": ["rgb"]}}
    (tmp_path / "preset.json").write_text(json.dumps(preset))
    words = [sys.executable, "-m", "noisy_world", "generate", tmp_path / "preset.json", "--dry-run"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "addon")}
    environment.pop("OPENCV_FFMPEG_LOGLEVEL", None)
    done = subprocess.run(words, env=environment, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 1
    assert re.fullmatch(r".*junk\.mp4: is no video that OpenCV can read; .*\n", done.stderr), done.stderr


def test_a_video_that_lacks_frames_is_told(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "whole.mkv"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for n in range(COUNT):
        writer.write(np.full((48, 64, 3), 20 * n, np.uint8))
    writer.release()
    assert read_video(tmp_path / "whole.mkv").note == ""
    data = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "walk.avi").write_bytes(data[: len(data) * 2 // 3])  # told by content, not by its name
    notes = []
    with make_plan(read_preset(preset_of(tmp_path))).renders[0].scene.source.prepare(None, notes.append):
        pass
    assert re.fullmatch(
        r"walk\.avi says that it has 7 frames, of which [1-5] can be decoded: it may be cut.*", notes[0]
    )


def test_a_rate_that_varies_is_no_cut():
    times = np.array([0, 1, 2, 30, 58, 59]) / 30  # of two seconds at 30 Hz, as Matroska says them
    assert VideoFile(Path("a.mkv"), (4, 3), times, 60, 30.0).note == ""
    assert "a.mkv says that it has 60 frames, of which 4" in VideoFile(Path("a.mkv"), (4, 3), times[:4], 60, 30.0).note
    assert "of which 1 can be decoded" in VideoFile(Path("a.mkv"), (4, 3), times[:1], 60, 30.0).note
    assert VideoFile(Path("a.mkv"), (4, 3), times, 0, 0.0).note == ""


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
    for change, named in (
        ("output.modalities=[rgb, depth]", ("output.modalities", "walk has no depth")),
        ("settings=[{name: a, perturb: [{fog_depth: {severity: 1}}]}]", ("a needs depth", "walk has none")),
        ("settings=[{name: a, perturb: [{motion_deviation: {rotation_deg: 1}}]}]", ("scenes.0.video: ", "elsewhere")),
        (
            "camera={width: 8, height: 6, fx: 4, fy: 4, cx: 3, cy: 2}",
            ("scenes.0.video: ", "64 x 48", "set camera"),
        ),
        ("scenes.0.poses=keep", ("scenes.0.poses: ", "sequence")),
        ("scenes.0.video=other.avi", ("scenes.0.video: ", "other.avi")),
    ):
        refused(lambda change=change: make_plan(read_preset(path, [change])), names=("preset.json: ", *named))
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


def test_a_video_stands_under_its_name_when_it_is_whole(tmp_path, capfd, monkeypatch):
    film(tmp_path / "walk.avi")
    path = preset_of(tmp_path)
    assert main(["generate", str(path), "--out", str(path / "noisy.avi")]) == 1
    assert re.search(r"preset\.json: cannot be written: .+; mend that, or name another place\n", capfd.readouterr().err)
    before = sorted(tmp_path.rglob("*"))

    def stopped(video, frames, rate_hz):
        assert write_video(video, frames, rate_hz) == COUNT
        raise KeyboardInterrupt

    monkeypatch.setattr("noisy_world.images.video_files.write_video", stopped)
    assert main(["generate", str(path), "--out", str(tmp_path / "noisy.avi")]) != 0
    assert sorted(tmp_path.rglob("*")) == before


def depth_of(folder, steps):
    """Write a depth image for each of some arrays, numbered from 8, so that text order is another."""
    folder.mkdir(exist_ok=True)
    for n, one in enumerate(steps):
        assert cv2.imwrite(str(folder / f"d{n + 8}.png"), one)
    return folder


def test_a_video_with_depth_beside_it(tmp_path):
    film(tmp_path / "walk.avi")
    steps = np.arange(COUNT * 48 * 64, dtype=np.uint16).reshape(COUNT, 48, 64)
    depth_of(tmp_path / "walk_depth", steps)
    settings = [{"name": "clean"}, {"name": "foggy", "perturb": [{"fog_depth": {"severity": 3}}]}]
    path = preset_of(tmp_path, scenes=[{"video": "*.avi", "depth": "*_depth"}], settings=settings, output={})
    for layout in ("replica", "tum"):  # with 6553.5 and 5000 steps a metre
        run(path, tmp_path / layout, overrides=[f"output.layout={layout}"])
        found = find_sequence(tmp_path / layout / "clean/walk", poses="none")
        for row in range(COUNT):
            kept_m = np.where(steps[row] / 1000 * found.depth_scale_per_m < 65535.5, steps[row] / 1000, 0)
            assert np.abs(found.frame(row).depth_m - kept_m).max() <= 0.51 / found.depth_scale_per_m
        foggy = find_sequence(tmp_path / layout / "foggy/walk", poses="none").frame(COUNT - 1).rgb.astype(int)
        assert np.abs(foggy - found.frame(COUNT - 1).rgb).max() > 20
    as_is = ["output.layout=tum", "output.depth_scale_per_m=200", "scenes.0.depth_scale_per_m=200"]
    run(path, tmp_path / "linked", overrides=as_is)
    linked, source = tmp_path / "linked/clean/walk/depth/000003.png", tmp_path / "walk_depth/d11.png"
    assert linked.read_bytes() == source.read_bytes()
    first, second = (make_plan(read_preset(path, more)).renders[0].scene.source.hashes() for more in ([], as_is))
    assert first["depth_sha256"] == second["depth_sha256"]
    assert (first["depth_scale_per_m"], second["depth_scale_per_m"]) == (1000, 200)
    moved = read_preset(path, ["rig={rgb: {translation_m: [0, 0, 0]}}"])
    refused(make_plan, moved, names=("preset.json: scenes.0.video: ", "rig"))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda folder: (folder / "d14.png").unlink(), ("6 depth images", "7 frames", "a 16-bit PNG")),
        (lambda folder: (folder / "e08.png").write_bytes(b""), ("d8.png and e08.png", "keep one")),
        (lambda folder: (folder / "d9.png").rename(folder / "d.png"), ("d.png: ", "no number", "name depth")),
        (lambda folder: (folder / "d9.png").write_bytes(b"none"), "d9.png: is no image that can be read"),
        (
            lambda folder: cv2.imwrite(str(folder / "d9.png"), np.zeros((48, 64), np.uint8)),
            ("d9.png: ", "8-bit grey", "PNG of 16-bit grey"),
        ),
        (
            lambda folder: cv2.imwrite(str(folder / "d9.png"), np.zeros((24, 32), np.uint16)),
            ("d9.png: ", "32 x 24", "64 x 48", "register"),
        ),
        (lambda folder: folder.rename(folder.with_name("other")), "scenes.0.depth: no such folder"),
    ],
)
def test_depth_that_is_not_the_videos_is_one_line(tmp_path, change, named):
    film(tmp_path / "walk.avi")
    folder = depth_of(tmp_path / "depth", [np.zeros((48, 64), np.uint16)] * COUNT)
    path = preset_of(tmp_path, scenes=[{"video": "walk.avi", "depth": "depth"}])
    change(folder)
    refused(lambda: make_plan(read_preset(path)), names=named)


def test_depth_that_ends_early_is_refused_where_it_is_used(tmp_path):
    film(tmp_path / "walk.avi")
    folder = depth_of(tmp_path / "depth", [np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)] * COUNT)
    cut = folder / "d9.png"
    cut.write_bytes(cut.read_bytes()[:-40])
    path = preset_of(tmp_path, scenes=[{"video": "walk.avi", "depth": "depth"}], output={"layout": "tum"})
    for scale in (5000, 1000):  # decoded, or used as it is
        overrides = [f"output.depth_scale_per_m={scale}"]
        refused(run, path, tmp_path / f"{scale}", overrides=overrides, names=("d9.png: ", "cut short"))


def test_keys_of_depth_go_with_a_video(tmp_path):
    path = preset_of(tmp_path)
    for scene, named in (
        ("{sequence: a, depth: b}", ("scenes.0.depth: ", "goes with video", "leave it out")),
        ("{video: walk.avi, depth_scale_per_m: 1000}", ("depth_scale_per_m: ", "goes with depth")),
        ("{video: walk.avi, depth: b, depth_scale_per_m: 0.001}", ("depth_scale_per_m: ", "0.001")),
    ):
        refused(lambda scene=scene: read_scenes(read_preset(path, [f"scenes=[{scene}]"])), names=named)


def test_a_video_of_nothing_is_none(tmp_path):
    assert write_video(tmp_path / "a.avi", [], 25.0) == 0
    refused(find_sequence, tmp_path, names="is no sequence")
