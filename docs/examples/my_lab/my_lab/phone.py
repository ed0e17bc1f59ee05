# SPDX-License-Identifier: GPL-3.0-or-later
"""What our phone records: color_0.png, depth_0.png in millimetres, and pose_0.txt, camera-to-world."""

from pathlib import Path

from noisy_world.extend import ImageFiles, NumberedLayout


class PhoneLayout(NumberedLayout):
    """Images and poses by number, 10 a second."""

    name = "phone"
    label = "Our phone"
    meaning = "what our phone records; depth in mm"
    files = "color_0.png, depth_0.png, pose_0.txt"
    rgb = ImageFiles("", r"color_([0-9]+)\.png")
    depth = ImageFiles("", r"depth_([0-9]+)\.png")
    usual_hz = 10.0

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a first colour image and a first pose."""
        return (folder / "color_0.png").is_file() and (folder / "pose_0.txt").is_file()


LAYOUT = PhoneLayout()
