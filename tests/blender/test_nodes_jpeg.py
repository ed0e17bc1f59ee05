"""JPEG's node group beside libjpeg: the same tables, the same blocks, the same bytes but for its integer transform."""

import cv2
import numpy as np
from cases import cases
from group_tools import IDENTIFIERS, keep_group, by_reference, levels_apart, picture, step_of
from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.jpeg_compression import CHROMA, LUMA

NAME = "jpeg_compression"
# Where a frame of each kind ends: with a block, within one, within a pair of blocks, of pixels; in the first block.
SIZES = [(96, 128), (67, 93), (41, 56), (120, 72), (9, 5), (1, 1), (1, 7)]
ZIGZAG = sorted(np.ndindex(8, 8), key=lambda place: (sum(place), place[(sum(place) + 1) % 2]))


def noise(height, width, seed=0):
    return (np.random.default_rng(seed).integers(0, 256, (height, width, 3)) / 255).astype(np.float32)


def by_nodes(image, qualities, reference_width=None):
    """What the group makes of the image at each quality: as group_tools' of the same name, all in one call."""
    chains = {f"{quality}": [step_of(NAME, quality=quality)] for quality in qualities}
    size = image.shape[1], image.shape[0]
    keep_group(NAME)
    with Compositor(size, chains, reference_width or size[0]) as compositor:
        made = compositor.evaluate(image, dict.fromkeys(chains, (0, IDENTIFIERS)))[0]
    return [made[name] for name in chains]


def levels_from_libjpeg(image, qualities):
    """The largest and the mean difference at each quality."""
    pairs = zip(by_nodes(image, qualities), qualities, strict=True)
    return np.array([levels_apart(ours, by_reference(NAME, image, quality=quality)[0]) for ours, quality in pairs])


@cases("quality", [10, 49, 50, 75])
def test_the_tables_are_those_that_libjpeg_writes(quality):
    image = np.zeros((8, 8, 3), np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    percent = 5000 // quality if quality < 50 else 200 - 2 * quality
    for number, table in enumerate((LUMA, CHROMA)):
        start = data.index(b"\xff\xdb\x00\x43" + bytes([number])) + 5
        written = np.zeros((8, 8), int)
        for place, value in zip(ZIGZAG, data[start : start + 64], strict=True):
            written[place] = value
        assert (np.clip((np.array(table) * percent + 50) // 100, 1, 255) == written).all()


def test_a_frame_is_libjpegs_at_every_severity():
    image, qualities = picture(203, 349), registry()[NAME].severities["quality"]
    assert len(qualities) == 5
    for ours, quality in zip(by_nodes(image, qualities), qualities, strict=True):
        theirs = by_reference(NAME, image, quality=quality)[0]
        assert levels_apart(image, theirs)[1] > 5
        assert levels_apart(ours, theirs)[1] < 0.02
        assert (np.abs(ours - theirs).max(axis=2) < 1e-4).mean() > 0.99


def test_a_frame_is_libjpegs_at_any_quality():
    assert levels_from_libjpeg(picture(136, 200), [1, 2, 30, 49, 50, 51, 75, 90, 95, 100])[:, 1].max() < 0.05


@cases("size", SIZES)
def test_blocks_are_counted_from_the_top_left_and_the_border_replicated(size):
    assert levels_from_libjpeg(noise(*size), [7, 75])[:, 1].max() < 0.1


@cases("level", [0, 127, 128, 255])
def test_a_flat_frame_is_libjpegs_to_the_byte(level):
    image = np.full((20, 26, 3), level / 255, np.float32)
    assert levels_from_libjpeg(image, [7, 12, 50])[:, 0].max() < 0.01


@cases("size", [(7, 1), (3, 3)])
def test_a_frame_that_is_very_narrow_stays_finite(size):
    # libjpeg enlarges its chroma in another way.
    assert levels_from_libjpeg(noise(*size), [15])[0, 1] < 20


def test_what_comes_out_is_whole_bytes_and_the_same_again():
    image = noise(40, 50)
    first, second = (by_nodes(image, [15])[0] for _ in range(2))
    assert (first == second).all()
    assert np.abs(first * 255 - np.rint(first * 255)).max() < 1e-4


@cases("divisor", [1, 2, 4])
def test_a_preview_has_the_frames_blocks(divisor):
    # At the lowest quality a block is flat: what changes, changes from block to block.
    ramp = np.tile(np.linspace(0.1, 0.9, 320 // divisor, dtype=np.float32)[None, :, None], (80 // divisor, 1, 3))
    steps = np.abs(np.diff(by_nodes(ramp, [1], reference_width=320)[0][:, :, 1], axis=1)).mean(axis=0)
    between = np.arange(1, 320 // divisor) % (8 // divisor) == 0
    assert steps[between].sum() > 0.98 * steps.sum() > 0.5


def test_a_preview_looks_like_the_frame_made_small():
    image = picture(272, 480)
    frame = by_reference(NAME, image, quality=10)[0]
    small, expected = (cv2.resize(item, (240, 136), interpolation=cv2.INTER_AREA) for item in (image, frame))
    shown = by_nodes(small, [10], reference_width=480)[0]
    assert levels_apart(shown, expected)[1] < 0.35 * levels_apart(small, expected)[1]


def test_an_image_larger_than_the_reference_has_blocks_of_its_own_pixels():
    image = picture(72, 120)
    shown = by_nodes(image, [15], reference_width=60)[0]
    assert levels_apart(shown, by_reference(NAME, image, quality=15)[0])[1] < 0.1


def test_its_inner_groups_are_no_assets():
    found, graphs = {}, [build_group(registry()[NAME])]
    while graphs:
        inner = [node.group for node in graphs.pop().nodes if node.group is not None]
        found |= {item.name: item.category for item in inner}
        graphs += inner
    assert set(found.values()) == {""}
    assert len(found) == 5
