# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera decides by earlier frames is the same in a run, by any jobs, of a frame alone, and of a recording."""

import math
import threading
from types import SimpleNamespace

import cv2
import fake_session
import numpy as np
import pytest
import yaml
from cases import cases
from runs import run
from many_settings import image, records
from recipes_made import make
from recorded_presets import preset_of
from shard_workers import workers_here
from srgb import linear
from worlds import write_world

import noisy_world
from noisy_world.core.errors import InterruptedRunError
from noisy_world.dataset.frame import EarlierFrames
from noisy_world.perturb import frames

COUNT, RATE_HZ, LAG_S = 12, 20.0, 0.08
PHONE = [
    {"auto_exposure": {"lag_s": LAG_S, "max_ms": 20.0}},
    {"flicker": {"severity": 3}},
    {"sensor_noise": {"severity": 2}},
    {"white_balance": {"lag_s": 0.15}},
]
SETTINGS = [
    {"name": "clean"},
    {"name": "phone", "perturb": PHONE},
    {"name": "fast", "perturb": [*PHONE, {"faster_motion": {"factor": 3}}]},
    {"name": "late", "perturb": [*PHONE, {"desync": {"offset": 2, "edge": "drop"}}]},
]


def light_of(frame):
    """The light goes on and off: 1 for four frames, then 0.1."""
    return 1.0 if frame // 4 % 2 == 0 else 0.1


@pytest.fixture(autouse=True)
def lamps(no_blender, monkeypatch):
    original = fake_session.Session.frame

    def lit(self, request):
        found = original(self, request)
        if found.rgb is not None:
            found.rgb = found.rgb * np.float32(light_of(request.index))
        return found

    monkeypatch.setattr(fake_session.Session, "frame", lit)


def world(folder, **keys):
    keys.setdefault("settings", SETTINGS)
    return write_world(folder, frames=COUNT, size=(16, 12), output={"layout": "replica", "image": "png"}, **keys)


@pytest.fixture
def made(lamps, tmp_path):
    run(world(tmp_path / "world"), tmp_path / "out")
    return tmp_path


def preset_in(made):
    return next((made / "world").glob("preset.*"))


def content(out):
    return {str(path.relative_to(out)): path.read_bytes() for path in out.glob("*/box/**/*") if path.is_file()}


def test_records_say_exposure_and_gain_and_they_follow_the_formula(made):
    clean = [cv2.imread(str(image(made / "out", "clean", "frame", k)))[..., ::-1] / 255 for k in range(COUNT)]
    wanted = [math.log2(0.18 / (linear(rgb) @ [0.2126, 0.7152, 0.0722]).mean()) for rgb in clean]
    wanted = np.clip(wanted, math.log2(0.05 / 10), math.log2(20 / 10) + 24 / (20 * math.log10(2)))
    for setting, step in (("phone", 1), ("fast", 3)):
        now = wanted[0]
        for record in records(made / "out", setting):
            k = record["frame"]
            if k:
                now += (1 - math.exp(-1 / (RATE_HZ * LAG_S))) * (wanted[(k - 1) * step] - now)
            camera = record["perturbed"]["camera"]
            assert set(camera) == {"exposure_ms", "gain_db", "flicker", "red_gain", "green_gain", "blue_gain"}
            assert camera["exposure_ms"] == pytest.approx(10 * 2 ** min(now, 1), rel=1e-3)
            assert camera["gain_db"] == pytest.approx(max(now - 1, 0) * 20 * math.log10(2), abs=1e-2)
    assert "camera" not in records(made / "out", "clean")[0].get("perturbed", {})


def test_a_step_is_given_no_more_of_the_past_than_it_asks_for():
    # At 10 Hz: 0.25 s before frame 8 frame 5 was shown, and frame 3 as long before as any step of the setting asks.
    sequence = SimpleNamespace(setting=SimpleNamespace(looks_back_s=0.45), source_frames=range(10))
    earlier = EarlierFrames(np.arange(10) / 10, lambda source: np.full((1, 1, 3), source, np.float32))
    read, _ = earlier.before(sequence, 8)
    assert [int(frame.light.max()) for frame in read(0.25)] == [5, 6, 7]
    assert [int(frame.light.max()) for frame in read(0.45)] == [3, 4, 5, 6, 7]


@cases("jobs", [2, 3])
def test_any_jobs_make_the_same(made, jobs):
    path, out = preset_in(made), made / f"jobs{jobs}"
    workers = workers_here(path, out, order=lambda shards: shards[::-1])
    run(path, out, jobs=jobs, workers=workers)
    assert content(out) == content(made / "out")


@cases("first", [1, 5, 11])
def test_a_frame_alone_is_that_of_the_run(made, first):
    path = preset_in(made)
    fake_session.Session.rendered.clear()
    out = made / f"alone{first}"
    run(path, out, frames=slice(first, first + 1), overrides=["only.settings=[phone]"])
    assert image(out, "phone", "frame", first).read_bytes() == image(made / "out", "phone", "frame", first).read_bytes()
    (alone,), whole = records(out, "phone"), records(made / "out", "phone")
    assert alone["perturbed"] == whole[first]["perturbed"]
    assert len(fake_session.Session.rendered) <= first + 2, (
        "what was before it, and itself: a first look, then the frame"
    )


def test_a_run_renders_each_frame_once(tmp_path):
    fake_session.Session.rendered.clear()
    run(world(tmp_path / "world"), tmp_path / "out")
    assert sorted(fake_session.Session.rendered) == list(range(COUNT))


def test_what_was_made_before_a_stop_is_kept(made):
    path, out, stop = preset_in(made), made / "stopped", threading.Event()
    original = fake_session.Session.frame

    def until(self, request):
        if request.index == 5:
            stop.set()
        return original(self, request)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fake_session.Session, "frame", until)
        with pytest.raises(InterruptedRunError):
            run(path, out, stop=stop)
    there = {path: path.stat().st_ino for path in out.glob("phone/box/results/*")}
    assert there
    run(path, out)
    assert content(out) == content(made / "out")
    assert {path: path.stat().st_ino for path in there} == there, "nothing was made again"


def test_a_recording_is_seen_as_what_was_rendered(made):
    """Its frames are sRGB files; the light in them is what sRGB's inverse says, and the rest is the same."""
    source = made / "out/clean/box"
    seed = yaml.safe_load(preset_in(made).read_text()).get("seed", 0)
    preset = preset_of(made / "p", {"name": "box", "sequence": str(source)}, settings=SETTINGS[1:2])
    run(preset, made / "again", overrides=["output.image=png", f"seed={seed}"])
    told, rendered = records(made / "again", "phone"), records(made / "out", "phone")
    assert [each["perturbed"]["camera"] for each in told] == [each["perturbed"]["camera"] for each in rendered]
    for item in frames(source, PHONE, seed=seed, setting="phone", scene="box", rate_hz=RATE_HZ):
        written = cv2.imread(str(image(made / "again", "phone", "frame", item.index)))[..., ::-1]
        assert np.array_equal(item.rgb, written)


def test_a_recipe_makes_the_same_frames(tmp_path):
    recipe = make(tmp_path, settings=SETTINGS, output={"layout": "replica", "image": "png"})
    with noisy_world.open(recipe.recipe, recipe.clean) as opened:
        for name in ("phone/box", "fast/box"):
            for index in (2, 0, 1):
                found = opened[name][index]
                written = recipe.out / name / f"results/frame{index:06d}.png"
                assert np.array_equal(found.rgb, cv2.imread(str(written))[..., ::-1])
