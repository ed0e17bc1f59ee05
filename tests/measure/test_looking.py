# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults that are made in a sound recording are named with their figure, and nothing is said of the sound one."""

import json
import shutil
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from refusals import refused
from runs import run
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from noisy_world.cli import command
from noisy_world.core.schema import ConfigPath
from noisy_world.core.trajectory import FrameStamps, Stamps
from noisy_world.measure import looking
from noisy_world.measure.figure import Figure, jackknifed
from noisy_world.measure.looking import look_at, measured, remarks_on
from noisy_world.measure.motion import Steps
from noisy_world.measure.timing import per_frame, stamp_figures, without_gaps
from noisy_world.sources.recording import Recording, read_recording

GL = np.diag([1.0, -1.0, -1.0, 1.0])
TURN_DEG = (1.2, -1.2, 1.0)


@dataclass(frozen=True)
class Changed(Recording):
    """A recording with something done to its depth: a function of depth (H, W) and the camera's matrix."""

    change: Callable[..., np.ndarray] = np.asarray

    @contextmanager
    def prepare(self, camera, note):
        with super().prepare(camera, note) as opened:

            def frame(request):
                seen = opened.frame(request)
                return SimpleNamespace(rgb=seen.rgb, depth_m=self.change(seen.depth_m, camera.matrix))

            made = SimpleNamespace(frame=frame)
            made.open = lambda *_: made
            yield made


def turned(depth_m, matrix):
    """Depth as a camera sees it that is turned by TURN_DEG."""
    turn = matrix @ Rotation.from_rotvec(TURN_DEG, degrees=True).as_matrix() @ np.linalg.inv(matrix)
    return cv2.warpPerspective(depth_m, turn, depth_m.shape[::-1], flags=cv2.INTER_NEAREST)


def in_rows(depth_m, _):
    """Depth in every sixth row alone, as a lidar has it."""
    return np.where(np.arange(len(depth_m))[:, None] % 6 == 0, depth_m, 0)


def recording(folder):
    return read_recording(folder, ConfigPath("test"))


def told(source, **how):
    return look_at("walk", source, source.camera(None), **how)


def with_poses(source, change):
    path = source.stored.trajectory
    changed = replace(path, c2w=change(path.c2w), curve=None)
    return replace(source, stored=replace(source.stored, trajectory=changed))


def with_frames(source, colour, depth):
    """The recording with these frames of colour and of depth, under the stamps and poses of its own."""
    stored = source.stored
    count = len(colour)
    stamps_s = stored.stamps.rgb.seconds[:count]
    shown = replace(
        stored,
        rgb_files=tuple(stored.rgb_files[frame] for frame in colour),
        depth_files=tuple(stored.depth_files[frame] for frame in depth),
        trajectory=stored.trajectory.at(list(colour), stamps_s),
        stamps=FrameStamps.of(stamps_s),
        imu=None,
    )
    return replace(source, stored=shown)


def losing(source, late):
    """The recording with depth that is so many frames late, of which frames were lost; their stamps tell."""
    kept = [frame for frame in range(late, 100) if frame not in (20, 41, 42, 77)]
    shown = with_frames(source, kept, [frame - late for frame in kept])
    stamps = FrameStamps.of(source.stored.stamps.rgb.seconds[kept])
    return replace(shown, stored=replace(shown.stored, stamps=stamps))


def with_imu_later(source, seconds):
    imu = source.stored.imu
    samples = replace(imu.samples, stamps_ns=imu.samples.stamps_ns + round(seconds * 1e9))
    return replace(source, stored=replace(source.stored, imu=replace(imu, samples=samples)))


def scaled(source, times):
    return replace(source, stored=replace(source.stored, depth_scale_per_m=source.stored.depth_scale_per_m / times))


def doubled(source):
    count = len(source.stored.rgb_files)
    shown = [frame - 1 if frame % 7 == 6 else frame for frame in range(count)]
    path = source.stored.trajectory
    made = with_frames(source, shown, shown)
    return replace(made, stored=replace(made.stored, trajectory=path))


@pytest.fixture(scope="module")
def sound(walk):
    """What is told of each setting of the walk, of the noisy one its noise too."""
    noisy = recording(walk / "noisy/room")
    return {"clean": told(recording(walk / "clean/room")), "noisy": measured("walk", noisy, noisy.camera(None))}


@pytest.mark.parametrize("setting", ["clean", "noisy"])
def test_nothing_is_said_of_a_sound_recording(sound, setting):
    found = sound[setting]
    assert found.faults == ()
    assert found.figures["rate_hz"].value == pytest.approx(20, rel=1e-6)
    late = found.figures["depth_late_frames"]
    assert late.low - 0.15 < 0 < late.high + 0.15


def test_rows_of_a_lidar_are_no_edges(walk):
    source = recording(walk / "clean/room")
    found = told(Changed(source.stored, source.place, change=in_rows))
    assert found.faults == ()
    assert "void" in found.figures["depth_beside_colour_deg"].untold


FAULTS = {
    "scale": (lambda source: scaled(source, 5), "farther_than_depth_says", 0.2),
    "late": (lambda source: losing(source, 3), "depth_late_frames", 3.0),
    "early": (lambda source: with_frames(source, range(97), range(3, 100)), "depth_late_frames", -3.0),
    "imu": (lambda source: with_imu_later(source, 0.02), "imu_clock_by_poses_s", 0.02),
    "doubled": (doubled, "doubled_share", 1 / 7),
    "calibration": (
        lambda source: Changed(source.stored, source.place, change=turned),
        "depth_beside_colour_deg",
        np.linalg.norm(TURN_DEG),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_within_ten_percent(walk, fault):
    make, about, true = FAULTS[fault]
    found = told(make(recording(walk / "noisy/room")))
    assert about in found.told
    assert found.figures[about].value == pytest.approx(true, rel=0.1)
    if about == "depth_late_frames":  # edges are held against those of the colour that belongs to them
        assert found.told == (about,)


@pytest.mark.parametrize(
    ("change", "word"), [(np.linalg.inv, "world-to-camera"), (lambda c2w: c2w @ GL, "OpenGL")], ids=["w2c", "opengl"]
)
def test_poses_that_are_read_otherwise_are_named(walk, change, word):
    found = told(with_poses(recording(walk / "noisy/room"), change))
    assert found.told == ("poses",)
    assert word in found.faults[0]


def test_poses_with_stamps_of_another_clock_accuse_no_imu_that_fits_the_images(walk):
    source = recording(walk / "clean/room")
    stamps = source.stored.stamps
    later = replace(stamps, pose=Stamps(stamps.pose.seconds + 0.05))
    found = told(replace(source, stored=replace(source.stored, stamps=later)))
    assert found.figures["imu_clock_by_poses_s"].value == pytest.approx(-0.05, rel=0.1)
    assert not {"imu_clock_s", "imu_clock_by_poses_s"} & set(found.told)


def test_only_a_whole_interval_beyond_a_limit_is_sure():
    figure = Figure.within("late", 1.0, 0.2, 9)
    assert figure.high - 1.0 == pytest.approx(0.2 * student.ppf(0.975, 7), rel=1e-3)
    assert [figure.sure_beyond(limit) for limit in (0.5, 0.55)] == [True, False]
    assert [figure.plus(more).sure_beyond(0.5) for more in (-2.0, -1.0)] == [True, False]


def test_the_jackknife_of_a_mean_is_its_standard_error():
    samples = np.random.default_rng(1).normal(size=8)
    error = samples.std(ddof=1) / np.sqrt(8)
    assert jackknifed((samples.sum() - samples) / 7) == pytest.approx(error)


def test_stamps_that_are_missing_are_counted(walk):
    source = recording(walk / "clean/room")
    kept = [frame for frame in range(100) if frame % 10 not in (3, 4)]
    shown = with_frames(source, kept, kept)
    stamps = FrameStamps.of(source.stored.stamps.rgb.seconds[kept])
    shown = replace(shown, stored=replace(shown.stored, stamps=stamps))
    found = told(shown, looked_at=0)
    assert found.figures["missing_frames"].value == 20
    assert found.figures["longest_gap_s"].value == pytest.approx(0.15)
    assert found.told == ("missing_frames",)


def test_jitter_is_what_stamps_have_beside_an_even_clock():
    rng = np.random.default_rng(3)
    frames = np.flatnonzero(np.arange(90) % 11 != 7)
    off_s = rng.normal(0, 0.003, len(frames))
    even_s = 100 + frames / 29.7
    known_s = np.std(off_s - np.polyval(np.polyfit(frames, off_s, 1), frames))

    def jitter_s(stamps_s):
        return {figure.name: figure.value for figure in stamp_figures(stamps_s)}["jitter_s"]

    assert jitter_s(even_s + off_s) == pytest.approx(known_s, rel=1e-6)
    assert jitter_s(even_s) < 1e-9
    # A clock that goes ever slower does not jitter; its stamps do so by what is beside it.
    assert jitter_s(even_s + off_s + 1e-5 * frames**2) == pytest.approx(0.003, rel=0.25)


def test_steps_over_lost_frames_are_longer_and_no_faster():
    moves = np.array([[1.0], [2.0], [1.0]]) * np.arange(1.0, 7.0)
    steps = Steps(
        np.array([[0, 1], [1, 2], [2, 3]]),
        np.zeros(3, int),
        moves,
        np.ones((3, 6, 6)),
        np.ones((3, 6)),
        *np.zeros((2, 3), bool),
        np.zeros(3),
        {},
    )
    stamps_s = np.array([0.0, 0.1, 0.3, 0.4])  # a frame is lost between the second and the third
    made = per_frame(steps, stamps_s)
    assert made.move == pytest.approx(np.tile(moves[0], (3, 1)))
    # Of normal x = right with x twice as long: 4 normal (x / 2) = 2 right.
    assert [made.normal[1, 0, 0], made.right[1, 0]] == [4.0, 2.0]
    assert np.isnan(without_gaps(steps, stamps_s).move).all(axis=1).tolist() == [False, True, False]


def checked(capsys, *words):
    status = command.main(["check", *map(str, words)])
    return status, capsys.readouterr().out


def known(monkeypatch, name, found):
    """Let a command find at once what was found before; return the list of the files that it then asks about."""
    asked = []

    def look(name, source, camera):
        asked.append(source.stored.rgb_files[0])
        return found

    monkeypatch.setattr(looking, name, look)
    return asked


def test_the_command_says_it_on_a_page_and_as_json(walk, sound, capsys, monkeypatch):
    folder = walk / "clean/room"
    asked = known(monkeypatch, "look_at", sound["clean"])
    status, page = checked(capsys, folder)
    assert status == 0
    assert "nothing wrong" in page
    assert str(folder) in page.splitlines()[-1]
    status, text = checked(capsys, folder, "--json")
    (scene,) = json.loads(text)["scenes"]
    assert scene["faults"] == []
    assert scene["frames"] == 100
    assert {figure["name"] for figure in scene["figures"]} > {"rate_hz", "void_share", "imu_clock_s"}
    assert [folder in path.parents for path in asked] == [True, True]


def test_measure_prints_noise_too(walk, sound, capsys, monkeypatch):
    asked = known(monkeypatch, "measured", sound["noisy"])
    assert command.main(["measure", str(walk / "noisy/room"), "--json"]) == 0
    assert [walk / "noisy/room" in path.parents for path in asked] == [True]
    (scene,) = json.loads(capsys.readouterr().out)["scenes"]
    found = {figure["name"]: figure for figure in scene["figures"]}
    assert {"colour_gaussian_std", "gyro_noise_density", "doubled_share"} < set(found)
    # A Kinect's disparity has eighths of pixels, of 580 px and 75 mm.
    assert found["depth_step_per_m"]["value"] == pytest.approx(1 / (8 * 580 * 0.075), rel=0.05)


def test_a_preset_is_looked_at_with_its_keys(walk, tmp_path, capsys):
    preset = tmp_path / "p.yaml"
    scene = f"{{name: seen, sequence: {walk / 'clean/room'}, depth_scale_per_m: 1000}}"
    room = "{name: made, mesh: 'embedded:room', trajectory: {handheld: {frames: 5}}}"
    preset.write_text(f"scenes: [{scene}, {room}]\nsettings: [{{name: clean}}]\n")
    status, text = checked(capsys, preset, "--json", "--scenes", "seen")
    assert status == 1
    (found,) = json.loads(text)["scenes"]
    assert [fault["about"] for fault in found["faults"]] == ["farther_than_depth_says"]
    assert "depth_scale_per_m" in found["faults"][0]["text"]


def test_of_what_is_not_recorded_no_frame_is_looked_at():
    source = SimpleNamespace(capabilities=SimpleNamespace(recorded=False), remarks=lambda _: iter(["is small"]))
    assert list(remarks_on(source, None, 10_000)) == ["is small"]


def test_what_is_no_recording_is_refused(tmp_path, capsys):
    assert command.main(["check", str(tmp_path / "none")]) == 1
    assert "is not there" in capsys.readouterr().err
    assert command.main(["check", str(tmp_path), "--set", "seed=3"]) == 1
    assert "--set is for a preset" in capsys.readouterr().err


def test_few_frames_tell_little_and_break_nothing(walk):
    for count in (1, 2, 9):
        source = with_frames(recording(walk / "noisy/room"), range(count), range(count))
        found = measured("walk", source, source.camera(None))
        assert found.faults == ()
        assert found.frames == count
        assert found.figures["depth_late_frames"].value is None
        json.dumps([figure.content() for figure in found.figures.values()], allow_nan=False)


def test_a_run_says_faults_that_cost_little(walk, tmp_path):
    # Images of a recording are looked at where many are made of it; here stamps, poses and the IMU's clock are.
    folder = shutil.copytree(walk / "clean/room", tmp_path / "late")
    rows = (folder / "mav0/imu0/data.csv").read_text().splitlines()
    later = [f"{int(row.split(',')[0]) + 20_000_000},{row.split(',', 1)[1]}" for row in rows[1:]]
    (folder / "mav0/imu0/data.csv").write_text("\n".join([rows[0], *later]) + "\n")
    preset = tmp_path / "p.yaml"
    preset.write_text(
        f"scenes: [{{name: s, sequence: {folder}}}]\nsettings: [{{name: clean}}]\noutput: {{layout: euroc}}\n"
    )
    notes = [note for note in run(preset, tmp_path / "out", frames=slice(0, 2)).notes if "IMU" in note]
    assert len(notes) == 1
    assert notes[0].startswith("s: ")
    assert "20.0 ms" in notes[0]


def test_a_damaged_image_is_named(walk, tmp_path):
    folder = shutil.copytree(walk / "clean/room", tmp_path / "damaged")
    image = sorted((folder / "mav0/cam0/data").iterdir())[7]
    image.write_bytes(image.read_bytes()[:400])
    refused(told, recording(folder), names=image.name)
