# SPDX-License-Identifier: GPL-3.0-or-later
"""Any frame of a sequence, made by the reference from the clean frames that it shows, without writing anything."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS, in_order
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.records import COMPLETED
from ..core.errors import InputError
from ..core.perturbing.execution import ColourWork, DepthWork, Notes
from ..core.planning.sequence import Sequence, ShownSources
from ..core.regular_files import read_bytes
from .clean_frame import Camera, CleanFrame
from .pairs import CleanPair


@dataclass(frozen=True)
class SequenceMaker:
    """Makes frames of a sequence.

    colour, depth: the cameras of both images. clean: returns a source frame by its number. pair:
    returns what leads from one to another; None where nothing does.
    """

    sequence: Sequence
    colour: Camera
    depth: Camera
    clean: Callable[[int], CleanFrame]
    pair: Callable[[ShownSources], CleanPair] | None = None

    def frame(self, index: int) -> "MadeFrame":
        """Return a frame of the sequence; nothing is done before it is asked. Raises ValueError if it is left out."""
        shown = self.sequence.shown(index)
        shown_rgb = self.clean(shown.rgb_source)
        same = shown.depth_source == shown.rgb_source
        shown_depth = shown_rgb if same else self.clean(shown.depth_source)
        return MadeFrame(self, index, shown.depth_frame, shown_rgb, shown_depth)


class MadeFrame:
    """A frame of a sequence, each of its images made when it is first needed."""

    def __init__(self, maker: SequenceMaker, index: int, depth_frame: int, rgb: CleanFrame, depth: CleanFrame) -> None:
        """Take the clean frames that its colour and its depth are of. depth_frame: to which the depth belongs."""
        self._maker = maker
        self._index = index
        self._depth_frame = depth_frame
        self._clean_rgb = rgb
        self._clean_depth = depth

    @cached_property
    def _colour_work(self) -> ColourWork:
        maker = self._maker
        where = maker.colour.context(maker.sequence, self._index, self._clean_rgb)
        return ColourWork.of(maker.sequence.setting.rgb, where)

    @cached_property
    def _rgb(self) -> tuple[NDArray[np.uint8] | None, Notes]:
        return self._clean_rgb.perturbed_rgb(self._colour_work), self._colour_work.notes

    @cached_property
    def _depth_m(self) -> tuple[NDArray[np.float32] | None, Notes]:
        maker, clean = self._maker, self._clean_depth
        where = maker.depth.context(maker.sequence, self._depth_frame, clean)
        work = DepthWork.of(maker.sequence.setting.depth, where)
        return clean.perturbed_depth(work), work.notes

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, before it is encoded."""
        pixels, _ = self._rgb
        return self._clean_rgb.byte_rgb if pixels is None else pixels

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, before it is rounded to steps."""
        depth_m, _ = self._depth_m
        return self._clean_depth.depth_m if depth_m is None else depth_m

    def stored_rgb(self, written: OutputFormat) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return colour (H, W, 3), RGB, as a dataset's image holds it if nothing is lost in encoding."""
        pixels, _ = self._rgb
        return written.stored_rgb(self._clean_rgb.rgb if pixels is None else pixels)

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of another channel than colour and depth, before it is encoded."""
        if not CHANNELS[modality].pairs:
            return self._clean_rgb.image(modality)
        assert self._maker.pair is not None, "what perturbs images has no such channels"
        return self._maker.pair(self._maker.sequence.shows(modality, self._index)).image(modality)

    def rgb_to_decode(self, written: OutputFormat) -> bytes:
        """Return bytes that decode to the pixels of colour's file, and take less time where these are noisy."""
        pixels, _ = self._rgb
        return self.image_bytes("rgb", written) if pixels is None else written.encode_rgb(pixels, fit_tables=False)

    def image_bytes(self, modality: Modality, written: OutputFormat) -> bytes:
        """Return the image of a channel as a dataset holds it."""
        channel = CHANNELS[modality]
        if channel.steps is None:
            return channel.encode(self.image(modality), written)
        clean = self._clean_depth if channel.paired else self._clean_rgb
        pixels, _ = self._depth_m if channel.paired else self._rgb
        if pixels is not None:
            return channel.encode(pixels, written)
        whole = clean.file_as(modality, written)
        return channel.encode_clean(clean.image(modality), written) if whole is None else _content(whole.path)

    def done(self, written: OutputFormat) -> dict[str, Any]:
        """Return what was done to the images, as frames.jsonl has it; motion is not in it."""
        found: dict[str, Any] = {}
        for channel in map(CHANNELS.__getitem__, in_order(written.modalities)):
            if channel.steps is not None and (notes := (self._depth_m if channel.paired else self._rgb)[1]):
                found[channel.steps] = notes
                if channel.steps == "rgb":
                    work = self._colour_work
                    found |= {"camera": dict(work.decided)} if work.decided else {}
                    found |= {COMPLETED: made} if (made := self._clean_rgb.completed(work)) else {}
            if channel.paired and self._maker.sequence.paired:
                found["pairing"] = {"depth_of_frame": self._depth_frame}
        if exposure := (self._clean_rgb if "rgb" in written.modalities else self._clean_depth).exposure:
            found["exposure"] = exposure
        return found


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
