# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording without depth is perturbed as it is, and what needs depth is refused by name."""

import json

import numpy as np
from recorded_layouts import FRAMES, kitti
from recorded_presets import preset_of
from refusals import refused
from runs import run

from noisy_world.cli.command import main
from noisy_world.layouts import find_sequence
from noisy_world.perturb import frames

FOG = [{"fog_depth": {"severity": 3}}]
NOISE = [{"gaussian_noise": {"severity": 2}}]


def test_a_preset_writes_it_with_its_poses_and_times(tmp_path):
    (tmp_path / "drive").mkdir()
    written = kitti(tmp_path / "drive")
    scene = {"name": "drive", "sequence": str(tmp_path / "drive")}
    output = {"layout": "tum", "modalities": ["rgb"]}
    settings = [{"name": "clean"}, {"name": "noise", "perturb": NOISE}]
    run(preset_of(tmp_path / "p", scene, settings=settings, output=output), tmp_path / "out")
    found = find_sequence(tmp_path / "out/noise/drive")
    assert found.depth_files == ()
    np.testing.assert_allclose(found.trajectory.c2w, written.c2w, atol=1e-9)
    np.testing.assert_allclose(found.stamps.rgb.seconds, 0.1036 * np.arange(FRAMES), atol=1e-6)
    assert len(found.rgb_files) == FRAMES
    foggy = preset_of(tmp_path / "f", scene, settings=[{"name": "foggy", "perturb": FOG}], output=output)
    refused(run, foggy, tmp_path / "fog", names=("scenes.0.sequence", "foggy needs depth", "take that setting out"))
    scaled = preset_of(tmp_path / "s", {**scene, "depth_scale_per_m": 1000}, output=output)
    refused(run, scaled, tmp_path / "scaled", names=("depth_scale_per_m", "has no depth"))


def test_the_library_gives_its_colour(tmp_path):
    kitti(tmp_path)
    given = list(frames(tmp_path, NOISE))
    assert [(frame.rgb.shape, frame.depth_m) for frame in given] == [((48, 64, 3), None)] * FRAMES
    for needing in (FOG, [{"depth_gaussian_noise": {"severity": 1}}], [{"desync": {"offset": 1}}]):
        refused(frames, tmp_path, needing, names=("needs depth", str(tmp_path)))


def test_a_setting_that_needs_what_is_not_there_is_left_out_alone(tmp_path, capfd):
    (tmp_path / "drive").mkdir()
    kitti(tmp_path / "drive")
    settings = [
        {"name": "clean"},
        {"name": "foggy", "perturb": FOG},
        {"name": "torn", "perturb": [{"depth_gaussian_noise": {"severity": 1}}]},
        {"name": "apart", "perturb": [{"motion_deviation": {"rotation_deg": 1}}]},
        {"name": "slow", "perturb": [{"camera_motion_blur": {}}]},
        {"name": "noise", "perturb": NOISE},
    ]
    scene = {"name": "drive", "sequence": str(tmp_path / "drive")}
    path = preset_of(tmp_path / "p", scene, settings=settings, output={"layout": "tum", "modalities": ["rgb"]})
    words = [str(path), "--out", str(tmp_path / "out")]
    assert main(["generate", *words, "--dry-run"]) == 0
    dry = capfd.readouterr().out
    assert main(["generate", *words]) == 0
    said = capfd.readouterr().out
    report = json.loads((tmp_path / "out/run.json").read_text())
    reasons = {"foggy": "depth", "torn": "depth", "apart": "seen from elsewhere", "slow": "nothing between"}
    assert set(report["refused"]) == {f"{name}/drive" for name in reasons}
    for name, why in reasons.items():
        (line,) = [line for line in dry.splitlines() if f"{name}/drive is left out" in line]
        assert why in line
        assert f"left out {name}/drive: {report['refused'][f'{name}/drive']}\n" in said
        assert why in report["refused"][f"{name}/drive"]
    assert sorted(file.name for file in (tmp_path / "out").iterdir() if file.is_dir()) == ["clean", "noise"]
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert list(manifest["identity"]["settings"]) == ["clean", "noise"]
    # A dataset without them is whole: it is not resumed, status finds nothing missing, and it grows.
    before = (tmp_path / "out/manifest.json").read_bytes()
    assert main(["generate", *words]) == 0
    assert "left out foggy/drive" in capfd.readouterr().out
    assert (tmp_path / "out/manifest.json").read_bytes() == before
    assert main(["status", str(tmp_path / "out")]) == 0
    assert "foggy" not in capfd.readouterr().out
    grown = json.loads(path.read_text())
    grown["settings"].append({"name": "blurred", "perturb": [{"motion_blur": {"severity": 2}}]})
    path.write_text(json.dumps(grown))
    assert main(["generate", *words]) == 0
    assert (tmp_path / "out/blurred/drive/rgb").is_dir()


def test_a_preset_of_which_nothing_can_be_made_ends_with_an_error(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        kitti(tmp_path / name)
    scenes = [{"name": name, "sequence": str(tmp_path / name)} for name in ("one", "two")]
    settings = [
        {"name": "foggy", "perturb": FOG},
        {"name": "apart", "perturb": [{"motion_deviation": {"rotation_deg": 1}}]},
    ]
    path = preset_of(tmp_path / "p", *scenes, settings=settings, output={"modalities": ["rgb"]})
    refused(
        run, path, tmp_path / "out", names=("settings", "none of 4 sequences", "foggy needs depth", "add a setting")
    )
    assert not (tmp_path / "out").exists()
