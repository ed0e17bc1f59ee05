# SPDX-License-Identifier: GPL-3.0-or-later
"""A rough estimate of a plan's time and disk space, for --dry-run and the warning of a disk that is too small."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..channels.channel import PixelBytes
from ..core.errors import MORE_MEMORY, InputError, OutOfMemoryError
from ..core.machine import free_memory_bytes, held_memory_bytes
from ..core.schema import ConfigPath
from ..layouts import Modality
from ..perturbations.execution import split_motion
from ..perturbations.kinds import SEQUENCE_KINDS, ColourPerturbation, DepthPerturbation
from ..perturbations.parsing import Registry, parse_steps
from ..perturbations.steps import Setting
from .frame import PlannedFrame
from .identity import Described, RecordedSetting, RecordedStep
from .machine_pace import MachinePace
from .plan import Plan, Render
from .sequence import Numbers, PlannedSequence, array_of, lay_out, spread

# Measured on two cores at 1200 x 680 (docs/speed_against_error.md), and rounded.
SECONDS_PER_SAMPLE = 2.4e-7  # a ray in Cycles: 0.20 s for a frame of one sample
SECONDS_PER_PIXEL = 2e-8  # reading or encoding and writing a frame's two images: 0.016 s
SECONDS_PER_RAY = 6.5e-8  # engine embree: 0.05 s a frame
AVERAGED_SHARE = 0.1  # of pixels get all their samples with it: 0.02 of a scanned room's, 0.2 of the embedded rooms'
SECONDS_PER_SCENE = 2.0  # loading it, once for all renders that have its camera
SECONDS_OF_START = 1.2  # Python and its packages
SECONDS_OF_BLENDER = 2.0  # in addition
SECONDS_PER_OWN_SCENE = 4.0  # a .blend is looked at in a process of its own, too
SECONDS_OF_EEVEE = 10.0  # building its shaders, once
SECONDS_PER_EEVEE_PIXEL = 6e-6  # without a graphics card, whatever the samples
EXPOSED_TIMES = 12  # that a frame costs which is exposed at several moments
READ_TIMES = 1.3  # that one costs which is read line by line
SECONDS_PER_LINK = 1e-4  # an image that is there already under another name
SECONDS_PER_PERTURBED_PIXEL = 1.2e-8  # perturbing, encoding and writing an image: 0.01 s, the mean of the benchmark's
SECONDS_PER_COMPOSITED_PIXEL = 1e-7  # of each step in Blender's compositor, in addition: 0.08 s an image
SPREAD = 1.6  # by which the time may be off to either side; chosen
ASKED = 8  # frames of a sequence whose severity varies, by which the others are guessed; chosen


AS_MEASURED = MachinePace()
"""The pace of the machine on which the constants were measured."""


@dataclass(frozen=True)
class CostEstimate:
    """A rough guess of what a plan takes on two cores.

    least_bytes, most_bytes: what the content of its images makes likely. least_s, most_s: what is likely of the time.
    """

    bytes_written: int
    seconds: float
    least_bytes: int
    most_bytes: int

    @property
    def least_s(self) -> float:
        """The least that is likely."""
        return self.seconds / SPREAD

    @property
    def most_s(self) -> float:
        """The most that is likely."""
        return self.seconds * SPREAD


def parts_made(sequences: Iterable[PlannedSequence], modality: Modality) -> dict[str, float]:
    """Return for sequences of one render, by folder, which part of their images of a modality is made, from 0 to 1.

    The rest is clean, as severity 0 leaves it, or made for a sequence before it, which does the same to the frame: some
    frames are asked, one where no severity varies. Sequences that do nothing to the modality are left
    out.
    """
    working = [sequence for sequence in sequences if sequence.setting.on(modality) and sequence.frames]
    varies = any(step.levels is not None for sequence in working for step in sequence.setting.on(modality))
    count = ASKED if varies else 1
    found: dict[str, float] = {}
    made: set[Hashable] = set()
    for sequence in working:
        keys = [PlannedFrame(sequence, frame).key(modality) for frame in spread(sequence.frames, count)]
        new = {key for key in keys if key[-1] is not None} - made
        found[sequence.folder] = len(new) / len(keys)
        made |= new
    return found


def _parts_made_of(plan: Plan, render: Render, modality: Modality) -> dict[str, float]:
    """Return it of a render, for which it is found once."""
    if (render.name, modality) not in plan.parts_made:
        plan.parts_made[render.name, modality] = parts_made(render.sequences, modality)
    return plan.parts_made[render.name, modality]


def image_bytes(plan: Plan, render: Render, modality: Modality) -> int:
    """Estimate the bytes of an image of a render."""
    return int(_pixels(render, modality) * CHANNELS[modality].pixel_bytes(plan.format).usual)


def _pixels(render: Render, modality: Modality) -> int:
    camera = render.depth_camera if CHANNELS[modality].paired else render.camera
    return camera.width_px * camera.height_px


def size_text(count: int) -> str:
    """Return a number of bytes in words: "3.2 GB", "17 MB", "1.4 MB", "600 bytes"."""
    for size, unit in ((10**12, "TB"), (10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}" if count < 10 * size else f"{count / size:.0f} {unit}"
    return f"{count} bytes"


def estimate(plan: Plan, pace: MachinePace = AS_MEASURED, *, quick: bool = False) -> CostEstimate:
    """Estimate the bytes and the time of a plan from the measured costs of a pixel.

    pace: how fast this machine is. quick: as if meshes were rendered by Embree, and colour perturbed by the reference.
    """
    least, most = np.sum([_byte_bounds(plan, render) for render in plan.renders], axis=0)
    usual = sum(_bytes_of(plan, render) for render in plan.renders)  # of presets of many perturbations
    seconds = pace.factor * _preparing_s(plan, quick=quick)
    seconds += sum(
        float(frame_seconds(plan, render, render.frames, pace, quick=quick).sum()) for render in plan.renders
    )
    return CostEstimate(int(min(max(usual, least), most)), seconds, int(least), int(most))


def frame_seconds(
    plan: Plan, render: Render, frames: Sequence[int], pace: MachinePace = AS_MEASURED, *, quick: bool = False
) -> NDArray[np.float64]:
    """Estimate the seconds (N,) that some source frames of a render take, with all images that show them.

    pace, quick: as of `estimate`.
    """
    pixels = render.camera.width_px * render.camera.height_px
    each_s = pixels * SECONDS_PER_PIXEL
    if render.scene.source.capabilities.rendered:
        render_spec, own = plan.preset.spec.render, render.scene.source.capabilities.own
        engine, samples = (render_spec.engine, render_spec.samples) if own is None else (own.engine, own.samples)
        engine = "embree" if quick else engine
        rays_s = pixels * rendering_seconds(engine, samples) * _exposed_times(render)
        each_s = rays_s if engine == "embree" else each_s + rays_s
    each_s *= pace.factor
    images_s: dict[Numbers, float] = {}  # of all images that show the same source frames one after another
    for modality in plan.format.modalities:
        made = _parts_made_of(plan, render, modality)
        for sequence in render.sequences:
            pixel_s = pace.perturbed_s(sequence, modality, SECONDS_PER_PERTURBED_PIXEL)
            if not quick and CHANNELS[modality].steps == "rgb" and plan.composites and sequence.setting.composited:
                pixel_s += pace.factor * SECONDS_PER_COMPOSITED_PIXEL * len(sequence.setting.rgb)
            image_s = SECONDS_PER_LINK + made.get(sequence.folder, 0.0) * pixels * pixel_s
            sources = sequence.sources_shown(modality)
            images_s[sources] = images_s.get(sources, 0.0) + image_s
    seconds = np.full(max(render.frames[-1:], default=-1) + 1, each_s)
    for sources, image_s in images_s.items():
        if isinstance(sources, range):
            seconds[sources.start : sources.stop : sources.step] += image_s
        else:
            seconds += image_s * np.bincount(sources.values, minlength=len(seconds))
    return seconds[array_of(frames)]


def _exposed_times(render: Render) -> float:
    """Return how many times the clean frame's rays a frame of a render takes."""
    if any(step.perturbation.apply is not None for step in render.exposure):
        return EXPOSED_TIMES
    return READ_TIMES if render.exposure else 1.0


def rendering_seconds(engine: str, samples: int) -> float:
    """Estimate the seconds that a pixel takes, without writing it."""
    if engine == "embree":
        return SECONDS_PER_RAY * (1 if samples == 1 else 1 + AVERAGED_SHARE * samples)
    return SECONDS_PER_EEVEE_PIXEL if engine == "eevee" else SECONDS_PER_SAMPLE * samples


def _preparing_s(plan: Plan, *, quick: bool) -> float:
    """Estimate the seconds that go by without a frame: of starting, and of loading every scene once for each camera."""
    rendered = [render for render in plan.renders if render.scene.source.capabilities.rendered]
    scenes = {(render.scene.name, render.camera) for render in rendered}
    seconds = SECONDS_OF_START + SECONDS_PER_SCENE * len(scenes)
    if quick or not plan.needs_blender:
        return seconds
    own = {render.scene.name for render in rendered if render.scene.source.capabilities.own is not None}
    seconds += SECONDS_OF_BLENDER + SECONDS_PER_OWN_SCENE * len(own)
    return seconds + (SECONDS_OF_EEVEE if "eevee" in plan.engines else 0.0)


def quicker(plan: Plan, pace: MachinePace) -> tuple[str, float] | None:
    """Return what makes a plan without Blender, as words for --set, and its seconds; None where nothing does.

    The pixels are others: those of Embree's rays, and of the reference in numpy and OpenCV.
    """
    renders = plan.renders_in_blender
    capabilities = [scene.source.capabilities for scene in plan.scenes]
    if not (renders or plan.composites) or any(item.rendered and item.own is not None for item in capabilities):
        return None  # only Blender knows the materials and lights of a scene of one's own
    words = ["render.engine=embree"] if renders else []
    words += ["render.backend=reference"] if plan.composites else []
    return " ".join(words), estimate(plan, pace, quick=True).seconds


def _bytes_of(plan: Plan, render: Render) -> float:
    pixels = render.camera.width_px * render.camera.height_px
    format_ = plan.format
    sizes = {modality: CHANNELS[modality].pixel_bytes(format_) for modality in format_.modalities}
    clean = len(render.frames) * sum(size.usual for size in sizes.values())
    perturbed = 0.0
    for modality, size in sizes.items():
        made = _parts_made_of(plan, render, modality)
        images = sum(made.get(sequence.folder, 0.0) * len(sequence.frames) for sequence in render.sequences)
        perturbed += size.perturbed * images
    return pixels * (clean + perturbed)


def _byte_bounds(plan: Plan, render: Render) -> NDArray[np.float64]:
    """Return (2,): the least and the most bytes that the images of a render are likely to take."""
    bounds = np.zeros(2)
    for modality in plan.format.modalities:
        size, pixels = CHANNELS[modality].pixel_bytes(plan.format), _pixels(render, modality)
        bounds += pixels * len(render.frames) * np.array(size.clean)
        made = _parts_made_of(plan, render, modality)
        for sequence in render.sequences:
            images = made.get(sequence.folder, 0.0) * len(sequence.frames)
            bounds += pixels * images * np.array(_bytes_per_pixel(sequence.setting, modality, size))
    return bounds


def _bytes_per_pixel(setting: Setting, modality: Modality, size: PixelBytes) -> tuple[float, float]:
    """Return between which figures the bytes of a pixel lie after a setting's steps."""
    grain = [step.perturbation.grain for step in setting.on(modality)]
    if not any(grain):
        return size.changed
    least = size.grainy if grain[-1] else size.changed  # a step after it, such as JPEG's, may take the noise away
    return least[0], size.grainy[1]


# The memory that a plan's frames take, by the pixel, and the refusal of a plan that is beyond what there is.


# Measured as the peak of a run at 1200 x 680 and at 3600 x 2040 pixels, and rounded down: what frames take at least.
BYTES_READ = 16  # a pixel of a recording, read and written
BYTES_RENDERED = 60  # by Embree: colour and depth, rendered and written
BYTES_RENDERED_IN_BLENDER = 115  # by Cycles and Workbench
BYTES_PERTURBED = 25  # colour, in numpy and OpenCV, in addition
BYTES_COMPOSITED = 55  # colour, in Blender's compositor, in addition
BYTES_OF_PYTHON = 90_000_000
BYTES_OF_BLENDER = 450_000_000

# What the peaks of runs of sixteen presets had above that, at 640 x 360 to 1200 x 680 pixels.
USUAL_BYTES_BESIDE = 80_000_000  # packages, and frames that wait
USUAL_BYTES_IN_EMBREE = 450_000_000  # an embedded room with its textures and rays
USUAL_BYTES_IN_BLENDER = 270_000_000  # the same room in Cycles or Workbench
USUAL_BYTES_OF_EEVEE = 900_000_000  # in addition, on a processor alone


def memory_bytes(plan: Plan) -> int:
    """Estimate the bytes of memory that a process takes at least which makes the plan's frames, but for its scenes."""
    frame = max((_frame_bytes(plan, render) for render in plan.renders), default=0)
    return frame + (BYTES_OF_BLENDER if plan.needs_blender else BYTES_OF_PYTHON)


def usual_memory_bytes(plan: Plan) -> int:
    """Estimate the bytes of memory that such a process usually takes, with a scene of a room's size."""
    extra = USUAL_BYTES_BESIDE
    if plan.renders_in_blender:
        extra += USUAL_BYTES_IN_BLENDER + (USUAL_BYTES_OF_EEVEE if "eevee" in plan.engines else 0)
    elif "embree" in plan.engines:
        extra += USUAL_BYTES_IN_EMBREE
    return memory_bytes(plan) + extra


def check_memory(plan: Plan, processes: int = 1) -> None:
    """Raise OutOfMemoryError where processes that make frames of a plan need more memory than this one may take.

    What this process holds already, it need not take.
    """
    needed, free = processes * memory_bytes(plan), free_memory_bytes()
    if free is None or needed <= free + held_memory_bytes():
        return
    largest = max(plan.renders, key=lambda render: _frame_bytes(plan, render))
    size = f"{largest.camera.width_px} x {largest.camera.height_px} pixels"
    several = f" in each of {processes} processes" if processes > 1 else ""
    raise OutOfMemoryError(
        f"frames of {size} need at least {size_text(needed // processes)} of memory{several}, and "
        f"{size_text(free)} are free here",
        file=plan.preset.path,
        where="camera",
        remedy="take fewer jobs" if processes > 1 else MORE_MEMORY,
    )


def _frame_bytes(plan: Plan, render: Render) -> int:
    capabilities = render.scene.source.capabilities
    each = BYTES_READ
    if capabilities.rendered:
        engine = plan.preset.spec.render.engine if capabilities.own is None else capabilities.own.engine
        each = BYTES_RENDERED if engine == "embree" else BYTES_RENDERED_IN_BLENDER
    coloured = [sequence.setting for sequence in render.sequences if sequence.setting.rgb]
    if "rgb" in plan.format.modalities and coloured:
        each += BYTES_COMPOSITED if any(setting.composited for setting in coloured) else BYTES_PERTURBED
    pixels = max(camera.width_px * camera.height_px for camera in (render.camera, render.depth_camera))
    return each * pixels


# The sequences that an identity describes: their frames and rough cost, without the preset and without its files.


RENDERED = {"mesh", "blend"}  # inputs of scenes that a renderer takes; of others frames are read or computed


@dataclass(frozen=True)
class _Way:
    """How a setting makes its frames: what decides them, the images that it perturbs, and its composited steps."""

    known: Setting | None
    moves: bool
    perturbed: int
    composited: int


def described_sequences(
    identity: Mapping[str, Any], registry: Registry, chosen: slice | None = None
) -> tuple[Described, ...]:
    """Return every sequence of an identity, in its order.

    identity: one that `read_dataset_state` has accepted. registry: the perturbations that there are. chosen: the frames
    of each sequence that are asked for, start and stop only.
    """
    ways = {name: _way(name, content, registry) for name, content in identity["settings"].items()}
    pairs = [folder.split("/") for folder in identity["sequences"]]
    shared = dict.fromkeys((scene for _, scene in pairs), 0)
    for setting, scene in pairs:
        shared[scene] += not ways[setting].moves
    found = []
    for setting, scene in pairs:
        way = ways[setting]
        frames = _frames(way, identity, scene, chosen)
        cost_s = _render_s(identity, scene) / (1 if way.moves else shared[scene]) + _images_s(identity, scene, way)
        found.append(Described(setting, scene, frames, cost_s))
    return tuple(found)


def _way(name: str, content: Mapping[str, Any], registry: Registry) -> _Way:
    recorded = RecordedSetting.read(content)
    kinds = [registry.get(step.name) for step in recorded.steps]
    deciding = [
        step
        for step, kind in zip(recorded.steps, kinds, strict=True)
        if kind is None or isinstance(kind, SEQUENCE_KINDS)
    ]
    perturbed = sum(any(isinstance(kind, image) for kind in kinds) for image in (ColourPerturbation, DepthPerturbation))
    coloured = sum(isinstance(kind, ColourPerturbation) for kind in kinds)
    composited = coloured if recorded.backend == "compositor" else 0
    try:
        steps = parse_steps(list(_written(deciding)), ConfigPath(name, "steps"), registry)
    except InputError:  # of a package that is not installed here, or of a version with other parameters
        return _Way(None, False, perturbed, composited)
    setting = Setting(name, steps)
    moves = bool(setting.exposure or split_motion(setting.motion)[0])
    return _Way(setting, moves, perturbed, composited)


def _written(steps: Iterable[RecordedStep]) -> Iterator[dict[str, Any]]:
    """Yield steps of an identity as a preset would write them, with all their parameters."""
    for step in steps:
        severity = {} if step.severity is None else {"severity": step.severity}
        yield {step.name: {**severity, **(step.parameters[0] or {})}}


def _frames(way: _Way, identity: Mapping[str, Any], scene: str, chosen: slice | None) -> Numbers | None:
    if way.known is None:
        return None
    count = identity["scenes"][scene]["path"]["frames"]
    return lay_out(way.known, scene, count, (identity["seed"], scene, way.known.name), chosen).frames


def _described_pixels(identity: Mapping[str, Any], scene: str) -> int:
    camera = identity["scenes"][scene]["camera"]
    return camera["width"] * camera["height"]


def _render_s(identity: Mapping[str, Any], scene: str) -> float:
    """Estimate what rendering or reading a source frame takes, and writing it clean."""
    render = identity["render"]
    if render is None or not RENDERED & identity["scenes"][scene]["inputs"].keys():
        return _described_pixels(identity, scene) * SECONDS_PER_PIXEL
    return _described_pixels(identity, scene) * (
        rendering_seconds(render["engine"], render["samples"]) + SECONDS_PER_PIXEL
    )


def _images_s(identity: Mapping[str, Any], scene: str, way: _Way) -> float:
    per_pixel = way.perturbed * SECONDS_PER_PERTURBED_PIXEL + way.composited * SECONDS_PER_COMPOSITED_PIXEL
    return SECONDS_PER_LINK + _described_pixels(identity, scene) * per_pixel
