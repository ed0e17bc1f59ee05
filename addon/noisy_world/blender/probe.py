# SPDX-License-Identifier: GPL-3.0-or-later
"""Testing whether GL works here, in another process: where it does not, Blender may end without a message."""

import json
import subprocess
import sys

import bpy

from ..core.errors import MissingDependencyError
from ..core.messages import Message, PresetKey, either

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
print({MARK!r} + json.dumps([gpu.platform.renderer_get(), gpu.platform.version_get()]))
"""


def gl_version() -> str:
    """Render a few pixels with GL in another process; return GL's renderer and version.

    Raises MissingDependencyError, which names Debian's packages, where that fails.
    """
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
        message = f"EEVEE and Workbench need OpenGL, which fails here ({problem or 'it told nothing'})"
        other = Message("use ", PresetKey("render.engine", "cycles"), ", which needs none")
        raise MissingDependencyError(message, remedy=either(f"run: apt-get install {packages}", other))
    renderer, version = json.loads(answer[0].removeprefix(MARK))
    return f"{renderer}, {version}"
