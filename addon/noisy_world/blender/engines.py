# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles, EEVEE and Workbench, each set up to show unlit colours and planar depth, and nothing else."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import bpy

from ..core.errors import MissingDependencyError
from .scratch_images import muted_output
from .typed import cycles as cycles_of

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
    """What differs between engines.

    configure: sets a scene up for a seed and the number of samples that colours get.
    set_samples: sets the samples per pixel of the next render, which can be changed at no cost.
    shades: whether the material's nodes are evaluated; Workbench shows the colour attribute itself.
    centre_depth: whether depth is that of the pixel's centre at any number of samples; if not, it is rendered
    separately, with one sample.
    blurs_textures: whether it shows more of a texture than the four texels around a point.
    sample_offset_px: how far to the right of and above a pixel's centre its first sample is.
    """

    configure: Callable[[bpy.types.Scene, int, int], None]
    set_samples: Callable[[bpy.types.Scene, int], None]
    shades: bool
    centre_depth: bool
    blurs_textures: bool
    sample_offset_px: Callable[[int], float]


def configure(
    scene: bpy.types.Scene, engine: Engine, *, seed: int, samples: int, threads: int, device: Device = "cpu"
) -> None:
    """Set a scene up for an engine. samples: rays per pixel, for colour. threads: 0 for all.

    Raises MissingDependencyError where a GPU is asked for and none is found.
    """
    render = scene.render
    render.use_persistent_data = True
    render.use_compositing = False
    render.use_sequencer = False
    render.use_motion_blur = False
    render.use_simplify = False
    render.film_transparent = False
    render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:
        render.threads = threads
    # Without a world the background is black, which is the colour of void.
    scene.world = None
    engine.configure(scene, seed, samples)
    if device == "gpu":
        enable_gpu()
        cycles_of(scene).device = "GPU"


def show_textures(scene: bpy.types.Scene) -> None:
    """Make Workbench show textures, in place of the colour attribute; the other engines show what materials say."""
    shading = _display(scene).shading
    assert shading is not None
    shading.color_type = "TEXTURE"


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


def _configure_cycles(scene: bpy.types.Scene, seed: int, samples: int) -> None:
    """Configure Cycles without lights, bounces, denoiser and tiles."""
    _set_engine(scene, "CYCLES")
    cycles = cycles_of(scene)
    cycles.device = "CPU"
    cycles.seed = seed
    cycles.use_animated_seed = True
    sample_plainly(cycles, filter_width_px(samples))
    cycles.transparent_max_bounces = 0
    cycles.film_exposure = 1.0


def sample_plainly(cycles: Any, filter_px: float) -> None:
    """Let Cycles follow a camera's rays to what they meet and no further, by a fixed pattern."""
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_auto_tile = False
    cycles.use_light_tree = False
    cycles.max_bounces = 0
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = filter_px


def _configure_eevee(scene: bpy.types.Scene, _seed: int, samples: int) -> None:
    """Configure EEVEE without lights, shadows and ray tracing; its samples follow a fixed pattern."""
    _set_engine(scene, "BLENDER_EEVEE")
    scene.render.filter_size = AVERAGING_FILTER_PX if samples > 1 else 0.0
    eevee = _eevee(scene)
    eevee.use_shadows = False
    eevee.use_raytracing = False
    eevee.use_fast_gi = False
    eevee.use_overscan = False


def _configure_workbench(scene: bpy.types.Scene, _seed: int, _samples: int) -> None:
    """Configure Workbench to show the colour attribute, flat; nothing is random."""
    _set_engine(scene, "BLENDER_WORKBENCH")
    shading = _display(scene).shading
    assert shading is not None
    shading.light = "FLAT"
    shading.color_type = "VERTEX"
    shading.show_backface_culling = False
    shading.show_cavity = False
    shading.show_object_outline = False
    shading.show_shadows = False
    shading.show_specular_highlight = False
    shading.show_xray = False
    shading.use_dof = False


def _cycles_samples(scene: bpy.types.Scene, samples: int) -> None:
    cycles_of(scene).samples = samples


def _eevee_samples(scene: bpy.types.Scene, samples: int) -> None:
    _eevee(scene).taa_render_samples = samples


def _workbench_samples(scene: bpy.types.Scene, samples: int) -> None:
    name: Any = "OFF" if samples == 1 else str(samples)  # which numbers there are the preset has checked
    _display(scene).render_aa = name


def _set_engine(scene: bpy.types.Scene, name: str) -> None:
    engine: Any = name  # the stubs know none but EEVEE: the others are add-ons to them
    scene.render.engine = engine


def _eevee(scene: bpy.types.Scene) -> bpy.types.SceneEEVEE:
    assert scene.eevee is not None
    return scene.eevee


def _display(scene: bpy.types.Scene) -> bpy.types.SceneDisplay:
    assert scene.display is not None
    return scene.display


def filter_width_px(samples: int) -> float:
    """Return the width of Cycles' pixel filter: the least for a single sample, which shows the pixel's centre."""
    return CENTRE_FILTER_PX if samples == 1 else AVERAGING_FILTER_PX


def _no_offset(_samples: int) -> float:
    return 0.0


ENGINES: dict[EngineName, Engine] = {
    "cycles": Engine(
        _configure_cycles,
        _cycles_samples,
        shades=True,
        centre_depth=True,
        blurs_textures=False,
        sample_offset_px=lambda samples: FILTER_MIDDLE * filter_width_px(samples),
    ),
    "eevee": Engine(
        _configure_eevee,
        _eevee_samples,
        shades=True,
        centre_depth=False,
        blurs_textures=True,
        sample_offset_px=_no_offset,
    ),
    "workbench": Engine(
        _configure_workbench,
        _workbench_samples,
        shades=False,
        centre_depth=False,
        blurs_textures=False,
        sample_offset_px=_no_offset,
    ),
}
