# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbed datasets: what is done to which frame, what is shared, and that nothing depends on how it is run."""

import json
import subprocess
import sys
import threading

import cv2
import fake_session
import numpy as np
import pytest
from worlds import ROOT, content, write_world

from noisy_world.core.errors import InputError
from noisy_world.core.datasets.images import encode_colour
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.perturbing.kinds import FrameContext
from noisy_world.planning import make_plan
from noisy_world.core.presets.preset import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.core.schema import Place
from noisy_world.perturbations import registry
from noisy_world.pipeline.run import Run, split_work

SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]},
    {"name": "varied", "perturb": [{"gaussian_noise": {"severity": 5, "mode": "dynamic"}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 2}}]},
    {"name": "early", "perturb": [{"desync": {"offset": -1, "edge": "drop"}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 3}}]},
    {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]},
    {
        "name": "mixed",
        "perturb": [
            {"desync": {"offset": 1}},
            {"depth_random_missing": {"severity": 3}},
            {"jpeg_compression": {"severity": 2}},
            {"gaussian_noise": {"severity": 1}},
            {"faster_motion": {"factor": 2}},
        ],
    },
    {"sweep": {"perturb": ["brightness"], "severities": [1, 3], "modes": ["static", "dynamic"]}},
]
COUNT = 8


@pytest.fixture(autouse=True)
def _no_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.blender.session", fake_session)
    fake_session.Session.rendered.clear()


def run(preset, out, *, frames=None, overrides=(), stop=None):
    plan = make_plan(read_preset(preset, overrides), frames)
    return Run(plan, out, progress=PlainProgress(sys.stderr), stop=stop or threading.Event()).make_dataset()


@pytest.fixture
def world(tmp_path):
    return write_world(tmp_path / "world", frames=COUNT, size=(40, 32), settings=SETTINGS)


@pytest.fixture
def out(world, tmp_path):
    run(world, tmp_path / "out")
    return tmp_path / "out"


def image(out, setting, kind, frame, suffix="png"):
    return out / setting / "box" / "results" / f"{kind}{frame:06d}.{suffix}"


def numbers(out, setting, kind):
    return sorted(int(path.stem[-6:]) for path in (out / setting / "box/results").glob(f"{kind}*"))


def records(out, setting):
    return [json.loads(line) for line in (out / setting / "box" / "frames.jsonl").read_text().splitlines()]


def test_each_frame_is_rendered_once_for_all(out):
    # Once for all settings that leave the path alone, once for the one that does not.
    assert sorted(fake_session.Session.rendered) == sorted([*range(COUNT), *range(COUNT)])


def test_what_is_left_alone_is_linked(out):
    for frame in range(COUNT):
        clean = image(out, "clean", "depth", frame)
        assert clean.samefile(image(out, "noise", "depth", frame))
        assert not image(out, "clean", "frame", frame).samefile(image(out, "noise", "frame", frame))
        assert image(out, "clean", "frame", frame).samefile(image(out, "late", "frame", frame))
        assert clean.read_bytes() != image(out, "clean", "depth", (frame + 1) % COUNT).read_bytes()


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
    plan = make_plan(read_preset(world))
    pieces = []

    def workers(work, progress):
        pieces.extend(work)
        report = None
        for number, piece in reversed(list(enumerate(work))):
            run_ = Run(plan, tmp_path / "jobs", progress=progress, stop=threading.Event(), jobs=3)
            done = run_.take_part({name: frames[::-1] for name, frames in piece.items()}, number)
            report = done if report is None else (report.merge(done), report)[1]
        return report

    progress = PlainProgress(sys.stderr)
    Run(plan, tmp_path / "jobs", progress=progress, stop=threading.Event(), jobs=3, workers=workers).make_dataset()
    assert len(pieces) == 3
    assert content(tmp_path / "jobs") == content(out)
    assert split_work({"a": [1, 2]}, 5) == [{"a": [1]}, {"a": [2]}]


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


# --- existing sequences ---


def existing(tmp_path, source, **keys):
    camera = {"width": 40, "height": 32, "fx": 20.0, "fy": 20.0, "cx": 19.5, "cy": 15.5}
    render = {"backend": "reference"}
    preset = {"seed": 3, "scenes": [{"name": "box", "sequence": str(source)}], "camera": camera, "render": render}
    preset |= keys
    path = tmp_path / "existing.yaml"
    path.write_text(json.dumps(preset))
    return path


def test_an_existing_sequence_is_perturbed_as_rendered_frames_are(out, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.blender.session", None)  # importing it would fail
    settings = [item for item in SETTINGS if item.get("name") not in ("shaky", "mixed")]
    preset = existing(tmp_path, out / "clean" / "box", settings=settings, output={"image": "png"})
    report = run(preset, tmp_path / "again")
    assert report.frames_rendered == COUNT
    for setting in ("clean", "late", "early", "fast"):
        for path in (out / setting / "box/results").iterdir():
            other = tmp_path / "again" / setting / "box/results" / path.name
            assert other.read_bytes() == path.read_bytes()
            assert other.stat().st_ino in {item.stat().st_ino for item in (out / "clean/box/results").iterdir()}
    # The rendered frame was float before the noise, the stored one bytes: half a step apart at most, before rounding.
    for frame in range(COUNT):
        a, b = (
            cv2.imread(str(image(place, "noise", "frame", frame))).astype(int) for place in (out, tmp_path / "again")
        )
        assert np.abs(a - b).max() <= 1
    identity = json.loads((tmp_path / "again/manifest.json").read_text())["identity"]
    assert "blender" not in identity["versions"]
    assert len(identity["inputs"]["box"]["files_sha256"]) == 64


def test_a_tum_sequence_is_read_by_its_stamps(out, tmp_path):
    preset = existing(tmp_path, out / "clean" / "box", output={"layout": "tum"})
    run(preset, tmp_path / "tum")
    folder = tmp_path / "tum/clean/box"
    # Depth starts late and is listed out of step by less than the tolerance.
    lines = (folder / "depth.txt").read_text().splitlines()
    shifted = [
        line if line.startswith("#") else f"{float(line.split()[0]) + 0.01:.6f} {line.split()[1]}" for line in lines
    ]
    (folder / "depth.txt").write_text("\n".join(shifted[:2] + shifted[4:]) + "\n")
    path = existing(tmp_path, folder, output={"image": "png"})
    run(path, tmp_path / "back")
    assert len(records(tmp_path / "back", "clean")) == COUNT - 2
    for frame in range(COUNT - 2):
        back = cv2.imread(str(image(tmp_path / "back", "clean", "frame", frame)))
        assert np.array_equal(back, cv2.imread(str(image(out, "clean", "frame", frame + 2))))
        # 5000 steps a metre and back to 6553.5: half a step of each.
        steps = [
            cv2.imread(str(image(place, "clean", "depth", frame + extra)), cv2.IMREAD_UNCHANGED).astype(float)
            for place, extra in ((tmp_path / "back", 0), (out, 2))
        ]
        assert np.abs(steps[0] - steps[1]).max() <= 0.5 * 6553.5 / 5000 + 1.0


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda folder: (folder / "traj.txt").unlink(), "traj.txt"),
        (lambda folder: (folder / "results/depth000003.png").unlink(), "do not match"),
        (lambda folder: (folder / "results/frame000000.png").write_bytes(b"no image"), "frame000000.png"),
        (lambda folder: (folder.parent / "cam_params.json").write_text("{}"), "cam_params.json"),
        (lambda folder: (folder / "traj.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"), "1 poses for 8 frames"),
    ],
)
def test_a_broken_sequence_is_one_line_that_names_the_file(out, tmp_path, break_it, words):
    break_it(out / "clean/box")
    preset = existing(tmp_path, out / "clean" / "box")
    with pytest.raises(InputError, match=words) as error:
        run(preset, tmp_path / "again")
    assert "\n" not in str(error.value)


def test_what_an_existing_sequence_cannot_do(out, tmp_path):
    shaky = existing(tmp_path, out / "clean/box", settings=[{"name": "s", "perturb": [{"motion_deviation": None}]}])
    with pytest.raises(InputError, match="seen from elsewhere"):
        run(shaky, tmp_path / "x")
    small = existing(tmp_path, out / "clean/box", camera={"width": 4, "height": 3, "fx": 1, "fy": 1, "cx": 1, "cy": 1})
    with pytest.raises(InputError, match="40 x 32"):
        run(small, tmp_path / "x")
    with pytest.raises(InputError, match="no such folder"):
        run(existing(tmp_path, tmp_path / "nowhere"), tmp_path / "x")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="is no sequence; it has to have the files of a layout: Replica or TUM"):
        run(existing(tmp_path, empty), tmp_path / "x")
    gone = existing(
        tmp_path, out / "clean/box", settings=[{"name": "s", "perturb": [{"desync": {"offset": 99, "edge": "drop"}}]}]
    )
    with pytest.raises(InputError, match="leaves none of the 8 frames"):
        run(gone, tmp_path / "x")


def generate_without_blender(*arguments):
    script = (
        "import sys; sys.modules['bpy'] = None\n"
        "sys.path[:0] = sys.argv[1:3]\n"
        "import generate\n"
        "sys.exit(generate.main(sys.argv[3:]))"
    )
    paths = [str(ROOT / "addon"), str(ROOT / "headless")]
    command = [sys.executable, "-c", script, *paths, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_perturbing_a_sequence_by_the_reference_imports_no_blender(out, tmp_path):
    preset = existing(tmp_path, out / "clean" / "box", settings=SETTINGS[:3])
    result = generate_without_blender(preset, "--out", tmp_path / "b")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "b/noise/box/results/frame000007.jpg").exists()


def test_the_compositor_is_never_replaced_where_there_is_none(out, tmp_path):
    preset = existing(tmp_path, out / "clean" / "box", settings=SETTINGS[:2], render={})
    result = generate_without_blender(preset, "--out", tmp_path / "b")
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert "bpy" in line
    assert "render.backend=reference" in line
    assert not (tmp_path / "b").exists()
    # A setting may say for itself; and what leaves colour alone needs no compositor.
    settings = [{**SETTINGS[1], "backend": "reference"}, SETTINGS[3]]
    preset = existing(tmp_path, out / "clean" / "box", settings=settings, render={})
    assert generate_without_blender(preset, "--out", tmp_path / "b").returncode == 0


# --- mixtures ---


def test_equals_in_a_mixture_have_streams_of_their_own():
    steps = parse_steps([{"gaussian_noise": None}, {"gaussian_noise": None}], Place("x"), registry())
    first, second = (step.context(FrameContext(0, (1, "s", "t"))).stream().random(4) for step in steps)
    assert not np.array_equal(first, second)


def test_any_parameter_stands_over_the_severity():
    (step,) = parse_steps([{"gaussian_noise": {"severity": 5, "std": 0.01}}], Place("x"), registry())
    assert step.parameters(step.severity).std == 0.01
    (step,) = parse_steps([{"gaussian_noise": {"std": 0.02}}], Place("x"), registry())
    assert step.severity is None
    assert step.parameters(None).std == 0.02
    (step,) = parse_steps([{"gaussian_noise": {"severity": 2.5}}], Place("x"), registry())
    assert step.parameters(step.severity).std == pytest.approx(0.15)


def test_storing_adds_no_visible_perturbation():
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3)).astype(np.uint8), (0, 0), 3)
    stored = cv2.imdecode(np.frombuffer(encode_colour(smooth, "jpg"), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert cv2.PSNR(smooth, np.ascontiguousarray(stored)) > 48
