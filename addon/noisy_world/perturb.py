# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations as a library: for one image, or for the frames of a recording. No Blender is needed.

    from noisy_world.perturb import apply, frames

    foggy = apply(rgb, "fog", 3, seed=7, frame=12)
    for item in frames("Replica/room0", [{"fog": {"severity": 3}}, {"desync": {"offset": 5}}], seed=7):
        track(item.rgb, item.depth_m)

Equal seeds, names and frames give equal pixels, in any order and on any machine of one kind.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args, overload

import numpy as np
from numpy.typing import NDArray

from .core.geometry import Intrinsics
from .core.machine import keep_freed_memory
from .core.schema import ConfigPath, describe
from .images.measured_depth import Void, completed_m
from .images.pixels import GREY_WEIGHTS_PER_MILLE, as_float, grey_bytes
from .perturbations import registry
from .perturbations.execution import perturb_colour, perturb_depth, perturb_rgb, shown_share, split_motion
from .perturbations.kinds import (
    SEQUENCE_KINDS,
    SEVERITIES,
    ColourPerturbation,
    DepthPerturbation,
    FrameContext,
    alone,
    kind_name,
)
from .perturbations.parsing import drawing_by, parse_steps
from .perturbations.steps import Setting, Step

if TYPE_CHECKING:
    from .core.lens import Optics
    from .core.trajectory import Trajectory
    from .dataset.sequence import PlannedSequence
    from .sources.recording import Recording


# Checks and conversion of the arrays and numbers that callers of the library give.
#
# Each function names the argument in its errors: TypeError for what is of another kind, ValueError for values that it
# may not have.


LARGEST_SEED = 2**63 - 1  # as in presets
LARGEST_FRAME = 2**64 - 1  # what a random stream can count

_ROUNDING = 1e-6  # chosen: by how much float32 arithmetic may miss [0, 1]; it is clipped


def checked_colour(argument: str, image: Any) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return colour (H, W, 3), contiguous, as uint8 or float32 in [0, 1]. Other floating types become float32.

    Grey, (H, W) or (H, W, 1), becomes three equal channels.
    """
    _check_array(argument, image, "uint8, or float in [0, 1]")
    grey = _is_grey(image)
    if not grey and (image.ndim != 3 or image.shape[2] != 3):
        alpha = "; leave the alpha channel out" if image.ndim == 3 and image.shape[2] == 4 else ""
        wanted = f"colour has to be (H, W, 3), or grey (H, W){alpha}"
        raise TypeError(f"{argument} has the shape {image.shape}, but {wanted}")
    _check_pixels(argument, image)
    if grey:
        image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if image.dtype.kind != "f":
        remedy = "convert it to uint8, or divide by its largest value"
        raise TypeError(f"{argument} is {image.dtype}, but colour has to be uint8, or float32 in [0, 1]; {remedy}")
    pixels = _as_float32(argument, image)
    low, high = float(pixels.min()), float(pixels.max())
    if low < -_ROUNDING or high > 1.0 + _ROUNDING:
        remedy = "divide it by 255" if high <= 255 and low >= 0 and high > 2 else "clip it"
        raise ValueError(f"{argument} holds {low if low < 0 else high:.9g}, but float colour is in [0, 1]; {remedy}")
    return np.clip(pixels, 0.0, 1.0) if low < 0 or high > 1 else pixels


def checked_depth(argument: str, image: Any) -> NDArray[np.float32]:
    """Return planar depth (H, W), metres, 0 = void, contiguous, as float32; other floating types become float32."""
    _check_array(argument, image, "float32")
    if image.ndim != 2:
        raise TypeError(f"{argument} has the shape {image.shape}, but depth has to be (H, W)")
    _check_pixels(argument, image)
    if image.dtype.kind != "f":
        remedy = "divide the steps of a depth image by its steps a metre"
        raise TypeError(f"{argument} is {image.dtype}, but depth has to be float32 in metres; {remedy}")
    depth_m = _as_float32(argument, image, "; write 0 where there is no depth")
    if (lowest_m := float(depth_m.min())) < 0:
        raise ValueError(f"{argument} holds {lowest_m:g} m, but depth is 0 (void) or positive")
    return depth_m


def check_size(argument: str, image: NDArray[Any], beside: NDArray[Any]) -> None:
    """Check that an array has the height and width of the image beside it."""
    if image.shape[:2] != beside.shape[:2]:
        (high, wide), (high_beside, wide_beside) = image.shape[:2], beside.shape[:2]
        raise ValueError(f"{argument} is {wide} x {high} pixels, but the image is {wide_beside} x {high_beside}")


def check_intrinsics(intrinsics: Any, size_px: tuple[int, int] | None = None) -> None:
    """Check that these are None, or the intrinsics of images of this width and height, where one is given."""
    if intrinsics is None:
        return
    if not isinstance(intrinsics, Intrinsics):
        raise TypeError(f"intrinsics is a {type(intrinsics).__name__}, but has to be Intrinsics")
    if size_px is not None and (intrinsics.width_px, intrinsics.height_px) != size_px:
        message = f"{intrinsics.width_px} x {intrinsics.height_px}"
        raise ValueError(f"intrinsics is of {message} pixels, but the image is {size_px[0]} x {size_px[1]}")


def checked_whole_number(argument: str, value: Any, largest: int) -> int:
    """Return a number from 0 to `largest`, of Python's type."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a whole number")
    if not 0 <= value <= largest:
        raise ValueError(f"{argument} is {describe(int(value))}, but has to be from 0 to {largest}")
    return int(value)


def checked_rate(argument: str, value: Any) -> float | None:
    """Return a number above 0, such as a rate in hertz, or None."""
    rate = checked_number(argument, value)
    if rate is not None and rate <= 0:
        raise ValueError(f"{argument} is {describe(value)}, but has to be above 0")
    return rate


def checked_number(argument: str, value: Any) -> float | None:
    """Return a finite number, or None."""
    if value is None:
        return None
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a number")
    if not abs(value) <= float(np.finfo(np.float64).max) or not math.isfinite(value):
        raise ValueError(f"{argument} is {describe(value)}, but has to be finite")
    return float(value)


def checked_text(argument: str, value: Any) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a text")
    return value


def plain(value: Any) -> Any:
    """Return numpy's numbers and arrays, also inside mappings and lists, as Python's: what a preset may hold."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [plain(item) for item in value]
    return value


def _is_grey(image: NDArray[Any]) -> bool:
    return image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1)


def _as_grey(rgb: NDArray[Any], shape: tuple[int, ...], *, grain: bool) -> NDArray[Any]:
    """Return colour (H, W, 3) as grey of a shape: its luminance or, with noise of each pixel's own, one channel."""
    if grain:
        grey = rgb[..., 1]
    elif rgb.dtype == np.uint8:
        grey = grey_bytes(rgb)
    else:
        grey = rgb @ (np.array(GREY_WEIGHTS_PER_MILLE, rgb.dtype) / rgb.dtype.type(1000))
    return np.ascontiguousarray(grey).reshape(shape)


def _check_array(argument: str, image: Any, wanted: str) -> None:
    if image is None:
        raise TypeError(
            f"{argument} is None, as cv2.imread gives where there is no image; it has to be an array, {wanted}"
        )
    if not isinstance(image, np.ndarray):
        raise TypeError(f"{argument} is {describe(image)}, but has to be a numpy array, {wanted}")
    if isinstance(image, np.ma.MaskedArray):
        raise TypeError(f"{argument} is a masked array, whose mask would be lost; fill it")


def _check_pixels(argument: str, image: NDArray[Any]) -> None:
    if not image.size:
        raise ValueError(f"{argument} has the shape {image.shape}, which has no pixels")


def _as_float32(argument: str, image: NDArray[Any], remedy: str = "") -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        made = np.ascontiguousarray(image, dtype=np.float32)
    finite = np.isfinite(made)
    if not finite.all():
        row, column = (int(index[0]) for index in np.nonzero(~finite)[:2])
        raise ValueError(f"{argument} holds {image[row, column].max():g} at row {row}, column {column}{remedy}")
    return made


__all__ = ["PerturbedFrame", "apply", "corrupt", "frames", "get_corruption_names", "names"]

NamesOf: TypeAlias = Literal["image", "motion", "exposure", "colour", "depth", "pairing", "all"]
"""What `names` lists: those of one kind, of all kinds, or those that need nothing but a colour image."""


def __dir__() -> list[str]:
    return __all__


def names(kind: NamesOf = "image") -> list[str]:
    """Return the names of perturbations, those of installed packages too, in propagation order.

    kind: "image", those that `apply` makes of a colour image and nothing else; "colour", these and those that look at
    its depth too; "depth", "motion", "exposure" or "pairing"; "all".

    >>> from noisy_world.perturb import names
    >>> "fog" in names(), "fog_depth" in names(), "fog_depth" in names("colour"), "desync" in names("all")
    (True, False, True, True)

    Raises ValueError for another kind, InputError where an installed package brings what cannot be loaded.
    """
    if kind not in get_args(NamesOf):
        raise ValueError(f"kind is {describe(kind)}, but has to be one of {', '.join(get_args(NamesOf))}")
    if kind == "all":
        return list(registry())
    if kind != "image":
        return [name for name, item in registry().items() if kind_name(item) == kind]
    return [name for name, item in registry().items() if isinstance(item, ColourPerturbation) and not item.needs_depth]


# imagecorruptions' names of ImageNet-C, in its order; the last four are ImageNet-C's own for validation.
_CORRUPTIONS = (
    *("gaussian_noise", "shot_noise", "impulse_noise", "defocus_blur", "glass_blur", "motion_blur", "zoom_blur"),
    *("snow", "frost", "fog", "brightness", "contrast", "elastic_transform", "pixelate", "jpeg_compression"),
    *("speckle_noise", "gaussian_blur", "spatter", "saturate"),
)
_SUBSETS = {
    "common": slice(15),
    "validation": slice(15, None),
    "all": slice(None),
    "noise": slice(3),
    "blur": slice(3, 7),
    "weather": slice(7, 11),
    "digital": slice(11, 15),
}


def get_corruption_names(subset: str = "common") -> list[str]:
    """Return names of ImageNet-C's corruptions as imagecorruptions does.

    subset: "common", the 15 of ImageNet-C; "validation", its other four; "all"; or "noise", "blur", "weather" or
    "digital". Raises ValueError for another.

    >>> from noisy_world.perturb import get_corruption_names
    >>> get_corruption_names("blur")
    ['defocus_blur', 'glass_blur', 'motion_blur', 'zoom_blur']
    """
    if subset not in _SUBSETS:
        raise ValueError(f"subset is {describe(subset)}, but has to be one of {', '.join(_SUBSETS)}")
    return list(_CORRUPTIONS[_SUBSETS[subset]])


def corrupt(
    image: NDArray[np.uint8],
    severity: int = 1,
    corruption_name: str | None = None,
    corruption_number: int = -1,
    *,
    seed: int | None = None,
) -> NDArray[np.uint8]:
    """Corrupt an image by `apply`, for those who come from imagecorruptions: its signature and its names.

    image: (H, W, 3), (H, W) or (H, W, 1) uint8; the result has the same shape. severity: 1 to 5. corruption_name: as
    `get_corruption_names` lists them; or corruption_number, the place in its subset "all". seed: decides what is
    random; None draws one from numpy's global generator, so that `numpy.random.seed` decides it as there.

    Raises ValueError where neither name nor number is given, or there is none of it, and as `apply` does.
    """
    if corruption_name is None:
        if not 0 <= corruption_number < len(_CORRUPTIONS):
            places = f"a corruption_number from 0 to {len(_CORRUPTIONS) - 1}"
            raise ValueError(f"give a corruption_name, or {places}, not {describe(corruption_number)}")
        corruption_name = _CORRUPTIONS[corruption_number]
    elif corruption_name not in _CORRUPTIONS:
        raise ValueError(f"corruption_name is {describe(corruption_name)}; there are {', '.join(_CORRUPTIONS)}")
    if getattr(image, "dtype", None) != np.uint8:
        raise TypeError(f"image is {getattr(image, 'dtype', type(image).__name__)}, but has to be a uint8 array")
    if severity not in SEVERITIES:
        raise ValueError(f"severity is {describe(severity)}, but has to be a whole number from 1 to 5")
    if seed is None:
        seed = int(np.random.randint(2**31))  # noqa: NPY002 - what numpy.random.seed decides
    return apply(image, corruption_name, severity, seed=seed)


@overload
def apply(
    image: NDArray[np.uint8],
    name: str,
    severity: float | None = None,
    *,
    seed: int = 0,
    frame: int = 0,
    depth_m: NDArray[np.floating] | None = None,
    rgb: NDArray[Any] | None = None,
    intrinsics: Intrinsics | None = None,
    stamp_s: float | None = None,
    void: Void = "unmeasured",
    **values: Any,
) -> NDArray[np.uint8]: ...


@overload
def apply(
    image: NDArray[np.floating],
    name: str,
    severity: float | None = None,
    *,
    seed: int = 0,
    frame: int = 0,
    depth_m: NDArray[np.floating] | None = None,
    rgb: NDArray[Any] | None = None,
    intrinsics: Intrinsics | None = None,
    stamp_s: float | None = None,
    void: Void = "unmeasured",
    **values: Any,
) -> NDArray[np.float32]: ...


def apply(
    image: NDArray[Any],
    name: str,
    severity: float | None = None,
    *,
    seed: int = 0,
    frame: int = 0,
    depth_m: NDArray[np.floating] | None = None,
    rgb: NDArray[Any] | None = None,
    intrinsics: Intrinsics | None = None,
    stamp_s: float | None = None,
    void: Void = "unmeasured",
    **values: Any,
) -> NDArray[Any]:
    """Perturb one colour or depth image; the input is not changed.

    image: (H, W, 3) RGB, sRGB-encoded, uint8 or float in [0, 1], for a perturbation of colour; (H, W) float planar
    depth in metres, 0 = void, for one of depth. The result has the same shape; it is uint8 for uint8, and float32 for
    any floating type, which is converted first. Grey (H, W) or (H, W, 1) is perturbed as three equal channels; what
    comes back is their luminance or, of noise that each pixel has of its own, one of them.
    name: of the perturbation, such as "fog"; `names` lists them. severity: 0, or 1 to 5.
    seed, frame: decide the random stream; equal ones give equal pixels. seed is from 0 to 2^63 - 1, frame from 0 to
    2^64 - 1.
    depth_m: (H, W) float planar depth, 0 = void, for the perturbations of colour that depend on it. rgb: (H, W, 3) as
    an image of colour, for the perturbations of depth that depend on it. intrinsics, stamp_s: of the image, for
    perturbations that ask for them; stamp_s in seconds.
    void: what 0 means in depth_m: "unmeasured", as of a sensor, counts as far as what was measured around it;
    "sky", as of a renderer, is infinitely far.
    values: as in a preset: mode, levels, temporal, or single parameters.

    From the first call on, the process keeps freed memory for the next images, where its C library is glibc.

        >>> import numpy as np
        >>> from noisy_world.perturb import apply
        >>> grey = np.full((4, 6, 3), 128, np.uint8)
        >>> noisy = apply(grey, "gaussian_noise", 3, seed=7)
        >>> noisy.shape, noisy.dtype == np.uint8, (noisy != grey).any().item()
        ((4, 6, 3), True, True)
        >>> bool((apply(grey, "gaussian_noise", 3, seed=7) == noisy).all())  # the same seed, the same pixels
        True

    Raises InputError for a name or a value that does not exist; TypeError for an argument of another kind, such as
    depth in whole numbers or colour with an alpha channel; ValueError for values that it may not hold: colour outside
    [0, 1], negative depth, NaN and infinities, an image without pixels, sizes that differ, depth without any pixel
    that was measured.
    """
    keep_freed_memory()
    name = checked_text("name", name)
    void = _checked_void(void)
    place = ConfigPath("apply")
    values = values if severity is None else {"severity": severity, **values}
    (step,) = parse_steps([{name: plain(values)}], place, registry())
    if isinstance(step.perturbation, SEQUENCE_KINDS):
        raise TypeError(f"{name} acts on a whole sequence, not on an image")
    of_depth = isinstance(step.perturbation, DepthPerturbation)
    pixels = checked_depth("image", image) if of_depth else checked_colour("image", image)
    depth_m = None if depth_m is None else checked_depth("depth_m", depth_m)
    rgb = None if rgb is None else checked_colour("rgb", rgb)
    for argument, beside in (("depth_m", depth_m), ("rgb", rgb)):
        if beside is not None:
            check_size(argument, beside, pixels)
    check_intrinsics(intrinsics, (pixels.shape[1], pixels.shape[0]))
    where = FrameContext(
        checked_whole_number("frame", frame, LARGEST_FRAME),
        (checked_whole_number("seed", seed, LARGEST_SEED), "", ""),
        stamp_s=checked_number("stamp_s", stamp_s),
        intrinsics=intrinsics,
        read_rgb=None if rgb is None else lambda: as_float(rgb),
        read_depth_m=None if depth_m is None else cache(partial(_seen_depth_m, depth_m, void)),
        read_earlier=None if of_depth else alone(pixels),
    )
    made = _perturbed(step, pixels, where)
    if isinstance(step.perturbation, ColourPerturbation) and _is_grey(image):
        return _as_grey(made, image.shape, grain=step.perturbation.grain)
    return made.copy() if made is pixels else made


def _checked_void(void: Void) -> Void:
    if void not in get_args(Void):
        raise ValueError(f"void is {describe(void)}, but has to be {' or '.join(map(repr, get_args(Void)))}")
    return void


def _seen_depth_m(depth_m: NDArray[np.float32], void: Void) -> NDArray[np.float32]:
    """Return depth as perturbations of colour look at it. Raises ValueError where nothing was measured."""
    if void == "sky":
        return depth_m
    if not depth_m.any():
        raise ValueError("depth_m has no pixel that was measured; void='sky' takes it to be infinitely far")
    return completed_m(depth_m)


def _perturbed(step: Step[Any], image: NDArray[Any], where: FrameContext) -> NDArray[Any]:
    """Return the image, of the same type, after a step of colour or depth; itself where the step does nothing."""
    if isinstance(step.perturbation, DepthPerturbation):
        made_m, _ = perturb_depth([step], image, where)
        return image if made_m is None else made_m
    if image.dtype == np.uint8:
        pixels, _ = perturb_rgb([step], image, where)
        return image if pixels is None else pixels
    context = step.context(where)
    severity = step.severity_of(context)
    if severity == 0:
        return image
    made = shown_share(step, image, perturb_colour(step, image, severity, context), context, bright=False)
    return np.clip(made, 0.0, 1.0)


@dataclass(frozen=True, repr=False)
class PerturbedFrame:
    """A frame of a perturbed sequence.

    index: its number there. stamp_s: its time stamp, seconds. c2w: (4, 4) float64 camera-to-world of its colour, OpenCV
    axes, metres. rgb: (H, W, 3) uint8, RGB. depth_m: (H, W) float32 planar depth in metres, 0 = void; None of a
    recording without depth.
    """

    index: int
    stamp_s: float
    c2w: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32] | None

    def __repr__(self) -> str:
        size = "{1} x {0}".format(*self.rgb.shape)
        return f"<PerturbedFrame {self.index} at {self.stamp_s:.6f} s, {size}>"


def frames(
    folder: str | Path,
    perturb: Sequence[Mapping[str, Any]],
    *,
    seed: int = 0,
    setting: str = "setting",
    stream: str | None = None,
    scene: str | None = None,
    intrinsics: Intrinsics | None = None,
    rate_hz: float | None = None,
    depth_scale_per_m: float | None = None,
    void: Void = "unmeasured",
) -> Iterator[PerturbedFrame]:
    """Perturb a sequence in any layout, frame by frame, without writing anything.

    perturb: as in a preset, such as [{"fog": {"severity": 3}}]. seed, setting, scene (default: the folder's name):
    decide the random streams; a preset with equal ones makes equal pixels. stream: the name under which colour and
    depth draw random patterns, if not the setting's. intrinsics: of the sequence's camera, for perturbations that ask
    for them; default: what its files say, if they do. rate_hz: of a sequence that has no time
    stamps; default 20. depth_scale_per_m: steps a metre of depth images, where it is not what files and layout say.
    void: what depth 0 means to perturbations of colour, as `apply` says; a frame that measured nothing counts as far as
    the nearest frame that did. Warns of images without a partner, which are left out, and of what files say otherwise.

    Raises, when it is called, InputError for a folder that holds no sequence, for values that a preset could not have,
    and for intrinsics or a rate that the sequence's own files contradict; TypeError and ValueError for other arguments
    that are not as described.
    """
    from .core.frame_request import SensorPaths
    from .dataset.sequence import lay_out, written_paths  # an image needs none of these
    from .sources.recording import read_recording

    seed = checked_whole_number("seed", seed, LARGEST_SEED)
    setting = checked_text("setting", setting)
    name = Path(folder).name if scene is None else checked_text("scene", scene)
    if isinstance(perturb, (str, bytes)) or not isinstance(perturb, Sequence):
        raise TypeError(f"perturb is {describe(perturb)}, but has to be a list, such as [{{'fog': {{'severity': 3}}}}]")
    check_intrinsics(intrinsics)
    void = _checked_void(void)
    recording = read_recording(
        *(Path(folder), ConfigPath("frames"), checked_rate("rate_hz", rate_hz)),
        depth_scale_per_m=checked_rate("depth_scale_per_m", depth_scale_per_m),
        void=void,
    )
    stored = recording.stored
    for note in (*stored.notes, *stored.image_notes):
        warnings.warn(f"{folder}: {note}", stacklevel=2)
    check_intrinsics(intrinsics, stored.size_px)
    known = stored.known_camera if intrinsics is None else recording.camera(intrinsics)
    stream = None if stream is None else checked_text("stream", stream)
    steps = parse_steps(plain(perturb), ConfigPath("frames"), registry())
    whole = Setting(setting, drawing_by(steps, setting, stream, ConfigPath("frames").at("stream")))
    moving = (*split_motion(whole.motion, exposed=bool(whole.exposure))[0], *whole.exposure)
    if moving:
        motion = moving[-1].perturbation.name
        raise ConfigPath("frames").error(f"{motion} needs a mesh: a sequence cannot be seen from elsewhere")
    if not stored.depth_files and (whole.needs_depth or whole.depth or whole.pairing):
        problem = f"{setting} needs depth, and {folder} has none"
        raise ConfigPath("frames").error(problem, "leave out what needs depth")
    optics = stored.optics if known is None else recording.optics(known)
    if optics.depth is not None and known is None:
        raise ConfigPath("frames").error(f"depth of {folder} has a camera of its own", "give intrinsics")
    sequence = lay_out(whole, name, len(stored.trajectory), (seed, name, setting))
    path = written_paths(sequence, SensorPaths(stored.trajectory)).rgb
    return _perturbed_frames(recording, sequence, path, known, optics)


def _perturbed_frames(
    recording: "Recording",
    sequence: "PlannedSequence",
    path: "Trajectory",
    known: Intrinsics | None,
    optics: "Optics",
) -> Iterator[PerturbedFrame]:
    """Perturb the frames of a sequence. path: of the colour camera, a pose for each frame. known: its intrinsics.

    optics: what its cameras have beyond one pinhole.
    """
    from .dataset.frame import Camera, CleanFrame, CleanFrames, EarlierFrames, PlannedFrame
    from .images.measured_depth import Registration
    from .render.source import light_seen
    from .sources.recording import RecordedFrame

    stored, unmeasured_m = recording.stored, recording.capabilities.unmeasured_m
    seen = optics.depth
    stamps_s = stored.stamps.rgb.seconds
    earlier = EarlierFrames(stamps_s, lambda source: light_seen(RecordedFrame(stored.frame(source))))
    colour = Camera(known, stamps_s, stored.trajectory, earlier)
    depth = Camera(known if seen is None else seen.intrinsics, stored.stamps.depth.seconds)
    between = None if seen is None or known is None else Registration(known, seen, optics.distortion)
    keep_freed_memory()

    def clean(source: int) -> CleanFrame:
        return CleanFrame(source, RecordedFrame(stored.frame(source)), between, unmeasured_m=unmeasured_m)

    clean_frames = CleanFrames(colour, depth, clean)
    for index in sequence.frames:
        made = PlannedFrame(sequence, index, clean_frames)
        depth_m = made.depth_m if stored.depth_files else None
        yield PerturbedFrame(index, float(path.stamps_s[index]), path.c2w[index], made.rgb, depth_m)
