# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth beyond the range of 16 bits: how many pixels of an image, sequence or scene are, and the remedy."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from .errors import Message, PresetKey, Remedy, either

UINT16_MAX = 65535  # 2^16 - 1, the largest step of a depth image
LARGEST_FLOAT32 = (2 - 2**-23) * 2.0**127

Beyond = Literal["void", "farthest"]
"""What becomes of depth beyond the range: nothing, or the farthest depth that 16 bits hold."""


@dataclass(frozen=True)
class OutOfRange:
    """The pixels of a depth image whose depth 16 bits do not hold.

    pixels: how many, at least 1. of: how many pixels have depth. farthest_m: the farthest finite depth among them; None
    where all are infinitely far. infinite: how many are.
    """

    pixels: int
    of: int
    farthest_m: float | None
    infinite: int = 0

    def content(self) -> dict[str, Any]:
        """Return it as frames.jsonl has it; JSON knows no infinity."""
        found: dict[str, Any] = {"pixels": self.pixels, "of": self.of}
        if self.farthest_m is not None:
            found["farthest_m"] = self.farthest_m
        return found | ({"infinite": self.infinite} if self.infinite else {})

    @classmethod
    def of_content(cls, content: Mapping[str, Any]) -> "OutOfRange":
        """Read what `content` made. Raises ValueError, KeyError, TypeError or OverflowError for anything else."""
        farthest = content.get("farthest_m")
        found = cls(
            int(content["pixels"]),
            int(content["of"]),
            None if farthest is None else float(farthest),
            int(content.get("infinite", 0)),
        )
        far = found.farthest_m is None or 0 < found.farthest_m <= LARGEST_FLOAT32
        if not (far and 0 < found.pixels <= found.of and 0 <= found.infinite <= found.pixels):
            raise ValueError(f"{content} counts no pixels")
        return found


@dataclass(frozen=True)
class RangeLoss:
    """The pixels of many depth images whose depth 16 bits do not hold.

    share: of all their pixels, 0 to 1. frames: how many of the images have some. farthest_m, infinite: as OutOfRange's.
    """

    share: float
    frames: int
    farthest_m: float | None
    infinite: int

    def content(self) -> dict[str, Any]:
        """Return it as the manifest has it."""
        found: dict[str, Any] = {"share": self.share, "frames": self.frames}
        if self.farthest_m is not None:
            found["farthest_m"] = self.farthest_m
        return found | ({"infinite": self.infinite} if self.infinite else {})


def range_loss(images: Iterable[OutOfRange | None], pixels: int) -> RangeLoss | None:
    """Sum up images of `pixels` pixels each; None where nothing is out of range."""
    all_ = list(images)
    found = [image for image in all_ if image is not None]
    if not found:
        return None
    share = sum(image.pixels for image in found) / (pixels * len(all_))
    return RangeLoss(share, len(found), _farthest(found), sum(image.infinite for image in found))


def _farthest(found: Iterable[OutOfRange | RangeLoss]) -> float | None:
    return max((item.farthest_m for item in found if item.farthest_m is not None), default=None)


def scale_that_holds(farthest_m: float) -> float:
    """Return the largest scale of the series 1, 2, 5, 10, ... steps per metre at which 16 bits hold a depth."""
    decade = 10.0 ** math.floor(math.log10(UINT16_MAX / farthest_m))
    fit = (step * decade for step in (10, 5, 2, 1, 0.5) if round(farthest_m * step * decade) <= UINT16_MAX)
    return next(fit)


# --- in words ---


@dataclass(frozen=True)
class DepthRange:
    """The range of a dataset's depth images. scale_per_m: steps per metre. beyond: what becomes of depth beyond it."""

    scale_per_m: float
    beyond: Beyond

    def format_image_loss(self, image: OutOfRange, pixels: int) -> str:
        """Say what of an image of `pixels` pixels is out of range: "43.1 % of its pixels lie beyond 10 m ..."."""
        loss = RangeLoss(image.pixels / pixels, 1, image.farthest_m, image.infinite)
        return f"{_percent(loss.share)} of its pixels {self._fate(loss, 'become')}"

    def format_scene_loss(self, losses: Mapping[str, RangeLoss], frames: Mapping[str, int]) -> str:
        """Say in a sentence what of a scene is out of range: that of its worst setting.

        losses: by the setting's name, at least one. frames: how many each setting has.
        """
        worst = max(losses, key=lambda name: losses[name].share)
        loss, farthest_m = losses[worst], _farthest(losses.values())
        among = f", the most of {len(losses)} settings" if len(losses) > 1 else ""
        if farthest_m is not None and farthest_m != loss.farthest_m:
            among += f", of which one reaches {_digits(farthest_m, 4, math.ceil)} m"
        where = f"{worst} (in {loss.frames} of {frames[worst]} frames{among})"
        message = f"{_percent(loss.share)} of the pixels of {where} {self._fate(loss, 'became')}"
        return self.with_remedy(message, farthest_m)

    def with_remedy(self, problem: str, farthest_m: float | None) -> str:
        """Add to a sentence which keys keep depth as far as that, with values that do.

        farthest_m: finite; None if there is none to keep.
        """
        return Message(problem, self._remedy(farthest_m))

    def _fate(self, loss: RangeLoss, verb: str) -> str:
        reach = "infinitely far" if loss.farthest_m is None else f"as far as {_digits(loss.farthest_m, 4, math.ceil)} m"
        if loss.infinite and loss.farthest_m is not None:
            reach += ", some infinitely far"
        return f"lie beyond {_limit(self.scale_per_m)}, {reach}, and {verb} {self._becomes}"

    @property
    def _becomes(self) -> str:
        return "void" if self.beyond == "void" else _limit(self.scale_per_m)

    def _remedy(self, farthest_m: float | None) -> Remedy:
        # A scale below a step a metre is no remedy.
        ways: list[Message] = []
        if farthest_m is not None and (scale_per_m := scale_that_holds(farthest_m)) >= 1:
            held = f"{_limit(scale_per_m)} in steps of {1000 / scale_per_m:g} mm"
            ways.append(Message(PresetKey("output.depth_scale_per_m", f"{scale_per_m:g}"), f" holds {held}"))
        if self.beyond == "void":
            makes = f" makes them {_limit(self.scale_per_m)}"
            ways.append(Message(PresetKey("output.depth_beyond", "farthest"), makes))
        return either(*ways)


def _limit(scale_per_m: float) -> str:
    return f"{_digits(UINT16_MAX / scale_per_m, 3, math.floor)} m"  # what it says is held


def _digits(value: float, count: int, rounded: Callable[[float], int]) -> str:
    """Return a positive number with so many significant digits, rounded as asked for."""
    unit = 10.0 ** (math.floor(math.log10(value)) - count + 1)
    exact = round(value / unit, 6)  # 10 / 0.1 is a little less than 100
    return f"{rounded(exact) * unit:.{count}g}"


def _percent(share: float) -> str:
    percent = 100 * share
    return "less than 0.001 %" if percent < 0.001 else f"{percent:.3g} %"
