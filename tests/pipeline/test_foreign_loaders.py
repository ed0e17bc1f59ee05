# SPDX-License-Identifier: GPL-3.0-or-later
"""Our layouts as other people's systems load them: each frame has its own files and pose, the first and last too."""

import foreign_loaders
import numpy as np
import pytest
from cases import cases
from worlds import path_poses
from runs import run
from written import COUNT, RIG, SHAKY, fake_depth_m, fake_rgb, read, world, write_tum_path

LOADERS = {
    "tum": ("slam_tum", "associate_py", "orb_slam_rgbd_tum", "orb_slam_mono_tum"),
    "replica": ("slam_replica", "splatam_replica"),
    "euroc": ("orb_slam3_mono_euroc", "evo_euroc"),
    "tum_vi": ("orb_slam3_mono_tum_vi", "dm_vio", "pandas_tum_vi"),
    "vslamlab": ("vslamlab",),
    "kitti": ("pykitti_odometry",),
    "scannet": ("slam_scannet",),
    "nerfstudio": ("nerfstudio_parser",),
    "colmap": ("colmap_text",),
}
MILLIMETRES = {"depth_scale_per_m": 1000}
BENCHMARK_STAMPS = ["1305031102.175304", "1305031102.211214", "1305031102.243211", "1305031102.275326"]


pytestmark = pytest.mark.usefixtures("no_blender")


def check(found, frames, poses, stamps_s):
    """Hold what a system has against frames of known content: source frame k shows k in blue and in depth."""
    assert len(found.rgb) == len(frames)
    for place, frame in enumerate(frames):
        pixels = read(found.rgb[place]).astype(float)
        if pixels.ndim == 3:
            assert np.abs(pixels[..., 0].mean() - 255 * fake_rgb(frame)[..., 2].mean()) < 0.5
        else:
            grey = 255 * fake_rgb(frame) @ [0.299, 0.587, 0.114]
            assert np.abs(pixels - grey).max() <= 0.51
        if found.depth is not None:
            assert np.abs(read(found.depth[place]) / 1000 - fake_depth_m(frame)).max() <= 0.51 / 1000
    if found.stamps_s is not None:
        assert np.abs(np.array(found.stamps_s) - stamps_s).max() < 1e-6
    if found.c2w is not None:
        assert np.abs(found.c2w - poses).max() < 1e-9
    if found.camera is not None:
        assert found.camera == pytest.approx((4.0, 4.0, 3.5, 2.5), abs=1e-12)


def loaded(folder, layout):
    """What each system that reads the layout has of a sequence, by its name."""
    return {name: getattr(foreign_loaders, name)(folder) for name in LOADERS[layout]}


@cases("layout", LOADERS)
def test_every_frame_has_its_own_files_and_pose(tmp_path, layout):
    run(world(tmp_path / layout, layout, output=MILLIMETRES), tmp_path / f"{layout}_out")
    for found in loaded(tmp_path / f"{layout}_out/clean/box", layout).values():
        check(found, range(COUNT), path_poses(COUNT), np.arange(COUNT) / 20)


@cases("layout", LOADERS)
def test_stamps_that_a_trajectory_brings(tmp_path, layout):
    preset = world(tmp_path / layout, layout, output=MILLIMETRES)
    run(preset, tmp_path / f"{layout}_out", overrides=[write_tum_path(tmp_path / layout, BENCHMARK_STAMPS)])
    poses = np.stack([np.eye(4)] * COUNT)
    poses[:, :3, 3] = [[0.1 * k, 0.0, 1.2] for k in range(COUNT)]
    stamps_s = np.array([float(stamp) for stamp in BENCHMARK_STAMPS])
    for name, found in loaded(tmp_path / f"{layout}_out/clean/box", layout).items():
        kept = list(range(COUNT))
        if name == "slam_tum":  # it leaves out frames that follow within 1/32 s, of our sequences as of the benchmark's
            kept = [0]
            for k in range(1, COUNT):
                if stamps_s[k] - stamps_s[kept[-1]] > 1 / 32:
                    kept.append(k)
        check(found, kept, poses[kept], stamps_s[kept])


@cases("layout", LOADERS)
def test_selected_frames_of_a_faster_sequence(tmp_path, layout):
    fast = {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}
    preset = world(tmp_path / layout, layout, frames=9, output=MILLIMETRES, settings=[fast])
    run(preset, tmp_path / f"{layout}_out", frames=slice(1, 4))
    for found in loaded(tmp_path / f"{layout}_out/fast/box", layout).values():
        check(found, [2, 4, 6], path_poses(9)[[2, 4, 6]], np.array([1, 2, 3]) / 20)


def test_all_files_of_poses_have_the_benchmarks_lines(tmp_path):
    run(world(tmp_path / "w", "tum", rig=RIG, settings=[SHAKY]), tmp_path / "out")
    folder = tmp_path / "out/shaky/box"
    for name in ("groundtruth", "groundtruth_depth", "groundtruth_robot", "groundtruth_nominal"):
        lines = (folder / f"{name}.txt").read_text().splitlines()
        assert lines[0] == "# ground truth trajectory"
        assert lines[1].startswith("# file: ")
        assert lines[2] == "# timestamp tx ty tz qx qy qz qw"
        assert [len(line.split()) for line in lines[3:]] == [8] * COUNT
    for name, first in (("rgb", "# color images"), ("depth", "# depth maps")):
        lines = (folder / f"{name}.txt").read_text().splitlines()
        assert (lines[0], lines[2]) == (first, "# timestamp filename")
        assert lines[1].startswith("# file: ")
        assert not any(line.startswith("#") for line in lines[3:])
    assert "#" not in (folder / "associations.txt").read_text()


def test_a_loader_that_counts_lines_would_see_a_missing_header(tmp_path):
    """The loaders here are strict enough: without the three lines they go wrong as the originals do."""
    run(world(tmp_path / "w", "tum"), tmp_path / "out")
    folder = tmp_path / "out/clean/box"
    for name in ("groundtruth.txt", "rgb.txt"):
        lines = (folder / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(line for line in lines if not line.startswith("#")))
    assert np.abs(foreign_loaders.slam_tum(folder).c2w[0] - path_poses(COUNT)[1]).max() < 1e-9
    assert len(foreign_loaders.orb_slam_mono_tum(folder).rgb) == COUNT - 3
