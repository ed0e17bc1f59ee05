# SPDX-License-Identifier: GPL-3.0-or-later
"""What is imported is what is used: a subcommand loads nothing that it does not need."""

import json
import os
import subprocess
import sys

import pytest
from worlds import ROOT, generate_here, write_world

PROGRAM = """
import json, sys
from noisy_world.cli.command import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print()
print(json.dumps([name.removeprefix("noisy_world.") for name in sys.modules]))
"""
ARRAYS = ["numpy", "cv2", "yaml", "OpenEXR", "scipy", "pandas"]
PARTS = ["perturbations", "layouts", "channels", "preset", "scenes", "images", "sources", "dataset", "render", "nodes"]


def loaded(*words):
    """The names of the modules that a command line loads, ours without the package's name."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "addon")}
    command = [sys.executable, "-c", PROGRAM, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    "words",
    [["--version"], ["--help"], ["score", "--help"], ["generate", "nowhere.yaml"], ["list", "presets"]],
    ids=" ".join,
)
def test_what_needs_no_arrays_loads_none(words):
    modules = loaded(*words)
    assert not {*ARRAYS, *PARTS} & set(modules)


def test_a_subcommand_loads_no_other():
    ours = {name for name in loaded("--version") if name.startswith("cli.")}
    assert ours == {"cli.arguments", "cli.command", "cli.entry", "cli.system_libraries"}


def test_status_loads_no_perturbation_no_plan_and_no_source(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    noisy = {"name": "fog", "perturb": [{"fog": {"severity": 3}}]}
    render = {"engine": "embree", "backend": "reference"}
    preset = write_world(
        tmp_path / "world", frames=2, size=(16, 12), settings=[{"name": "clean"}, noisy], render=render
    )
    generate_here(preset, "--out", tmp_path / "out")
    modules = loaded("status", tmp_path / "out")
    assert "dataset.status" in modules
    assert not [
        name for name in modules if name.split(".")[0] in ("perturbations", "sources", "render", "nodes", "rooms")
    ]
    assert not {"dataset.plan", "dataset.estimate", "preset.keys", "cv2", "yaml", "bpy"} & set(modules)
