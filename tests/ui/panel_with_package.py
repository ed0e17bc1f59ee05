# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person does in the panel with an installed package's perturbations; `test_installed_panel` runs it.

python panel_with_package.py WORLD: takes WORLD/preset.yaml into the panel, and prints what came of it as JSON.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

from keyed_poses import keyed_poses
from panel_tools import open_document

import noisy_world
from noisy_world.core.errors import InputError

world_folder = Path(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
noisy_world.register()

from noisy_world.panel import source_views
from noisy_world.panel import document, frame_preview, gallery, drawn_paths, preview, step_list, loading

scene = bpy.context.scene
settings = scene.noisy_world
told = {}


def keyed():
    return keyed_poses(scene, scene.camera, np.arange(scene.frame_end + 1)).tolist()


# By hand: from the menu, with sliders.
found = gallery.offered(gallery.PACKAGES)
told["menus"] = {stage: [item.name for item in found if item.stage == stage] for stage in ("motion", "pairing")}
settings.mesh_source = settings.trajectory_source = "FILE"
settings.of_mesh.mesh, settings.scene.trajectory.file = str(world_folder / "mesh.ply"), str(world_folder / "traj.txt")
settings.scene.name = "box"
settings.seed = 3
loading.load_scene(scene)
loading.load_path(scene)
told["clean keys"] = keyed()
bpy.ops.noisy_world.add_step(perturbation="fog")
told["keys with fog"] = keyed()
bpy.ops.noisy_world.add_step(perturbation="lift")
told["added keys"] = keyed()
step = settings.steps[settings.active_step]
step.use_severity = False
step.lift.height_m, step.lift.shiver_m = 0.25, 0.5
told["slid keys"] = keyed()
told["lines"] = drawn_paths.drawn_poses(scene, drawn_paths.clean_poses(scene)).tolist()
step.enabled = False
told["keys when off"] = keyed()
told["lines when off"] = drawn_paths.drawn_poses(scene, drawn_paths.clean_poses(scene))
told["refused"] = []
try:
    bpy.ops.noisy_world.add_step(perturbation="lift")
except RuntimeError as error:
    told["refused"].append(str(error))
bpy.ops.noisy_world.add_step(perturbation="stutter")
told["stuttering lines"] = drawn_paths.drawn_poses(scene, drawn_paths.clean_poses(scene)).tolist()
told["order"] = [item.perturbation for item in settings.steps]

# A preset that says them.
document.open_preset(settings, world_folder / "preset.yaml")
loading.load_scene(scene)
loading.load_path(scene)
told["opened"] = document.perturb_of(settings)
told["opened keys"] = keyed()
scene.frame_set(4)
sequence, index = frame_preview.sequence_of(scene)
told["shows"] = [list(sequence.source_frames), index]
picture, _ = frame_preview.draw_colour(scene, 2)
told["red"] = float(picture[..., 0].mean())
told["depth"] = frame_preview.draw_depth(scene, 0)[1]
document.save_preset(settings, world_folder / "saved.yaml")

# A motion that breaks its contract, and a perturbation that is not installed any more.
from noisy_world.perturbations import registry

lift = registry()["lift"]
before = keyed()
object.__setattr__(lift, "apply", lambda path, *_: type(path)(path.c2w[1:], path.stamps_s[1:]))
next(item for item in settings.steps if item.perturbation == "lift").lift.height_m = 0.5
told["keys stay"] = keyed() == before
settings.steps.clear()
settings.steps.add().perturbation = "gone"
try:
    document.steps_of(settings)
except InputError as error:
    told["gone"] = f"{type(error).__name__}: {error}"
told["has depth steps"] = preview.has_depth_steps(settings)
step_list.add_step(settings, "fog")

# A source that the package brings.
from noisy_world.panel import document, wording
from noisy_world.panel.properties import ITEMS

settings.steps.clear()
told["source"] = next(item[:3] for item in ITEMS if item[0] == "corridor")
corridor = settings.of_corridor.corridor
told["source fields"] = {key: corridor.bl_rna.properties[key].name for key in ("width_m", "frames")}
settings.mesh_source, settings.scene.name = "corridor", "hall"
corridor.width_m, corridor.frames = 3.3, 7
told["source entry"] = document.scene_of(settings)
content = document.to_document(settings)
content["scenes"] = [{"name": "hall", "corridor": {"width_m": 2.5, "frames": 5}}]
content["camera"] = {"width": 64, "height": 48, "fx": 64, "fy": 64, "cx": 32, "cy": 24}
open_document(content, world_folder / "corridor.yaml")
told["source taken"] = [corridor.width_m, corridor.frames, settings.scene.name]
shown = document.recorded(settings)
told["source frames"] = len(shown.stamps_s)
told["source depth"] = float(source_views.still(shown, 0).depth_m[24, 0])
document.save_preset(settings, world_folder / "corridor.yaml")
content["scenes"][0]["corridor"]["width_m"] = 0
try:
    open_document(content, world_folder / "corridor.yaml")
except InputError as error:
    told["source error"] = wording.spoken(error.message, str(world_folder / "corridor.yaml"))
noisy_world.unregister()
print("TOLD " + json.dumps(told, default=lambda value: np.asarray(value).tolist()))
