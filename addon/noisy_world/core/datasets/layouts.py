# SPDX-License-Identifier: GPL-3.0-or-later
"""The two dataset layouts: which file is called what, and the text files beside the images.

Replica: that of iMAP and NICE-SLAM. TUM: that of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ..geometry import Intrinsics
from ..trajectories.files import replica_text, tum_text
from ..trajectories.trajectory import Trajectory
from .images import UINT16_MAX

REPLICA_SCALE_PER_M = 6553.5  # 16 bits are 10 m
TUM_SCALE_PER_M = 5000.0


@dataclass(frozen=True)
class Layout:
    """A layout, the kind of its colour images, and what is in it: "rgb", "depth" or both."""

    name: Literal["replica", "tum"]
    image: Literal["jpg", "png"]
    modalities: tuple[str, ...] = ("rgb", "depth")

    @property
    def depth_scale_per_m(self) -> float:
        """Steps of the depth images a metre."""
        return REPLICA_SCALE_PER_M if self.name == "replica" else TUM_SCALE_PER_M

    @property
    def depth_limit_m(self) -> float:
        """The largest depth that 16 bits hold; what lies beyond is void."""
        return UINT16_MAX / self.depth_scale_per_m

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders of a sequence."""
        return ("results",) if self.name == "replica" else self.modalities

    def rgb_name(self, frame: int) -> str:
        """The colour image of a frame, inside its sequence."""
        return f"results/frame{frame:06d}.{self.image}" if self.name == "replica" else f"rgb/{frame:06d}.{self.image}"

    def depth_name(self, frame: int) -> str:
        """The depth image of a frame, inside its sequence."""
        return f"results/depth{frame:06d}.png" if self.name == "replica" else f"depth/{frame:06d}.png"

    def names(self, frame: int) -> set[str]:
        """The images of a frame, inside its sequence."""
        found = {"rgb": self.rgb_name(frame), "depth": self.depth_name(frame)}
        return {found[modality] for modality in self.modalities}

    @property
    def patterns(self) -> tuple[str, ...]:
        """Glob patterns of every file that may lie in a sequence's folder, for who removes a dataset."""
        images = ("results/frame{}.jpg", "results/frame{}.png", "results/depth{}.png", "rgb/{}.png", "depth/{}.png")
        numbers = ("[0-9]" * 6, "[0-9]" * 7)
        poses = [
            f"{name}{sensor}.txt" for name in ("traj", "groundtruth") for sensor in ("", "_depth", "_robot", "_nominal")
        ]
        lists = ("rgb.txt", "depth.txt", "associations.txt", "frames.jsonl")
        return (*(image.format(number) for image in images for number in numbers), *poses, *lists)

    def sequence_texts(self, frames: Sequence[int], trajectories: dict[str, Trajectory]) -> dict[str, str]:
        """Return the text files of a sequence by name.

        frames: which frames of the trajectories there are. trajectories: "" is the colour camera's; others (the depth
        sensor's, the robot's) get a file of their own with the key in its name.
        """
        rows = list(frames)
        chosen = {key: Trajectory(path.c2w[rows], path.stamps_s[rows]) for key, path in trajectories.items()}
        suffix = {key: f"_{key}" if key else "" for key in chosen}
        if self.name == "replica":
            return {f"traj{suffix[key]}.txt": replica_text(value) for key, value in chosen.items()}
        stamps = [f"{stamp:.6f}" for stamp in chosen[""].stamps_s]
        rgb = [f"{stamp} {self.rgb_name(frame)}" for stamp, frame in zip(stamps, frames, strict=True)]
        depth = [f"{stamp} {self.depth_name(frame)}" for stamp, frame in zip(stamps, frames, strict=True)]
        texts = {f"groundtruth{suffix[key]}.txt": tum_text(value) for key, value in chosen.items()}
        if "rgb" in self.modalities:
            texts["rgb.txt"] = _lines(["# color images", "# timestamp filename", *rgb])
        if "depth" in self.modalities:
            texts["depth.txt"] = _lines(["# depth maps", "# timestamp filename", *depth])
        if len(self.modalities) == 2:
            texts["associations.txt"] = _lines([f"{left} {right}" for left, right in zip(rgb, depth, strict=True)])
        return texts

    def setting_texts(self, camera: Intrinsics) -> dict[str, str]:
        """Return the text files of a setting by name: the intrinsics as NICE-SLAM's successors read them."""
        values = {
            "w": camera.width_px,
            "h": camera.height_px,
            "fx": float(camera.fx_px),
            "fy": float(camera.fy_px),
            "cx": float(camera.cx_px),
            "cy": float(camera.cy_px),
            "scale": self.depth_scale_per_m,
        }
        return {"cam_params.json": json.dumps({"camera": values}, indent=2) + "\n"}


def _lines(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"
