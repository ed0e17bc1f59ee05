"""Building ORB-SLAM from source: what is refused, what is kept, and what its driver is given; tools are stand-ins."""

import json
import subprocess

import pytest
from refusals import refused

from noisy_world.cli import command
from noisy_world.core.errors import MissingDependencyError, StorageError
from noisy_world.evaluate import system_installation
from noisy_world.evaluate.system_runs import PROGRAMS, system_versions

# Configures by writing down what it is asked for; builds a program that says what it is given.
CMAKE = """#!/bin/sh
echo "$*" >>"$ASKED"
case "$*" in
  *--build*) test -z "$BROKEN" || {{ echo "error: no such header"; exit 1; }}
    printf '#!/bin/sh\\nprintf "%%s\\\\n" "$@"\\n' >"$2/orb_slam"; chmod +x "$2/orb_slam" ;;
esac
"""
INDEX = {
    "camera": {"width": 320, "height": 240, "fx": 300.0, "fy": 301.0, "cx": 159.5, "cy": 119.5},
    "depth_scale_per_m": 5000.0,
    "inverse_depth": {"median_per_m": 0.5, "noise_per_m": 0.001},
    "frames": [{"index": k, "stamp_s": 0.1 * k, "colour": f"/a b/{k}.png", "depth": f"/d/{k}.png"} for k in range(3)],
}


@pytest.fixture
def source(tmp_path):
    folder = tmp_path / "ORB_SLAM2"
    for name in ("include", "src", "Thirdparty/g2o"):
        (folder / name).mkdir(parents=True)
    (folder / "include/System.h").write_text("namespace ORB_SLAM2\n{\n}\n")
    return folder


@pytest.fixture(autouse=True)
def tools(tmp_path, monkeypatch):
    folder = tmp_path / "tools"
    folder.mkdir()
    for name, text in (("cmake", CMAKE.format()), ("c++", "#!/bin/sh\n"), ("make", "#!/bin/sh\n")):
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    monkeypatch.setenv("ASKED", str(tmp_path / "asked"))
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.setattr(system_installation, "train", lambda: "10 6 0 0\n")
    return folder


def build(source, folder):
    return system_installation.build(system_installation.CLONED["orb-slam2"], source, folder, lambda _: None)


def test_it_is_built_once_and_anew_where_its_source_differs(source, tmp_path):
    folder = tmp_path / ".venv-orb-slam2"
    assert build(source, folder)
    configured = (tmp_path / "asked").read_text().splitlines()[0].split()
    assert {f"-DSOURCE={source}", "-DGENERATION=2"} <= set(configured)
    assert {path.name for path in (folder / "bin").iterdir()} >= {"orb_slam", "python"}
    assert not build(source, folder)
    (source / "README.md").write_text("is not compiled")
    assert not build(source, folder)
    (source / "src/Tracking.cc").write_text("int changed;\n")
    assert build(source, folder)


def test_what_cannot_be_built_is_a_line(source, tmp_path, tools, monkeypatch):
    refused(build, tmp_path, tmp_path / "new", names=["--source: ", "git clone https://"])
    (source / "include/System.h").write_text("namespace ORB_SLAM3\n")
    refused(build, source, tmp_path / "new", names=[str(source), "ORB_SLAM2"])
    (source / "include/System.h").write_text("namespace ORB_SLAM2\n")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").touch()
    refused(build, source, tmp_path / "mine", names=str(tmp_path / "mine"), error=StorageError)
    monkeypatch.setenv("BROKEN", "1")
    refused(build, source, tmp_path / "new", names=["f2e6f51cdc8d", "error: no such header"], error=StorageError)
    monkeypatch.delenv("BROKEN")
    assert build(source, tmp_path / "new"), "what was made half is made anew"
    for name in ("cmake", "c++", "make"):
        (tools / name).unlink()
    monkeypatch.setenv("PATH", str(tools))
    names = ["cmake, c++, make", "apt-get install cmake"]
    refused(build, source, tmp_path / "other", names=names, error=MissingDependencyError)


def test_the_driver_is_given_settings_and_frames(source, tmp_path):
    folder, out, frames = tmp_path / ".venv-orb-slam2", tmp_path / "out", tmp_path / "frames.json"
    build(source, folder)
    out.mkdir()
    frames.write_text(json.dumps(INDEX))
    start = [str(folder / "bin/python"), str(PROGRAMS / "orb_slam_built.py")]
    words = [*start, "2", frames, out, folder, "--bf-px-m", "40", "--near-m", "3.1"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    names = [folder / "orb_vocabulary.txt", out / "orb_slam.yaml", out / "frames.tsv", out]
    assert done.stdout.splitlines() == [str(name) for name in names]
    assert (out / "frames.tsv").read_text().splitlines() == [
        "rgbd 5000.0 0.1",
        *(f"{0.1 * k!r}\t/a b/{k}.png\t/d/{k}.png" for k in range(3)),
    ]
    lines = dict(line.split(": ") for line in (out / "orb_slam.yaml").read_text().splitlines()[1:])
    # As ORB-SLAM2's own TUM1.yaml names them; Camera.bf is the baseline in metres times fx.
    assert float(lines["Camera.fx"]) == 300.0
    assert float(lines["Camera.bf"]) == pytest.approx(40.0)
    assert float(lines["ThDepth"]) * float(lines["Stereo.b"]) == pytest.approx(3.1)
    assert lines["DepthMapFactor"] == "1.0"
    subprocess.run([*start, "2", frames, out, folder, "--mono"], capture_output=True, check=True)
    assert (out / "frames.tsv").read_text().splitlines()[:2] == ["mono 5000.0 0.1", "0.0\t/a b/0.png\t"]
    said = subprocess.run([*start, "--versions", folder], capture_output=True, text=True, check=True).stdout
    assert set(json.loads(said)) == {"source", "driver", "vocabulary"}


def test_the_command_says_what_it_needs(source, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path / "named"))
    monkeypatch.setattr("noisy_world.cli.entry.blender_problem", lambda entry: "")

    def install(*words):
        return command.main(["systems", "install", *map(str, words)]), *capfd.readouterr()

    assert "is needed: the folder of ORB_SLAM2's source; get it: git clone" in install("orb_slam2")[2]
    assert "orb_slam3 is not built from source" in install("orb_slam3", "--source", source)[2]
    assert "is built from C++" in install("orb_slam2", "--source", source, "--python", "python3")[2]
    system_versions.cache_clear()
    status, told, _ = install("orb_slam2_mono", "--source", source)
    system_versions.cache_clear()
    assert (status, told) == (0, f"installed {tmp_path}/named/.venv-orb-slam2\n")
