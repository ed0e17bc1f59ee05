# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbed datasets: what is done to which frame, what is shared, and that nothing depends on how it is run."""

import json
import threading
import time
import weakref
from contextlib import contextmanager

import cv2
import fake_session
import numpy as np
import pytest
from runs import planned, run
from many_settings import COUNT, image, numbers, records
from shard_workers import workers_here
from worlds import content, write_world

from noisy_world.channels import COLOUR_AND_DEPTH
from noisy_world.dataset.frame import CleanFrame, PlannedFrame
from noisy_world.images import pixels as images
from noisy_world.images.pixels import encode_colour
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.dataset import making
from noisy_world.dataset.making import colour_of

pytestmark = pytest.mark.usefixtures("no_blender")


def test_each_frame_is_rendered_once_for_all(world, tmp_path):
    run(world, tmp_path / "out")
    # Once for all settings that leave the path alone, once for the one that does not.
    assert sorted(fake_session.Session.rendered) == sorted([*range(COUNT), *range(COUNT)])


def test_an_image_is_let_go_when_it_is_written(tmp_path, monkeypatch):
    settings = [{"name": f"s{k}", "perturb": [{"brightness": {"severity": k}}]} for k in range(1, 6)]
    write_world(tmp_path, frames=1, settings=settings, render={"backend": "reference"})
    made, alive, perturbed = [], [], CleanFrame.perturbed_rgb

    def watched(self, work):
        alive.append(sum(item() is not None for item in made))
        pixels = perturbed(self, work)
        made.append(weakref.ref(pixels))
        return pixels

    monkeypatch.setattr(CleanFrame, "perturbed_rgb", watched)
    run(tmp_path / "preset.yaml", tmp_path / "out")
    assert len(alive) == 5
    assert max(alive) <= 1


def test_what_is_left_alone_is_linked(out):
    for frame in range(COUNT):
        clean = image(out, "clean", "depth", frame)
        assert clean.samefile(image(out, "noise", "depth", frame))
        assert not image(out, "clean", "frame", frame).samefile(image(out, "noise", "frame", frame))
        assert image(out, "clean", "frame", frame).samefile(image(out, "late", "frame", frame))
        assert clean.read_bytes() != image(out, "clean", "depth", (frame + 1) % COUNT).read_bytes()


def test_a_planned_frame_tells_its_record_and_which_images_are_one(world, out):
    keys, files = [], []
    for render in planned(world).renders:
        for sequence in render.sequences:
            for index, record in zip(sequence.frames, records(out, sequence.setting.name), strict=True):
                frame = PlannedFrame(sequence, index)
                told = {name: done for name, done in record.get("perturbed", {}).items() if name != "motion"}
                assert json.loads(json.dumps(frame.record(COLOUR_AND_DEPTH, COLOUR_AND_DEPTH))) == told
                for channel, kind in (("rgb", "frame"), ("depth", "depth")):
                    keys.append((render.name, frame.key(channel)))
                    files.append(image(out, sequence.setting.name, kind, index).stat().st_ino)
    assert len(keys) > 100
    assert len({*zip(keys, files, strict=True)}) == len({*keys}) == len({*files})


def test_desynchronisation_pairs_as_it_says_and_writes_no_image(out):
    for frame in range(COUNT):
        assert image(out, "late", "depth", frame).samefile(image(out, "clean", "depth", min(frame + 2, COUNT - 1)))
    assert numbers(out, "early", "frame") == numbers(out, "early", "depth") == list(range(1, COUNT))
    for frame in range(1, COUNT):
        assert image(out, "early", "depth", frame).samefile(image(out, "clean", "depth", frame - 1))
    assert len((out / "early/box/traj.txt").read_text().splitlines()) == COUNT - 1
    assert [record["perturbed"]["pairing"]["depth_of_frame"] for record in records(out, "late")] == [
        2,
        3,
        4,
        5,
        6,
        7,
        7,
        7,
    ]


def test_faster_motion_is_every_nth_frame_with_its_own_pose(out):
    assert numbers(out, "fast", "frame") == [0, 1, 2]
    for frame in range(3):
        for kind in ("frame", "depth"):
            assert image(out, "fast", kind, frame).samefile(image(out, "clean", kind, 3 * frame))
    poses = np.loadtxt(out / "clean/box/traj.txt")
    assert np.array_equal(np.loadtxt(out / "fast/box/traj.txt"), poses[::3])
    assert [record["time_s"] for record in records(out, "fast")] == [
        record["time_s"] for record in records(out, "clean")
    ][:3]


def test_the_true_path_is_the_ground_truth_beside_the_nominal_one(out):
    nominal = np.loadtxt(out / "shaky/box/traj_nominal.txt")
    assert np.array_equal(nominal, np.loadtxt(out / "clean/box/traj.txt"))
    true = np.loadtxt(out / "shaky/box/traj.txt")
    assert true.shape == nominal.shape
    assert (np.abs(true - nominal).max(axis=1) > 1e-4).all()
    assert not (out / "clean/box/traj_nominal.txt").exists()


def test_a_mixture_is_its_parts_in_propagation_order(out, world):
    clean = [cv2.imread(str(image(out, "clean", "frame", k)), cv2.IMREAD_COLOR)[..., ::-1] for k in range(COUNT)]
    for frame in range(COUNT // 2):
        record = records(out, "mixed")[frame]
        assert [step["name"] for step in record["perturbed"]["rgb"]] == ["gaussian_noise", "jpeg_compression"]
        assert record["perturbed"]["pairing"] == {"depth_of_frame": min(frame + 1, COUNT // 2 - 1)}
        # By hand from the clean frame, whose bytes are within half a step of what was rendered.
        steps = registry()["gaussian_noise"], registry()["jpeg_compression"]
        pixels = (clean[2 * frame] / 255).astype(np.float32)
        for step, severity in zip(steps, (1, 2), strict=True):
            where = FrameContext(frame, (3, "box", "mixed", step.name, 0))
            pixels = np.clip(step.apply(pixels, step.at_severity(severity), where), 0, 1)
        mine = cv2.imread(str(image(out, "mixed", "frame", frame)), cv2.IMREAD_COLOR)[..., ::-1] / 255
        assert np.abs(mine - pixels).mean() < 0.01
    depth = [cv2.imread(str(image(out, "mixed", "depth", k)), cv2.IMREAD_UNCHANGED) for k in range(COUNT // 2)]
    for frame, steps in enumerate(depth):
        taken = min(frame + 1, COUNT // 2 - 1)
        true = cv2.imread(str(image(out, "clean", "depth", 2 * taken)), cv2.IMREAD_UNCHANGED)
        assert ((steps == true) | (steps == 0)).all()
        assert 0.1 < (steps == 0).mean() < 0.6
    # The last two frames show one and the same depth image, so its patches are the same ones.
    assert image(out, "mixed", "depth", 2).samefile(image(out, "mixed", "depth", 3))


def test_dynamic_severities_are_recorded_and_zero_is_the_clean_file(world, tmp_path):
    run(world, tmp_path / "out", overrides=["scenes.0.trajectory={handheld: {frames: 40}}"])
    found = records(tmp_path / "out", "varied")
    drawn = [record["perturbed"]["rgb"][0]["severity"] for record in found]
    assert set(drawn) <= {0, 1, 2, 3, 4, 5}
    assert len(set(drawn)) >= 4
    for frame, severity in enumerate(drawn):
        same = image(tmp_path / "out", "varied", "frame", frame).samefile(
            image(tmp_path / "out", "clean", "frame", frame)
        )
        assert same == (severity == 0)
    sweep = {path.name for path in (tmp_path / "out").iterdir() if path.name.startswith("brightness")}
    assert sweep == {"brightness_s1", "brightness_s1_dynamic", "brightness_s3", "brightness_s3_dynamic"}


def test_a_frame_alone_is_that_of_the_whole_run(world, out, tmp_path):
    whole = content(out)
    run(world, tmp_path / "part", frames=slice(3, 5))
    part = {name: data for name, data in content(tmp_path / "part").items() if "results" in name}
    assert len(part) > 20
    for name, data in part.items():
        assert data == whole[name], name
    assert numbers(tmp_path / "part", "mixed", "frame") == [3]
    assert not (tmp_path / "part/fast").exists()  # it has frames 0 to 2
    run(world, tmp_path / "part")
    assert {name for name, data in content(tmp_path / "part").items() if data != whole.get(name)} == set()
    assert content(tmp_path / "part").keys() == whole.keys()
    run(world, tmp_path / "part", frames=slice(3, 5))
    assert content(tmp_path / "part") == whole


def test_order_and_workers_change_no_byte(world, out, tmp_path):
    shards = []
    workers = workers_here(world, tmp_path / "jobs", order=lambda each: each[::-1], asked=shards)
    run(world, tmp_path / "jobs", jobs=3, workers=workers, shards=24)
    assert {shard.render for shard in shards} == {"box", "box@shaky"}
    assert len(shards) > 3, "more than workers, so that they take turns"
    assert content(tmp_path / "jobs") == content(out)


def test_a_lost_file_is_made_again_and_nothing_else(world, out):
    whole = content(out)
    lost = image(out, "mixed", "depth", 1)  # shows frame 2 of its own, 4 of the render
    lost.unlink()
    fake_session.Session.rendered.clear()
    run(world, out)
    assert fake_session.Session.rendered == [4]
    assert content(out) == whole


def test_parts_that_an_interrupted_choice_of_frames_left_go(world, out, tmp_path):
    # Frame 1 of `late` needs depth 3: with frames 1 to 2 alone it is whole, but a run killed between leaves halves.
    stop = threading.Event()
    part = tmp_path / "part"
    rendered = fake_session.Session.frame

    def render(self, frame):
        if frame.index == 2:
            stop.set()
        return rendered(self, frame)

    fake_session.Session.frame = render
    try:
        with pytest.raises(Exception, match="stopped"):
            run(world, part, stop=stop)
    finally:
        fake_session.Session.frame = rendered
    run(world, part, frames=slice(0, 1))
    for setting in ("late", "mixed", "early", "clean"):
        folder = part / setting / "box"
        if folder.exists():
            names = {name for record in records(part, setting) for name in record["sha256"]}
            assert {f"results/{path.name}" for path in (folder / "results").iterdir()} == names
            assert numbers(part, setting, "frame") == numbers(part, setting, "depth")
    run(world, part)
    assert content(part) == content(out)


# --- mixtures ---


def test_equals_in_a_mixture_have_streams_of_their_own():
    steps = parse_steps([{"gaussian_noise": None}, {"gaussian_noise": None}], ConfigPath("x"), registry())
    first, second = (step.context(FrameContext(0, (1, "s", "t"))).stream().random(4) for step in steps)
    assert not np.array_equal(first, second)


def test_any_parameter_stands_over_the_severity():
    (step,) = parse_steps([{"gaussian_noise": {"severity": 5, "std": 0.01}}], ConfigPath("x"), registry())
    assert step.parameters(step.severity).std == 0.01
    (step,) = parse_steps([{"gaussian_noise": {"std": 0.02}}], ConfigPath("x"), registry())
    assert step.severity is None
    assert step.parameters(None).std == 0.02
    (step,) = parse_steps([{"gaussian_noise": {"severity": 2.5}}], ConfigPath("x"), registry())
    assert step.parameters(step.severity).std == pytest.approx(0.15)


def test_storing_adds_no_visible_perturbation():
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3)).astype(np.uint8), (0, 0), 3)
    stored = cv2.imdecode(np.frombuffer(encode_colour(smooth, "jpg"), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert cv2.PSNR(smooth, np.ascontiguousarray(stored)) > 48


def test_what_is_made_once_for_a_scene_counts_as_loading(tmp_path, monkeypatch):
    @contextmanager
    def slowly(*asked, **keys):
        end_s = time.process_time() + 0.4
        while time.process_time() < end_s:
            pass
        with colour_of(*asked, **keys) as made:
            yield made

    monkeypatch.setattr(making, "colour_of", slowly)
    preset = write_world(tmp_path / "world", frames=1, size=(8, 6), settings=[{"name": "clean"}])
    report = run(preset, tmp_path / "out")
    assert report.processor_s["loading"] >= 0.4 > report.processor_s["rendering"]


def test_a_clean_image_has_the_usual_huffman_tables_however_noisy_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "NOISY", -1)
    settings = [{"name": "clean"}, {"name": "noise", "perturb": [{"gaussian_noise": None}]}]
    preset = write_world(tmp_path / "world", frames=1, size=(40, 32), settings=settings, output={"image": "jpg"})
    run(preset, tmp_path / "out")
    # Annex K.3 of ITU-T T.81: how many codes of the luminance's DC coefficients have 1, 2 and more bits.
    usual = bytes([0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0])
    found = [usual in image(tmp_path / "out", name, "frame", 0, "jpg").read_bytes() for name in ("clean", "noise")]
    assert found == [True, False]
