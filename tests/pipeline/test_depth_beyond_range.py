# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth beyond what 16 bits hold, in a hall of 40 m: what is said of it, against the depth in closed form."""

import json
import shutil
import sys
import threading

import cv2
import fake_session
import numpy as np
import pytest
from analytic import box_depth
from shard_workers import workers_here
from worlds import generate_here, path_poses, write_world
from runs import run
from written import stored

from noisy_world.images.pixels import encode_png
from noisy_world.core.errors import InterruptedRunError
from noisy_world.core.geometry import Intrinsics

SIZE = (48, 36)
COUNT = 6
LOW, HIGH = np.array([-20.0, -15.0, 0.0]), np.array([20.0, 15.0, 6.0])
CAMERA = Intrinsics(48, 36, 24.0, 24.0, 23.5, 17.5)
NOTE = "of the pixels of"


class Listener:
    """What a run says, and when: after how many frames."""

    def __init__(self):
        self.said, self.done = [], 0

    def start(self, label, total, done=0):
        pass

    def advance(self, count=1):
        self.done += count

    def note(self, text, subject=""):
        self.said.append((self.done, text))

    def finish(self):
        pass

    def about_depth(self):
        return [(done, text) for done, text in self.said if "beyond" in text]


def depth_of(frame):
    """Planar depth of the hall (H, W) in float32, by intersecting each pixel's ray with six planes."""
    return box_depth(CAMERA, path_poses(COUNT)[frame], LOW, HIGH)[0].astype(np.float32)


@pytest.fixture
def hall(monkeypatch):
    """Frames of the hall in Blender's place."""

    def frame(self, request):
        depth_m = box_depth(CAMERA, request.depth_c2w, LOW, HIGH)[0].astype(np.float32)
        return fake_session.Frame(rgb=np.full((*depth_m.shape, 3), 0.5, np.float32), depth_m=depth_m)

    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    monkeypatch.setattr(fake_session.Session, "frame", frame)


def world(folder, *, settings=({"name": "clean"},), **output):
    return write_world(
        folder, frames=COUNT, size=SIZE, settings=list(settings), output={"layout": "replica", "image": "jpg", **output}
    )


def make(preset, out, **options):
    """Make a dataset; return what was said and the report."""
    heard = Listener()
    return heard, run(preset, out, progress=heard, **options)


def manifest(out):
    return json.loads((out / "manifest.json").read_text())


def lines(out, setting="clean"):
    return [json.loads(line) for line in (out / setting / "box/frames.jsonl").read_text().splitlines()]


def written(out, setting, frame):
    path = out / setting / "box" / "results" / f"depth{frame:06d}.png"
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def beyond(frame, scale_per_m=6553.5):
    return np.rint(depth_of(frame).astype(np.float64) * scale_per_m) > 65535


def test_a_hall_of_40_m(hall, tmp_path):
    heard, report = make(world(tmp_path / "w"), tmp_path / "out")
    lost = [beyond(frame) for frame in range(COUNT)]
    share = np.mean(lost)
    farthest = max(float(depth_of(frame).max()) for frame in range(COUNT))
    assert 0.3 < share < 0.7
    for frame, line in enumerate(lines(tmp_path / "out")):
        assert line["depth_out_of_range"] == {
            "pixels": int(lost[frame].sum()),
            "of": 48 * 36,
            "farthest_m": float(depth_of(frame).max()),
        }
        assert (written(tmp_path / "out", "clean", frame)[lost[frame]] == 0).all()
        assert (written(tmp_path / "out", "clean", frame)[~lost[frame]] > 0).all()
    summed = manifest(tmp_path / "out")["depth_out_of_range"]
    assert summed == {"clean/box": {"share": pytest.approx(share, abs=1e-12), "frames": 6, "farthest_m": farthest}}
    (early, first), (_, last) = heard.about_depth()
    assert early == 0  # before the first frame counts as done
    assert first.startswith(f"box: frame 0 of clean: {100 * lost[0].mean():.3g} % of its pixels lie beyond 10 m")
    assert last.startswith(
        f"box: {100 * share:.3g} % of the pixels of clean (in 6 of 6 frames) lie beyond 10 m, as far as"
    )
    for text in (first, last):
        assert "output.depth_scale_per_m: " in text
        assert "output.depth_beyond: farthest makes them 10 m" in text
    assert [note for note in report.notes if "beyond" in note] == [last]


def test_the_scale_that_is_named_holds_all_and_farthest_is_named_as_such(hall, tmp_path):
    _, report = make(world(tmp_path / "w"), tmp_path / "out")
    (note,) = [note for note in report.notes if NOTE in note]
    scale_per_m = float(note.split("depth_scale_per_m: ")[1].split()[0])
    heard, report = make(world(tmp_path / "held", depth_scale_per_m=scale_per_m), tmp_path / "held/out")
    assert heard.about_depth() == []
    assert manifest(tmp_path / "held/out")["depth_out_of_range"] == {}
    assert all(set(line) == {"frame", "time_s", "sha256"} for line in lines(tmp_path / "held/out"))
    for frame in range(COUNT):
        steps = written(tmp_path / "held/out", "clean", frame)
        assert np.abs(steps / scale_per_m - depth_of(frame)).max() <= 0.51 / scale_per_m
    heard, report = make(world(tmp_path / "far", depth_beyond="farthest"), tmp_path / "far/out")
    (note,) = [note for note in report.notes if NOTE in note]
    assert "and became 10 m; output.depth_scale_per_m: " in note
    assert "depth_beyond" not in note
    assert (written(tmp_path / "far/out", "clean", 0)[beyond(0)] == 65535).all()


SETTINGS = (
    {"name": "clean"},
    {"name": "late", "perturb": [{"desync": {"offset": 2}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 3}}]},
    {"name": "near", "perturb": [{"depth_range_clipping": {"min_m": 0.1, "max_m": 9.0}}]},
    {"name": "rough", "perturb": [{"depth_gaussian_noise": {"scale": 0.5}}]},
)


def test_every_setting_counts_what_its_own_files_lose(hall, tmp_path):
    heard, report = make(world(tmp_path / "w", settings=SETTINGS), tmp_path / "out")
    found = manifest(tmp_path / "out")["depth_out_of_range"]
    assert set(found) == {"clean/box", "late/box", "fast/box", "rough/box"}
    counts = [int(beyond(frame).sum()) for frame in range(COUNT)]
    shown = {"clean": range(6), "late": [2, 3, 4, 5, 5, 5], "fast": [0, 3]}
    for setting, frames in shown.items():
        told = [line["depth_out_of_range"]["pixels"] for line in lines(tmp_path / "out", setting)]
        assert told == [counts[frame] for frame in frames], setting
    # Nothing here is void before the noise, and noise that makes depth negative makes it void: the rest is too far.
    for frame, line in enumerate(lines(tmp_path / "out", "rough")):
        void = int((written(tmp_path / "out", "rough", frame) == 0).sum())
        assert line["depth_out_of_range"]["pixels"] == void - (48 * 36 - line["depth_out_of_range"]["of"])
        assert line["depth_out_of_range"]["farthest_m"] > depth_of(frame).max()
    worst = max(found, key=lambda folder: found[folder]["share"]).removesuffix("/box")
    notes = [note for note in report.notes if NOTE in note]
    assert len(notes) == 1
    assert f"of {worst} (in" in notes[0]
    assert "the most of 4 settings" in notes[0]
    assert len(heard.about_depth()) == 2


def test_a_run_that_is_taken_up_grown_or_divided_says_the_same(hall, tmp_path):
    preset = world(tmp_path / "w", settings=SETTINGS)
    _, whole = make(preset, tmp_path / "whole")
    wanted = manifest(tmp_path / "whole")["depth_out_of_range"]
    notes = [note for note in whole.notes if NOTE in note]

    stop = threading.Event()
    rendered = fake_session.Session.frame

    def frame(self, request):
        if request.index == 2:
            stop.set()
        return rendered(self, request)

    fake_session.Session.frame = frame
    try:
        with pytest.raises(InterruptedRunError):
            make(preset, tmp_path / "stopped", stop=stop)
    finally:
        fake_session.Session.frame = rendered
    make(preset, tmp_path / "parts", frames=slice(1, 3))

    divided = workers_here(preset, tmp_path / "jobs")
    stop.clear()
    for name, keys in (("stopped", {}), ("parts", {}), ("jobs", {"jobs": 3, "workers": divided}), ("whole", {})):
        _, report = make(preset, tmp_path / name, **keys)
        assert manifest(tmp_path / name)["depth_out_of_range"] == wanted, name
        assert [note for note in report.notes if NOTE in note] == notes, name
        for setting in SETTINGS:
            assert lines(tmp_path / name, setting["name"]) == lines(tmp_path / "whole", setting["name"])


def test_settings_that_are_added_take_the_counts_with_the_files(hall, tmp_path):
    whole = world(tmp_path / "w", settings=SETTINGS)
    make(whole, tmp_path / "whole")
    make(world(tmp_path / "w", settings=SETTINGS[:1]), tmp_path / "out")
    make(world(tmp_path / "w", settings=SETTINGS[:2]), tmp_path / "out")
    make(world(tmp_path / "w", settings=SETTINGS[2:]), tmp_path / "out")  # the other two stay
    assert manifest(tmp_path / "out")["depth_out_of_range"] == manifest(tmp_path / "whole")["depth_out_of_range"]
    for setting in SETTINGS:
        assert lines(tmp_path / "out", setting["name"]) == lines(tmp_path / "whole", setting["name"])
    clean, late = (tmp_path / f"out/{name}/box/results/depth00000{k}.png" for name, k in (("clean", 2), ("late", 0)))
    assert clean.samefile(late)


def test_a_recording_converted_to_a_finer_scale(tmp_path, monkeypatch):
    """65535 steps of 1/5000 m are 13.1 m; at 6553.5 steps a metre 16 bits end at 10 m."""
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", None)
    steps = np.linspace(1, 65535, 48).astype(np.uint16).reshape(6, 8)
    folder = tmp_path / "recording"
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
        (folder / f"{name}.txt").write_text("".join(f"{k / 20:.6f} {name}/{k:06d}.png\n" for k in range(2)))
    for k in range(2):
        assert cv2.imwrite(str(folder / f"rgb/{k:06d}.png"), np.full((6, 8, 3), 90, np.uint8))
        (folder / f"depth/{k:06d}.png").write_bytes(encode_png(steps))
    (folder / "groundtruth.txt").write_text("".join(f"{k / 20:.6f} {k} 0 0 0 0 0 1\n" for k in range(2)))
    heard, report = make(stored(tmp_path / "p", folder, layout="replica"), tmp_path / "out")
    lost = steps.astype(np.int64) * 65535 // 50000 > 65535
    assert [line["depth_out_of_range"]["pixels"] for line in lines(tmp_path / "out")] == [lost.sum(), lost.sum()]
    (note,) = [note for note in report.notes if NOTE in note]
    assert "beyond 10 m, as far as 13.11 m" in note
    assert "output.depth_scale_per_m: 2000" in note or "output.depth_scale_per_m: 5000" in note
    # At its own scale the files are taken over, and nothing is lost.
    heard, _ = make(stored(tmp_path / "p", folder, layout="tum"), tmp_path / "same")
    assert heard.about_depth() == []
    assert (tmp_path / "same/clean/box/depth/000001.png").read_bytes() == encode_png(steps)


def test_infinite_depth_is_said_and_written_in_json_that_all_read(hall, tmp_path, monkeypatch):
    frame_of_hall = fake_session.Session.frame

    def frame(self, request):
        made = frame_of_hall(self, request)
        made.depth_m[:3] = np.inf
        return made

    monkeypatch.setattr(fake_session.Session, "frame", frame)
    _, report = make(world(tmp_path / "w", depth_scale_per_m=1000), tmp_path / "out")
    for name in ("manifest.json", "clean/box/frames.jsonl", "run.json"):
        for line in (tmp_path / "out" / name).read_text().splitlines() if name.endswith("l") else [""]:
            json.loads(line or (tmp_path / "out" / name).read_text(), parse_constant=pytest.fail)
    assert lines(tmp_path / "out")[0]["depth_out_of_range"] == {"pixels": 144, "of": 48 * 36, "infinite": 144}
    (note,) = [note for note in report.notes if NOTE in note]
    assert "beyond 65.5 m, infinitely far, and became void; output.depth_beyond: farthest makes them 65.5 m" in note


def test_layouts_say_who_does_not_find_colour(tmp_path, hall):
    preset = world(tmp_path / "w", image="png", depth_scale_per_m=1000)
    heard, _ = make(preset, tmp_path / "out")
    ((_, note),) = heard.said
    assert "look for results/frame*.jpg" in note
    assert "output.image: jpg" in note
    for overrides in (["output.image=jpg"], ["output.layout=tum"], ["output.modalities=[depth]"]):
        assert make(preset, tmp_path / "quiet", overrides=overrides)[0].said == []
        shutil.rmtree(tmp_path / "quiet")
    pytest.importorskip("embreex", reason="embreex is not installed")  # a dry run asks for what renders
    dry = ("--dry-run", "--set", "render.engine=embree")
    assert f"note       {note}" in generate_here(preset, *dry).stdout
    assert "note " not in generate_here(preset, *dry, "--set", "output.image=jpg").stdout
