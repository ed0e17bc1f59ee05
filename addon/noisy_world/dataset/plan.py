# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preset asks for: its sequences and renders, each checked before anything is made."""

from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.errors import InputError, Message, PresetKey
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics
from ..images.measured_depth import Registration
from ..layouts import Modality, OutputFormat
from ..perturbations import registry
from ..perturbations.execution import chosen_poses, exposure_key, split_motion
from ..perturbations.kinds import ExposurePerturbation, Identifiers, MotionPerturbation
from ..perturbations.parsing import Registry, parse_settings
from ..perturbations.steps import Setting, Step
from ..preset.keys import EngineName, Preset
from ..preset.names import format_same_folder, selected
from ..sources import find_scenes
from ..sources.scene_kinds import Scene
from ..trajectories.rig import Rig
from .sensors import (
    DepthUnit,
    check_clock,
    check_distorts,
    check_exposed,
    check_imu,
    check_light,
    check_pairs,
    check_sensors,
    check_surface,
    depth_sensor,
    mounted,
    read_rig,
    repeats_of,
    unit_of,
)
from .sequence import Numbers, PartsMade, PlannedSequence, lay_out, union

OTHER_LAYOUT = Message("choose another ", PresetKey("output.layout"), ", such as tum")


@dataclass(frozen=True)
class Render:
    """What is rendered (or read) once for all the sequences that show it.

    frames: the source frames that these need. camera: of its images. moving: the steps that move the scene's path, with
    the identifiers of their random streams; without steps the path is as planned. exposure: the steps that take frames
    at other moments than the instants of their stamps. optics: what the cameras have beyond one pinhole, as images are
    written. unit: the rig's depth sensor, where it is a device of its own.
    """

    name: str
    scene: Scene
    frames: Numbers
    sequences: tuple[PlannedSequence, ...]
    camera: Intrinsics
    moving: tuple[Step[MotionPerturbation], ...] = ()
    identifiers: Identifiers = ()
    exposure: tuple[Step[ExposurePerturbation], ...] = ()
    optics: Optics = PINHOLE
    unit: DepthUnit | None = None

    @property
    def acts_on_light(self) -> bool:
        """Whether a step of a setting acts on the light of a lit scene, before its view transform."""
        steps = [step for sequence in self.sequences for step in sequence.setting.rgb]
        return self.scene.source.capabilities.lit and any(step.perturbation.acts_on_light for step in steps)

    @property
    def depth_camera(self) -> Intrinsics:
        """The camera of its depth images: the colour's, unless they have one of their own."""
        return self.camera if self.optics.depth is None else self.optics.depth.intrinsics

    @property
    def measured_camera(self) -> Intrinsics:
        """The camera by which depth is measured: that of its images, unless these are registered into colour."""
        return self.depth_camera if self.registration is None else self.registration.depth.intrinsics

    @property
    def registers(self) -> bool:
        """Whether depth is registered into colour before it is written."""
        return self.unit is not None and self.unit.registered and self.unit.camera is not None

    @cached_property
    def registration(self) -> Registration | None:
        """What is between colour and depth as it is measured; None where they have one camera."""
        depth = self.optics.depth if self.unit is None or self.unit.camera is None else self.unit.camera
        return None if depth is None else Registration(self.camera, depth, self.optics.distortion)

    @property
    def needs_depth(self) -> bool:
        """Whether a step of colour depends on depth."""
        return any(sequence.setting.needs_depth for sequence in self.sequences)

    @property
    def needs_rgb(self) -> bool:
        """Whether a step of depth depends on colour."""
        return any(sequence.setting.needs_rgb for sequence in self.sequences)

    @property
    def needed_besides(self) -> frozenset[Modality]:
        """The channels that steps need, whether they are written or not."""
        depth = self.needs_depth or any(sequence.setting.measures_travel for sequence in self.sequences)
        return frozenset(name for name, wanted in (("rgb", self.needs_rgb), ("depth", depth)) if wanted)


@dataclass(frozen=True)
class Refused:
    """A sequence of a preset that cannot be made of what its scene has.

    why: a sentence's end, after the setting's name. error: what ends a run where nothing is left out.
    """

    setting: str
    scene: str
    why: str
    error: InputError

    @property
    def folder(self) -> str:
        """The folder that it would have in the dataset."""
        return f"{self.setting}/{self.scene}"


@dataclass(frozen=True)
class Plan:
    """All renders and sequences of a preset. chosen: the frames of each sequence to make, if not all.

    refused: sequences that are left out, as their scenes lack what their settings need.
    """

    preset: Preset
    format: OutputFormat
    rig: Rig | None
    settings: tuple[Setting, ...]
    renders: tuple[Render, ...]
    chosen: slice | None = None
    refused: tuple[Refused, ...] = ()

    @cached_property
    def sequences(self) -> tuple[PlannedSequence, ...]:
        """Every sequence, in the order of the renders; --frames may leave it without a frame."""
        return tuple(sequence for render in self.renders for sequence in render.sequences)

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """Every scene once, in order."""
        return tuple({render.scene.name: render.scene for render in self.renders}.values())

    @cached_property
    def cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of each scene's frames, by the scene's name."""
        return {render.scene.name: render.camera for render in self.renders}

    @cached_property
    def depth_cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of each scene's depth images, by the scene's name."""
        return {render.scene.name: render.depth_camera for render in self.renders}

    @property
    def camera(self) -> Intrinsics | None:
        """The intrinsics of all frames; None where scenes have different ones."""
        cameras = set(self.cameras.values())
        return cameras.pop() if len(cameras) == 1 else None

    @property
    def renders_anything(self) -> bool:
        """Whether anything is rendered, rather than read from a recording."""
        return any(scene.source.capabilities.rendered for scene in self.scenes)

    @property
    def uses_render_settings(self) -> bool:
        """Whether anything is rendered as the preset says, rather than by settings of its own."""
        return any(
            scene.source.capabilities.rendered and scene.source.capabilities.own is None for scene in self.scenes
        )

    @property
    def engines(self) -> tuple[EngineName, ...]:
        """The engines that render anything, each once, in alphabetical order."""
        capabilities = [scene.source.capabilities for scene in self.scenes if scene.source.capabilities.rendered]
        engine = self.preset.spec.render.engine
        return tuple(sorted({engine if item.own is None else item.own.engine for item in capabilities}))

    @property
    def renders_in_blender(self) -> bool:
        """Whether Blender renders anything."""
        return any(engine != "embree" for engine in self.engines)

    @cached_property
    def composites(self) -> bool:
        """Whether anything is perturbed in Blender's compositor."""
        return "rgb" in self.format.modalities and any(setting.composited for setting in self.settings)

    @property
    def needs_blender(self) -> bool:
        """Whether Blender renders anything, or its compositor perturbs it."""
        return self.renders_in_blender or self.composites

    @cached_property
    def parts_made(self) -> PartsMade:
        """Which part of each render's perturbed images is made, and not linked."""
        return PartsMade()

    def only(self, render: Render) -> "Plan":
        """Return the plan of one of the renders alone, with the settings of its sequences."""
        settings = tuple(sequence.setting for sequence in render.sequences)
        return replace(self, renders=(render,), settings=settings)

    @property
    def frame_count(self) -> int:
        """How many source frames are rendered or read."""
        return sum(len(render.frames) for render in self.renders)


def read_settings(preset: Preset, registry: Registry) -> tuple[Setting, ...]:
    """Read the settings of a preset that are wanted. registry: the perturbations that they may name.

    Raises InputError where they are wrong or cannot be carried out.
    """
    spec = preset.spec
    settings = parse_settings(spec.settings, preset.setting_places, registry, spec.render.backend)
    names = [setting.name for setting in settings]
    wanted = set(selected(names, spec.only.settings, preset.place("only.settings")))
    sensor = depth_sensor(preset, registry)
    settings = tuple(replace(setting, sensor=sensor) for setting in settings if setting.name in wanted)
    check_sensors(settings, preset)
    _check_executions(settings, preset)
    return settings


def lay_out_plan(
    preset: Preset,
    settings: tuple[Setting, ...],
    scenes: Sequence[Scene],
    chosen: slice | None = None,
    *,
    leave_out: bool = False,
) -> Plan:
    """Lay out the work of a preset with its settings and scenes.

    chosen: the frames of each sequence to make, start and stop only; they keep their numbers. leave_out: whether a
    setting that needs what a scene has not is left out there, and the rest planned. Raises InputError where the preset
    asks for what cannot be made, and where nothing is left.
    """
    spec = preset.spec
    _check_scenes(scenes, preset)
    plan = Plan(
        preset=preset,
        format=spec.output.format,
        rig=read_rig(preset, {axes for scene in scenes if (axes := scene.source.robot_axes) is not None}),
        settings=settings,
        renders=(),
        chosen=chosen,
    )
    if plan.rig is not None:
        check_imu(plan.rig, settings, scenes, preset)
        scenes = [mounted(scene, plan.rig, preset) for scene in scenes]
    refused = tuple(found for scene in scenes for setting in settings if (found := _refused(setting, scene)))
    if refused and (not leave_out or len(refused) == len(scenes) * len(settings)):
        raise _none_left(refused, preset) if leave_out else refused[0].error
    without = {item.folder for item in refused}
    renders = tuple(render for scene in scenes for render in _renders(plan, scene, without))
    planned = {sequence.setting.name for render in renders for sequence in render.sequences}
    settings = tuple(setting for setting in settings if setting.name in planned)
    return replace(plan, settings=settings, renders=renders, refused=refused)


def _refused(setting: Setting, scene: Scene) -> Refused | None:
    """Return why a setting cannot be carried out on what a scene has; None where it can."""
    capabilities, remedies = scene.source.capabilities, ["take that setting out"]
    moves = any(step.perturbation.apply is not None for step in setting.motion if step.severity != 0)
    lacks = None
    if setting.exposure and (between := capabilities.instants_only):
        why = f"looks between the frames with {setting.exposure[0].perturbation.name}, but {between}"
        remedies.append("render a mesh")
    elif not capabilities.depth and (
        setting.needs_depth or setting.measures_travel or setting.depth or setting.pairing
    ):
        why, lacks = f"needs depth, and {scene.name} has none", "depth"
    elif moves and not capabilities.any_pose:
        why = "deviates from the path, but an existing sequence cannot be seen from elsewhere"
        remedies.append("render the scene's mesh")
    else:
        return None
    return Refused(setting.name, scene.name, why, scene.error(f"{setting.name} {why}", *remedies, lacks=lacks))


def _none_left(refused: Sequence[Refused], preset: Preset) -> InputError:
    """Return the error that says that nothing of a preset can be made."""
    if len(refused) == 1:
        return refused[0].error
    reasons = list(dict.fromkeys(item.why for item in refused))
    others = f", and {len(reasons) - 1} reasons more" if len(reasons) > 1 else ""
    first = f"{refused[0].setting} {reasons[0]}"
    problem = f"none of {len(refused)} sequences can be made: {first}{others}"
    return preset.place("settings").error(problem, "add a setting that its scenes can show, such as {name: clean}")


def _renders(plan: Plan, scene: Scene, without: Collection[str]) -> list[Render]:
    """Group the settings of a scene by what has to be rendered: one render serves all that leave the path alone.

    Those that expose its frames alike, along equal poses, share one too. without: folders of sequences to leave out.
    """
    settings = [setting for setting in plan.settings if f"{setting.name}/{scene.name}" not in without]
    if not settings:
        return []
    _check_chosen(scene, plan)
    preset, modalities = plan.preset, plan.format.modalities
    camera = scene.camera(preset)
    optics, unit = _optics(scene, plan, camera), unit_of(scene)
    check_pairs(scene, optics, preset, unit)
    clocked = unit is not None and unit.clock is not None
    check_light(scene, settings, preset)
    shared: list[PlannedSequence] = []
    moved: dict[Hashable, Render] = {}
    for setting in settings:
        moving, _ = split_motion(setting.motion, exposed=clocked or bool(setting.exposure))
        _check_exposure(setting, moving, scene, preset)
        identifiers = (preset.spec.seed, scene.name, setting.name)
        pairing = {"clocked": clocked, "repeats": repeats_of(scene)}
        sequence = lay_out(setting, scene.name, scene.frame_count, identifiers, plan.chosen, **pairing)
        if plan.chosen is None and not sequence.frames:
            pairing = ", ".join(step.perturbation.name for step in setting.pairing)
            raise preset.place("settings").error(
                f"{setting.name}: {pairing} leaves none of the {scene.frame_count} frames of {scene.name}",
                "change its parameters; desync has edge: clamp",
            )
        if clocked:
            check_clock(setting, moving, preset)
        if not moving and not setting.exposure:
            shared.append(sequence)
            continue
        key = _shown_key(setting, moving, scene.frame_count, identifiers)
        empty = Render(f"{scene.name}@{setting.name}", scene, range(0), (), camera, moving, identifiers)
        first = moved.get(key, replace(empty, optics=optics, unit=unit))
        sequences = (*first.sequences, sequence)
        moved[key] = replace(
            first, frames=needed_sources(sequences, modalities), sequences=sequences, exposure=setting.exposure
        )
    if not shared:
        return list(moved.values())
    needed = needed_sources(shared, modalities)
    return [Render(scene.name, scene, needed, tuple(shared), camera, optics=optics, unit=unit), *moved.values()]


def _shown_key(
    setting: Setting, moving: tuple[Step[MotionPerturbation], ...], count: int, identifiers: Identifiers
) -> Hashable:
    """Return what is equal for settings whose frames are taken along equal poses, at equal moments.

    Poses that a setting moves are its own.
    """
    if any(step.perturbation.apply is not None for step in moving):
        return setting.name
    chosen = chosen_poses(moving, count, identifiers)
    return exposure_key(setting.exposure), None if chosen is None else chosen.tobytes()


def _check_exposure(
    setting: Setting, moving: tuple[Step[MotionPerturbation], ...], scene: Scene, preset: Preset
) -> None:
    """Refuse to look between frames where there is nothing."""
    if not setting.exposure:
        return
    exposing = setting.exposure[0].perturbation.name
    check_exposed(f"{setting.name}: {exposing}", preset)
    bent = [step.perturbation.name for step in setting.exposure if step.perturbation.rays]
    if bent and not scene.source.capabilities.casts_rays:
        why = scene.source.capabilities.at_once
        problem = f"{setting.name}: {bent[0]} {why or 'casts rays of its own, which this scene does not do'}"
        other = () if why else (Message("use ", PresetKey("render.engine", "embree")),)
        raise scene.error(problem, "take that setting out", *other)
    apart = [step.perturbation for step in moving if step.perturbation.apply is not None]
    if lone := next((item.name for item in apart if not item.continuous), ""):
        problem = f"{setting.name}: {exposing} looks between the poses, but {lone} moves each pose by itself"
        raise preset.place("settings").error(problem, "take one of them out")


def _optics(scene: Scene, plan: Plan, camera: Intrinsics) -> Optics:
    """Return what a scene's cameras have beyond one pinhole. Raises InputError where the layout cannot tell it."""
    check_distorts(scene, plan.preset)
    optics, layout = scene.source.optics(camera), plan.format.layout
    said = optics.depth is None and optics.distortion is not None and layout.says_lens(optics.distortion)
    if optics.plain or layout.optics or said:
        return optics
    if optics.depth is not None:
        problem = f"depth has a camera of its own, which the {layout.label} layout cannot say"
        raise scene.error(problem, OTHER_LAYOUT, lacks="registration")
    raise scene.error(f"its lens distorts, which the {layout.label} layout cannot say", OTHER_LAYOUT, lacks="pinhole")


def needed_sources(sequences: Sequence[PlannedSequence], modalities: Sequence[Modality]) -> Numbers:
    """Return the source frames that sequences of one render show, increasing."""
    return union([sequence.sources_shown(modality) for sequence in sequences for modality in modalities])


# --- checks ---


def _check_scenes(scenes: Sequence[Scene], preset: Preset) -> None:
    """Refuse names given twice, and scenes that do not fit the layout or the rig."""
    names: dict[str, str] = {}
    for scene in scenes:
        if (other := names.get(scene.name.casefold())) is not None:
            same = other == scene.name
            problem = f"{scene.name!r} names two scenes" if same else format_same_folder(scene.name, other)
            raise scene.place.at("name").error(problem, "give each a name of its own")
        names[scene.name.casefold()] = scene.name
        if preset.spec.rig is not None and not scene.source.capabilities.any_pose:
            raise scene.error("is a recording, which has no other poses for a rig", "leave rig out")
        if problem := preset.spec.output.format.layout.stamps_problem(scene.source.frame_stamps):
            raise scene.place.error(problem, Message("mend the stamps, or ", OTHER_LAYOUT))
        if not scene.source.capabilities.any_pose:
            _check_poses(scene, preset)
        if not scene.source.capabilities.depth and "depth" in preset.spec.output.modalities:
            problem = Message(f"{scene.name} has no depth, but ", PresetKey("output.modalities"), " asks for it")
            raise scene.error(problem, Message("set ", PresetKey("output.modalities", "[rgb]")), lacks="depth")
        check_surface(scene, preset)


def _check_poses(scene: Scene, preset: Preset) -> None:
    """Refuse frames without a pose in a layout that has a line for each."""
    known, layout = scene.path.known, preset.spec.output.format.layout
    if known.any() and not known.all() and not layout.gaps:
        message = f"{np.count_nonzero(~known)} of {len(known)} frames have no pose, but {layout.label} has one for each"
        raise scene.error(message, OTHER_LAYOUT, lacks="poses")


def _check_executions(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse perturbations that the compositor cannot execute."""
    for setting in settings:
        lacking = [step.perturbation.name for step in setting.rgb if step.perturbation.nodes is None]
        if setting.composited and lacking:
            problem = f"{setting.name}: {lacking[0]} has no node group for the compositor"
            raise preset.place("settings").error(problem, Message("give it ", PresetKey("backend", "reference")))


def _check_chosen(scene: Scene, plan: Plan) -> None:
    chosen = plan.chosen
    if chosen is not None and not range(scene.frame_count)[chosen]:
        raise InputError(
            plan.preset.path,
            f"--frames {chosen.start or 0}:{'' if chosen.stop is None else chosen.stop} chooses none of the "
            f"{scene.frame_count} frames of {scene.name}",
            remedy=f"choose from 0:{scene.frame_count}",
        )


# What a user should know about a plan before it is made: one sentence each.


MS_PER_S = 1000.0


def plan_notes(plan: Plan) -> list[str]:
    """Return what is to be said of a plan beside its format: what is left out, exposures, what is seen too much."""
    refused = [f"{item.folder} is left out: {item.setting} {item.why}" for item in plan.refused]
    return [*refused, *_long_exposures(plan), *_limits(plan), *_broken_depth(plan)]


def _broken_depth(plan: Plan) -> list[str]:
    """Return a sentence for each setting of a dataset with depth that moves colour away from it."""
    if not {"rgb", "depth"} <= set(plan.format.modalities):
        return []
    return [
        f"{setting.name}: {step.perturbation.name} moves colour alone: depth no longer fits it"
        for setting in plan.settings
        for step in setting.rgb
        if step.perturbation.breaks_depth and step.severity != 0
    ]


def _limits(plan: Plan) -> list[str]:
    """Return a sentence for each setting that draws less of something than it asks for, as a camera sees so much."""
    found: dict[str, None] = {}
    for render in plan.renders:
        if render.scene.source.capabilities.lit:
            continue  # node groups draw there, whose time goes with the image
        for setting in (sequence.setting for sequence in render.sequences):
            for step in () if setting.composited else setting.rgb:
                if step.perturbation.limits is None or step.severity == 0:
                    continue
                severities = (step.severity,) if step.levels is None else sorted({*step.levels} - {0})
                said = (step.perturbation.limits(step.parameters(each), render.camera) for each in severities)
                if text := next(filter(None, said), ""):
                    found[f"{setting.name}: {step.perturbation.name} {text}"] = None
    return list(found)


def _long_exposures(plan: Plan) -> list[str]:
    """Return a sentence for each setting whose shutter, or whose readout, takes longer than frames are apart."""
    gaps = [
        (float(np.diff(stamps).min()), scene.name)
        for scene in plan.scenes
        if len(stamps := scene.source.frame_stamps.rgb.seconds) > 1
    ]
    if not gaps:
        return []
    apart_s, nearest = min(gaps)
    found: list[str] = []
    for setting in plan.settings:
        if (shutter := setting.shutter) is None:
            continue
        longest_s, what = max((shutter.exposure_s, "exposure"), (shutter.readout_s, "readout"))
        if longest_s > apart_s * (1 + 1e-6):
            longest_ms, apart_ms = longest_s * MS_PER_S, apart_s * MS_PER_S
            took = f"{what} of {longest_ms:.3g} ms is longer than the {apart_ms:.3g} ms between frames of {nearest}"
            found.append(f"{setting.name}: {took}, which no camera does; shorten it, or take fewer frames a second")
    return found


# Making a preset's plan, with its files found and all perturbations that are installed.


def make_plan(preset: Preset, chosen: slice | None = None, scenes: Collection[str] = ()) -> Plan:
    """Find every file of a preset and lay out the work.

    chosen: the frames of each sequence to make, start and stop only; they keep their numbers.
    scenes: names; with some, the plan has these alone, as a machine that makes one shard looks at no other scene.

    Raises InputError for files that are missing or wrong, and for what cannot be made from them.
    """
    settings = read_settings(preset, registry())  # first, so that a misspelt key is reported before files are read
    return lay_out_plan(preset, settings, find_scenes(preset, set(scenes)), chosen, leave_out=True)
