"""Written groups in two: what chains of one stream draw alike, and the rest."""

import pytest
from noisy_world.nodes.chain import build_written
from noisy_world.nodes.chain import divided
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

NOISE = "ShaderNodeTexWhiteNoise"


def step_of(name, **values):
    (step,) = parse_steps([{name: values}], ConfigPath("test"), registry())
    return step


def kinds(graph):
    return [graph.nodes[number].idname for number in graph.reachable()]


@pytest.mark.parametrize("name", ["gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise", "glass_blur"])
def test_all_noise_of_a_group_is_drawn_apart(name):
    whole = build_written([step_of(name, severity=3)])
    parts = divided(whole)
    assert NOISE in kinds(whole)
    assert NOISE in kinds(parts.draws)
    assert NOISE not in kinds(parts.rest)
    given = {item.name for item in parts.rest.inputs}
    assert {item.name for item in parts.draws.outputs} <= given
    # What a severity decides is asked for by the rest alone, and the seed by the draws alone.
    label = next(item.name for item in whole.inputs if item.name.endswith(": Seed"))
    assert label in {item.name for item in parts.draws.inputs}
    assert label not in given
    assert [item.name for item in parts.rest.outputs] == ["Image", "Bytes"]


@pytest.mark.parametrize("name", ["brightness", "gaussian_blur", "jpeg_compression", "motion_blur", "snow"])
def test_a_group_whose_random_images_depend_on_its_severity_stays_whole(name):
    # Motion blur draws one number, and snow's noise has as many cells as its scale says.
    assert divided(build_written([step_of(name, severity=3)])) is None


def test_what_a_second_step_draws_for_the_first_one_s_image_is_its_own():
    steps = [step_of("gaussian_noise", severity=3), step_of("shot_noise", severity=3)]
    parts = divided(build_written(steps))
    # Each is drawn by four numbers or, quickly, by two that the frame's own stretch.
    assert kinds(parts.draws).count(NOISE) == 3
    assert kinds(parts.rest).count(NOISE) == 3
