# SPDX-License-Identifier: GPL-3.0-or-later
"""Light as output: refused of what has none, before anything is made."""

from dataclasses import replace

import pytest
from refusals import refused
from packed import write_preset
from worlds import write_world

from noisy_world.cli.generate import videos_of
from noisy_world.core.errors import StorageError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan


@pytest.mark.parametrize("made", ["recording", "mesh"])
def test_a_source_without_light(made, tmp_path):
    output = {"image": "exr"}
    if made == "recording":
        preset = write_preset(tmp_path, settings=[{"name": "clean"}], **output)
    else:
        preset = write_world(tmp_path / "world", frames=2, render={"engine": "embree"}, output=output)
    refused(make_plan, read_preset(preset), names=["output.image exr", "set output.image: png"])


def test_without_colour_its_kind_says_nothing(tmp_path):
    preset = write_preset(tmp_path, settings=[{"name": "clean"}], image="exr", modalities=["depth"])
    assert not make_plan(read_preset(preset)).format.of_light


def test_a_video_shows_no_light(tmp_path):
    preset = write_preset(tmp_path, settings=[{"name": "clean"}], image="exr", modalities=["rgb"])
    plan = make_plan(read_preset(write_preset(tmp_path / "other", settings=[{"name": "clean"}])))
    of_light = replace(plan, format=read_preset(preset).spec.output.format)
    refused(videos_of, of_light, tmp_path / "walk.mp4", overwrite=False, names="output.image exr", error=StorageError)
