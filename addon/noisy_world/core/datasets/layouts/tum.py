# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read."""

from pathlib import Path

from ...errors import InputError
from ...geometry import Intrinsics
from ...trajectories.files import read_trajectory, tum_text
from ..stored import StampedFile, StoredSequence, pair_by_stamp, read_text
from .cam_params import CAM_PARAMS, cam_params_text, read_depth_scale
from .layout import PATH_SUFFIXES, Image, Layout, SequenceFacts, lines, numbered, path_suffix

# The benchmark's files begin with three lines of comments. Readers rely on them: ORB-SLAM's mono_tum leaves out three
# lines of rgb.txt whatever they are, NICE-SLAM and its successors one of groundtruth.txt.
_NO_BAG = "# file: none; written by Noisy World"
_LISTED = "# timestamp filename"
_POSES_HEADER = lines(["# ground truth trajectory", _NO_BAG, "# timestamp tx ty tz qx qy qz qw"])


class TumLayout(Layout):
    """`rgb/*.png`, `depth/*.png`, their lists `rgb.txt` and `depth.txt`, `associations.txt` and `groundtruth.txt`."""

    name = "tum"
    label = "TUM"
    meaning = "of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read"
    images = ("png",)
    colours = ("rgb", "grey")
    depth_scale_per_m = 5000.0  # the benchmark's own
    patterns = (
        *numbered("rgb/{}.png"),
        *numbered("depth/{}.png"),
        *(f"groundtruth{suffix}.txt" for suffix in PATH_SUFFIXES),
        "rgb.txt",
        "depth.txt",
        "associations.txt",
    )
    setting_files = (CAM_PARAMS,)

    def rgb_name(self, frame: int, stamp_s: float, image: Image) -> str:
        """Return the name of a frame's colour image."""
        del stamp_s
        return f"rgb/{frame:06d}.{image}"

    def depth_name(self, frame: int, stamp_s: float) -> str:
        """Return the name of a frame's depth image."""
        del stamp_s
        return f"depth/{frame:06d}.png"

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file of poses for each path, a list for each modality, and the pairs if there are two modalities."""
        stamps = [f"{stamp_s:.6f}" for stamp_s in facts.chosen.rgb.stamps_s]
        names, modalities = facts.names, facts.format.modalities
        rgb = [f"{stamp} {names.rgb(frame)}" for stamp, frame in zip(stamps, facts.frames, strict=True)]
        depth = [f"{stamp} {names.depth(frame)}" for stamp, frame in zip(stamps, facts.frames, strict=True)]
        texts = {
            f"groundtruth{path_suffix(name)}.txt": _POSES_HEADER + tum_text(path)
            for name, path in facts.chosen.named().items()
        }
        if "rgb" in modalities:
            texts["rgb.txt"] = lines(["# color images", _NO_BAG, _LISTED, *rgb])
        if "depth" in modalities:
            texts["depth.txt"] = lines(["# depth maps", _NO_BAG, _LISTED, *depth])
        if len(modalities) == 2:  # without comments: ORB-SLAM's rgbd_tum reads every line as a pair
            texts["associations.txt"] = lines([f"{left} {right}" for left, right in zip(rgb, depth, strict=True)])
        return texts

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float) -> dict[str, str]:
        """Return cam_params.json, as the benchmark has no file of intrinsics of its own."""
        return {CAM_PARAMS: cam_params_text(camera, depth_scale_per_m)}

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a list of colour images."""
        return (folder / "rgb.txt").is_file()

    def read(self, folder: Path) -> StoredSequence:
        """Find images and poses with close stamps."""
        rgb, depth = _listed(folder / "rgb.txt"), _listed(folder / "depth.txt")
        poses = folder / "groundtruth.txt"
        rgb_files, depth_files, trajectory = pair_by_stamp(folder, rgb, depth, poses, read_trajectory(poses))
        scale_per_m = read_depth_scale(folder) or self.depth_scale_per_m
        return StoredSequence(folder, rgb_files, depth_files, poses, trajectory, scale_per_m)


def _listed(path: Path) -> list[StampedFile]:
    """Read a list of stamps and files."""
    found = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            found.append((float(words[0]), path.parent / words[1]))
        except (ValueError, IndexError) as error:
            raise InputError(path, "is no time stamp and file name", where=f"line {number}") from error
    return found
