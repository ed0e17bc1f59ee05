# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests of what makes a frame's images: perturbations and channels."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ..channels import contract_problem
from ..channels.channel import Channel, FileKind, PairChannel, Surface, SurfaceChannel, View
from ..core.errors import NoisyWorldError
from ..core.frame_request import AT_ONCE, RequestedRays
from ..core.geometry import Intrinsics
from ..core.trajectory import FrameStamps, Trajectory
from ..images.pixels import as_float, rgb_bytes
from ..layouts import LAYOUTS, OutputFormat
from ..perturbations.execution import expose, move, perturb_colour, perturb_depth
from ..perturbations.kinds import (
    KINDS,
    SEVERITIES,
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    MotionPerturbation,
    PairingPerturbation,
    Perturbation,
    SceneAround,
    alone,
)
from ..perturbations.steps import Step
from ..scenes.polygon_mesh import Mesh

WIDTH_PX, HEIGHT_PX = 48, 36
CAMERA = Intrinsics(WIDTH_PX, HEIGHT_PX, 40.0, 42.0, 23.5, 17.5)
NAME = r"[a-z][a-z0-9_]*"


def require(kept: Any, name: str, rule: str) -> None:
    """Raise AssertionError, `name: rule`, where a rule is not kept."""
    if not kept:
        raise AssertionError(f"{name}: {rule}")


def require_name(name: Any) -> None:
    """Require that this is a name that presets, options and tables can have."""
    require(isinstance(name, str) and re.fullmatch(NAME, name), str(name), "is no name: small letters, digits and _")


def images(frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return colour (H, W, 3) float32 in [0, 1] and planar depth (H, W) float32, metres, a part of it void (0)."""
    row, column = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float32)
    waves = np.stack([np.sin(row / 3 + frame), np.cos(column / 4), np.sin((row + column) / 5)], axis=-1)
    depth_m = 1.0 + row / 20 + column / 30 + 0.01 * np.float32(frame)
    depth_m[:6, :8] = 0.0
    return (0.5 + 0.5 * waves).astype(np.float32), depth_m.astype(np.float32)


def path(frames: int) -> Trajectory:
    """Return a path that walks and turns; its stamps are no multiples of anything: nobody can count them."""
    turn = np.linspace(0.0, 0.5, frames)
    c2w = np.tile(np.eye(4), (frames, 1, 1))
    c2w[:, 0, 0], c2w[:, 0, 2], c2w[:, 2, 0], c2w[:, 2, 2] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
    steps = np.arange(frames)
    c2w[:, :3, 3] = np.stack([0.1 * steps, 0.02 * np.sin(steps), 0.05 * steps + 0.01 * steps**2], axis=1)
    return Trajectory(c2w, 10.0 + 0.05 * steps + 0.001 * (steps % 3))


# --- perturbations ---


FRAMES = 12
USUAL_SEVERITY = 3


def check_perturbation(perturbation: Perturbation) -> None:
    """Check a perturbation of any kind. Raises AssertionError with the rule that it breaks.

    Of all kinds: its defaults are its parameters at severity 3, and every severity from 1 to 5 gives parameters in
    their ranges. It gives the same twice, so a frame made alone equals that of a whole run, and it leaves what it is
    given as it is. Colour and depth keep shape and type and are finite; depth is never negative, and void stays void.
    A perturbation of colour that says repeatable gives the same in every frame; apply_bytes gives what apply does,
    rounded. Motion keeps the number of poses and their stamps, or chooses among those that there are; pairing names
    frames that there are, or -1.
    """
    require(isinstance(perturbation, KINDS), str(perturbation), f"is a {type(perturbation).__name__}, no perturbation")
    name = perturbation.name
    require_name(name)
    require(perturbation.label and perturbation.source, name, "needs a label, and the source of its severities")
    _check_severities(perturbation)
    for severity in (None, *SEVERITIES) if perturbation.severities else (None,):
        for temporal in perturbation.temporals or ("fresh",):
            step = Step[Any](perturbation, 0, severity, None, temporal, {})
            try:
                _check_work(perturbation, step)
            except NoisyWorldError as error:  # what a run would end with
                raise AssertionError(str(error)) from error


def _check_severities(perturbation: Perturbation) -> None:
    name, usual = perturbation.name, perturbation.parameters()
    for severity in SEVERITIES if perturbation.severities else ():
        try:
            found = perturbation.at_severity(severity)
        except (TypeError, ValueError) as error:
            raise AssertionError(f"{name}: severity {severity} gives no parameters: {error}") from error
        for key in perturbation.severities:
            value, default = getattr(found, key), getattr(usual, key)
            require(np.isfinite(value), name, f"{key} is {value} at severity {severity}")
            if severity == USUAL_SEVERITY:
                message = f"the default of {key} is {default}, but severity {USUAL_SEVERITY} says {value}"
                require(value == default, name, f"{message}: they have to be equal")


@dataclass(frozen=True)
class _Frame:
    """A frame to be perturbed, its arrays read-only."""

    index: int
    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]

    def context(self, step: Step[Any], index: int | None = None) -> FrameContext:
        """Return the context of a step on this frame; index: another number of it."""
        number = self.index if index is None else index
        where = FrameContext(
            number,
            (7, "scene", "setting"),
            step.temporal,
            stamp_s=0.05 * number,
            intrinsics=CAMERA,
            read_rgb=lambda: self.rgb,
            read_depth_m=lambda: self.depth_m,
            read_earlier=alone(self.rgb),
        )
        return step.context(where)


def _frame(index: int) -> _Frame:
    rgb, depth_m = images(0)
    for image in (rgb, depth_m):
        image.setflags(write=False)
    return _Frame(index, rgb, depth_m)


def _check_work(perturbation: Perturbation, step: Step[Any]) -> None:
    match perturbation:
        case ColourPerturbation():
            _check_colour(perturbation, step)
        case DepthPerturbation():
            _check_depth(perturbation, step)
        case MotionPerturbation():
            _check_motion(perturbation, step)
        case PairingPerturbation():
            _check_pairing(perturbation, step)
        case ExposurePerturbation():
            _check_exposure(perturbation, step)


def _twice(name: str, what: str, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Return what is made, which has to be equal when it is made again. What it is made from is read-only."""
    try:
        first, second = make(), make()
    except ValueError as error:
        changed = "read-only" in str(error)
        require(not changed, name, f"changes {what} that it is given; copy it")
        raise
    same = np.array_equal(first, second, equal_nan=True)
    require(same, name, f"gives another {what} for the same frame; draw from the context only")
    return first


def _check_colour(perturbation: ColourPerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)

    def made(index: int) -> NDArray[Any]:
        return perturb_colour(step, frame.rgb, step.severity, frame.context(step, index))

    image = _twice(name, "colour", lambda: made(4))
    require(np.isfinite(image).all(), name, "gives colour that is not finite")
    require(not np.shares_memory(image, frame.rgb), name, "returns the array that it is given; return a new one")
    if perturbation.repeatable:
        require(np.array_equal(image, made(5)), name, "says repeatable, but frames 4 and 5 differ for equal images")
    if (apply_bytes := perturbation.apply_bytes) is None:
        return
    rgb, parameters = rgb_bytes(frame.rgb), step.parameters(step.severity)
    rgb.setflags(write=False)
    found = _twice(name, "colour", lambda: apply_bytes(rgb, parameters, frame.context(step)))
    rounded = rgb_bytes(perturb_colour(step, as_float(rgb), step.severity, frame.context(step)))
    require(np.array_equal(found, rounded), name, "apply_bytes gives other bytes than apply, rounded")


def _check_depth(perturbation: DepthPerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)
    void = frame.depth_m == 0

    def made() -> NDArray[Any]:
        own = frame.context(step)
        found = perturbation.apply(frame.depth_m, step.parameters(step.severity), own)
        perturb_depth([step], frame.depth_m, FrameContext(4, (7, "", ""), intrinsics=CAMERA, read_rgb=own.read_rgb))
        return found

    depth_m = _twice(name, "depth", made)
    require(np.isfinite(depth_m).all(), name, "gives depth that is not finite; what has no depth is 0")
    require(depth_m.min() >= 0, name, f"gives depth of {depth_m.min():g} m; what has no depth is 0")
    require(not depth_m[void].any(), name, "gives depth where there was none; void (0) has to stay void")
    require(not np.shares_memory(depth_m, frame.depth_m), name, "returns the array that it is given; return a new one")


def _check_motion(perturbation: MotionPerturbation, step: Step[Any]) -> None:
    name, given, identifiers = perturbation.name, path(FRAMES), (7, "scene", "setting")
    c2w = _twice(name, "path", lambda: move([step], given, identifiers).c2w)
    rotations = c2w[:, :3, :3]
    rigid = np.abs(rotations @ rotations.swapaxes(-1, -2) - np.eye(3)).max() < 1e-6
    require(rigid and (np.linalg.det(rotations) > 0).all(), name, "gives poses that are not rigid")


def _check_pairing(perturbation: PairingPerturbation, step: Step[Any]) -> None:
    name, context = perturbation.name, step.sequence_context((7, "scene", "setting"))
    parameters = step.parameters(step.severity)
    paired = _twice(name, "pairing", lambda: np.asarray(perturbation.apply(FRAMES, parameters, context)))
    whole = paired.shape == (FRAMES,) and np.issubdtype(paired.dtype, np.integer)
    require(whole, name, f"has to give a whole number for each of {FRAMES} frames, not {paired.dtype} {paired.shape}")
    inside = (paired >= -1) & (paired < FRAMES)
    require(inside.all(), name, f"has to name frames from 0 to {FRAMES - 1}, or -1, not {paired[~inside][:1]}")


def _check_exposure(perturbation: ExposurePerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)

    if perturbation.rays is not None:
        made_rays = [perturbation.rays(AT_ONCE, step.parameters(step.severity)) for _ in range(2)]
        require(
            isinstance(made_rays[0], RequestedRays), name, f"rays has to return RequestedRays, not {made_rays[0]!r}"
        )
        require(made_rays[0] == made_rays[1], name, "says other rays for the same parameters")
        return

    def made(which: int) -> NDArray[Any]:
        found = expose([step], SceneAround(lambda *_: frame))[which]
        require(found is not None, name, "leaves out an image that it is given")
        assert found is not None
        return found

    for which, (what, given) in enumerate((("colour", frame.rgb), ("depth", frame.depth_m))):
        image = _twice(name, what, lambda which=which: made(which))
        require(image.shape == given.shape, name, f"makes {what} of {image.shape} of {given.shape}")
        require(np.isfinite(image).all(), name, f"gives {what} that is not finite")


# --- channels ---


def check_channel(channel: Channel) -> None:
    """Check a channel of a surface, or one that leads on. Raises AssertionError with the rule that it breaks.

    It says all that a channel says of itself. Of what is seen it gives an image of its dtype and components, the same
    twice, and leaves what it is given as it is; what is void has one value. Each kind of file that it may have gives
    the same bytes twice and what `stored` says back; 16-bit steps are uint16, of the image's shape. Every layout has a
    name of its own for each frame.
    """
    name = getattr(channel, "name", str(channel))
    require(isinstance(channel, (SurfaceChannel, PairChannel)), name, "is no SurfaceChannel, and no PairChannel")
    problem = contract_problem(channel)
    require(not problem, name, problem)
    require(set(channel.kinds) <= set(get_args(FileKind)) and channel.kinds, name, f"{channel.kinds} are no kinds")
    lossless = channel.dtype == "float32" or "exr" not in channel.kinds
    require(lossless, name, f"is {channel.dtype}, and an EXR holds float32: leave exr out of kinds")
    parts = len(channel.parts) in (0, channel.components)
    require(parts, name, f"names {len(channel.parts)} parts of {channel.components} components")
    for what, image, void in _images(channel):
        _check_image(channel, what, image, void)
    stamps = FrameStamps.of(path(2).stamps_s)
    for layout in LAYOUTS.values():
        for kind in channel.kinds:
            names = [channel.name_in(layout, frame, stamps, kind) for frame in (0, 1)]
            apart = names[0] != names[1] and all(item.endswith(f".{kind}") for item in names)
            require(apart, name, f"gives two frames the names {names} in the layout {layout.name}")


def _images(channel: Channel) -> Iterator[tuple[str, NDArray[Any], NDArray[np.bool_]]]:
    """Yield images of it: what of, the image, and which pixels (H, W) are void."""
    _, depth_m = images(0)
    void = depth_m == 0
    nothing = np.ones_like(void)
    if isinstance(channel, PairChannel):
        c2w = path(2).c2w
        views = [View(_fixed(images(frame)[1]), _fixed(c2w[frame]), CAMERA) for frame in (0, 1)]
        yield "of two frames", _channels_twice(channel, lambda: channel.of_views(views[0], views[1])), void
        yield "of the last frame", _channels_twice(channel, lambda: channel.of_last(CAMERA)), nothing
        return
    assert isinstance(channel, SurfaceChannel)
    corners = np.array([[-9.0, -9, 2], [9, -9, 2], [9, 9, 3], [-9, 9, 3]])
    mesh = Mesh(corners, None, np.arange(4, dtype=np.int32), np.array([0], np.int32), object_ids=np.array([7]))
    normals = np.tile(np.array([0.6, 0.0, -0.8], np.float32), (HEIGHT_PX, WIDTH_PX, 1))
    made = channel.of_mesh(mesh)
    for what, empty in (("of a surface", void), ("of nothing", nothing)):
        faces = np.where(empty, -1, 0).astype(np.int32)
        objects = np.where(empty, 0, 7).astype(np.uint16)
        seen = Surface(_fixed(np.where(empty[..., None], np.float32(0), normals)), _fixed(faces), _fixed(objects))
        given = {need: getattr(seen, need) for need in channel.needs}
        yield what, _channels_twice(channel, lambda given=given: made(Surface(**given))), empty


def _fixed(values: NDArray[Any]) -> NDArray[Any]:
    values.setflags(write=False)
    return values


def _channels_twice(channel: Channel, make: Any) -> NDArray[Any]:
    """Return an image, which has to be the same twice, and made without changing what it is made of."""
    try:
        first, second = make(), make()
    except ValueError as error:
        require("read-only" not in str(error), channel.name, "changes what it is given; copy it")
        raise
    require(np.array_equal(first, second), channel.name, "gives two images of the same frame")
    return first


def _check_image(channel: Channel, what: str, image: NDArray[Any], void: NDArray[np.bool_]) -> None:
    name, shape = channel.name, (HEIGHT_PX, WIDTH_PX)
    wanted = shape if channel.components == 1 else (*shape, channel.components)
    message = f"its image {what} is {image.dtype} {image.shape}, but it says {channel.dtype} {wanted}"
    require((str(image.dtype), image.shape) == (channel.dtype, wanted), name, message)
    require(len(np.unique(image[void], axis=0)) == 1, name, f"has several values for what is void, {what}")
    for kind in channel.kinds:
        layout = next(iter(LAYOUTS.values()))
        written = OutputFormat(layout, "png", layout.colours[0], (name,), 1000.0, formats=((name, kind),))
        stored = channel.stored(image, kind)
        if kind == "png":
            steps = channel.steps_of(image)
            message = f"its steps are {steps.dtype} {steps.shape}, not uint16 {wanted}"
            require((steps.dtype, steps.shape) == (np.uint16, wanted), name, message)
        data = channel.encode(image, written)
        require(data == channel.encode(image, written), name, f"gives two {kind} files of the same image")
        back = channel.decode(data, kind)
        same = back.dtype == stored.dtype and np.array_equal(back, stored)
        require(same, name, f"reads another image from its {kind} file than `stored` says, {what}")
