# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy-Replica, Noisy-Rooms and the mixtures: the paper's counts, by its list of statistics."""

from collections import Counter
from itertools import product

import pytest
from worlds import ROOT, generate_here, path_poses, write_box_ply, write_replica

from noisy_world.perturbations.kinds import ColourPerturbation, DepthPerturbation
from noisy_world.dataset.plan import read_settings
from noisy_world.preset.keys import read_preset
from noisy_world.sources.replica_scenes import REPLICA_SCENES
from noisy_world.perturbations import registry

REPLICA, ROOMS, MIXED = (ROOT / f"presets/noisy_{name}.yaml" for name in ("replica", "rooms", "replica_mixed"))
FRAMES = 3
# The names of the paper's taxonomy, as its tables have them.
COLOUR = (
    "gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise", "defocus_blur", "glass_blur", "motion_blur",
    "gaussian_blur", "snow", "frost", "fog", "spatter", "brightness", "contrast", "pixelate", "jpeg_compression",
)  # fmt: skip
DEPTH = ("depth_gaussian_noise", "depth_edge_erosion", "depth_random_missing", "depth_range_clipping")


def settings_of(preset):
    return {item.name: item for item in read_settings(read_preset(preset), registry())}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """Replica as its download has it, of boxes, with paths beside it."""
    data = tmp_path_factory.mktemp("data")
    for scene in REPLICA_SCENES:
        for folder in (data / f"replica_v1/{scene[:-1]}_{scene[-1]}", data / f"Replica/{scene}"):
            folder.mkdir(parents=True)
        write_box_ply(data / f"replica_v1/{scene[:-1]}_{scene[-1]}/mesh.ply")
        write_replica(data / f"Replica/{scene}/traj.txt", path_poses(FRAMES))
    return data


def test_the_dry_run_says_a_thousand_sequences_and_128_renders(tree):
    said = generate_here(REPLICA, "--data", tree, "--dry-run").stdout
    assert "sequences  1000 (8 scenes, 125 settings)\n" in said
    assert f"renders    128, {128 * FRAMES} frames in all\n" in said
    assert "camera     1200 x 680, fx 600, fy 600\n" in said
    assert len(said.splitlines()) < 30
    listed = generate_here(REPLICA, "--data", tree, "--list").stdout.splitlines()
    assert len(set(listed)) == len(listed) == 1000
    assert "fog_s3_static/room0" in listed
    assert Counter(name.partition("/")[2] for name in listed) == dict.fromkeys(REPLICA_SCENES, 125)


def test_a_part_is_planned_by_the_same_command(tree):
    part = [REPLICA, "--data", tree, "--scenes", "room*,office0", "--settings", "fog*", "--settings", "clean"]
    assert "sequences  28 (4 scenes, 7 settings)\n" in generate_here(*part, "--dry-run").stdout
    assert generate_here(*part, "--list", "settings").stdout.split() == ["clean", *(
        f"fog_s{severity}_{mode}" for severity, mode in product((1, 3, 5), ("static", "dynamic"))
    )]  # fmt: skip
    refused = generate_here(REPLICA, "--data", tree, "--scenes", "kitchen", "--dry-run", check=False)
    assert (refused.returncode, refused.stderr.count("\n")) == (1, 1)
    assert "'kitchen' matches none of 8 scenes; near it: room0, " in refused.stderr


def test_the_settings_are_those_of_the_papers_statistics():
    settings = settings_of(REPLICA)
    degrees, metres = (0, 1, 3, 5), ("0", "0.0125", "0.025", "0.05")
    expected = {
        "colour": [f"{n}_s{s}_{m}" for n, s, m in product(COLOUR, (1, 3, 5), ("static", "dynamic"))],
        "depth": [f"{name}_s3" for name in DEPTH],
        "speed": ["speed_x2", "speed_x4", "speed_x8"],
        "deviation": [f"deviation_{d}deg_{m}m" for d, m in product(degrees, metres) if (d, m) != (0, "0")],
        "desync": [f"desync_{k}_{m}" for k, m in product((5, 10, 20), ("static", "dynamic"))],
    }
    counts = {name: len(names) for name, names in expected.items()}
    assert counts == {"colour": 96, "depth": 4, "speed": 3, "deviation": 15, "desync": 6}
    assert sorted(settings) == sorted(["clean", *(name for names in expected.values() for name in names)])
    for name in expected["colour"]:
        (step,) = settings[name].steps
        kind, severity, mode = name.rsplit("_", 2)
        assert isinstance(step.perturbation, ColourPerturbation)
        assert (step.perturbation.name, step.severity, dict(step.given)) == (kind, int(severity[1:]), {})
        assert step.levels == (None if mode == "static" else tuple(float(k) for k in range(int(severity[1:]) + 1)))
    for name in expected["depth"]:
        (step,) = settings[name].steps
        assert isinstance(step.perturbation, DepthPerturbation)
        assert (f"{step.perturbation.name}_s3", step.severity, step.levels) == (name, 3, None)
    for name in expected["speed"]:
        (step,) = settings[name].steps
        assert (step.perturbation.name, dict(step.given)) == ("faster_motion", {"factor": int(name[-1])})
    for name in expected["deviation"]:
        (step,) = settings[name].steps
        given = (step.given["rotation_deg"], step.given["translation_m"])
        assert name == f"deviation_{given[0]:g}deg_{given[1]:g}m"
        assert step.perturbation.name == "motion_deviation"
    for name in expected["desync"]:
        (step,) = settings[name].steps
        assert name == f"desync_{step.given['offset']}_{step.given['mode']}"
        assert step.parameters(None).edge == "clamp"  # each sequence keeps its 2,000 frames


def test_the_rooms_have_the_same_settings():
    replica, rooms = settings_of(REPLICA), settings_of(ROOMS)
    assert list(replica) == list(rooms)
    assert replica == rooms
    said = generate_here(ROOMS, "--list", "scenes", "--settings", "clean").stdout.splitlines()
    assert [line.split()[:3] for line in said] == [[f"room{k}", "2,000", "frames"] for k in range(8)]


def test_the_mixtures_are_the_papers_six_columns(tree):
    settings = settings_of(MIXED)
    done = [[step.perturbation.name for step in setting.steps] for setting in settings.values()]
    rows = ["snow", "motion_blur", "gaussian_noise", "jpeg_compression", "depth_gaussian_noise", "desync"]
    assert done == [rows[:count] for count in range(7)]
    assert all(step.severity in (3, None) and step.levels is None for item in settings.values() for step in item.steps)
    assert read_preset(MIXED).spec.seed == read_preset(REPLICA).spec.seed
    assert "sequences  56 (8 scenes, 7 settings)\n" in generate_here(MIXED, "--data", tree, "--dry-run").stdout
