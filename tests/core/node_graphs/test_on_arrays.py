"""Described node groups carried out on arrays, against numpy and closed forms; Blender itself is in tests/blender."""

import numpy as np
import pytest
from noisy_world.core.node_graph import Graph, GroupInput
from noisy_world.core.graph_arrays import BAND_ROWS, carried_out, image_of

EXTEND = {"Extension X": "Extend", "Extension Y": "Extend"}


def graph_of(describe, inputs=("Image",)):
    graph = Graph("Test", "For a test")
    sockets = [graph.input(GroupInput(name, "color", (0.0, 0.0, 0.0, 1.0), "An image")) for name in inputs]
    result = describe(graph, *sockets)
    graph.output("Image", result, "color", "The result")
    return graph


def made(describe, image):
    found = carried_out(graph_of(describe), {"Image": image})["Image"]
    return image_of(found, image.shape[:2])


@pytest.fixture
def image():
    return np.random.default_rng(5).random((3 * BAND_ROWS + 5, 23, 3)).astype(np.float32)


def test_arithmetic_is_numpys(image):
    found = made(lambda graph, item: graph.math("MULTIPLY_ADD", item, (2.0, 3.0, 4.0), item * item), image)
    assert np.allclose(found, image * (2, 3, 4) + image**2, rtol=1e-6)
    found = made(
        lambda graph, item: graph.vector(*[graph.math("SQRT", graph.math("DOT_PRODUCT", item, item))] * 3), image
    )
    assert np.allclose(found[..., 0], np.linalg.norm(image, axis=2), rtol=1e-6)


def test_images_are_mixed_by_one_share_or_by_one_for_each_channel(image):
    for share in (0.25, (0.0, 0.25, 1.5)):  # a share is clamped
        found = made(lambda graph, item, share=share: graph.blend(item, item * 3.0, share), image)
        assert np.allclose(found, image * (1 + 2 * np.clip(share, 0, 1)), rtol=1e-6)


def test_division_by_zero_is_zero_and_a_choice_takes_one_branch(image):
    found = made(lambda graph, item: graph.math("DIVIDE", item, item * 0.0), image)
    assert not found.any()
    found = made(lambda graph, item: graph.choose(graph.math("GREATER_THAN", 2.0, 1.0), item, item * 5.0), image)
    assert np.array_equal(found, image)


def test_columns_are_counted_from_the_left_and_rows_from_below(image):
    found = made(
        lambda graph, item: graph.node("CompositorNodeImageCoordinates", {"Image": item}).out("Pixel", "vector"), image
    )
    height, width = image.shape[:2]
    assert np.array_equal(found[..., 0], np.tile(np.arange(width), (height, 1)))
    assert np.array_equal(found[::-1, :, 1], np.tile(np.arange(height)[:, None], (1, width)))


def test_a_group_inside_is_done_in_bands_and_as_a_whole_alike(image):
    part = Graph("Part", "For a test")
    item = part.input(GroupInput("Of", "vector", (0.0, 0.0, 0.0), "A vector"))
    part.output("Same", item * item + item.x, "vector", "The result")
    assert image.shape[0] > 2 * BAND_ROWS
    found = made(lambda graph, item: graph.group(part, {"Of": item}).out("Same", "vector"), image)
    assert np.allclose(found, image**2 + image[..., :1], rtol=1e-6)


def test_what_is_looked_up_and_moved(image):
    def upside_down(graph, item):
        place = graph.node("CompositorNodeImageCoordinates", {"Image": item}).out("Normalized", "vector")
        where = graph.math("MULTIPLY_ADD", place, (1.0, -1.0, 0.0), (0.0, 1.0, 1.0))
        return graph.node(
            "CompositorNodeMapUV", {"Image": item, "UV": where, "Interpolation": "Bilinear", **EXTEND}
        ).out("Image", "color")

    assert np.allclose(made(upside_down, image), image[::-1], atol=1e-5)
    by = {"Displacement": (3.0, -2.0), "Interpolation": "Nearest", **EXTEND}
    found = made(
        lambda graph, item: graph.node("CompositorNodeDisplace", {"Image": item, **by}).out("Image", "color"), image
    )
    assert np.array_equal(found[2:, 3:], image[:-2, :-3])  # to the right and, as rows are counted from below, down


def test_means_of_blocks_begin_at_the_lower_left(image):
    found = made(
        lambda graph, item: graph.node("CompositorNodePixelate", {"Color": item, "Size": 8.0}).out("Color", "color"),
        image,
    )
    assert np.allclose(found[-8:, :8], image[-8:, :8].mean(axis=(0, 1)), atol=1e-6)
    assert np.allclose(found[-8:, 16:], image[-8:, 16:].mean(axis=(0, 1)), atol=1e-6)


def test_a_blur_keeps_the_light_of_what_lies_inside():
    image = np.zeros((41, 41, 3), np.float32)
    image[20, 20] = 100
    inputs = {"Size": (9.0, 9.0), "Type": "Gaussian", "Separable": True}
    found = made(
        lambda graph, item: graph.node("CompositorNodeBlur", {"Image": item, **inputs}).out("Image", "color"), image
    )
    assert found.sum() == pytest.approx(300, rel=1e-5)
    assert found[20, 23, 0] / found[20, 20, 0] == pytest.approx(np.exp(-0.5), rel=1e-4)  # sigma is a third of the size


def test_a_node_that_has_no_counterpart_is_said(image):
    with pytest.raises(ValueError, match=r"CompositorNodeLensdist .* no counterpart on arrays"):
        made(lambda graph, item: graph.node("CompositorNodeLensdist", {"Image": item}).out("Image", "color"), image)
    inputs = {"Size": (9.0, 9.0), "Type": "Tent", "Separable": True}
    with pytest.raises(ValueError, match="Tent"):
        made(
            lambda graph, item: graph.node("CompositorNodeBlur", {"Image": item, **inputs}).out("Image", "color"), image
        )
