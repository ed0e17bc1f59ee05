# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `video`: a video file's colour, and depth where a folder holds it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..core.errors import Message, Part, PresetKey
from ..core.schema import ConfigPath, key
from ..images.measured_depth import VOID_CHOICES, VOID_MEANING, Void
from ..layouts.layout import MILLIMETRES
from ..layouts.stored_recording import SCALES_PER_M
from ..preset.scene_keys import SceneKeys
from ..render.source import Source
from .scene_files import FileSource, filled, found_path
from .scene_kinds import Lack, SceneEntry


@dataclass(frozen=True, kw_only=True)
class VideoKeys(SceneKeys):
    """What a preset says of a video."""

    video: str = key("instead of sequence: a video file, relative to the preset; * allowed", identity="meaning")
    depth: str | None = key(
        "the folder of a video's depth, a 16-bit PNG for each frame in the order of their numbers, relative to the "
        "preset; * stands for what the * of video matched",
        default=None,
        identity="meaning",
    )
    depth_scale_per_m: float | None = key(
        "steps a metre of the depth beside a video; default 1000: millimetres",
        unit="steps/m",
        default=None,
        minimum=SCALES_PER_M[0],
        maximum=SCALES_PER_M[1],
        identity="meaning",
        slider=(100, 10_000),
    )
    void: Void = key(VOID_MEANING, default="unmeasured", choices=VOID_CHOICES)


class VideoKind(FileSource[VideoKeys]):
    """A video file, with a folder of depth where there is one."""

    name = "video"
    order = 40
    label = "Video"
    meaning = "a video file; a folder beside it may hold its depth"
    keys = VideoKeys
    several = "videos"
    remedies: ClassVar[Mapping[Lack, Part]] = {"depth": Message("name the folder of its depth: ", PresetKey("depth"))}
    instead: ClassVar[Mapping[str, Part]] = {"trajectory": "leave it out: a video has no poses"}

    def check(self, keys: VideoKeys, place: ConfigPath) -> None:
        """Refuse a depth scale without depth."""
        if keys.depth is not None:
            return
        for name, given in (("depth_scale_per_m", keys.depth_scale_per_m is not None), ("void", keys.void == "sky")):
            if given:
                raise place.at(name).error("goes with depth of a video", "leave it out")

    def open_file(self, entry: SceneEntry[VideoKeys], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a file."""
        del name
        from .footage import read_video_source

        beside, where = None, entry.place.at("depth")
        if entry.keys.depth is not None:
            beside = found_path(entry.preset, where, filled(entry.keys.depth, parts, where), folder=True)
        return read_video_source(
            path, entry.place, beside, entry.keys.depth_scale_per_m or MILLIMETRES, entry.keys.void
        )


SOURCE = VideoKind()
