# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of poses as a preset names them: keys, notes, and what is refused at which key."""

import json
import time

import numpy as np
import pytest
from refusals import refused
from cases import cases
from worlds import write_world

from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

EYE = "1 0 0 0\n0 1 0 0\n0 0 1 1\n0 0 0 1\n"
LOST = "-inf -inf -inf -inf\n" * 4


@pytest.fixture
def planned(tmp_path):
    preset = write_world(tmp_path)

    def plan(**trajectory):
        text = ", ".join(f"{key}: {value}" for key, value in trajectory.items())
        return make_plan(read_preset(preset, [f"scenes.0.trajectory={{{text}}}"]))

    return plan


def source_of(plan):
    return plan.renders[0].scene.source


def test_a_folder_of_poses_is_a_path(planned, tmp_path):
    (tmp_path / "pose").mkdir()
    for number, text in ((0, EYE), (1, LOST), (10, EYE)):
        (tmp_path / f"pose/{number}.txt").write_text(text)
    source = source_of(planned(file="pose", rate_hz=10))
    np.testing.assert_array_equal(source.stamps_s, [0.0, 1.0])
    (note,) = source.trajectory().notes
    assert note.startswith("pose: 1 of 3 poses are not finite (tracking was lost) and are left out, first 1.txt")
    before = source.hashes()["trajectory_sha256"]
    (tmp_path / "pose/10.txt").write_text(EYE.replace("0 0 1 1", "0 0 1 2"))
    assert source.hashes()["trajectory_sha256"] != before
    assert source_of(planned(file="pose")).hashes()["trajectory"] == "pose"


def test_transforms_json_has_its_own_axes_and_camera(planned, tmp_path):
    blender = np.diag([1.0, -1.0, -1.0, 1.0])  # a camera that looks along world z, y down, in OpenGL's axes
    document = {"fl_x": 20.0, "w": 640, "frames": [{"file_path": "0.png", "transform_matrix": blender.tolist()}]}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    source = source_of(planned(file="transforms.json"))
    np.testing.assert_array_equal(source.trajectory().c2w, [np.eye(4)])
    assert source.robot_axes == "opengl"
    (note,) = source.trajectory().notes
    assert note.startswith("transforms.json: states another camera, width 640 (the preset's: ")
    assert note.endswith("; the preset's camera is used")
    declared = source_of(planned(file="transforms.json", axes="opencv"))
    np.testing.assert_array_equal(declared.trajectory().c2w, [blender])
    assert declared.robot_axes == "opencv"


def test_axes_are_opencvs_where_nothing_says_otherwise(planned):
    assert source_of(planned(file="traj.txt")).robot_axes == "opencv"
    assert source_of(planned(handheld="{frames: 3}")).robot_axes == "opencv"


def test_keys_for_what_content_cannot_tell(planned, tmp_path):
    (tmp_path / "ms.csv").write_text("0,0,0,1,0,0,0,1\n50,0,0,1,0,0,0,1\n")
    refused(planned, file="ms.csv", names="too close for EuRoC's nanoseconds")
    np.testing.assert_array_equal(
        source_of(planned(file="ms.csv", format="tum", stamp_unit="ms")).stamps_s, [0.0, 0.05]
    )
    refused(planned, file="ms.csv", stamp_unit="min", names=("scenes.0.trajectory.stamp_unit: ", "'min'"))


@cases(
    ("keys", "words"),
    [
        ({"resample_hz": 20}, ("trajectory.resample_hz: ", "20 Hz", "1e+09 s", "2e+10")),
        ({"resample_hz": 10_000, "every": 100_000}, ("trajectory.resample_hz: ", " makes 1e+13 poses")),
        (
            {"resample_hz": 10_000, "start": 1, "stop": 2},
            ("trajectory.resample_hz: ", "1,000,000", "at most 0.00099"),
        ),
    ],
)
def test_absurd_numbers_of_poses_are_refused_at_once(planned, tmp_path, keys, words):
    (tmp_path / "gap.txt").write_text("0.5 0 0 1 0 0 0 1\n1000000000.5 0 0 1 0 0 0 1\n")
    began = time.process_time()
    refused(planned, file="gap.txt", **keys, names=words)
    assert time.process_time() - began < 1.0
    assert len(source_of(planned(file="gap.txt")).stamps_s) == 2
    assert len(source_of(planned(file="gap.txt", stop=1, resample_hz=1.0e-9)).stamps_s) == 1


@cases(
    ("keys", "words"),
    [
        ("{frames: 1000000, rate_hz: 0.001}", ("handheld: ", "1,000,000", "0.001 Hz", "100,000 s")),
        ("{frames: 2, rate_hz: 1.0e-310}", ("trajectory.handheld: ", "1e-310 Hz")),
        ("{frames: 1000000, speed_m_s: 10}", ("trajectory.handheld: ", "500 km", "more than 50")),
    ],
)  # fmt: skip
def test_walks_without_end_are_refused(planned, keys, words):
    refused(planned, handheld=keys, names=words)


def test_a_rate_without_meaning_is_refused(planned):
    refused(planned, file="traj.txt", rate_hz="1.0e-300", names=("1e-300 Hz", "raise rate_hz"))
