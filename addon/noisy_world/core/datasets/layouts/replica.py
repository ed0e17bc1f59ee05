# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the Replica sequences that iMAP and NICE-SLAM read."""

import re
from pathlib import Path

from ...errors import InputError
from ...geometry import Intrinsics
from ...trajectories.files import read_trajectory, replica_text
from ..stored import StoredSequence
from .cam_params import CAM_PARAMS, cam_params_text, read_depth_scale
from .layout import PATH_SUFFIXES, Image, Layout, SequenceFacts, numbered, path_suffix

RESULTS = "results"


class ReplicaLayout(Layout):
    """`results/frame000000.jpg`, `results/depth000000.png`, `traj.txt`, and `cam_params.json` one level up."""

    name = "replica"
    label = "Replica"
    meaning = "of iMAP and NICE-SLAM"
    images = ("jpg", "png")
    colours = ("rgb", "grey")
    depth_scale_per_m = 6553.5  # 16 bits are 10 m
    patterns = (
        *numbered(f"{RESULTS}/frame{{}}.jpg"),
        *numbered(f"{RESULTS}/frame{{}}.png"),
        *numbered(f"{RESULTS}/depth{{}}.png"),
        *(f"traj{suffix}.txt" for suffix in PATH_SUFFIXES),
    )
    setting_files = (CAM_PARAMS,)

    def rgb_name(self, frame: int, stamp_s: float, image: Image) -> str:
        """Return the name of a frame's colour image."""
        del stamp_s
        return f"{RESULTS}/frame{frame:06d}.{image}"

    def depth_name(self, frame: int, stamp_s: float) -> str:
        """Return the name of a frame's depth image."""
        del stamp_s
        return f"{RESULTS}/depth{frame:06d}.png"

    def image_note(self, image: Image) -> str:
        """Say that PNG is not found: NICE-SLAM and its successors list results/frame*.jpg."""
        if image == "jpg":
            return ""
        return (
            "NICE-SLAM, Co-SLAM, GO-SLAM, SplaTAM and others that read this layout look for results/frame*.jpg and "
            f"find no colour in {image}; set output.image: jpg for them"
        )

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file of poses for each path."""
        return {f"traj{path_suffix(name)}.txt": replica_text(path) for name, path in facts.chosen.named().items()}

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float) -> dict[str, str]:
        """Return cam_params.json."""
        return {CAM_PARAMS: cam_params_text(camera, depth_scale_per_m)}

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a folder `results`."""
        return (folder / RESULTS).is_dir()

    def read(self, folder: Path) -> StoredSequence:
        """Find the images, which match by number, and the poses, one for each image."""
        results = folder / RESULTS
        rgb = sorted((path for kind in self.images for path in results.glob(f"frame*.{kind}")), key=_number)
        depth = sorted(results.glob("depth*.png"), key=_number)
        if not rgb or [_number(path) for path in rgb] != [_number(path) for path in depth]:
            problem = f"has {len(rgb)} colour and {len(depth)} depth images, which do not match by number"
            raise InputError(results, problem)
        poses = folder / "traj.txt"
        trajectory = read_trajectory(poses)
        if len(trajectory) != len(rgb):
            raise InputError(poses, f"has {len(trajectory)} poses for {len(rgb)} frames", remedy="one line a frame")
        scale_per_m = read_depth_scale(folder) or self.depth_scale_per_m
        return StoredSequence(folder, tuple(rgb), tuple(depth), poses, trajectory, scale_per_m)


def _number(path: Path) -> int:
    digits = re.search(r"(\d+)$", path.stem)
    if digits is None:
        raise InputError(path, "has no number in its name", remedy="frame000000.jpg, depth000000.png and so on")
    return int(digits[1])
