# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening what a path or an address leads to; a recipe's frames are made on the spot."""

import json
import threading
import warnings
from collections import OrderedDict
from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH, in_order
from ..channels.channel import View
from ..core.errors import InputError, nearest
from ..core.file_access import with_home
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Distortion
from ..perturbations import registry
from ..perturbations.steps import Setting
from ..render.source import PERTURBED, OpenSource, PreparedSource, SourceFrame
from ..sources import find_scenes
from ..sources.scene_kinds import Scene
from .clean_store import CleanStore, read_store
from .frame import (
    CleanFrame,
    CleanPair,
    EarlierFrames,
    PlannedFrame,
    cameras_of,
    clean_frames_of,
    motion_of_frames,
    view_of,
)
from .identity import versions_of
from .loader import Frame, Opened, OpenedFolder, OpenedPacked, OpenedSequence
from .plan import Plan, Render, lay_out_plan, read_settings
from .recipe import FrameNumbers, Recipe, read_recipe
from .remaking import check_inputs, check_setting, made_here, made_otherwise, preset_of, same_path
from .rendering import open_render, render_options, source_paths
from .sequence import ShownSources, written_paths
from .store import is_address
from .stored import is_packed

# A recipe, opened: its frames are made on the spot from clean ones, equal to the bytes of a dataset's files.


KEPT_SEQUENCES = 256  # whose frames are laid out; some hundred kilobytes each
KEPT_FRAMES = 2  # clean frames that stay in memory: colour and depth of a late pair, or one frame for many settings


class OpenedRecipe(Opened):
    """A recipe with what its frames are made from: a store of clean frames, or inputs that need no Blender."""

    def __init__(self, recipe: Recipe, store: CleanStore | None, data: Path | None) -> None:
        """Read its settings. data: the folder that the paths of its scenes begin at; default the recipe's.

        Raises InputError where its preset cannot be read by this version.
        """
        super().__init__(str(recipe.path))
        self.recipe = recipe
        self._store = store
        self._data = data
        self._preset = preset_of(recipe, data)
        self._settings = {setting.name: setting for setting in read_settings(self._preset, registry())}
        self._scenes: dict[tuple[str, bool], Scene] = {}  # by name, and whether it is a store's
        self._opened = lru_cache(maxsize=KEPT_SEQUENCES)(self._open)
        self._recent: OrderedDict[tuple[str, int], CleanFrame] = OrderedDict()
        self._paths: dict[str, SensorPaths] = {}
        self._prepared: dict[str, PreparedSource] = {}
        self._live: dict[str, tuple[str, OpenSource]] = {}  # by the scene: the render that is open, and its frames
        self._closing = ExitStack()
        self._lock = threading.RLock()

    def __reduce__(self) -> tuple[Any, ...]:
        folder = None if self._store is None else self._store.folder
        return _reopened, (self.recipe.path, folder, self._data, self._scenes)

    @property
    def identity(self) -> dict[str, Any]:
        """As the recipe has it."""
        return dict(self.recipe.identity)

    @property
    def _names(self) -> Collection[str]:
        return self.recipe.sequences.keys()

    def _numbers(self, name: str) -> FrameNumbers:
        return self.recipe.sequences[name].frames

    def _sequence(self, name: str) -> "SequenceOfRecipe":
        return self._opened(name)

    def _open(self, name: str) -> "SequenceOfRecipe":
        setting, scene = name.split("/")
        if setting not in self._settings:
            remedy = "the dataset had grown by another preset; take a recipe from when it was made"
            raise InputError(self.place, f"its preset does not name {setting}", remedy=remedy)
        if (wanted := self.recipe.identity["settings"].get(setting)) is not None:
            check_setting(self.recipe.path, wanted, self._settings[setting])
        if self._store is not None and self._store.has_scene(scene):
            self._store.check(self.recipe.identity, scene, setting)
        return SequenceOfRecipe(self, name, self._settings[setting], self._scene(scene))

    # --- scenes ---

    def _scene(self, name: str, *, real: bool = False) -> Scene:
        """Return a scene: with the store's path, if it is there, or else with its inputs. real: with its inputs."""
        with self._lock:
            stored = not real and self._store is not None and self._store.has_scene(name)
            if (name, stored) not in self._scenes:
                self._scenes[name, stored] = self._stored_scene(name) if stored else self._real_scene(name)
            return self._scenes[name, stored]

    def _stored_scene(self, name: str) -> Scene:
        assert self._store is not None
        return Scene(name, self._preset.place("scenes.0"), self._store.source(name))

    def _real_scene(self, name: str) -> Scene:
        (scene,) = find_scenes(preset_of(self.recipe, self._data, scenes=[name]))
        wanted = self.recipe.identity["scenes"][name]
        check_inputs(self.recipe.path, wanted, scene)
        if not same_path(wanted, scene):
            other = made_otherwise(self.recipe.identity, made_here())
            problem = f"{name}: its path is not the recipe's"
            if not other:
                raise InputError(self.place, problem, remedy="were its keys changed?")
            warnings.warn(f"{self.place}: {problem} to the last digit, so pixels may differ", stacklevel=2)
        return scene

    # --- clean frames ---

    def plan(self, setting: Setting, scene: Scene) -> Plan:
        """Return the plan of one sequence."""
        return lay_out_plan(self._preset, (setting,), [scene])

    def paths(self, plan: Plan, render: Render) -> SensorPaths:
        """Return the sensors' paths of a render; each is made once."""
        with self._lock:
            if render.name not in self._paths:
                self._paths[render.name] = source_paths(plan, render)
            return self._paths[render.name]

    def clean(self, sequence: "SequenceOfRecipe", source: int) -> CleanFrame:
        """Return a source frame of a sequence's render."""
        key = (sequence.render.name, source)
        with self._lock:
            if key not in self._recent:
                self._recent[key] = clean_frames_of(sequence.render)(source, self._clean_image(sequence, source))
                if len(self._recent) > KEPT_FRAMES:
                    self._recent.popitem(last=False)
            return self._recent[key]

    def view(self, sequence: "SequenceOfRecipe", source: int) -> View:
        """Return what the colour camera sees at a source frame of a sequence's render."""
        clean, paths, camera = self.clean(sequence, source), sequence.paths, sequence.render.camera
        with self._lock:
            return view_of(lambda: self._open_source(sequence), paths, clean, camera)

    def _clean_image(self, sequence: "SequenceOfRecipe", source: int) -> SourceFrame:
        render = sequence.render
        between = render.needs_depth and render.unit is not None and render.unit.camera is not None
        kept = None if between else self._store  # which has no depth that colour itself sees
        stored = None if kept is None else kept.frame(render.name, source)
        return stored or self._open_source(sequence).frame(sequence.paths.request(source))

    def _open_source(self, sequence: "SequenceOfRecipe") -> OpenSource:
        """Return what gives the clean frames of a render. Raises InputError where that needs Blender."""
        render, scene = sequence.render, sequence.render.scene.name
        name, source = self._live.get(scene, ("", None))
        if source is not None and name == render.name:
            return source
        if self._preset.spec.render.in_blender and self._store is not None and self._store.has_scene(scene):
            raise self._lacking(sequence)  # before the inputs are looked for, which nobody needs who has a store
        real = self._scene(scene, real=True)
        plan = self.plan(sequence.sequence.setting, real)
        if plan.renders_in_blender:
            raise self._lacking(sequence)
        if scene not in self._prepared:
            self._check_renderer(plan)
            prepared = real.source.prepare(render.camera, _ignore)
            self._prepared[scene] = self._closing.enter_context(prepared)
        rendered_with = render_options(sequence.plan, render)
        options = replace(rendered_with, channels=rendered_with.channels | COLOUR_AND_DEPTH)
        self._live[scene] = render.name, open_render(self._prepared[scene], render, sequence.paths, options, _ignore)
        return self._live[scene][1]

    def _check_renderer(self, plan: Plan) -> None:
        """Say where what renders here is of another version than the recipe's. Raises MissingDependencyError."""
        if plan.renders_anything:
            here = {**made_here(), "versions": versions_of(plan)}
            if other := made_otherwise({**here, "versions": self.recipe.identity["versions"]}, here):
                warnings.warn(f"{self.place}: {other}", stacklevel=2)

    def _lacking(self, sequence: "SequenceOfRecipe") -> InputError:
        setting, scene = sequence.name.split("/")
        where = "DIR" if self._store is None else str(self._store.folder)
        problem = f"{sequence.name} needs clean frames of {sequence.render.name}, which Blender renders"
        if self._store is not None:
            problem += f"; {where} lacks them"
        command = f"noisy-world render-clean {self.place} --out {where} --scenes {scene} --settings {setting}"
        opening = "" if self._store is not None else ", and open(..., clean=DIR) takes them"
        return InputError(self.place, problem, remedy=f"'{command}' makes them{opening}")

    def load(self, name: str, index: int) -> None:
        """Make the clean colour frame that a frame shows, for which its scene is loaded."""
        sequence = self._opened(name)
        self.clean(sequence, sequence.sequence.shown(index).rgb_source)

    def close(self) -> None:
        """Let go of the sources that are open."""
        self._live.clear()
        self._prepared.clear()
        self._closing.close()


def _reopened(path: Path, store: Path | None, data: Path | None, scenes: dict[tuple[str, bool], Scene]) -> OpenedRecipe:
    """Open a recipe again in another process, with the scenes that are found and checked."""
    opened = OpenedRecipe(read_recipe(path), None if store is None else read_store(store), data)
    opened._scenes.update(scenes)
    return opened


def _ignore(text: str) -> None:
    """Notes on inputs were told when the dataset was made."""
    del text


class SequenceOfRecipe(OpenedSequence):
    """A sequence that is made on the spot."""

    def __init__(self, opened: OpenedRecipe, name: str, setting: Setting, scene: Scene) -> None:
        """Lay out its frames."""
        self.name = name
        self._opened = opened
        self.plan = opened.plan(setting, scene)
        (self.render,) = self.plan.renders
        (self.sequence,) = self.render.sequences
        self.paths = opened.paths(self.plan, self.render)
        self.written = written_paths(self.sequence, self.paths).rgb
        self.stamps = self.render.scene.source.frame_stamps
        earlier = EarlierFrames(scene.source.stamps_s, lambda source: opened.clean(self, source).light_seen)
        cameras = cameras_of(self.render, self.paths, earlier)
        self.clean = replace(cameras, frame=partial(opened.clean, self), pair=self.pair)

    def __reduce__(self) -> tuple[Any, ...]:
        return _sequence_of, (self._opened, self.name)

    @property
    def frames(self) -> FrameNumbers:
        """The numbers of its frames, as the recipe has them."""
        return self._opened.recipe.sequences[self.name].frames

    @property
    def camera(self) -> Intrinsics:
        """The intrinsics of its frames."""
        return self.render.camera

    @property
    def distortion(self) -> Distortion | None:
        """The lens of its frames."""
        return self.render.optics.distortion

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The camera of its depth."""
        return self.render.optics.depth

    @cached_property
    def motion(self) -> list[dict[str, Any]]:
        """What motion did to each frame; [] where it did nothing."""
        return motion_of_frames(self.render, self.sequence, self.paths)

    def check_executable(self) -> None:
        """Raise InputError where colour is perturbed by Blender's compositor."""
        if self.sequence.setting.composited:
            problem = f"the colour of {self.name} is made by Blender's compositor, in Blender's own thread alone"
            remedy = "'noisy-world remake' makes its files; with render.backend: reference colour needs no Blender"
            raise InputError(self._opened.place, problem, remedy=remedy)
        scene = self.render.scene.name
        if self.plan.format.of_light:
            problem = f"the colour of {self.name} is light before the view transform of {scene}, which Blender renders"
            raise InputError(self._opened.place, problem, remedy="'noisy-world remake' makes its files")
        inputs = self._opened.recipe.identity["scenes"][scene]["inputs"]
        if PERTURBED in inputs and any(step.perturbation.acts_on_light for step in self.sequence.setting.rgb):
            problem = (
                f"the colour of {self.name} is made before the view transform of {scene}, which Blender alone knows"
            )
            raise InputError(self._opened.place, problem, remedy="'noisy-world remake' makes its files")

    def pair(self, shown: ShownSources) -> CleanPair:
        """Return what is seen at a source frame and at the next. Raises InputError where that needs Blender."""
        sources = [source for source in shown if source is not None and None not in shown]
        elsewhere = self.paths.depth is not None and self.plan.renders_in_blender
        if sources and (elsewhere or self.render.scene.source.capabilities.moving):
            what = "depth from colour's place, beside a depth sensor," if elsewhere else "how things move"
            problem = f"{self.name}: {what} is rendered by Blender alone"
            raise InputError(self._opened.place, problem, remedy="open the dataset, which has its files")
        views = (self._opened.view(self, source) for source in sources)
        return CleanPair(shown, self.render.camera, *views)

    def _frame(self, index: int) -> "FrameOfRecipe":
        return FrameOfRecipe(self, index)


def _sequence_of(opened: Opened, name: str) -> OpenedSequence:
    return opened[name]


class FrameOfRecipe(Frame):
    """A frame that is made when it is asked for."""

    def __init__(self, made_in: SequenceOfRecipe, index: int) -> None:
        """Look up what it shows."""
        self.sequence = made_in.name
        self.index = index
        self._in = made_in
        self._format = made_in.plan.format
        self.stamp_s, depth_s = made_in.stamps.frame_times(index)
        self.depth_stamp_s = self.stamp_s if depth_s is None else depth_s
        self.c2w = made_in.written.c2w[index].copy()

    def __reduce__(self) -> tuple[Any, ...]:
        return _frame_of, (self._in, self.index)

    @cached_property
    def _made(self) -> PlannedFrame:
        return PlannedFrame(self._in.sequence, self.index, self._in.clean)

    def _coloured(self) -> PlannedFrame:
        self._check("rgb", "colour")
        self._in.check_executable()
        return self._made

    def _check(self, modality: str, what: str) -> None:
        if modality not in self._format.modalities:
            remedy = f"its preset's output.modalities lacks {modality}"
            raise InputError(self._in.plan.preset.path, f"makes no {what}", remedy=remedy)

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, encoded and decoded. Raises InputError where Blender's compositor makes it."""
        if self._format.image == "png":
            return self.rgb_uncompressed
        return _decoded(self._coloured().rgb_to_decode(self._format))

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB. Raises InputError where Blender's compositor makes it."""
        return self._coloured().stored_rgb(self._format)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, in the steps of the file."""
        self._check("depth", "depth")
        return self._format.stored_depth_m(self._made.depth_m)

    def _other(self, channel: str) -> NDArray[Any]:
        item = CHANNELS[channel]
        self._check(channel, item.spoken)
        return item.stored(self._made.pixels(channel), item.suffix(self._format))

    @property
    def done(self) -> dict[str, Any]:
        """What was done to it, as frames.jsonl has it; both images are made for that."""
        return self._done

    @cached_property
    def _done(self) -> dict[str, Any]:
        if "rgb" in self._format.modalities:
            self._in.check_executable()
        written = self._format.modalities
        found = self._made.record(in_order(written), written)
        if motion := self._in.motion:
            found["motion"] = motion[self.index]
        return json.loads(json.dumps({name: found[name] for name in sorted(found)}))

    def image_bytes(self, channel: str) -> bytes:
        """Return the file of a channel's image. Raises InputError where Blender's compositor makes it."""
        item = CHANNELS[channel]
        self._check(channel, item.spoken)
        if item.steps == "rgb":
            self._in.check_executable()
        return self._made.bytes(channel, self._format)


def _frame_of(sequence: OpenedSequence, index: int) -> Frame:
    return sequence[index]


def _decoded(data: bytes) -> NDArray[np.uint8]:
    import cv2

    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None, "what was encoded can be decoded"
    return np.asarray(image, np.uint8)


def open_path(path: str | Path, clean: str | Path | None = None, data: str | Path | None = None) -> Opened:
    """Open what is at a path; see noisy_world.open."""
    if is_address(str(path)):
        _refuse_inputs(path, "an address", clean, data)
        return OpenedPacked(str(path))
    place = _place(path)
    if place.is_dir():
        _refuse_inputs(place, "a folder", clean, data)
        return OpenedPacked(place) if is_packed(place) else OpenedFolder(place)
    if not place.exists():
        raise _not_there(place)
    recipe = read_recipe(place)
    store = None if clean is None else read_store(_place(clean))
    for made in [made_here()] + ([store.identity] if store is not None else []):
        if otherwise := made_otherwise(recipe.identity, made):
            warnings.warn(f"{place}: {otherwise}", stacklevel=3)
            break
    return OpenedRecipe(recipe, store, None if data is None else _place(data))


def _not_there(place: Path) -> InputError:
    """Return the error for a path that leads nowhere, with what is near its first part that is not there."""
    first = next(part for part in [*reversed(place.parents), place] if not part.exists())
    beside = {item.name: item for item in sorted(first.parent.iterdir())} if first.parent.is_dir() else {}
    near = nearest(first.name, beside)
    remedy = f"did you mean {str(beside[near])!r}?" if near else f"{first.parent} holds nothing of a name like it"
    return InputError(place, "no such folder or recipe", remedy=remedy)


def _refuse_inputs(path: str | Path, what: str, clean: str | Path | None, data: str | Path | None) -> None:
    for name, given in (("clean", clean), ("data", data)):
        if given is not None:
            raise InputError(path, f"is {what}, whose files are read: {name} goes with a recipe")


def _place(path: str | Path) -> Path:
    try:
        return with_home(str(path))
    except LookupError as error:
        raise InputError(str(path), str(error)) from error
