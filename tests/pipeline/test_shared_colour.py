# SPDX-License-Identifier: GPL-3.0-or-later
"""What several settings do alike to a frame is made once and linked, and only that."""

from collections import Counter
from dataclasses import fields

import numpy as np
import pytest
from runs import run
from many_settings import image, records
from recipes_made import frames_from_arithmetic
from worlds import write_world

from noisy_world.perturbations.kinds import ColourPerturbation, FrameContext
from noisy_world.perturbations import registry

COUNT = 24
REPEATABLE = ["brightness", "contrast", "jpeg_compression", "pixelate", "gaussian_blur", "defocus_blur"]
ALSO_REPEATABLE = {"haze", "fog_depth", "defocus_depth", "vignetting", "chromatic_aberration", "bloom"}
SETTINGS = [
    {"name": "clean"},
    {"sweep": {"perturb": ["contrast", "gaussian_noise"], "severities": [1, 3], "modes": ["static", "dynamic"]}},
    {"name": "twin", "perturb": [{"contrast": {"severity": 3}}]},
    {"name": "noisy_too", "perturb": [{"contrast": {"severity": 3}}, {"gaussian_noise": {"severity": 1}}]},
    {"name": "late", "perturb": [{"contrast": {"severity": 3}}, {"desync": {"offset": 2}}]},
    {"name": "fast", "perturb": [{"contrast": {"severity": 3}}, {"faster_motion": {"factor": 2}}]},
    {"name": "near", "perturb": [{"contrast": {"factor": 0.2}}]},
]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shared")
    with frames_from_arithmetic():
        run(write_world(folder / "world", frames=COUNT, size=(16, 12), settings=SETTINGS), folder / "out")
    return folder / "out"


def test_equal_work_is_one_file(out):
    for frame in range(COUNT):
        first = image(out, "contrast_s3", "frame", frame)
        others = [image(out, name, "frame", frame) for name in ("twin", "late", "near")]
        assert all(first.samefile(other) for other in others), "severity 3 is a factor of 0.2"
        apart = [image(out, name, "frame", frame) for name in ("clean", "contrast_s1", "noisy_too")]
        assert not any(first.samefile(other) for other in apart)
    for frame in range(COUNT // 2):
        assert image(out, "fast", "frame", frame).samefile(image(out, "twin", "frame", 2 * frame))


def test_dynamic_frames_share_what_they_drew(out):
    """By each frame's own record: where a static setting does the same, the file is its; else its own."""
    static = {0.0: "clean", 1.0: "contrast_s1", 3.0: "contrast_s3"}
    drawn = Counter()
    for name in ("contrast_s1_dynamic", "contrast_s3_dynamic"):
        for frame, record in enumerate(records(out, name)):
            (note,) = record["perturbed"]["rgb"]
            assert note["stream"][2] == name, "the note is the setting's own"
            drawn[note["severity"]] += 1
            own = image(out, name, "frame", frame)
            alike = [there for level, there in static.items() if own.samefile(image(out, there, "frame", frame))]
            assert alike == [there for level, there in static.items() if level == note["severity"]]
    assert set(drawn) == {0, 1, 2, 3}


def test_what_is_random_is_not_shared(out):
    names = [f"gaussian_noise_s{k}{mode}" for k in (1, 3) for mode in ("", "_dynamic")]
    for frame in range(COUNT):
        files = [image(out, name, "frame", frame) for name in names]
        levels = [records(out, name)[frame]["perturbed"]["rgb"][0]["severity"] for name in names]
        drawn = [file.stat().st_ino for file, level in zip(files, levels, strict=True) if level]
        assert len(set(drawn)) == len(drawn)


class Watched(FrameContext):
    """A context that may be asked for nothing but the frame's depth and the camera."""

    def __getattribute__(self, name):
        if name in {"index", "identifiers", "temporal", "stamp_s", "stream", "pattern_stream", "drift_frames"}:
            raise AssertionError(f"it looks at {name}")
        return super().__getattribute__(name)


def test_what_says_so_is_repeatable():
    coloured = [item for item in registry().values() if isinstance(item, ColourPerturbation)]
    found = [item for item in coloured if item.is_repeatable(item.at_severity(3))]
    assert {item.name for item in found} >= {*REPEATABLE, *ALSO_REPEATABLE}
    rng = np.random.default_rng(0)
    rgb, depth_m = rng.random((24, 32, 3), dtype=np.float32), rng.uniform(1, 5, (24, 32)).astype(np.float32)
    for item in found:
        depth = (lambda: depth_m) if item.needs_depth else None
        parameters, watched = item.at_severity(3), Watched(0, ("x",), read_depth_m=depth)
        once = item.apply(rgb, parameters, watched)
        assert np.array_equal(once, item.apply(rgb, parameters, watched))
        if item.apply_bytes is not None:
            item.apply_bytes((rgb * 255).astype(np.uint8), parameters, watched)


def test_a_random_pattern_is_not_repeatable():
    fog = registry()["fog_depth"]
    assert not fog.is_repeatable(fog.at_severity(3, unevenness=0.1))
    for name, told in (
        ("gaussian_noise", "what is repeatable has no random pattern"),
        ("auto_exposure", "what is repeatable neither looks back nor decides"),
    ):
        given = {item.name: getattr(registry()[name], item.name) for item in fields(ColourPerturbation)}
        with pytest.raises(ValueError, match=f"{name}: {told}"):
            ColourPerturbation(**{**given, "repeatable": True})
