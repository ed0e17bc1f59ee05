# SPDX-License-Identifier: GPL-3.0-or-later
"""Light as half floats: what OpenEXR's own reader finds, what is beyond a half, and what an EXR is refused for."""

import io

import numpy as np
import OpenEXR
import pytest
from refusals import refused

from noisy_world.images.pixels import decode_light, encode_exr, encode_light
from noisy_world.images.image_files import read_header
from noisy_world.images.image_files import read_colour, read_light
from noisy_world.layouts import LAYOUTS, OutputFormat
from noisy_world.core.errors import NoisyWorldError


@pytest.fixture
def light():
    values = np.random.default_rng(2).random((20, 30, 3)).astype(np.float32) ** 4
    values[3:5, 6:9] = (4, 20, 100)
    values[7, 7] = 65504
    return values


def test_openexr_reads_half_floats_of_red_green_and_blue(light):
    data = encode_light(light)
    assert data == encode_light(light.copy())
    with OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
        found = file.channels()
        assert {name: found[name].pixels.dtype for name in found} == dict.fromkeys("RGB", np.dtype(np.float16))
        pixels = np.stack([found[name].pixels for name in "RGB"], axis=-1).astype(np.float64)
    assert np.array_equal(pixels, light.astype(np.float16))
    assert (np.abs(pixels - light) <= np.maximum(light * 2.0**-11, 2.0**-25)).all()  # half of a half float's step
    assert np.array_equal(decode_light(data), pixels)


def test_what_a_half_float_does_not_hold(light):
    light[0, 0] = 1e9
    assert decode_light(encode_light(light))[0, 0].tolist() == [65504.0] * 3
    for wrong in (np.nan, np.inf):
        light[1, 1, 2] = wrong
        refused(encode_light, light, names="1 pixels of light", error=NoisyWorldError)


def test_a_display_reader_refuses_light_and_others_read_it(light, tmp_path):
    path = tmp_path / "frame000000.exr"
    path.write_bytes(encode_light(light))
    assert (read_header(path).size_px, read_header(path).description) == ((30, 20), "an EXR of scene-linear light")
    assert np.array_equal(read_light(path, (30, 20)), light.astype(np.float16))
    refused(read_colour, path, (30, 20), names=("frame000000.exr: ", "scene-linear light"))
    refused(read_light, path, (31, 20), names=("30 x 20", "31 x 20"))


def test_an_exr_that_is_none_of_light(light, tmp_path):
    path = tmp_path / "frame000000.exr"
    for data, named in (
        (encode_exr(light, "XYZ"), "the channels X, Y, Z"),
        (encode_light(light)[:60], "no whole EXR"),
        (b"\x76\x2f\x31\x01" + bytes(40), "no whole EXR"),
    ):
        path.write_bytes(data)
        refused(read_header, path, names=("frame000000.exr: ", named))


def test_only_a_layout_that_takes_it_writes_it(light):
    assert [name for name, layout in LAYOUTS.items() if "exr" in layout.images] == ["replica"]
    layout = LAYOUTS["replica"]
    written = OutputFormat(layout, "exr", "rgb", ("rgb",), layout.depth_scale_per_m)
    assert written.names([0.0]).rgb(0) == "results/frame000000.exr"
    assert "find no colour in exr" in str(written.note)
