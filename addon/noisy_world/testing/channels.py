# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a channel keeps its contract."""

from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.channels import contract_problem
from ..core.channels.channel import Channel, FileKind
from ..core.channels.pair import PairChannel, View
from ..core.channels.surface import Surface, SurfaceChannel
from ..core.datasets.layouts import LAYOUTS, OutputFormat
from ..core.scenes.mesh import Mesh
from ..core.trajectories.stamps import FrameStamps
from .rules import CAMERA, HEIGHT_PX, WIDTH_PX, images, path, require


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
        yield "of two frames", _twice(channel, lambda: channel.of_views(views[0], views[1])), void
        yield "of the last frame", _twice(channel, lambda: channel.of_last(CAMERA)), nothing
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
        yield what, _twice(channel, lambda given=given: made(Surface(**given))), empty


def _fixed(values: NDArray[Any]) -> NDArray[Any]:
    values.setflags(write=False)
    return values


def _twice(channel: Channel, make: Any) -> NDArray[Any]:
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
