# SPDX-License-Identifier: GPL-3.0-or-later
"""All images of a sequence in one folder, and a pose for each frame in a file of its own."""

from pathlib import Path

from noisy_world.extend import ImageFiles, LayoutWithReader, NumberedLayout, SequenceFacts, lines, numbered


class FlatRecordings(NumberedLayout):
    """Images and poses by number."""

    name = "flat"
    label = "Flat"
    meaning = "all images in one folder, each pose in a file"
    files = "000000_rgb.png, 000000_depth.png, poses/000000.txt"
    rgb = ImageFiles("", r"([0-9]+)_rgb\.png")
    depth = ImageFiles("", r"([0-9]+)_depth\.png")
    pose_folder = "poses"

    def recognises(self, folder: Path) -> bool:
        """Tell whether the first images lie in the folder itself."""
        return any(folder.glob("0*_rgb.png"))


class FlatLayout(LayoutWithReader):
    """`000000_rgb.png`, `000000_depth.png`, `poses/000000.txt`, and `cam_params.json` beside the sequence."""

    reader = FlatRecordings()
    images = ("png",)
    colours = ("rgb",)
    depth_scale_per_m = 1000.0
    rgb_file, depth_file = "{frame:06d}_rgb.{image}", "{frame:06d}_depth.png"
    patterns = numbered("poses/{}.txt")

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file for each pose that is known, four lines of four numbers: camera-to-world."""
        path = facts.chosen.rgb
        return {
            f"poses/{frame:06d}.txt": lines([" ".join(map(repr, row)) for row in c2w.tolist()])
            for frame, c2w, known in zip(facts.frames, path.c2w, path.known, strict=True)
            if known
        }


LAYOUT = FlatLayout()
