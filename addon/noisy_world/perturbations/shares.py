# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a step's effect shows, when, where and in which colours: `mix`, `mask` and `colour` of a step."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import read_sha256
from ..core.errors import InputError
from ..core.file_access import path_in
from ..core.schema import ConfigPath, describe, quoted
from ..images.image_files import check_colour, decoded_colour, read_whole
from ..images.image_header import UnfitImageError
from ..images.pixels import read_only
from .kinds import ColourPerturbation, Perturbation

MIX, MASK, COLOUR = "mix", "mask", "colour"
WHITE = (1.0, 1.0, 1.0)
IMAGES = (".png", ".jpg", ".jpeg")
MOST_KEPT = 8  # masks in memory; chosen: a few steps' own, each 3 MB at 1200 x 680


def has_share(perturbation: Perturbation) -> bool:
    """Tell whether a step of a perturbation may have `mix` and `mask`: of colour, with no parameter of these names."""
    names = perturbation.parameters.__dataclass_fields__
    return isinstance(perturbation, ColourPerturbation) and not names.keys() & {MIX, MASK}


def has_colour(perturbation: Perturbation) -> bool:
    """Tell whether a step of a perturbation may have `colour`, too."""
    own = COLOUR in perturbation.parameters.__dataclass_fields__
    return isinstance(perturbation, ColourPerturbation) and perturbation.tinted and has_share(perturbation) and not own


@dataclass(frozen=True)
class Share:
    """The share of a step's effect that shows; the rest is the image before it.

    mix: of the sequence's frames one after another, of which the last one holds, each in [0, 1]. masks: likewise, image
    files whose white shows the effect and whose black does not; () for everywhere. colour: how much of it shows in red,
    green and blue.
    """

    mix: tuple[float, ...] = (1.0,)
    masks: tuple[Path, ...] = ()
    colour: tuple[float, float, float] = WHITE

    def mix_of(self, index: int) -> float:
        """Return the mix of a frame of the sequence."""
        return self.mix[min(index, len(self.mix) - 1)]

    def mask_of(self, index: int) -> Path | None:
        """Return the mask of a frame of the sequence; None for everywhere."""
        return self.masks[min(index, len(self.masks) - 1)] if self.masks else None

    def key(self, index: int) -> tuple[float, str | None, tuple[float, ...]]:
        """Return what is equal for equal shares of two frames. Raises OSError where a mask is gone."""
        mask = self.mask_of(index)
        return self.mix_of(index), None if mask is None else sha256_of(mask), self.colour

    def note(self, index: int) -> dict[str, Any]:
        """Return a record of a frame's share, for frames.jsonl; only what is given."""
        mask = self.mask_of(index)
        mix = ({} if self.mix == WHOLE.mix else {MIX: self.mix_of(index)}) | self._coloured
        return mix if mask is None else mix | {MASK: {"name": mask.name, "sha256": sha256_of(mask)}}

    def deciding(self) -> dict[str, Any]:
        """Return it as an identity has it: a mask by its SHA-256. Raises OSError where one is gone."""
        mix = {} if self.mix == WHOLE.mix else {MIX: list(self.mix)}
        return mix | self._coloured | ({MASK: [sha256_of(mask) for mask in self.masks]} if self.masks else {})

    @property
    def _coloured(self) -> dict[str, Any]:
        return {} if self.colour == WHITE else {COLOUR: list(self.colour)}

    def at(self, index: int, size_px: tuple[int, int]) -> NDArray[np.float32] | np.float32:
        """Return what shows of the effect in a frame, in [0, 1]: one number, (H, W, 1), (3,) or (H, W, 3).

        size_px: width, height.
        """
        mask, mix = self.mask_of(index), np.float32(self.mix_of(index))
        share = mix if mask is None else read_mask(mask, size_px)[..., None] * mix
        return share if self.colour == WHITE else share * np.array(self.colour, np.float32)


WHOLE = Share()


def mixed(
    before: NDArray[np.float32], made: NDArray[np.float32], share: NDArray[np.float32] | np.float32
) -> NDArray[np.float32]:
    """Return a share of what a step made of an image, and the rest as it was; (H, W, 3)."""
    return (before * (np.float32(1) - share) + made * share).astype(np.float32, copy=False)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, which is known while the file stays. Raises OSError."""
    status = path.stat()
    return _sha256(str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4096)
def _sha256(path: str, _changed_ns: int, _size: int) -> str:
    return read_sha256(Path(path))


def read_mask(path: Path, size_px: tuple[int, int]) -> NDArray[np.float32]:
    """Return a mask (H, W) in [0, 1], at the size of a frame: width, height. Read-only.

    It is the mean of red, green and blue as the file stores them. Another size is made the frame's: by averages where
    it is larger, else linearly. Raises InputError where the file is damaged, or no image of 8 or 16 bits.
    """
    status = path.stat()
    return _mask(str(path), size_px, status.st_mtime_ns, status.st_size)


def whole_mask(path: Path) -> NDArray[np.float32]:
    """Return a mask (H, W) in [0, 1] at its own size, as `read_mask` says. Raises InputError."""
    rgb = _decoded(path)
    return np.divide(rgb.sum(axis=2, dtype=np.float32), np.float32(3 * 255 if rgb.dtype == np.uint8 else 3))


@lru_cache(maxsize=MOST_KEPT)
def _mask(name: str, size_px: tuple[int, int], _changed_ns: int, _size: int) -> NDArray[np.float32]:
    import cv2

    mask = whole_mask(Path(name))
    high, wide = mask.shape
    if (wide, high) != size_px:
        smaller = wide > size_px[0] or high > size_px[1]
        mask = cv2.resize(mask, size_px, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return read_only(np.asarray(mask, np.float32).reshape(size_px[::-1]))


def _decoded(path: Path) -> NDArray[Any]:
    header, data = read_whole(path)
    check_colour(path, header)
    try:
        return decoded_colour(header, data)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


# --- reading ---


def parse_share(values: dict[str, Any], place: ConfigPath) -> Share | None:
    """Return what a preset's step says of its share; None where it says nothing. place: of the step.

    Raises InputError naming the key.
    """
    mix = _mix(values[MIX], place.at(MIX)) if values.get(MIX) is not None else WHOLE.mix
    masks = _masks(values[MASK], place.at(MASK)) if values.get(MASK) is not None else ()
    colour = _colour(values[COLOUR], place.at(COLOUR)) if values.get(COLOUR) is not None else WHITE
    share = Share(mix, masks, colour)
    return None if share == WHOLE else share


def _mix(value: object, place: ConfigPath) -> tuple[float, ...]:
    if not isinstance(value, Sequence) or isinstance(value, (str, bytes)):
        return (_number(value, place),)
    if not value:
        raise place.error("is an empty list", "give one number, or that of each frame")
    numbers = [_number(one, place.at(k)) for k, one in enumerate(value)]
    while len(numbers) > 1 and numbers[-1] == numbers[-2]:
        numbers.pop()
    return tuple(numbers)


def _number(value: object, place: ConfigPath) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise place.error(
            f"is {describe(value)}, but has to be a number from 0 to 1, or a list with that of each frame"
        )
    if not 0 <= value <= 1:
        raise place.error(f"is {quoted(value)}, out of range", "allowed: 0 to 1")
    return float(value)


def _colour(value: object, place: ConfigPath) -> tuple[float, float, float]:
    if not isinstance(value, Sequence) or isinstance(value, (str, bytes)) or len(value) != len(WHITE):
        raise place.error(f"is {describe(value)}, but has to be red, green and blue, each from 0 to 1", "[1, 0.8, 0.6]")
    red, green, blue = (_number(one, place.at(k)) for k, one in enumerate(value))
    return red, green, blue


def _masks(value: object, place: ConfigPath) -> tuple[Path, ...]:
    """Return the files of a mask: one, or those of a folder by their names, one for each frame."""
    if not isinstance(value, str) or not value:
        raise place.error(f"is {describe(value)}, but has to be an image file, or a folder with one for each frame")
    path = path_in(place.folder, value, place).absolute()
    files = (
        tuple(sorted(each for each in path.iterdir() if each.suffix.lower() in IMAGES)) if path.is_dir() else (path,)
    )
    if not files:
        raise place.error(f"{path} holds no image", f"put one in for each frame: {', '.join(IMAGES)}")
    if not files[0].exists():
        raise place.error(f"{path} is not there", "name an image file or a folder, relative to the preset")
    for file in files:
        try:
            _decoded(file)
        except InputError as error:
            raise place.error(f"{file} {error.problem}", error.remedy) from error
    return files
