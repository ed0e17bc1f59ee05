# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of one stream draw equal random patterns: what they do alike is one file, and severities are comparable."""

import hashlib
from collections import Counter

import numpy as np
import pytest
from runs import run
from many_settings import image, records
from recipes_made import frames_from_arithmetic
from worlds import content, write_world

from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import SettingSpec, SweepSpec
from noisy_world.core.schema import ConfigPath
from noisy_world.core.streams import stream
from noisy_world.perturb import frames
from noisy_world.perturbations import registry

pytestmark = pytest.mark.usefixtures("no_blender")
COUNT = 16
SEED = 3  # of write_world
NOISE, HOLES = "gaussian_noise", "depth_random_missing"
SWEEP = {"severities": [1, 3], "modes": ["static", "dynamic"], "stream": "{perturb}"}
CHAIN = [{NOISE: {"severity": 3}}, {HOLES: {"severity": 3}}]
SETTINGS = [
    {"name": "clean"},
    {"sweep": {"perturb": [NOISE, HOLES], **SWEEP}},
    {"name": "own", "perturb": [{NOISE: {"severity": 3}}]},
    {"name": "kept", "stream": NOISE, "perturb": [{NOISE: {"severity": 3, "temporal": "fixed"}}]},
    {"name": "twice", "stream": NOISE, "perturb": [{NOISE: {"severity": 3}}, {NOISE: {"severity": 1}}]},
    {"name": "both", "stream": HOLES, "perturb": CHAIN},
    {"name": "late", "stream": HOLES, "perturb": [{HOLES: {"severity": 3}}, {"desync": {"offset": 2}}]},
    {"name": "fast", "stream": NOISE, "perturb": [{NOISE: {"severity": 3}}, {"faster_motion": {"factor": 2}}]},
]
KINDS = {NOISE: ("rgb", "frame"), HOLES: ("depth", "depth")}


def world_of(folder, settings, **keys):
    return write_world(folder, frames=COUNT, size=(24, 16), settings=settings, **keys)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("streams")
    with frames_from_arithmetic():
        run(world_of(folder / "world", SETTINGS), folder / "out")
    return folder / "out"


def levels_of(out, setting, modality):
    return [record["perturbed"][modality][0]["severity"] for record in records(out, setting)]


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("name", [NOISE, HOLES])
def test_a_dynamic_frame_is_the_static_one_of_its_level(out, name):
    modality, kind = KINDS[name]
    static = {0: "clean", 1: f"{name}_s1", 3: f"{name}_s3"}
    drawn = Counter()
    for setting in (f"{name}_s1_dynamic", f"{name}_s3_dynamic"):
        for frame, level in enumerate(levels_of(out, setting, modality)):
            drawn[level] += 1
            own = image(out, setting, kind, frame)
            for other, there in static.items():
                assert own.samefile(image(out, there, kind, frame)) == (level == other)
            if level in static:
                assert sha256(own) == sha256(image(out, static[level], kind, frame))
            assert records(out, setting)[frame]["perturbed"][modality][0]["stream"] == [SEED, "box", name, name, 0]
    assert set(drawn) == {0, 1, 2, 3}


def test_each_setting_draws_its_own_levels(out):
    for name, highest in ((f"{NOISE}_s1_dynamic", 1), (f"{NOISE}_s3_dynamic", 3)):
        wanted = [
            int(stream(SEED, "box", name, NOISE, 0, "severity", frame=frame).integers(highest + 1))
            for frame in range(COUNT)
        ]
        assert levels_of(out, name, "rgb") == wanted


def test_only_equal_work_is_shared(out):
    first = [image(out, f"{NOISE}_s3", "frame", frame) for frame in range(COUNT)]
    for other in ("own", "kept", "twice", "both", "clean", f"{NOISE}_s1"):
        assert all(sha256(image(out, other, "frame", k)) != sha256(first[k]) for k in range(COUNT)), other
    assert image(out, "fast", "frame", 0).samefile(first[0])
    assert sha256(image(out, "fast", "frame", 2)) != sha256(first[4]), "the same source frame, but the third it shows"
    holes = [image(out, f"{HOLES}_s3", "depth", frame) for frame in range(COUNT)]
    for frame in range(COUNT):
        assert holes[frame].samefile(image(out, "both", "depth", frame))
        assert image(out, "late", "depth", frame).samefile(holes[min(frame + 2, COUNT - 1)])


def test_the_stream_is_a_name_and_nothing_else(out, tmp_path):
    """A setting draws by another's name what that draws by its own, in another dataset."""
    renamed = {"name": "other", "stream": "own", "perturb": [{NOISE: {"severity": 3}}]}
    run(world_of(tmp_path / "renamed", [renamed]), tmp_path / "there")
    (own,) = [item for item in SETTINGS if item.get("name") == "own"]
    run(world_of(tmp_path / "plain", [own | {"stream": "own"}]), tmp_path / "plain/out")
    for frame in range(COUNT):
        wanted = sha256(image(out, "own", "frame", frame))
        assert sha256(image(tmp_path / "there", "other", "frame", frame)) == wanted
        assert sha256(image(tmp_path / "plain/out", "own", "frame", frame)) == wanted
    made = frames(out / "clean/box", [{NOISE: {"severity": 3}}], seed=SEED, setting="x", stream="own", scene="box")
    plain = frames(out / "clean/box", [{NOISE: {"severity": 3}}], seed=SEED, setting="own", scene="box")
    assert np.array_equal(next(made).rgb, next(plain).rgb)


def test_made_in_parts_it_is_the_same(out, tmp_path):
    preset = world_of(tmp_path / "parts", SETTINGS)
    run(preset, tmp_path / "grown", overrides=['only.settings=["*s3", "*s1_dynamic"]'], frames=slice(0, 7))
    run(preset, tmp_path / "grown", overrides=['only.settings=["*_dynamic"]'])
    run(preset, tmp_path / "grown")
    assert content(tmp_path / "grown") == content(out)


# Ties of bytes are kept clear by 1e-3 of one; gains are odd multiples of 2^-14.
@pytest.mark.parametrize(("name", "tolerance"), [(NOISE, 1e-5), ("speckle_noise", 2 * 2**-14)])
def test_severities_scale_one_field(name, tolerance):
    """Without rounding and clipping: the noise of severity 5 is that of severity 3, times the parameters' ratio."""
    sweep = SweepSpec(perturb=(name,), severities=(3.0, 5.0), modes=("static", "dynamic"), stream="{perturb}")
    settings = parse_settings([SettingSpec(sweep=sweep)], [ConfigPath("test")], registry())
    rgb = np.random.default_rng(1).uniform(0.2, 0.8, (40, 50, 3)).astype(np.float32)
    added = {}
    for setting in settings:
        (step,) = setting.rgb
        context = step.context(FrameContext(7, (SEED, "room", setting.name)))
        for severity in (3.0, 5.0):
            made = step.perturbation.apply(rgb, step.parameters(severity), context)
            added[setting.name, severity] = made.astype(np.float64) - rgb
    weak, strong = (added[f"{name}_s3", severity] for severity in (3.0, 5.0))
    assert np.abs(weak).max() > 0.1
    ratio = step.parameters(5.0).std / step.parameters(3.0).std
    np.testing.assert_allclose(strong, weak * ratio, rtol=0, atol=tolerance)
    for severity in (3.0, 5.0):
        assert len({made.tobytes() for (_, level), made in added.items() if level == severity}) == 1
