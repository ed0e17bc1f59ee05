# SPDX-License-Identifier: GPL-3.0-or-later
"""A file that is a parameter, in the tab: chosen, written into a preset, and read back."""

import bpy
import pytest
from refusals import refused
import yaml
from panel_tools import settings, use_files

from noisy_world.panel.document import open_preset
from noisy_world.panel.document import save_preset, steps_of

pytestmark = pytest.mark.usefixtures("add_on")


def test_a_table_is_a_file_of_the_tab_and_comes_back_from_a_preset(tmp_path):
    use_files(tmp_path)
    table = tmp_path / "warp.txt"
    table.write_text("\n".join(["head"] * 5 + ["9000 " * 22 + "1"] * 6400))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    assert bpy.ops.noisy_world.add_step(perturbation="redwood") == {"FINISHED"}
    group = settings().steps[0].redwood
    assert group.bl_rna.properties["warp"].subtype == "FILE_PATH"
    group.warp = "//warp.txt"
    assert steps_of(settings())[0].given["warp"] == str(table)
    save_preset(settings(), tmp_path / "mine.yaml")
    (setting,) = (
        item for item in yaml.safe_load((tmp_path / "mine.yaml").read_text())["settings"] if "perturb" in item
    )
    assert setting["perturb"][0]["redwood"]["warp"] == str(table)
    group.warp = ""
    assert "warp" not in steps_of(settings())[0].given
    open_preset(settings(), tmp_path / "mine.yaml")
    assert settings().steps[0].redwood.warp == str(table)
    table.unlink()
    refused(steps_of, settings(), names="warp.txt")
