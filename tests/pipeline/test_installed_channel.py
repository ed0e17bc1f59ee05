# SPDX-License-Identifier: GPL-3.0-or-later
"""The channel of docs/examples/my_lab, of an installed package: listed, written, and in the panel."""

import json
import os
import re
import subprocess
import sys

import cv2
import installed_package
import numpy as np
import pytest
from worlds import BLENDER_IS_HERE, ROOT, write_world

from noisy_world.channels import in_order
from noisy_world.core.errors import NoisyWorldError

pytest.importorskip("embreex", reason="embreex comes with an extra")

FACING = (ROOT / "docs/examples/my_lab/my_lab/facing.py").read_text(encoding="utf-8")
PROGRAM = """
import sys
from noisy_world.cli import command
for words in (["list", "channels"], ["generate", "world/preset.yaml", "--out", "out"]):
    if command.main(words):
        sys.exit(f"{words} ended with an error")
"""
PANEL = """
import bpy, noisy_world
noisy_world.register()
panel = bpy.context.scene.noisy_world
choices = panel.output.bl_rna.properties["modalities"].enum_items
print("panel", "facing" in panel.output.modalities, choices["facing"].name)
panel.output.modalities |= {"facing"}
from noisy_world.panel.document import to_document
print("written", to_document(panel)["output"]["modalities"])
"""


def run(folder, site, program=PROGRAM):
    return subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(site), str(ROOT / "addon")])},
        check=False,
    )


def test_the_channel_of_a_package(tmp_path):
    entries = {"channels": {"facing": "my_channel.facing:CHANNEL"}}
    modules = {"__init__.py": "", "facing.py": FACING}
    site = installed_package.install(tmp_path / "site", "my-channel", "1.0", entries, modules, kind=None)
    output = {"layout": "euroc", "modalities": ["depth", "normal", "facing"]}
    write_world(tmp_path / "world", frames=2, render={"engine": "embree", "backend": "reference"}, output=output)
    result = run(tmp_path, site)
    assert result.returncode == 0, result.stderr
    assert re.search(
        r"facing +how far the surface faces the camera: uint16 = .*; from my-channel 1\.0\n", result.stdout
    )
    sequence = tmp_path / "out/clean/box/mav0"
    files = sorted((sequence / "facing0/data").iterdir())
    assert len(files) == 2
    for file in files:
        facing = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        normal = cv2.imread(str(sequence / "normal0/data" / file.name), cv2.IMREAD_UNCHANGED)
        assert facing is not None
        assert normal is not None
        towards = np.maximum(1 - 2 * (normal[..., 0] / 65535), 0)  # OpenCV gives z first
        assert np.abs(facing / 65535 - towards).max() < 3e-5
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["identity"]["versions"]["my-channel"] == "1.0"
    assert manifest["conventions"]["facing"].startswith("uint16")

    if BLENDER_IS_HERE:
        shown = run(tmp_path, site, PANEL)
        assert "panel False Facing\n" in shown.stdout, shown.stderr
        assert "written ['rgb', 'depth', 'facing']\n" in shown.stdout

    (site / "my_channel/facing.py").write_text(FACING.replace('    unit = "1"\n', ""))
    refused = run(tmp_path, site)
    assert refused.returncode
    assert "lacks unit" in refused.stdout + refused.stderr


def test_a_channel_whose_package_is_not_installed_is_never_left_out():
    with pytest.raises(NoisyWorldError, match=r"there is no channel facing here: install the package that brings it"):
        in_order(["depth", "facing"])
