# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles, EEVEE and Workbench: set up for unlit colours and planar depth, and rendered into float arrays."""

import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels.channel import Fact, Surface
from ..core.errors import Message, MissingDependencyError, PresetKey, StorageError, either
from ..core.file_access import ScratchFolder, utf8_name
from ..core.frame_request import Shutter
from ..core.lens import Bending
from ..core.srgb import exact_colours
from ..nodes.datablocks import camera_of, muted_output, override_scene, write_plain_floats
from ..nodes.datablocks import cycles as cycles_of
from .source import RenderedFrame

EngineName: TypeAlias = Literal["cycles", "eevee", "workbench"]
Device: TypeAlias = Literal["cpu", "gpu"]

GPU_KINDS = ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI")  # OptiX before CUDA: both drive the same cards, OptiX faster

AVERAGING_FILTER_PX = 1.5  # Blender's default
CENTRE_FILTER_PX = 0.01  # the smallest width that Blender allows
# Z is that of a pixel's first sample, which goes through the middle of the filter. Cycles looks the middle up in a
# table of 1024 entries that is symmetric about entry 511, not 511.5, so it is half a step off, to the right and up. In
# units of half the filter's width (which is the width set), a step there is the integral of the Blackman-Harris filter,
# its coefficient a0 = 0.35875, divided by 511. With the averaging filter that is 5e-4 px, and depth along a wall would
# be wrong by up to 1e-4 of itself.
FILTER_MIDDLE = 0.5 * 0.35875 / 511


@dataclass(frozen=True)
class Engine:
    """What differs between engines. Properties are those of a scene, by their paths from it.

    blender_name: what Blender calls it. plain: properties by which it shows unlit colours and nothing else. filtered:
    gives those of its pixel filter for a number of samples. samples: the property with the samples per pixel of the
    next render, which can be changed at no cost. counted: gives its value.
    shades: whether the material's nodes are evaluated; Workbench shows the colour attribute itself.
    centre_depth: whether depth is that of the pixel's centre at any number of samples; if not, it is rendered
    separately, with one sample.
    blurs_textures: whether it shows more of a texture than the four texels around a point.
    sample_offset_px: how far to the right of and above a pixel's centre its first sample is.
    """

    blender_name: str
    plain: Mapping[str, Any]
    filtered: Callable[[int], Mapping[str, Any]]
    samples: str
    counted: Callable[[int], Any] = int
    shades: bool = True
    centre_depth: bool = False
    blurs_textures: bool = False
    sample_offset_px: Callable[[int], float] = lambda _samples: 0.0

    def set_samples(self, scene: bpy.types.Scene, samples: int) -> None:
        """Set the samples per pixel of the next render."""
        set_properties(scene, {self.samples: self.counted(samples)})


def set_properties(scene: bpy.types.Scene, values: Mapping[str, Any]) -> None:
    """Set properties of a scene by their paths from it, such as "render.use_border"."""
    for path, value in values.items():
        owner, _, name = path.rpartition(".")
        setattr(scene.path_resolve(owner) if owner else scene, name, value)


# Rays of a camera end where they first meet something; the pattern of samples is fixed.
PLAIN_CYCLES: Mapping[str, Any] = {
    "cycles.use_adaptive_sampling": False,
    "cycles.use_denoising": False,
    "cycles.use_auto_tile": False,
    "cycles.use_light_tree": False,
    "cycles.max_bounces": 0,
    "cycles.sampling_pattern": "TABULATED_SOBOL",
    "cycles.pixel_filter_type": "BLACKMAN_HARRIS",
}
_PLAIN: Mapping[str, Any] = {
    "render.use_persistent_data": True,
    "render.use_compositing": False,
    "render.use_sequencer": False,
    "render.use_motion_blur": False,
    "render.use_simplify": False,
    "render.film_transparent": False,
}
_SHADING = "display.shading"
_UNSHADED = ("backface_culling", "cavity", "object_outline", "shadows", "specular_highlight", "xray")


def filter_width_px(samples: int) -> float:
    """Return the width of Cycles' pixel filter: the least for a single sample, which shows the pixel's centre."""
    return CENTRE_FILTER_PX if samples == 1 else AVERAGING_FILTER_PX


ENGINES: dict[EngineName, Engine] = {
    "cycles": Engine(
        "CYCLES",
        PLAIN_CYCLES
        | {
            "cycles.device": "CPU",
            "cycles.use_animated_seed": True,
            "cycles.transparent_max_bounces": 0,
            "cycles.film_exposure": 1.0,
        },
        filtered=lambda samples: {"cycles.filter_width": filter_width_px(samples)},
        samples="cycles.samples",
        centre_depth=True,
        sample_offset_px=lambda samples: FILTER_MIDDLE * filter_width_px(samples),
    ),
    "eevee": Engine(
        "BLENDER_EEVEE",
        {f"eevee.use_{name}": False for name in ("shadows", "raytracing", "fast_gi", "overscan")},
        filtered=lambda samples: {"render.filter_size": AVERAGING_FILTER_PX if samples > 1 else 0.0},
        samples="eevee.taa_render_samples",
        blurs_textures=True,
    ),
    "workbench": Engine(
        "BLENDER_WORKBENCH",
        {f"{_SHADING}.show_{name}": False for name in _UNSHADED}
        | {f"{_SHADING}.light": "FLAT", f"{_SHADING}.color_type": "VERTEX", f"{_SHADING}.use_dof": False},
        filtered=lambda _samples: {},
        samples="display.render_aa",
        counted=lambda samples: "OFF" if samples == 1 else str(samples),  # which there are the preset has checked
        shades=False,
    ),
}
NAMES_IN_BLENDER: dict[str, EngineName] = {engine.blender_name: name for name, engine in ENGINES.items()}
"""Our names of the engines, by Blender's."""


def configure(
    scene: bpy.types.Scene, engine: Engine, *, seed: int, samples: int, threads: int, device: Device = "cpu"
) -> None:
    """Set a scene up for an engine. samples: rays per pixel, for colour. threads: 0 for all.

    Raises MissingDependencyError where a GPU is asked for and none is found.
    """
    # Without a world the background is black, which is the colour of void.
    set_properties(scene, {"render.engine": engine.blender_name, **_PLAIN, "world": None, "cycles.seed": seed})
    set_properties(scene, {**engine.plain, **engine.filtered(samples), **for_threads(threads)})
    if device == "gpu":
        enable_gpu()
        cycles_of(scene).device = "GPU"


def for_threads(count: int) -> dict[str, Any]:
    """Return the properties of a scene that is rendered with so many threads; 0 for all."""
    fixed = {"render.threads": count} if count else {}
    return {"render.threads_mode": "FIXED" if count else "AUTO", **fixed}


def show_textures(scene: bpy.types.Scene) -> None:
    """Make Workbench show textures, in place of the colour attribute; the other engines show what materials say."""
    set_properties(scene, {f"{_SHADING}.color_type": "TEXTURE"})


def enable_gpu() -> str:
    """Make Cycles use all graphics cards of the first of GPU_KINDS that is found, and nothing else.

    Returns the kind and the cards' names. Raises MissingDependencyError where none is found.
    """
    preferences = bpy.context.preferences.addons["cycles"].preferences
    built_in = {kind for kind, *_ in preferences.get_device_types(bpy.context)}
    for kind in filter(built_in.__contains__, GPU_KINDS):
        with muted_output():  # Blender prints many lines on drivers that it does not find
            cards = [card for card in preferences.get_devices_for_type(kind) if card.type == kind]
        if cards:
            preferences.compute_device_type = kind
            for device in preferences.devices:
                device.use = device.type == kind
            return f"{kind} {', '.join(card.name for card in cards)}"
    raise MissingDependencyError(
        f"render.device is gpu, but Cycles finds no graphics card here (it looked for "
        f"{', '.join(kind for kind in GPU_KINDS if kind in built_in) or 'nothing, as it is built without'}); "
        "use render.device: cpu, or install the card's driver"
    )


# Testing whether GL works here, in another process: where it does not, Blender may end without a message.


MARK = "@gl "
TIMEOUT_S = 180  # chosen: far longer than software GL takes to start
ASK = f"""
import bpy, gpu, json
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
scene = bpy.context.scene
scene.render.engine = "BLENDER_WORKBENCH"
scene.render.resolution_x = scene.render.resolution_y = 4
scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(scene.camera)
bpy.ops.render.render()
told = gpu.platform.renderer_get(), gpu.platform.version_get(), gpu.platform.device_type_get()
print({MARK!r} + json.dumps(told))
"""


def gl_version() -> str:
    """Render a few pixels with GL in another process; return GL's renderer and version.

    Raises MissingDependencyError, which names Debian's packages, where that fails.
    """
    other = Message("use ", PresetKey("render.engine", "cycles"), ", which needs none")
    renderer, version, _ = _gl_here("EEVEE and Workbench need", other)
    return f"{renderer}, {version}"


def compositor_card() -> str:
    """Return the graphics card that the compositor would run on, and its driver's version.

    Raises MissingDependencyError where there is none; one in software does not count.
    """
    other = Message("use ", PresetKey("render.compositor_device", "cpu"))
    renderer, version, kind = _gl_here("a compositor on a graphics card needs", other)
    if kind == "SOFTWARE":
        problem = f"render.compositor_device is gpu, but there is no graphics card here: {renderer} is software"
        raise MissingDependencyError(problem, remedy=either(other, "install the card's driver"))
    return f"{renderer}, {version}"


def _gl_here(asking: str, other: Message) -> tuple[str, str, str]:
    """Return GL's renderer, version and kind of device. asking, other: the error's beginning and another remedy."""
    command = [bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", ASK]
    if not bpy.app.binary_path:
        command = [sys.executable, "-c", ASK]
    try:
        asked = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)  # noqa: S603
        answer = [line for line in asked.stdout.splitlines() if line.startswith(MARK)]
        problem = "" if asked.returncode == 0 else f"Blender ended with status {asked.returncode}"
    except subprocess.TimeoutExpired:
        answer, problem = [], f"no answer within {TIMEOUT_S} s"
    if problem or not answer:
        packages = "libegl1 libgl1 libgl1-mesa-dri"
        message = f"{asking} OpenGL, which fails here ({problem or 'it told nothing'})"
        raise MissingDependencyError(message, remedy=either(f"run: apt-get install {packages}", other))
    renderer, version, kind = json.loads(answer[0].removeprefix(MARK))
    return renderer, version, kind


# Lines of a frame that are read one after another: each band of them is rendered at its own moment, by a border.


BANDS_PER_PX = 32.0  # of what moves most while the image is read: a line is at most 1/64 px off; chosen


@dataclass(frozen=True)
class Band:
    """Lines of an image (height, width) that see the same moment. after_s: the moment, after the frame's time stamp."""

    rows: slice
    columns: slice
    after_s: float


def bands_of(readout: Shutter, size_px: tuple[int, int], travel_px: float) -> list[Band]:
    """Return the bands of an image that is read, in the image's order. size_px: width, height.

    travel_px: how far anything goes on the image meanwhile, at most; it decides how many bands there are.
    """
    width, height = size_px
    upright = readout.direction in ("right", "left")
    count = width if upright else height
    times_s = readout.line_times_s(count)
    number = min(count, max(1, math.ceil(travel_px * BANDS_PER_PX)))
    bands = []
    for part in np.array_split(np.arange(count), number):
        lines, after_s = slice(int(part[0]), int(part[-1]) + 1), float(times_s[part].mean())
        bands.append(Band(slice(0, height), lines, after_s) if upright else Band(lines, slice(0, width), after_s))
    return bands


def whole(size_px: tuple[int, int]) -> Band:
    """Return all of an image, at the frame's time stamp. size_px: width, height."""
    return Band(slice(0, size_px[1]), slice(0, size_px[0]), 0.0)


def behind_lens(band: Band, bending: Bending | None) -> tuple[Band, Bending | None]:
    """Return what is rendered of a pinhole for a band behind a lens, and what bends it; the band itself without one."""
    if bending is None:
        return band, None
    rows, columns, part = bending.part(band.rows, band.columns)
    return replace(band, rows=rows, columns=columns), part


def joined(
    bands: Sequence[Band], size_px: tuple[int, int], passes_of: Callable[[Band], dict[str, NDArray[np.float32]]]
) -> dict[str, NDArray[np.float32]]:
    """Return the passes (H, W) of a frame. passes_of: gives those of a band's lines, by name."""
    found: dict[str, NDArray[np.float32]] = {}
    for band in bands:
        for name, pixels in passes_of(band).items():
            image = found.setdefault(name, np.empty((size_px[1], size_px[0]), np.float32))
            image[band.rows, band.columns] = pixels
    return found


@contextmanager
def bordered(scene: bpy.types.Scene, size_px: tuple[int, int], band: Band | None) -> Iterator[tuple[slice, slice]]:
    """Let the scene render a band alone; give what of the rendered image is asked for. None: the whole image.

    size_px: width, height of the frame, at the left top of the scene's image.
    """
    if band is None:
        yield slice(size_px[1]), slice(size_px[0])
        return
    render = scene.render
    # A quarter of a pixel beyond the pixels' edges, so that however it is rounded no neighbour is taken.
    left, right = ((at + 0.25) / render.resolution_x for at in (band.columns.start, band.columns.stop))
    top, bottom = ((render.resolution_y - at + 0.25) / render.resolution_y for at in (band.rows.start, band.rows.stop))
    render.border_min_x, render.border_max_x = left, right
    render.border_min_y, render.border_max_y = bottom, top
    render.use_border = render.use_crop_to_border = True
    try:
        yield slice(None), slice(None)
    finally:
        render.use_border = False


# Rendering frames in Blender into float arrays: colour and planar depth, each only if asked for.


FAR_PLANE_TOLERANCE = 1e-4  # of the far plane's distance; chosen: a z-buffer rounds depths next to it by less
EXR_BYTES_PER_PIXEL = 20  # five channels of float32
BYTES_PER_PIXEL = 36  # nine channels, as where a denoiser keeps what it was given
SURFACE_BYTES_PER_PIXEL = 28  # seven more: a normal, and a face with its alpha
FACE_OUTPUT = "Noisy World face"
FACE_ATTRIBUTE = "noisy_world_face"
FACE_STEP = 4096  # a face's number is told in two parts below this, which float32 holds exactly; chosen


@dataclass(frozen=True)
class FrameAndSurface(RenderedFrame):
    """What a render gives. world: of the surface, where it is asked for; normals in the scene's axes."""

    world: Surface | None = None


class RenderFile:
    """The scratch file, in memory, that a scene is rendered into.

    In background mode Python cannot read a render result, but it can read an uncompressed float EXR, in 7 ms.
    """

    def __init__(
        self, scene: bpy.types.Scene, size_px: tuple[int, int], bytes_per_pixel: int = BYTES_PER_PIXEL
    ) -> None:
        """Prepare the scene. size_px: width, height of the frames, which stand at the left top of the image."""
        self._scene = scene
        self.size_px = size_px
        self.keep_all = False  # whether `last` is told after each render
        self.last: tuple[dict[str, NDArray[np.float32]], dict[str, str]] = {}, {}
        """All channels (H, W) of the last frame by their whole names, and the texts of its header."""
        self._scratch = ScratchFolder(bytes_per_pixel * size_px[0] * size_px[1])
        self.folder = self._scratch.path
        self._path = self.folder / "frame.exr"
        render = scene.render
        render.filepath = utf8_name(self._path)
        render.use_file_extension = False
        render.use_overwrite = True
        render.use_placeholder = False
        write_plain_floats(render.image_settings)

    def render(
        self, layer: str, size_px: tuple[int, int] | None = None, *, band: Band | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Render the scene as it is, and return a layer's channels (H, W) by pass and channel, such as "Depth.Z".

        size_px: width, height of this frame, where they are not those that were given. band: the lines of it that are
        rendered and returned; None for all.
        Raises StorageError where the scratch file could not be written, for instance on a full disk.
        """
        import OpenEXR  # needed only for rendering

        self._path.unlink(missing_ok=True)
        problem, crop = "", (slice(0), slice(0))
        try:
            with (
                bordered(self._scene, size_px or self.size_px, band) as crop,
                muted_output(),
                override_scene(self._scene),
            ):
                bpy.ops.render.render(write_still=True)
        except RuntimeError as error:  # Blender reports in this way that it could not write
            problem = str(error).strip().splitlines()[-1]
        if problem or not self._path.exists():
            raise StorageError(
                f"Blender could not write its scratch file: {problem or 'no file came'}", file=self._path
            )
        with OpenEXR.File(utf8_name(self._path), separate_channels=True) as file:
            named = {tuple(name.rsplit(".", 2)): item.pixels[crop] for name, item in file.channels().items()}
            if self.keep_all:
                texts = {name: value for name, value in file.header().items() if isinstance(value, str)}
                self.last = {".".join(name): pixels for name, pixels in named.items()}, texts
        return {".".join(name[1:]): pixels for name, pixels in named.items() if name[0] == layer}

    def close(self) -> None:
        """Remove the scratch file."""
        self._scratch.remove()


class FrameRenderer:
    """Renders a scene into arrays.

    Passes and camera are set once: setting them, even to equal values, makes Cycles load the whole scene again, which
    takes as long as a frame. Moving the camera and changing the number of samples cost nothing.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        size_px: tuple[int, int],
        *,
        rgb: bool,
        depth: bool,
        encoded_colours: bool,
        facts: frozenset[Fact] = frozenset(),
    ) -> None:
        """Prepare the scene.

        size_px: width, height. rgb, depth: what is rendered. encoded_colours: the scene shows display-encoded values.
        facts: what is told of the surface, with Cycles; for faces their materials have to say it (`tell_faces`).
        """
        self._scene = scene
        self._rgb = rgb
        self._depth = depth
        self._encoded_colours = encoded_colours
        self._facts = facts
        bytes_per_pixel = EXR_BYTES_PER_PIXEL + (SURFACE_BYTES_PER_PIXEL if facts else 0)
        self._file = RenderFile(scene, size_px, bytes_per_pixel)
        layer = scene.view_layers[0]
        layer.use_pass_combined = rgb
        layer.use_pass_z = depth
        layer.use_pass_normal = "normals" in facts
        if "faces" in facts:
            face = layer.aovs.add()
            face.name, face.type = FACE_OUTPUT, "COLOR"
        self._layer = layer.name

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()

    def render(self, size_px: tuple[int, int] | None = None) -> FrameAndSurface:
        """Render the scene in its current state. size_px: width, height, where they are not those that were given.

        Raises StorageError where the scratch file could not be written, for instance on a full disk.
        """
        channels = self._file.render(self._layer, size_px)
        colours = None
        if self._rgb:
            colours = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
            if not self._encoded_colours:
                colours = exact_colours(colours)
        depth_m = None
        if self._depth:
            depth_m = without_void(channels["Depth.Z"], camera_of(self._scene.camera).clip_end)
        return FrameAndSurface(colours, depth_m, world=self._surface(channels) if self._facts else None)

    def _surface(self, channels: dict[str, NDArray[np.float32]]) -> Surface:
        normals = faces = None
        if "normals" in self._facts:
            normals = np.stack([channels[f"Normal.{name}"] for name in "XYZ"], axis=-1)
        if "faces" in self._facts:
            low, high, hit = (np.rint(channels[f"{FACE_OUTPUT}.{name}"]).astype(np.int32) for name in "RGB")
            faces = np.where(hit > 0, high * FACE_STEP + low, -1).astype(np.int32)
        return Surface(normals, faces)


def without_void(z_m: NDArray[np.float32], far_m: float) -> NDArray[np.float32]:
    """Return Z as depth: 0 where nothing was hit, which is Z 1e10 or the far plane's."""
    return np.where(z_m < far_m * (1 - FAR_PLANE_TOLERANCE), z_m, np.float32(0))
