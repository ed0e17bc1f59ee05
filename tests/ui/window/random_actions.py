# SPDX-License-Identifier: GPL-3.0-or-later
"""Random valid actions in a Blender's window with the add-on on: run by a Blender program.

    blender -P tests/ui/window/random_actions.py -- FOLDER ADD-ON'S-FOLDER SEED MINUTES [MOST ACTIONS]

FOLDER holds mesh.ply and trajectory.txt. Operators and properties of the add-on, undo and redo, views, renders, files
and scenes, drawn by the seed. actions.jsonl there has each action before it is done and what came of it after; a last
line tells that the time was over. What the user made is looked at after each action of the add-on.
"""

import hashlib
import json
import random
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

WORDS = sys.argv[sys.argv.index("--") + 1 :]
FOLDER, SOURCE = (Path(word) for word in WORDS[:2])
SEED, MINUTES = int(WORDS[2]), float(WORDS[3])
MOST = int(WORDS[4]) if len(WORDS) > 4 else 10**9
DRAW = random.Random(SEED)
OURS = "Noisy World"
PAUSE_S = 0.01  # until the next action, once the windows are drawn
USER_FILE, OTHER_FILE = FOLDER / "user.blend", FOLDER / "other.blend"
PRESETS = sorted(map(str, (SOURCE.parent / "presets").rglob("*.yaml")))
# What buttons and menus give, and few people type.
KNOWN: dict[str, list[str]] = {"of": ["other_scenes", "other_settings"], "setting": [""]}
OFTEN = {
    "noisy_world.add_step": 8.0, "noisy_world.use_preset": 2.0, "noisy_world.preview_frame": 2.0,
    "noisy_world.generate": 0.2, "noisy_world.generate_anew": 0.2, "noisy_world.generate_without": 0.2,
    "noisy_world.generate_shots": 0.2, "noisy_world.track": 0.2, "noisy_world.remove_step": 2.0,
}  # fmt: skip
NEVER = {
    "noisy_world.open_output",  # a file manager of the machine
    "noisy_world.open_page",
}
LOG = (FOLDER / "actions.jsonl").open("w", encoding="utf-8")


def main() -> None:
    """Register the add-on from a checkout and begin."""
    sys.path[:0] = [str(SOURCE)]
    sys.path.append(str(SOURCE.parent / ".blender-env" / str(sys.implementation.cache_tag)))
    bpy.ops.wm.read_homefile(use_splash=False)
    make_user_file()
    import noisy_world

    noisy_world.register()
    from noisy_world.perturbations import registry
    from noisy_world.preset.camera_devices import CAMERA_DEVICES

    KNOWN.update(perturbation=sorted(registry()), device=sorted(CAMERA_DEVICES))
    state = State()
    bpy.app.timers.register(state.proceed, first_interval=1.0, persistent=True)


def log(**content: Any) -> None:
    """Write a line that a crash does not take along."""
    LOG.write(json.dumps(content) + "\n")
    LOG.flush()


# --- what a user has made ---


def make_user_file() -> None:
    """Save two files of a user's: objects, an animation, compositing, a text, a picture and a second scene."""
    scene = bpy.context.scene
    scene.name = "Mine"
    cube = bpy.data.objects["Cube"]
    for frame, x in ((1, 0.0), (5, 1.0)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    picture = bpy.data.images.new("My Picture", 8, 8)
    picture.pixels = [0.25] * 256
    picture.pack()
    bpy.data.texts.new("My Notes").write("as it was")
    tree = bpy.data.node_groups.new("My Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, blur = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeBlur")
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(layers.outputs["Image"], blur.inputs["Image"])
    tree.links.new(blur.outputs["Image"], end.inputs[0])
    scene.compositing_node_group = tree
    other = bpy.data.scenes.new("Second")
    other.collection.objects.link(bpy.data.objects["Camera"])
    other.camera = bpy.data.objects["Camera"]
    for each in (scene, other):
        each.render.engine = "BLENDER_WORKBENCH"
        each.render.resolution_x, each.render.resolution_y = 64, 36
        each.frame_start, each.frame_end = 1, 5
    for item in (picture, tree):
        item.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(OTHER_FILE))
    bpy.ops.wm.save_as_mainfile(filepath=str(USER_FILE))


def user_data() -> dict[str, str]:
    """Return a hash of each thing that a user has made, by its kind and name."""
    found = {}
    for kind, (kept, contents) in OF_USER.items():
        for item in getattr(bpy.data, kind):
            if kept(item):
                found[f"{kind} {item.name}"] = hashlib.sha256(repr(contents(item)).encode()).hexdigest()[:12]
    return found


def is_own(item: bpy.types.ID) -> bool:
    """Tell whether something is the user's: what Noisy World makes is marked, or has its name."""
    return item.library is None and not item.get("noisy_world") and not item.name.startswith(OURS)


def of_object(item: bpy.types.Object) -> tuple[Any, ...]:
    """Return what an object is; not where, if it is animated, which follows the scene's frame."""
    names = [part and part.name for part in (item.parent, item.data)]
    place = None if item.animation_data else [tuple(row) for row in item.matrix_basis]
    return item.type, names, [part.name for part in item.constraints], place


def of_action(item: bpy.types.Action) -> list[Any]:
    """Return an action's keys."""
    bags = [bag for layer in item.layers for strip in layer.strips for bag in strip.channelbags]
    curves = [curve for bag in bags for curve in bag.fcurves]
    return [(curve.data_path, [tuple(point.co) for point in curve.keyframe_points]) for curve in curves]


def of_tree(item: bpy.types.NodeTree) -> tuple[Any, ...]:
    """Return what a group of nodes is."""
    return sorted(node.name for node in item.nodes), sorted((e.from_node.name, e.to_node.name) for e in item.links)


OF_USER: dict[str, tuple[Callable[[Any], bool], Callable[[Any], Any]]] = {
    "objects": (is_own, of_object),
    "meshes": (
        lambda item: any(part.data == item and is_own(part) for part in bpy.data.objects),
        lambda item: ([tuple(vertex.co) for vertex in item.vertices], [part and part.name for part in item.materials]),
    ),
    "texts": (is_own, lambda item: item.as_string()),
    "images": (lambda item: item.name == "My Picture", lambda item: (tuple(item.size), list(item.pixels[:16]))),
    "node_groups": (lambda item: item.name.startswith("My "), of_tree),
    "lights": (is_own, lambda item: (item.type, item.energy)),
    "actions": (lambda item: item.name.startswith("Cube"), of_action),
    "scenes": (is_own, lambda item: sorted(part.name for part in item.collection.children if is_own(part))),
}
"""By the name of the file's list: what of it the user has made, and what is looked at of that."""


# --- actions ---


class State:
    """What was done, and what it is compared with."""

    def __init__(self) -> None:
        self.end_s = time.monotonic() + 60 * MINUTES
        self.number = 0
        self.prepare = True
        self.files = {path: path.read_bytes() for path in (OTHER_FILE, FOLDER / "mesh.ply", FOLDER / "trajectory.txt")}
        self.known = user_data()
        self.last: dict[str, float] = {}

    def proceed(self) -> float | None:
        """Do one action; runs when the windows are drawn."""
        if self.last:
            drawn_s = time.monotonic() - self.last["s"] - PAUSE_S
            log(after=self.number, drawn_s=round(drawn_s, 3), cpu_s=round(time.thread_time() - self.last["cpu_s"], 3))
        if time.monotonic() > self.end_s or self.number >= MOST:
            log(over=self.number)
            with suppress(RuntimeError):
                bpy.ops.noisy_world.generate_cancel()
            bpy.ops.wm.quit_blender()
            return None
        self.number += 1
        with in_view():
            action, words = (prepare, [DRAW.random() < 0.7]) if self.prepare else self.draw()
        self.prepare = action in (load_file, restart_add_on) and DRAW.random() < 0.8
        log(
            number=self.number,
            action=action.__name__,
            words=words if action != use_operator else [str(w) for w in words],
        )
        start_s, cpu_s = time.monotonic(), time.thread_time()
        result = ""
        try:
            with in_view():
                result = str(action(*words))
        except RuntimeError as error:  # an operator's report, or the traceback of its error
            result = f"RuntimeError: {error}"
        except Exception:  # noqa: BLE001 - the test shows it
            result = traceback.format_exc()
        took = {"s": round(time.monotonic() - start_s, 3), "cpu_s": round(time.thread_time() - cpu_s, 3)}
        wrong = self.wrong(by_user=action in BY_USER or action is undo)
        log(done=self.number, result=result[:2000], wrong=wrong, **took)
        self.last = {"s": time.monotonic(), "cpu_s": time.thread_time()}
        return PAUSE_S

    def draw(self) -> tuple[Callable[..., Any], list[Any]]:
        """Draw an action, and what it is called with."""
        kind = DRAW.choices(list(ACTIONS), [weight for weight, _ in ACTIONS.values()])[0]
        return kind, ACTIONS[kind][1]()

    def wrong(self, *, by_user: bool) -> list[str]:
        """Return what the user had made and has been changed by the add-on."""
        now = user_data()
        lost = [] if by_user else [name for name, value in self.known.items() if now.get(name) != value]
        lost += [str(path) for path, content in self.files.items() if path.read_bytes() != content]
        self.known = now
        return lost


def in_view() -> Any:
    """Return a context of the largest 3D view of the first window, as buttons of its sidebar have it."""
    window = bpy.context.window_manager.windows[0]
    areas = sorted(window.screen.areas, key=lambda area: (area.type == "VIEW_3D", area.width * area.height))
    region = next(item for item in areas[-1].regions if item.type == "WINDOW")
    return bpy.context.temp_override(window=window, screen=window.screen, area=areas[-1], region=region)


def panel() -> Any:
    """Return what the panel holds for the window's scene."""
    return bpy.context.window_manager.windows[0].scene.noisy_world


def names_of_operators() -> list[str]:
    """Return the add-on's operators that draw nothing from the machine."""
    return sorted({f"noisy_world.{name}" for name in dir(bpy.ops.noisy_world)} - NEVER)


def some_operator() -> list[Any]:
    """Draw an operator and its arguments."""
    names = [name for name in names_of_operators() if getattr(bpy.ops.noisy_world, name.partition(".")[2]).poll()]
    name = DRAW.choices(names, [OFTEN.get(name, 1.0) for name in names])[0]
    operator = getattr(bpy.ops.noisy_world, name.partition(".")[2])
    arguments: dict[str, Any] = {}
    for item in operator.get_rna_type().properties:
        if item.identifier == "rna_type" or item.is_readonly or (item.is_hidden and item.type != "STRING"):
            continue
        if DRAW.random() < 0.7 or item.type in ("ENUM", "STRING"):
            value = some_value(item, None)
            if value is not None:
                flags = item.type == "ENUM" and item.is_enum_flag
                arguments[item.identifier] = set(value) if flags else value
    if "save" in name and "filepath" in arguments:  # over another file the browser would ask
        arguments["filepath"] = str(FOLDER / "preset.yaml")
    return [name, arguments, DRAW.choice(["EXEC_DEFAULT", "INVOKE_DEFAULT"])]


def use_operator(name: str, arguments: dict[str, Any], how: str) -> Any:
    """Press an operator's button, where it is not grey."""
    operator = getattr(bpy.ops.noisy_world, name.partition(".")[2])
    if not operator.poll(how):
        return "grey"
    try:
        return operator(how, True, **arguments)
    except TypeError as error:  # an entry that this state does not have
        return f"not now: {error}"


def groups(owner: Any, path: str = "", depth: int = 0) -> list[tuple[str, Any]]:
    """Return the property groups of the panel by their paths."""
    found = [(path, owner)]
    for item in owner.bl_rna.properties:
        if item.type == "POINTER" and item.identifier != "rna_type" and depth < 6:
            value = getattr(owner, item.identifier)
            if isinstance(value, bpy.types.PropertyGroup):
                found += groups(value, f"{path}.{item.identifier}", depth + 1)
        elif item.type == "COLLECTION" and depth < 6:
            for place, value in enumerate(getattr(owner, item.identifier)):
                if isinstance(value, bpy.types.PropertyGroup):
                    found += groups(value, f"{path}.{item.identifier}[{place}]", depth + 1)
    return found


def some_property() -> list[Any]:
    """Draw a property of the panel and a value of it."""
    steps = list(enumerate(panel().steps))
    if steps and DRAW.random() < 0.4:  # what an artist drags
        place, step = DRAW.choice(steps)
        owners = [
            (f".steps[{place}]", step),
            (f".steps[{place}].{step.perturbation}", getattr(step, step.perturbation, step)),
        ]
        path, owner = DRAW.choice(owners)
    else:
        found = [item for item in groups(panel()) if ".steps[" not in item[0]]
        path, owner = DRAW.choice([*found, *found[:1] * (len(found) // 2)])
    items = [item for item in owner.bl_rna.properties if is_drawn(item)]
    if not items:
        return [path, "", None]
    item = DRAW.choice(items)
    return [path, item.identifier, some_value(item, owner)]


def is_drawn(item: Any) -> bool:
    """Tell whether a property is one that a user sets."""
    return item.type not in ("POINTER", "COLLECTION") and not item.is_readonly and not item.is_hidden


def some_value(item: Any, owner: Any) -> Any:
    """Draw a value of a property."""
    if item.type == "BOOLEAN":
        return [DRAW.random() < 0.5 for _ in range(item.array_length)] if item.is_array else DRAW.random() < 0.5
    if item.type in ("INT", "FLOAT"):
        soft = DRAW.random() < 0.8
        low, high = (item.soft_min, item.soft_max) if soft else (item.hard_min, item.hard_max)
        low, high = max(low, -1e6), min(high, 1e6)
        whole = item.type == "INT"

        def one() -> float | int:
            value = DRAW.choice(
                [low, high, item.default, DRAW.uniform(low, high), min(max(DRAW.uniform(0, 4), low), high)]
            )
            return int(value) if whole else value

        if not soft and item.identifier.endswith(("width", "height")):
            return None  # a frame of a million pixels a side is no crash, only long
        return [one() for _ in range(item.array_length)] if item.is_array else one()
    if item.type == "ENUM":
        names = [entry.identifier for entry in item.enum_items_static] or [
            entry.identifier for entry in item.enum_items
        ]
        if item.is_enum_flag:
            return [name for name in names if DRAW.random() < 0.5]
        return DRAW.choice(names) if names else None
    if item.type == "STRING":
        return some_text(item)
    return None


def some_text(item: Any) -> str:
    """Draw what somebody types: a path that is there or not, a word, a number, YAML."""
    name = item.identifier
    if name in KNOWN:  # what a button gives, and nobody types
        return DRAW.choice(KNOWN[name])
    if name == "filepath" and DRAW.random() < 0.5:
        return DRAW.choice(PRESETS)
    if item.subtype in ("DIR_PATH", "FILE_PATH", "FILE_NAME") or "folder" in name or "file" in name:
        kinds = ["mesh.ply", "trajectory.txt", "preset.yaml", "nothing.ply", "out", "user.blend", ""]
        word = DRAW.choice(kinds)
        return str(FOLDER / word) if word else ""
    shipped = sorted(path.stem for path in (SOURCE.parent / "presets").rglob("*.yaml"))
    return DRAW.choice(["", "a", "room", "3", "[1, 3]", "{a: 1}", "Größe", "fog", "x" * 70, *DRAW.sample(shipped, 3)])


def set_property(path: str, name: str, value: Any) -> Any:
    """Set a property as a click does: with a step for undo."""
    if value is None:
        return "nothing"
    owner = next((item for at, item in groups(panel()) if at == path), None)
    if owner is None:
        return "gone"
    item = owner.bl_rna.properties[name]
    if item.type == "ENUM" and item.is_enum_flag:
        value = set(value)
    try:
        setattr(owner, name, value)
    except TypeError as error:  # an entry that is not there now
        return f"not now: {error}"
    bpy.ops.ed.undo_push(message=f"Set {name}")
    return "set"


def prepare(preview: bool) -> Any:
    """Let the panel show the small room and the short path: on a processor, drawing the embedded one takes seconds."""
    item = panel()
    item.mesh_source, item.of_mesh.mesh = "FILE", str(FOLDER / "mesh.ply")
    item.trajectory_source, item.scene.trajectory.file = "FILE", str(FOLDER / "trajectory.txt")
    item.camera.width, item.camera.height, item.camera.fx, item.camera.fy = 64, 36, 40, 40
    item.camera.cx, item.camera.cy = 31.5, 17.5
    item.preview = preview
    bpy.ops.ed.undo_push(message="Prepare")
    return "set"


def key_severity(frame: int, severity: float) -> Any:
    """Key a severity, as I does over its slider."""
    steps = panel().steps
    if not steps:
        return "nothing"
    steps[0].severity = severity
    steps[0].id_data.keyframe_insert("noisy_world.steps[0].severity", frame=frame)
    bpy.ops.ed.undo_push(message="Insert Keyframe")
    return "keyed"


def undo(times: int, back: int) -> Any:
    """Press Ctrl Z some times, and Ctrl Shift Z some."""
    pressed = [bpy.ops.ed.undo] * times + [bpy.ops.ed.redo] * back
    return [operator() for operator in pressed if operator.poll()]


def shade(kind: str, compositor: str) -> Any:
    """Choose how the 3D view shows the scene."""
    area = bpy.context.area
    if area.type != "VIEW_3D":
        return "no view"
    area.spaces.active.shading.type = kind
    area.spaces.active.shading.use_compositor = compositor
    return "set"


def look(kind: str) -> Any:
    """Let an area show something else, or the camera."""
    area = bpy.context.area
    if kind == "CAMERA":
        return bpy.ops.view3d.view_camera() if area.type == "VIEW_3D" else "no view"
    if kind == "SIDEBAR":
        if area.type != "VIEW_3D":
            return "no view"
        area.spaces.active.show_region_ui = True
        region = next(item for item in area.regions if item.type == "UI")
        with suppress(AttributeError, TypeError):
            region.active_panel_category = OURS
        return "set"
    other = min(bpy.context.window.screen.areas, key=lambda item: item.width * item.height)
    area = DRAW.choice([area, other]) if kind != "VIEW_3D" else area
    area.ui_type = kind
    return "set"


def render() -> Any:
    """Press F12 in Workbench."""
    scene = bpy.context.scene
    if scene.render.resolution_x * scene.render.resolution_y > 10**6:
        scene.render.resolution_percentage = 10
    return bpy.ops.render.render(scene=scene.name)


def go_to_frame(frame: int) -> Any:
    """Move in time."""
    bpy.context.scene.frame_set(frame)
    return "set"


def load_file(which: str) -> Any:
    """Open a user's file, or a new one."""
    if which == "new":
        return bpy.ops.wm.read_homefile(use_splash=False, use_empty=DRAW.random() < 0.3)
    return bpy.ops.wm.open_mainfile(filepath=str(FOLDER / which))


def save_file(name: str) -> Any:
    """Save the file, or a copy of it."""
    return bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / name), copy=DRAW.random() < 0.5)


def add_scene(kind: str) -> Any:
    """Press the button of the scene's menu."""
    if len(bpy.data.scenes) > 6:
        return "enough"
    return bpy.ops.scene.new(type=kind)


def delete_scene() -> Any:
    """Press the cross beside the scene's name."""
    return bpy.ops.scene.delete() if bpy.ops.scene.delete.poll() else "grey"


def go_to_scene(part: float) -> Any:
    """Choose a scene in the window."""
    scenes = list(bpy.data.scenes)
    bpy.context.window.scene = scenes[int(part * len(scenes))]
    return "set"


def delete_data(kind: str, part: float) -> Any:
    """Delete something, ours or the user's, as the outliner does."""
    kept = list(getattr(bpy.data, kind))
    if not kept:
        return "nothing"
    bpy.data.batch_remove([kept[int(part * len(kept))]])
    bpy.ops.ed.undo_push(message="Delete")
    return "deleted"


def rename_data(kind: str, part: float, name: str) -> Any:
    """Rename something."""
    kept = [item for item in getattr(bpy.data, kind) if item.library is None]
    if not kept:
        return "nothing"
    kept[int(part * len(kept))].name = name
    bpy.ops.ed.undo_push(message="Rename")
    return "renamed"


def restart_add_on() -> Any:
    """Switch the add-on off and on."""
    import noisy_world

    noisy_world.unregister()
    noisy_world.register()
    return "restarted"


def animate() -> Any:
    """Press space."""
    return bpy.ops.screen.animation_play()


def one(*items: Any) -> Callable[[], list[Any]]:
    """Return what draws one of the items as the only argument."""
    return lambda: [DRAW.choice(items)]


KINDS = ("objects", "node_groups", "images", "collections", "cameras", "meshes", "materials", "worlds", "actions")
ACTIONS: dict[Callable[..., Any], tuple[float, Callable[[], list[Any]]]] = {
    use_operator: (40, some_operator),
    set_property: (40, some_property),
    undo: (8, lambda: [DRAW.choice([1, 1, 2, 5]), DRAW.choice([0, 1, 2, 5])]),
    shade: (
        3,
        lambda: [DRAW.choice(["SOLID", "WIREFRAME", "RENDERED"]), DRAW.choice(["ALWAYS", "CAMERA", "DISABLED"])],
    ),
    look: (
        4,
        one(
            "CAMERA",
            "SIDEBAR",
            "SIDEBAR",
            "VIEW_3D",
            "VIEW_3D",
            "VIEW_3D",
            "IMAGE_EDITOR",
            "CompositorNodeTree",
            "PROPERTIES",
        ),
    ),
    render: (2, list),
    key_severity: (3, lambda: [DRAW.randint(0, 5), DRAW.uniform(1.0, 5.0)]),
    go_to_frame: (3, lambda: [DRAW.randint(-2, 12)]),
    load_file: (1.5, one("new", "user.blend", "other.blend", "saved.blend")),
    save_file: (1.5, one("saved.blend", "user.blend")),
    add_scene: (1.5, one("NEW", "EMPTY", "LINK_COPY", "FULL_COPY")),
    delete_scene: (1, list),
    go_to_scene: (2, lambda: [DRAW.random()]),
    delete_data: (2, lambda: [DRAW.choice(KINDS), DRAW.random()]),
    rename_data: (
        1,
        lambda: [DRAW.choice(KINDS), DRAW.random(), DRAW.choice(["Renamed", "Noisy World Camera", "Fog"])],
    ),
    restart_add_on: (0.7, list),
    animate: (1, list),
}
"""Each action with how often it comes, and what draws its arguments."""
BY_USER = {render, load_file, add_scene, delete_scene, delete_data, rename_data, go_to_scene}


main()
