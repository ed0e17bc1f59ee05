# SPDX-License-Identifier: GPL-3.0-or-later
"""When colour and depth of recordings were taken, by preset and by the library."""

from recorded_presets import preset_of, recorded
import json

import cv2
import numpy as np
import pytest
from refusals import refused
from probes import BOTH_PROBES, COLOUR, DEPTH, Probes
from runs import run
from written import read, states

import noisy_world
from noisy_world.layouts import find_sequence
from noisy_world.core.errors import StorageError
from noisy_world.preset.keys import read_preset
from noisy_world.perturb import frames
from noisy_world.dataset.plan import make_plan


pytestmark = pytest.mark.usefixtures("no_blender")


# --- stamps of depth ---


def jittered_tum(folder):
    """A recording whose depth is 7 ms late, whose third image has no depth, and whose poses are 4 ms early."""
    source = recorded(folder, "tum", frames=6)
    shift = {"rgb.txt": 0.0, "depth.txt": 0.007, "groundtruth.txt": -0.004}
    for name, late_s in shift.items():
        rows = [row for row in (source / name).read_text().splitlines() if not row.startswith("#")]
        rows = [f"{1.4e9 + float(row.split()[0]) + late_s:.6f} {row.split(' ', 1)[1]}" for row in rows]
        if name == "depth.txt":
            del rows[2]
        (source / name).write_text("\n".join(rows) + "\n")
    return source


def test_each_frame_says_when_its_depth_was_taken_and_the_report_what_is_left_out(tmp_path):
    source = jittered_tum(tmp_path)
    late = {"name": "late", "perturb": [{"desync": {"offset": 1}}]}
    fast = {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}
    scene = {"name": "box", "sequence": str(source)}
    preset = preset_of(tmp_path / "p", scene, settings=[{"name": "clean"}, late, fast])
    report = run(preset, tmp_path / "out")
    assert report.notes[-1] == "box: 1 of 6 colour images are left out: 1 with no depth image within 0.02 s"
    wanted_s = [1.4e9 + k / 20 for k in (0, 1, 3, 4, 5)]
    for setting, count in (("clean", 5), ("late", 5), ("fast", 3)):
        records = [json.loads(line) for line in (tmp_path / f"out/{setting}/box/frames.jsonl").read_text().splitlines()]
        # Frame i keeps the i-th stamps, whatever it shows.
        assert np.allclose([item["time_s"] for item in records], wanted_s[:count], atol=1e-6)
        assert np.allclose([item["depth_time_s"] for item in records], np.array(wanted_s[:count]) + 0.007, atol=1e-6)
        opened = noisy_world.open(tmp_path / "out")[f"{setting}/box"]
        assert [frame.depth_stamp_s for frame in opened] == [item["depth_time_s"] for item in records]
    # Resumed and complete: nothing is made again, and the stamps stay.
    before = (tmp_path / "out/clean/box/frames.jsonl").read_bytes()
    assert run(preset, tmp_path / "out").frames_rendered == 0
    assert (tmp_path / "out/clean/box/frames.jsonl").read_bytes() == before
    run(
        preset_of(tmp_path / "e", {"name": "box", "sequence": str(source)}, output={"layout": "euroc"}), tmp_path / "ns"
    )
    names = sorted(path.name for path in (tmp_path / "ns/clean/box/mav0/depth0/data").iterdir())
    assert names == [f"{round((t - 1.4e9) * 1e6) + 7000 + 1_400_000_000_000_000}000.png" for t in wanted_s]
    # Poses keep their own stamps too, of all frames and of chosen ones.
    early_ns = [(round((t - 1.4e9) * 1e6) - 4000 + 1_400_000_000_000_000) * 1000 for t in wanted_s]
    assert states(tmp_path / "ns/clean/box")[0] == early_ns
    run(tmp_path / "e/preset.json", tmp_path / "some", frames=slice(1, 3))
    assert states(tmp_path / "some/clean/box")[0] == early_ns[1:3]


def test_depth_of_an_opened_dataset_is_that_of_its_record(tmp_path):
    # The depth of each image is 10 ms from it and 2 ms from the other one: by stamps alone they would be exchanged.
    source = recorded(tmp_path, "tum", frames=2)
    for name in ("rgb.txt", "depth.txt", "frames.jsonl"):
        (source / name).unlink(missing_ok=True)
    rows = ("0.000 rgb/000000.png 0.010 depth/000000.png", "0.012 rgb/000001.png 0.002 depth/000001.png")
    (source / "associations.txt").write_text("\n".join(rows) + "\n")
    (source / "groundtruth.txt").write_text("0.000 0 0 0 0 0 0 1\n0.012 0 0 1 0 0 0 1\n")
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)}, output={"layout": "tum"})
    run(preset, tmp_path / "out")
    written = [cv2.imread(str(source / f"depth/00000{k}.png"), cv2.IMREAD_UNCHANGED) for k in range(2)]
    assert not np.array_equal(*written)
    for frame, steps in zip(noisy_world.open(tmp_path / "out")["clean/box"], written, strict=True):
        np.testing.assert_array_equal(np.round(frame.depth_m * 5000), steps)


def test_colour_and_depth_are_told_their_own_stamps_by_preset_and_library(tmp_path, monkeypatch):
    # Five frames are left, of the images 0, 1, 3, 4 and 5; every other of these, each with depth of the frame after it.
    source = jittered_tum(tmp_path)
    steps = [*BOTH_PROBES, {"desync": {"offset": 1}}, {"faster_motion": {"factor": 2}}]
    preset = preset_of(
        tmp_path / "p", {"name": "box", "sequence": str(source)}, settings=[{"name": "mixed", "perturb": steps}]
    )
    probes, library = Probes(), Probes()
    probes.install(monkeypatch)
    run(preset, tmp_path / "out")
    library.install(monkeypatch)
    with pytest.warns(UserWarning, match="left out"):
        made = [(item, item.rgb, item.depth_m) for item in frames(source, steps, seed=3, setting="mixed", scene="box")]
    rgb_s = [1.4e9 + k / 20 for k in (0, 1, 3)]
    poses = find_sequence(source).trajectory.c2w[[0, 2, 4]]
    assert np.array_equal(find_sequence(tmp_path / "out/mixed/box").trajectory.c2w.round(5), poses.round(5))
    assert [item.stamp_s for item, _, _ in made] == pytest.approx(rgb_s, abs=1e-6)
    assert np.array_equal([item.c2w for item, _, _ in made], poses)
    for told in (probes, library):
        colour, depth = told.of(COLOUR, "mixed"), told.of(DEPTH, "mixed")
        assert (list(colour), list(depth)) == ([0, 1, 2], [1, 2])
        for frame, item in colour.items():
            assert item.context.stamp_s == pytest.approx(rgb_s[frame], abs=1e-6)
            # The camera's rate stays: to the third frame it takes 0.1 s, as from image 1 to image 3.
            passed_s = rgb_s[frame] - rgb_s[frame - 1] if frame else 1.0
            moved_m = poses[frame, :3, 3] - poses[max(frame - 1, 0), :3, 3]
            assert item.context.motion.velocity_m_s == pytest.approx(moved_m / passed_s, rel=1e-3)
        for frame, item in depth.items():
            assert item.context.stamp_s == pytest.approx(rgb_s[frame] + 0.007, abs=1e-6)
            # Images 0, 3 and 5 show: the stand-in for the renderer makes depth a metre deeper in each image.
            assert round(float(item.own[0, 0])) - 1 == [0, 3, 5][frame]
            assert round(float(item.other[0, 0, 2]) * 255) == [0, 3, 5][frame]


def test_the_library_reads_as_a_preset_does(tmp_path):
    source = jittered_tum(tmp_path)
    with pytest.warns(UserWarning, match="1 of 6 colour images are left out"):
        found = list(frames(source, [{"fog_depth": {"severity": 2}}], seed=3, setting="hazy", scene="box"))
    hazy = {"name": "hazy", "perturb": [{"fog_depth": {"severity": 2}}]}
    preset = preset_of(
        tmp_path / "p", {"name": "box", "sequence": str(source)}, settings=[hazy], output={"image": "png"}
    )
    run(preset, tmp_path / "out")
    for item in found:
        assert np.array_equal(item.rgb, read(tmp_path / f"out/hazy/box/results/frame{item.index:06d}.png")[..., ::-1])
    assert np.allclose([item.stamp_s for item in found], [1.4e9 + k / 20 for k in (0, 1, 3, 4, 5)], atol=1e-6)
    (source / "groundtruth.txt").write_text("0 0 0 0 0 0 0 1\n")
    refused(lambda: next(frames(source, [])), names=str(source))


@pytest.mark.parametrize("name", ["rgb.txt", "depth.txt"])
def test_when_colour_and_depth_were_taken_is_part_of_the_identity(tmp_path, name):
    """Files, poses and pairs stay what they are; stamps alone are a millisecond later."""
    source = jittered_tum(tmp_path)
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)})
    run(preset, tmp_path / "out")
    before = json.loads((tmp_path / "out/manifest.json").read_text())["identity"]["scenes"]["box"]["inputs"]
    lines = [line.split(" ", 1) for line in (source / name).read_text().splitlines()]
    (source / name).write_text("".join(f"{float(stamp) + 0.001:.6f} {rest}\n" for stamp, rest in lines))
    (scene,) = make_plan(read_preset(preset)).scenes
    after = scene.source.hashes()
    assert {key for key in before if before[key] != after[key]} == {"stamps_sha256"}
    refused(run, preset, tmp_path / "out", names="scenes.0.stamps", error=StorageError)
