# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets that grow: a world whose preset is changed as an editor would, and marks that show what was touched."""

import threading

import fake_session
import pytest
import yaml
from worlds import content, write_world
from runs import run

from noisy_world.core.errors import InterruptedRunError

PATH = "scenes.0.trajectory"
CLEAN = {"name": "clean"}
FOG = {"name": "fog", "perturb": [{"fog": {"severity": 3}}]}
NOISE = {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 2}}, {"depth_gaussian_noise": {"severity": 2}}]}
LATE = {"name": "late", "perturb": [{"desync": {"offset": 1}}]}
FAST = {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}
SHAKY = {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]}
THREE = [CLEAN, FOG, LATE]


def world(folder, **keys):
    """A world of eight poses; the preset uses the first six."""
    path = write_world(folder, frames=8, size=(16, 12), **{"settings": THREE, **keys})
    return change(path, {"scenes.0.trajectory": {"file": "traj.txt", "stop": 6}})


def change(path, values):
    """Change a preset's file as an editor would. values: by dotted keys."""
    document = yaml.safe_load(path.read_text())
    for name, value in values.items():
        *keys, last = (int(key) if key.isdecimal() else key for key in name.split("."))
        node = document
        for key in keys:
            node = node[key]
        node[last] = value
    path.write_text(yaml.safe_dump(document))
    return path


def marks(folder):
    """The bytes, the time of change and the inode of every image and text file but those of the whole dataset."""
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_ino)
        for path in folder.glob("*/**/*")
        if path.is_file()
    }


def at_once(preset, tmp_path):
    run(preset, tmp_path / "at_once")
    return content(tmp_path / "at_once")


def stopped(preset, out, frames):
    """Run until so many frames are rendered, as Ctrl-C does."""
    stop = threading.Event()
    original = fake_session.Session.frame

    def render(self, request):
        if request.index == frames - 1:
            stop.set()
        return original(self, request)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fake_session.Session, "frame", render)
        with pytest.raises(InterruptedRunError):
            run(preset, out, stop=stop)
