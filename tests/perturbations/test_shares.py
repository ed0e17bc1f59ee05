# SPDX-License-Identifier: GPL-3.0-or-later
"""Mix and mask of a step: how much of its effect shows, where and when, by arrays; and what is refused."""

import cv2
import numpy as np
import pytest
from refusals import refused

from noisy_world.perturb import apply
from noisy_world.core.schema import ConfigPath
from noisy_world.dataset.identity import RecordedStep
from noisy_world.perturbations import registry
from noisy_world.perturbations.execution import ColourWork, on_light, perturb_rgb
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps

IMAGE = np.random.default_rng(3).random((6, 8, 3)).astype(np.float32)
WHERE = ConfigPath("preset.yaml", "perturb")


def steps_of(folder, *items):
    return parse_steps(items, ConfigPath(folder / "preset.yaml", "perturb"), registry())


def made(steps, index=0, image=IMAGE):
    return perturb_rgb(steps, image, FrameContext(index, (1, "room", "x")))


@pytest.fixture
def left(tmp_path):
    """A mask of half the size: white on the left, a grey of 51 in the middle, black on the right."""
    mask = np.zeros((6, 8), np.uint8)
    mask[:, :3], mask[:, 3:5] = 255, 51
    cv2.imwrite(str(tmp_path / "left.png"), mask)
    return tmp_path


def test_brightness_by_a_share_is_that_share_of_what_it_adds(left):
    """Brightness in ImageNet-C adds to HSV's value; a grey image just becomes lighter by that much."""
    grey = np.full((6, 8, 3), 64 / 255, np.float32)
    whole = {"brightness": {"offset": 0.4}}
    for share, level in (({}, 166), ({"mix": 0.5}, 115), ({"mix": 0.2, "mask": "left.png"}, None)):
        (pixels, notes) = made(steps_of(left, {"brightness": whole["brightness"] | share}), image=grey)
        assert notes[0].get("mix") == share.get("mix")
        if level is not None:
            assert np.ptp(pixels) == 0
            assert pixels[0, 0, 0] == level
            continue
        row = pixels[2, :, 1].tolist()
        assert row == [round(64 + 102 * 0.2 * white) for white in (1, 1, 1, 0.2, 0.2, 0, 0, 0)]
        assert notes[0]["mask"]["name"] == "left.png"
        assert len(notes[0]["mask"]["sha256"]) == 64


def test_what_is_mixed_is_what_a_file_would_hold(left):
    """The effect is clipped before it is mixed, as two layers of an image editor are."""
    (pixels, _) = made(steps_of(left, {"brightness": {"offset": 0.9, "mix": 0.5}}), image=np.full_like(IMAGE, 0.5))
    assert pixels[0, 0, 0] == round(0.75 * 255)


def test_each_frame_has_its_own_mix_and_mask_and_the_last_one_holds(left):
    for number, white in enumerate((0, 255)):
        (left / "masks").mkdir(exist_ok=True)
        cv2.imwrite(str(left / f"masks/{number}.png"), np.full((3, 4), white, np.uint8))
    grey = np.full((6, 8, 3), 64 / 255, np.float32)
    step = {"brightness": {"offset": 0.4, "mix": [1, 0.5, 0, 1.0, 1], "mask": "masks"}}
    (by,) = steps_of(left, step)
    found = [made([by], index, grey) for index in range(6)]
    assert [None if pixels is None else int(pixels[0, 0, 0]) for pixels, _ in found] == [64, 115, None, 166, 166, 166]
    assert found[2][1][0]["severity"] == 0
    assert "parameters" not in found[2][1][0]
    assert by.share.mix == (1, 0.5, 0, 1)  # what the last one holds for is not repeated


def test_light_is_mixed_as_light_and_lamps_keep_theirs(left):
    """Half of a lamp of 20 and half of it blurred away: the light of both, by the mean."""
    light = np.full((6, 8, 3), 0.1, np.float32)
    light[3, 4] = 20.0
    (whole,), (half,) = (
        steps_of(left, {"defocus_blur": {"radius_px": 2, "alias_sigma_px": 0.1} | share})
        for share in ({}, {"mix": 0.5})
    )
    where = FrameContext(0, (1, "room", "x"))
    one, both = (on_light(ColourWork.of([step], where), light) for step in (whole, half))
    np.testing.assert_allclose(both, (one + light) / 2, rtol=1e-5)
    assert both[3, 4].min() > 10


def test_equal_steps_of_other_shares_are_other_images_and_a_share_is_in_the_identity(left):
    plain, half, masked = (
        steps_of(left, {"contrast": {"severity": 2, **share}})[0] for share in ({}, {"mix": 0.5}, {"mask": "left.png"})
    )
    keys = {ColourWork.of([step], FrameContext(0, (1, "room", "x"))).key for step in (plain, half, masked)}
    assert len(keys) == 3
    assert "share" not in RecordedStep.of(plain).content()
    for step, share in ((half, {"mix": [0.5]}), (masked, {"mask": [step_mask(left)]})):
        content = RecordedStep.of(step).content()
        assert content["share"] == share
        assert RecordedStep.read(content) == RecordedStep.of(step)
    assert steps_of(left, {"contrast": {"severity": 2, "mix": 1.0}})[0] == plain  # which is what it is without the key


def step_mask(folder):
    import hashlib

    return hashlib.sha256((folder / "left.png").read_bytes()).hexdigest()


def test_the_library_takes_a_mix(left):
    whole, half = (apply(IMAGE, "contrast", 2, **share) for share in ({}, {"mix": 0.5}))
    np.testing.assert_allclose(half, (IMAGE + whole) / 2, atol=1e-6)


def test_a_colour_shows_as_much_in_each_channel(left):
    """Frost at full strength on black is the ice alone, so red, green and blue of it are the colour's shares."""
    frost = {"intensity": 0.0, "influence": 1.0}
    black = np.zeros((6, 8, 3), np.float32)
    (whole, _), (tinted, notes) = (
        made(steps_of(left, {"frost": frost | more}), image=black) for more in ({}, {"colour": [1, 0.5, 0], "mix": 0.5})
    )
    assert whole.max() > 50
    np.testing.assert_allclose(tinted, whole * [0.5, 0.25, 0.0], atol=0.51)
    assert notes[0]["colour"] == [1.0, 0.5, 0.0]
    (step,) = steps_of(left, {"frost": frost | {"colour": [1, 0.5, 0]}})
    content = RecordedStep.of(step).content()
    assert content["share"] == {"colour": [1.0, 0.5, 0.0]}
    assert RecordedStep.read(content) == RecordedStep.of(step)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"mix": 1.5}, ["mix", "0 to 1"]),
        ({"mix": "much"}, ["mix", "number"]),
        ({"mix": []}, ["mix", "empty"]),
        ({"mix": [0.5, True]}, ["mix.1", "number"]),
        ({"mask": "nothing.png"}, ["mask", "not there"]),
        ({"mask": 3}, ["mask", "image file"]),
        ({"mask": "empty"}, ["mask", "holds no image"]),
        ({"mask": "text.png"}, ["mask", "text.png"]),
        ({"mask": "clear.png"}, ["mask", "transparent"]),
    ],
)
def test_what_is_no_share_is_refused_in_a_line_that_names_its_key(left, values, names):
    (left / "empty").mkdir()
    (left / "text.png").write_text("no image")
    cv2.imwrite(str(left / "clear.png"), np.zeros((4, 4, 4), np.uint8))
    refused(steps_of, left, {"contrast": values}, names=["contrast.", *names])


def test_only_what_lies_over_the_image_has_a_colour(left):
    for value, name in (([1, 1], "red, green and blue"), ([1, 2, 1], "0 to 1"), ("red", "red, green and blue")):
        refused(steps_of, left, {"bloom": {"colour": value}}, names=["bloom.colour", name])
    refused(steps_of, left, {"contrast": {"colour": [1, 1, 1]}}, names="contrast.colour")


def test_only_colour_has_a_share(left):
    for name in ("depth_gaussian_noise", "desync", "motion_deviation"):
        refused(steps_of, left, {name: {"mix": 0.5}}, names=f"{name}.mix")
