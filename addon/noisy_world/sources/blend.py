# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `blend`: a scene of one's own, a .blend rendered as its artist set it up."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from ..core.errors import Message, PresetKey, either
from ..core.schema import Choice, ConfigPath, key
from ..preset.keys import CameraSpec, Preset
from ..preset.names import LAST_POSSIBLE, FrameRange, frame_range_problem
from ..preset.scene_keys import PathKeys, check_trajectory
from ..render.source import OwnRendering, Source
from ..scenes.sun_air import SunAir
from .renderers import check_light_lens
from .scene_kinds import FileSource, SceneEntry, path_file_of, read_path

if TYPE_CHECKING:
    from ..scenes.blend_scene import OwnScene


@dataclass(frozen=True)
class AirSpec:
    """The air of a scene: what the sun shines through, and what lies behind surfaces that mirror."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "soften_sun": "On: sun lamps shine as through heavy air: shadows are softer, and the sun is weaker",
        "visibility_m": "Lower: the sun's shadows are softer",
        "path_m": "Higher: the sun's shadows are softer",
        "reflections": "On: fog and haze hide what water, wet floors and mirrors show as far behind them as it is",
    }

    soften_sun: bool = key(
        "whether the scene's sun lamps get the wide disc and the light of a sun behind that air, in every setting",
        default=False,
        identity="meaning",
    )
    visibility_m: float = key(
        "distance at which 5 % of the contrast is left, as of fog_depth",
        unit="m",
        default=200.0,
        above=0,
        maximum=100_000,
        identity="meaning",
        slider=(10, 5000),
    )
    path_m: float = key(
        "way of the sun's light through that air: its layer's height divided by the sine of the sun's",
        unit="m",
        default=100.0,
        above=0,
        maximum=100_000,
        identity="meaning",
        slider=(1, 1000),
        label="Sunlight's Way",
    )
    reflections: bool = key(
        "whether fog, haze, rain and snow are behind surfaces that mirror, too; else what these show fades as they do",
        default=False,
        identity="meaning",
        label="Air in Reflections",
    )

    @property
    def sun_air(self) -> SunAir | None:
        """What softens the scene's sun; None where nothing does."""
        return SunAir(self.visibility_m, self.path_m) if self.soften_sun else None


@dataclass(frozen=True, kw_only=True)
class BlendKeys(PathKeys):
    """What a preset says of a scene of one's own."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "depth_alpha": "Higher: depth sees through surfaces that are less transparent",
    }

    blend: str = key(
        "instead of mesh: a .blend, rendered as its artist set it up, relative to the preset; * allowed",
        identity="meaning",
    )
    scene: str | None = key("the scene of the .blend; default the file's active one", default=None, identity="meaning")
    camera: str | None = key(
        "the camera object of that scene; default the scene's own, and those that its markers name",
        default=None,
        identity="meaning",
    )
    frames: str | None = key(
        "the scene's frames, FIRST:LAST or FIRST:LAST:STEP, both with them; default the scene's range and step",
        default=None,
        pattern=frame_range_problem,
        identity="meaning",
    )
    compositor: Literal["off", "keep"] = key(
        "what becomes of the .blend's own compositor",
        default="off",
        choices={
            "off": Choice("Off", "Frames are as rendered, before the compositing"),
            "keep": Choice("Keep", "Frames are as the compositing makes them"),
        },
        identity="meaning",
    )
    depth_alpha: float = key(
        "depth of a .blend goes through what is less opaque than this",
        default=0.5,
        minimum=0,
        maximum=1,
        identity="meaning",
    )
    air: AirSpec | None = key("the air of the scene; default clear air for its sun and in reflections", default=None)

    @property
    def sun_air(self) -> SunAir | None:
        """What softens the scene's sun; None where nothing does."""
        return None if self.air is None else self.air.sun_air

    @property
    def mirrors(self) -> bool:
        """Whether air lies behind surfaces that mirror, too."""
        return self.air is not None and self.air.reflections

    @property
    def frame_range(self) -> FrameRange | None:
        """The scene's frames that are asked for; None for its own."""
        return None if self.frames is None else FrameRange.parse(self.frames)


class BlendKind(FileSource[BlendKeys]):
    """A scene of a .blend, along its own camera's path or one of a file."""

    name = "blend"
    order = 50
    label = "Scene of one's own"
    meaning = "a scene of a .blend, rendered as its artist set it up"
    keys = BlendKeys
    several = "files"
    always_recorded = ("scene", "camera", "frames", "compositor", "depth_alpha")

    def check(self, keys: BlendKeys, place: ConfigPath) -> None:
        """Refuse a path that is made, for which there is no mesh."""
        where = place.at("trajectory")
        if keys.trajectory is not None and keys.trajectory.handheld is not None:
            problem = "is made through a mesh, which a .blend is not"
            raise where.at("handheld").error(problem, "give a file, or let the scene's camera move")
        if keys.trajectory is not None and keys.trajectory.body is not None:
            problem = "needs a mesh, whose walls it keeps away from, which a .blend is not"
            raise where.at("body").error(problem, "take it out")
        if keys.trajectory is not None:
            check_trajectory(keys.trajectory, where)

    def path_key(self, keys: BlendKeys) -> str:
        """Return the key of the path's file or, where the scene's camera moves by itself, of its frames."""
        return "frames" if keys.trajectory is None else "trajectory"

    def open_file(self, entry: SceneEntry[BlendKeys], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a file."""
        del name
        return blend_scene(entry, path, parts)


SOURCE = BlendKind()


def blend_scene(entry: SceneEntry[BlendKeys], path: Path, parts: tuple[str, ...]) -> Source:
    """Return the source of a .blend. parts: what the entry's wildcards matched.

    Raises InputError where a file is missing or wrong, MissingDependencyError where there is no Blender.
    """
    from .blender_process import inspect_blend
    from .lit_scene import BlendSource

    preset, place, spec = entry.preset, entry.place, entry.keys
    given = preset.spec.camera
    check_light_lens(preset)
    if spec.compositor == "keep" and given is not None and given.distortion is not None:
        problem = "is keep, but a compositor works on the image, and camera.distortion bends the light before it"
        raise place.at("compositor").error(problem, "leave one of them out")
    found = inspect_blend(
        path,
        place,
        scene=spec.scene,
        camera=spec.camera,
        frames=spec.frame_range,
        needs_path=spec.trajectory is None,
        lens_given=given is not None,
        composited=spec.compositor == "keep",
        softened=spec.sun_air is not None,
    )
    rendering, sampled = _rendering(preset, place, found, given)
    if spec.sun_air is not None and rendering.engine == "workbench":
        problem = "is true, but workbench shows no lamps"
        raise place.at("air").at("soften_sun").error(problem, Message("set ", PresetKey("render.engine", "cycles")))
    problem = reflections_problem(rendering.engine, composited=spec.compositor == "keep") if spec.mirrors else ""
    if problem:
        remedy = Message("set it to false, or set ", PresetKey("render.engine", "cycles"), " and compositor: off")
        raise place.at("air").at("reflections").error(f"is true, but {problem}", remedy)
    path_file, known, axes = None, None, None
    if spec.trajectory is not None:
        where = place.at("trajectory")
        path_file = path_file_of(preset, where, spec.trajectory, parts)
        seen_with = found.camera_parameters.intrinsics if given is None else given.intrinsics
        known, read_as = read_path(path_file, spec.trajectory, where, seen_with)
        axes = None if read_as.axes == "auto" else read_as.axes
    source = BlendSource(
        place,
        path,
        spec.compositor,
        spec.depth_alpha,
        found,
        given,
        path_file,
        known,
        axes or "opencv",
        rendering,
        sampled,
        preset.place("camera").at("distortion"),
        spec.sun_air,
        spec.mirrors,
    )
    if max(abs(source.scene_frames[0]), abs(source.scene_frames[-1])) > LAST_POSSIBLE:
        span_s = float(source.stamps_s[-1] - source.stamps_s[0])
        problem = f"lasts {span_s:.6g} s, at {found.fps:g} frames a second longer than a scene of Blender's"
        raise place.at("trajectory").error(
            problem, Message("is its ", PresetKey("stamp_unit"), " right? Or choose poses with start and stop")
        )
    source.trajectory()  # its errors need not wait
    return source


def reflections_problem(engine: str | None, *, composited: bool) -> str:
    """Return why nothing can tell what the surfaces of a scene mirror; "" where it can be told."""
    if engine != "cycles":
        return f"Cycles alone tells how far behind a surface is what it mirrors, not {engine}"
    return "nothing tells what an image mirrors that a compositor has made" if composited else ""


def _rendering(
    preset: Preset, place: ConfigPath, found: "OwnScene", given: CameraSpec | None
) -> tuple[OwnRendering, bool]:
    """Return how a scene is rendered, and whether the preset gives the samples: what it gives holds, else the file."""
    render = preset.document.get("render") or {}
    render_spec = preset.spec.render
    engine = render_spec.engine if "engine" in render else found.engine
    if engine == "embree":
        problem = "is embree, which knows no lights or materials of a .blend"
        raise preset.place("render.engine").error(problem, "leave it out for the file's own, or use cycles")
    if engine is None:
        problem = f"{found.scene} is rendered by {found.engine_name}, which is not supported"
        raise place.at("blend").error(problem, Message("set ", PresetKey("render.engine", "cycles"), " or eevee"))
    sampled = "samples" in render
    if render_spec.device == "gpu" and engine != "cycles":
        problem = f"is gpu, but {engine} renders with GL, on whatever GL finds"
        raise preset.place("render.device").error(
            problem, either("leave it out", Message("set ", PresetKey("render.engine", "cycles")))
        )
    samples = render_spec.samples if sampled else found.samples[engine]
    near_m, far_m = (
        (found.camera_parameters.near_m, found.camera_parameters.far_m)
        if given is None
        else (given.near_m, given.far_m)
    )
    return OwnRendering(engine, samples, near_m, far_m), sampled
