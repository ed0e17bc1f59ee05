# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world view` and `noisy-world video`: read back by Rerun's own reader and by OpenCV."""

import base64
import json
import os
import re
import sys
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from cases import cases
from chromium import READY, browser, find_chromium
from runs import run
from written import RIG, SIZE, read, rows_of, world
from recipes_made import frames_from_arithmetic

import noisy_world
from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.cli.frame_views import clean_beside, planned_pose, words_of
from noisy_world.layouts import LAYOUTS

VIEW = Entry("noisy-world view", ("noisy-world", "view"))
VIDEO = Entry("noisy-world video", ("noisy-world", "video"))
FRAMES = 6
IMU = {"translation_m": [0.02, -0.03, 0.05], "device": "adis16448"}
SETTINGS = [
    {"name": "clean"},
    {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]},
    {"name": "walked", "perturb": [{"faster_motion": {"factor": 2}}, {"vibration": {"source": "walk"}}]},
]
WRITTEN = [name for name, layout in LAYOUTS.items() if layout.images]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    @cache
    def made(layout="euroc", width=SIZE[0]):
        folder = tmp_path_factory.mktemp("look")
        camera = {"width": width, "height": width * 3 // 4, "fx": width / 2, "fy": width / 2}
        keys = {"camera": camera | {"cx": (width - 1) / 2, "cy": (width * 3 // 4 - 1) / 2}}
        keys |= {"rig": {**RIG, "imu": IMU}, "settings": SETTINGS, "frames": FRAMES}
        scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
        with frames_from_arithmetic():
            run(world(folder / "w", layout, scenes=scenes, **keys), folder / "out")
        return folder / "out"

    return made


def values(store, path, component):
    """The values of a component, in order of time."""
    found = []
    for chunk in store.stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == path and component in batch.schema.names:
            timed = "time" in batch.schema.names
            times = batch.column("time").cast("int64").to_pylist() if timed else [0] * batch.num_rows
            found += list(zip(times, batch.column(component).to_pylist(), strict=True))
    return [value for _, value in sorted(found, key=lambda item: item[0])]


def recorded(out, *words):
    chunk = pytest.importorskip("rerun.chunk", reason="rerun is not installed")
    assert command.run("view", [*map(str, words), "--save", str(out)], VIEW) == 0
    return chunk.RrdReader(out).store()


@cases("layout", WRITTEN)
def test_a_recording_holds_the_dataset(dataset, tmp_path, layout):
    pytest.importorskip("rerun", reason="rerun is not installed")
    out = dataset(layout)
    store = recorded(tmp_path / f"{layout}.rrd", out)
    opened = noisy_world.open(out)
    for name, sequence in opened.items():
        setting, scene = name.split("/")
        root = f"/{scene}/{setting}"
        frames = list(sequence)
        blobs = values(store, f"{root}/camera/rgb", "EncodedImage:blob")
        assert [bytes(blob[0]) for blob in blobs] == [frame.rgb_bytes() for frame in frames]
        depths = values(store, f"{root}/camera/depth", "EncodedDepthImage:blob")
        (meter,) = {value[0] for value in values(store, f"{root}/camera/depth", "EncodedDepthImage:meter")}
        for blob, frame in zip(depths, frames, strict=True):
            steps = cv2.imdecode(np.frombuffer(bytes(blob[0]), np.uint8), cv2.IMREAD_UNCHANGED)
            np.testing.assert_allclose(steps / meter, frame.depth_m, rtol=1e-6)
        moved = values(store, f"{root}/camera", "Transform3D:translation")
        np.testing.assert_allclose([m[0] for m in moved], [frame.c2w[:3, 3] for frame in frames], atol=1e-6)
        path = values(store, f"{root}/path", "LineStrips3D:strips")[0][0]
        np.testing.assert_allclose(path, [frame.c2w[:3, 3] for frame in frames], atol=1e-6)
        planned = values(store, f"{root}/path_planned", "LineStrips3D:strips")
        assert bool(planned) == (setting == "walked")
        if planned:  # every second pose of the clean path
            clean = [frame.c2w[:3, 3] for frame in opened[f"clean/{scene}"]][::2]
            np.testing.assert_allclose(planned[0][0], clean, atol=1e-6)
        said = [text[0] for text in values(store, f"{root}/done", "TextLog:text")]
        assert said == ["; ".join(words_of(frame.done)) for frame in frames if frame.done]


def test_a_recording_holds_the_rig_and_the_imu(dataset, tmp_path):
    store = recorded(tmp_path / "seen.rrd", dataset(), "--only", "noisy/box", "--every", "4")
    rows = rows_of(dataset() / "noisy/box/mav0/imu0/data.csv")
    for column, part in enumerate(["gyro/x", "gyro/y", "gyro/z", "accel/x", "accel/y", "accel/z"]):
        found = values(store, f"/box/noisy/imu/{part}", "Scalars:scalars")
        np.testing.assert_array_equal([value[0] for value in found], [float(row[1 + column]) for row in rows])
    (moved,) = values(store, "/box/noisy/camera/depth", "Transform3D:translation")
    turned = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # looking along the robot's x: RIG's Euler angles, by hand
    np.testing.assert_allclose(moved[0], turned.T @ [0, 0.05, 0], atol=1e-6)
    assert len(values(store, "/box/noisy/camera/rgb", "EncodedImage:blob")) == 2
    assert values(store, "/box/noisy/severity/gaussian_noise", "Scalars:scalars") == [[3.0]] * FRAMES
    assert not values(store, "/box/clean/camera", "Transform3D:translation")


def test_packed_datasets_give_the_same(dataset, tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    out, packed = dataset(), tmp_path / "packed"
    assert command.run("publish", [str(out), str(packed)]) == 0
    opened = noisy_world.open(packed)
    for name, sequence in noisy_world.open(out).items():
        for file in ("mav0/imu0/data.csv", "frames.jsonl", "mav0/none.csv"):
            assert opened[name].text(file) == sequence.text(file)
    assert opened["clean/box"].text("mav0/imu0/data.csv") is not None
    assert opened.identity == noisy_world.open(out).identity != {}
    stores = [recorded(tmp_path / f"{place.name}.rrd", place, "--only", "walked/box") for place in (out, packed)]
    for path, component in (
        ("camera/rgb", "EncodedImage:blob"),
        ("imu/gyro/x", "Scalars:scalars"),
        ("camera/imu", "Transform3D:translation"),
    ):
        first, second = (values(store, f"/box/walked/{path}", component) for store in stores)
        assert first == second != []


def frames_of(path):
    capture = cv2.VideoCapture(str(path))
    rate_hz, found = capture.get(cv2.CAP_PROP_FPS), []
    while (read_one := capture.read())[0]:
        found.append(read_one[1])
    return rate_hz, found


@cases("layout", WRITTEN)
def test_videos_of_each_layout(dataset, tmp_path, capsys, layout):
    out = dataset(layout)
    assert command.run("video", [str(out), str(tmp_path / f"{layout}.avi")], VIDEO) == 0
    said = capsys.readouterr().out
    assert "Motion JPEG (MJPG)" in said
    for name, sequence in noisy_world.open(out).items():
        rate_hz, found = frames_of(tmp_path / f"{layout}-{name.replace('/', '-')}.avi")
        stamps_s = [frame.stamp_s for frame in sequence]
        assert rate_hz == pytest.approx(1 / np.median(np.diff(stamps_s)), rel=1e-3)
        assert len(found) == len(sequence)
        tiles = 2 if name.startswith("clean") else 3
        assert found[0].shape == (SIZE[1] + 26, tiles * SIZE[0], 3)
        # The colour of every frame stands where it has to, to within the codec's loss on images of 8 pixels.
        for picture, frame in zip(found, sequence, strict=True):
            shown = picture[: SIZE[1], (tiles - 2) * SIZE[0] : (tiles - 1) * SIZE[0], ::-1]
            assert abs(shown.mean() - np.asarray(frame.rgb).mean()) < 12


def test_mp4_of_one_sequence_and_a_sheet(dataset, tmp_path, capsys):
    out = dataset("replica", width=64)
    words = [str(out), str(tmp_path / "walk.mp4"), "--only", "noisy/box", "--frames", "1:4"]
    assert command.run("video", words, VIDEO) == 0
    assert re.search(r"wrote .*walk.mp4: 3 frames of noisy/box, .*, MPEG-4 part 2 \(mp4v\)", capsys.readouterr().out)
    assert len(frames_of(tmp_path / "walk.mp4")[1]) == 3
    assert command.run("video", [str(out), str(tmp_path / "sheet.png"), "--sheet", "2"], VIDEO) == 0
    sheet = read(tmp_path / "sheet.png")
    assert sheet.shape == (3 * (26 + 2 * 180), 2 * 240, 3)
    first = noisy_world.open(out)["clean/box"][0].rgb
    shown = cv2.resize(np.ascontiguousarray(first[..., ::-1]), (240, 180), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(sheet[26:206, :240], shown)


def test_the_clean_frame_beside_is_that_of_the_same_pose(dataset, tmp_path):
    opened = noisy_world.open(dataset("replica"))
    assert clean_beside(opened, "clean/box") is None
    beside = clean_beside(opened, "walked/box")
    assert beside is not None
    for frame in opened["walked/box"]:
        np.testing.assert_allclose(planned_pose(frame), beside[2 * frame.index].c2w, atol=1e-6)


def test_what_cannot_be_is_refused_in_a_line(dataset, tmp_path, capsys, monkeypatch):
    out = dataset("replica")
    (tmp_path / "there.rrd").write_bytes(b"mine")
    for words, line in (
        ([out, tmp_path / "walk.gif"], "walk.gif: ends in .gif; name a file that ends in"),
        ([out, tmp_path / "a.mp4", "--sheet", "3"], "ends in .mp4; name a file that ends in .png"),
        ([out, tmp_path / "a.mp4", "--only", "nosy/box"], "nosy/box"),
        ([out, tmp_path / "a.mp4", "--frames", "40:50"], "has no such frames"),
        ([tmp_path / "none", tmp_path / "a.mp4"], "none: no such folder or recipe"),
    ):
        assert command.run("video", [*map(str, words)], VIDEO) != 0
        assert line in capsys.readouterr().err.replace("\n", " ")
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert command.run("view", [str(out), "--save", str(tmp_path / "x.rrd")], VIEW) != 0
    said = capsys.readouterr().err
    assert "rerun" in said
    assert "[view]" in said
    monkeypatch.undo()
    pytest.importorskip("rerun", reason="rerun is not installed")
    for name, line in (
        ("there.rrd", "there.rrd: is there already; --overwrite replaces it"),
        ("a.txt", "let it end in"),
    ):
        assert command.run("view", [str(out), "--save", str(tmp_path / name)], VIEW) != 0
        assert line in capsys.readouterr().err
    assert (tmp_path / "there.rrd").read_bytes() == b"mine"
    assert not list(tmp_path.glob("*.mp4"))


def test_what_cannot_be_written_is_refused_in_a_line(dataset, tmp_path, capsys):
    pytest.importorskip("rerun", reason="rerun is not installed")
    out = dataset("replica")
    (tmp_path / "file").write_text("mine")
    capsys.readouterr()
    before = sorted(tmp_path.rglob("*"))
    for name, entry, words in (
        ("video", VIDEO, [out, tmp_path / "file/walk.mp4", "--only", "noisy/box"]),
        ("video", VIDEO, [out, tmp_path / "file/sheet.png", "--sheet", "1"]),
        ("view", VIEW, [out, "--save", tmp_path / "file/walk.rrd"]),
    ):
        assert command.run(name, [*map(str, words)], entry) != 0
        said = capsys.readouterr().err
        assert re.search(r"file/\w+\.\w+: cannot be written: .+; mend that, or name another place\n$", said)
        assert said.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_viewer_needs_a_display_and_is_found_beside_this_python(dataset, tmp_path, capsys, monkeypatch):
    rerun = pytest.importorskip("rerun", reason="rerun is not installed")
    out = dataset("replica")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert command.run("view", [str(out)], VIEW) == 1
    assert "needs a display, and there is none here; set DISPLAY, or write a recording by --save" in (
        capsys.readouterr().err
    )
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setenv("PATH", "/nowhere")
    found = []

    def spawn(_stream, **_options):
        found.append(os.environ["PATH"].split(os.pathsep)[0])
        raise RuntimeError("it is tired\nand says more")

    monkeypatch.setattr(rerun.RecordingStream, "spawn", spawn)
    capsys.readouterr()
    assert command.run("view", [str(out)], VIEW) == 1
    said = capsys.readouterr().err
    assert "Rerun cannot open its viewer: it is tired; mend that, or write a recording by --save" in said
    assert said.count("\n") == 1
    assert found == [str(Path(sys.executable).parent)]


def page_of(out, *words):
    assert command.run("view", [*map(str, words), "--html", str(out)], VIEW) == 0
    return json.loads(re.search(r'id="data">(.*)</script>', out.read_text())[1])


def test_a_page_holds_frames_and_what_was_done_to_them(dataset, tmp_path):
    page = page_of(tmp_path / "look.html", dataset())
    assert page["channels"] == ["colour", "depth"]
    assert [item["name"] for item in page["sequences"]] == ["clean/box", "noisy/box", "walked/box"]
    clean, noisy, walked = page["sequences"]
    assert [frame["number"] for frame in clean["frames"]] == list(range(FRAMES))
    assert len(walked["frames"]) == FRAMES // 2
    assert clean["frames"][0]["done"] == []
    assert noisy["frames"][0]["done"] == ["rgb gaussian_noise severity 3", "depth depth_gaussian_noise severity 2"]
    assert clean["depth"] == noisy["depth"]  # one scale, so that they can be compared
    opened = noisy_world.open(dataset())
    seen = cv2.imdecode(
        np.frombuffer(base64.b64decode(noisy["frames"][2]["images"][0]), np.uint8), cv2.IMREAD_COLOR_RGB
    )
    whole = opened["noisy/box"][2].rgb
    assert seen.shape == whole.shape
    assert np.abs(seen.astype(float) - whole).mean() < 12  # JPEG's
    few = page_of(tmp_path / "few.html", dataset(), "--only", "clean/*", "--every", "4")
    assert [[frame["number"] for frame in item["frames"]] for item in few["sequences"]] == [[0, 4]]
    assert few["note"] == "The dataset has 4 frames more; --every 1 shows all."


def test_a_page_is_refused_where_it_cannot_be(dataset, tmp_path, capsys):
    (tmp_path / "there.html").write_text("")
    for name, said in (("look.pdf", "let it end in .html"), ("there.html", "--overwrite replaces it")):
        assert command.run("view", [str(dataset()), "--html", str(tmp_path / name)], VIEW) == 1
        assert said in capsys.readouterr().err


def test_a_browser_shows_the_page(dataset, tmp_path):
    if find_chromium() is None:
        pytest.skip("needs chromium")
    page_of(tmp_path / "look.html", dataset())
    shown = "[...document.querySelectorAll('figcaption')].map((item) => item.textContent)"
    with browser() as tab:
        tab.open((tmp_path / "look.html").as_uri())
        tab.run(READY)
        assert (
            tab.run(f"Promise.all([...document.images].map((image) => image.decode())).then(() => {shown}.length)") == 3
        )
        tab.run("document.getElementById('at').value = 5")
        tab.run("document.getElementById('at').dispatchEvent(new Event('input'))")
        assert [re.search(r"frame (\d+)", text)[1] for text in tab.run(shown)] == ["5", "5", "2"]
        tab.run("document.querySelector('input[type=checkbox]').click()")
        assert [text.partition("/")[0] for text in tab.run(shown)] == ["noisy", "walked"]
        assert tab.complaints() == []
