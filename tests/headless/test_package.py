# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's zips: what is staged, which wheels are taken, and what a real Blender says of them.

The zips of this machine's platform need wheels that were fetched before (`make extension`) or a registry; the tests in
a Blender program need NOISY_WORLD_BLENDER.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
import zipfile

import pytest
from refusals import refused
import yaml
from worlds import ROOT, write_world

sys.path.append(str(ROOT / "headless"))
import installation
from tools import package

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
needs_blender = pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program")
ID = "noisy_world"
NAMES = {
    "deflate": "deflate-1.9-cp313-cp313-manylinux2014_x86_64.manylinux_2_28_x86_64.whl",
    "opencv-contrib-python-headless": "opencv_contrib_python_headless-5.0-cp37-abi3-linux_x86_64.whl",
    "openexr": "openexr-3.5-cp313-cp313-linux_x86_64.whl",
    "pyyaml": "pyyaml-6.0-cp313-cp313-manylinux2014_x86_64.manylinux_2_17_x86_64.whl",
    "simplejpeg": "simplejpeg-1.9-cp313-cp313-manylinux2014_x86_64.manylinux_2_28_x86_64.whl",
    "tqdm": "tqdm-4.70-py3-none-any.whl",
}


@pytest.fixture
def wheels(tmp_path):
    """A folder with a file under each wheel's name, and the pins of these files."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    for name in NAMES.values():
        (folder / name).write_bytes(name.encode())
    return folder, {name: frozenset([hashlib.sha256(file.encode()).hexdigest()]) for name, file in NAMES.items()}


# --- wheels ---


@pytest.mark.parametrize(
    ("name", "packaged", "served"),
    [
        ("opencv_contrib_python_headless-5.0.0.93-cp37-abi3-win_amd64.whl", "opencv-contrib-python-headless", (13, 14)),
        ("openexr-3.5.3-cp313-cp313-macosx_11_0_arm64.whl", "openexr", (13,)),
        ("OpenEXR-3.5.3-1-cp314-cp314-macosx_11_0_arm64.whl", "openexr", (14,)),
        ("tqdm-4.70.1-py3-none-any.whl", "tqdm", (13, 14)),
        ("six-1.0-py2.py3-none-any.whl", "six", (13, 14)),
        ("later-1.0-cp314-abi3-any.whl", "later", (14,)),
    ],
)
def test_a_wheels_name_says_whom_it_serves(tmp_path, name, packaged, served):
    wheel = package.parse_wheel(tmp_path / name)
    assert wheel.package == packaged
    assert [minor for minor in (13, 14) if wheel.serves(f"3.{minor}")] == list(served)


@pytest.mark.parametrize("name", ["openexr.whl", "openexr-3.5.whl", "a-1-cp313-cp313.whl", "a-1-pp310-pypy310-any.whl"])
def test_a_bad_name_is_refused(wheels, name):
    folder, pins = wheels
    (folder / name).write_bytes(b"")
    refused(package.choose, folder, "3.13", pins, names=f"{name}: ", error=package.PackageError)


def test_numpy_and_whatever_else_does_not_belong_is_refused(wheels):
    folder, pins = wheels
    (folder / "numpy-2.5.5-cp313-cp313-win_amd64.whl").write_bytes(b"")
    refused(package.choose, folder, "3.13", pins, names="numpy", error=package.PackageError)


def test_another_files_hash_is_refused(wheels):
    folder, pins = wheels
    assert {wheel.package for wheel in package.choose(folder, "3.13", pins)} == set(NAMES)
    (folder / NAMES["openexr"]).write_bytes(b"something else")
    refused(
        package.choose, folder, "3.13", pins, names=["openexr", "requirements/base.lock"], error=package.PackageError
    )


def test_what_a_python_lacks_is_named(wheels):
    folder, pins = wheels
    names = ["deflate, openexr, pyyaml, simplejpeg", "3.14"]
    refused(package.choose, folder, "3.14", pins, names=names, error=package.PackageError)


def test_wheels_that_are_there_are_not_fetched_again(wheels, monkeypatch):
    folder, pins = wheels
    asked = []
    monkeypatch.setattr(package, "download", lambda platform, python, where: asked.append(python))
    with pytest.raises(package.PackageError):
        package.fetch("linux-x64", folder, pins)
    assert asked == ["3.14"]


def test_the_lock_pins_every_package_that_is_bundled():
    pins = package.pinned_hashes((ROOT / "requirements/base.lock").read_text())
    assert set(pins) == set(NAMES)
    assert all(pins.values())


# --- staging ---


def test_the_staged_manifest_adds_platforms_and_wheels_alone():
    text = (ROOT / "blender_manifest.toml").read_text()
    staged = tomllib.loads(package.manifest(text, "linux-x64", ["a-1-py3-none-any.whl"]))
    assert staged.pop("platforms") == ["linux-x64"]
    assert staged.pop("wheels") == ["./wheels/a-1-py3-none-any.whl"]
    assert staged == tomllib.loads(text)
    assert staged["blender_version_min"] == "5.2.0"
    assert set(staged["permissions"]) == {"files"}
    with pytest.raises((package.PackageError, tomllib.TOMLDecodeError)):
        package.manifest('wheels = []\n[permissions]\nfiles = "x"\n', "linux-x64", [])


def test_what_is_staged(wheels, tmp_path):
    folder, _ = wheels
    package.stage(tmp_path / "staged", "linux-x64", sorted(folder.iterdir()))
    there = {path.relative_to(tmp_path / "staged").as_posix() for path in (tmp_path / "staged").rglob("*.*")}
    assert {"__init__.py", "dataset/run.py", "scenes/ply.py", "perturbations/shipped/ice/rime.jpg"} <= there
    assert {"headless/run_odometry.py", "evaluate/odometry.py", "evaluate/trajectory_scores.py"} <= there
    assert {"blender_manifest.toml", "presets/demo.yaml", "presets/perturbations/fog.yaml"} <= there
    assert {f"wheels/{name}" for name in NAMES.values()} <= there
    assert not [name for name in there if "__pycache__" in name or name.endswith((".pyc", ".toml.txt"))]
    assert [name for name in there if name.endswith(".toml")] == ["blender_manifest.toml"]


def test_every_script_that_generate_imports_is_staged():
    siblings = {path.stem for path in (ROOT / "headless").glob("*.py")}
    for script in package.SCRIPTS:
        text = (ROOT / "headless" / script).read_text()
        imported = set(re.findall(r"^\s*(?:from|import) (\w+)", text, re.MULTILINE)) & siblings
        assert {f"{name}.py" for name in imported} <= set(package.SCRIPTS), script


# --- the scripts in the extension ---


@pytest.fixture(scope="module")
def extension(tmp_path_factory):
    """The extension as it lies where Blender would put it, without wheels."""
    folder = tmp_path_factory.mktemp("blender") / "extensions/user_default/noisy_world"
    package.stage(folder, "linux-x64", [])
    return folder


def test_the_scripts_use_the_package_that_blender_loaded(extension, tmp_path):
    code = f"""
        import sys, importlib
        sys.path[:0] = [{str(extension.parents[1])!r}, {str(extension / "headless")!r}]
        sys.modules["bl_ext"] = importlib.import_module("user_default")  # any parent will do
        loaded = importlib.import_module("user_default.noisy_world")
        import user_default.noisy_world.core.errors
        import installation
        installation.prepare_imports()
        from noisy_world.core.errors import NoisyWorldError
        from noisy_world.core import trajectory
        import noisy_world.perturbations.shipped.fog as fog
        assert NoisyWorldError is sys.modules["user_default.noisy_world.core.errors"].NoisyWorldError
        files = [getattr(module, "__file__", None) or "" for module in set(sys.modules.values())]
        files = [file for file in files if "noisy_world" in file]
        assert len(files) == len(set(files)), files
        assert sys.modules["noisy_world"] is loaded
        assert fog.__name__ == fog.__spec__.name == "user_default.noisy_world.perturbations.shipped.fog"
        try:
            import noisy_world.nothing
        except ModuleNotFoundError as error:
            print(error)
    """
    assert "noisy_world.nothing" in python(code, tmp_path)


def test_the_scripts_load_the_package_that_nobody_loaded(extension, tmp_path):
    world = write_world(tmp_path / "world", frames=2)
    command = [sys.executable, str(extension / "headless/generate.py"), str(world), "--list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "clean/box\n"
    code = f"""
        import sys
        sys.path.insert(0, {str(extension / "headless")!r})
        import installation
        installation.prepare_imports()
        import noisy_world.core.packages as shipped
        print(shipped.__file__, shipped.package_version())
    """
    said = python(code, tmp_path).split()
    assert said[0] == str(extension / "core/packages.py")
    assert said[1] == tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]


def test_a_checkout_is_not_an_extension():
    assert not installation.INSTALLED


def python(code, folder):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# --- zips ---


@pytest.fixture(scope="session")
def zips(tmp_path_factory, building):
    """The zips of two platforms, by platform; one of them is built twice."""
    folders = [tmp_path_factory.mktemp("zips") for _ in range(2)]
    for folder, platforms in zip(folders, (("linux-x64", "macos-arm64"), ("linux-x64",)), strict=True):
        command = [sys.executable, str(ROOT / "headless/tools/package.py"), "--out", str(folder)]
        for platform in platforms:
            command += ["--platform", platform]
        with building():
            done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
        if "pip got no wheels" in done.stderr:
            pytest.skip(f"wheels cannot be fetched here: {done.stderr.strip()}")
        assert done.returncode == 0, done.stderr
    first, second = ({path.name: path for path in folder.glob("*.zip")} for folder in folders)
    assert len(second) == 1
    for name, path in second.items():
        assert first[name].read_bytes() == path.read_bytes(), "two runs, other bytes"
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    found = {platform: first.pop(f"{ID}-{version}-{platform}.zip") for platform in ("linux_x64", "macos_arm64")}
    assert not first
    for path in second.values():
        path.unlink()
    yield found
    for path in found.values():
        path.unlink()


@pytest.mark.long
def test_a_zip_holds_its_platforms_wheels_alone(zips):
    for platform, tag in {"linux_x64": "x86_64", "macos_arm64": "arm64"}.items():
        with zipfile.ZipFile(zips[platform]) as packed:
            names = packed.namelist()
            generated = tomllib.loads(packed.read("blender_manifest.toml").decode())["build"]["generated"]
        bundled = [name.removeprefix("wheels/") for name in names if name.startswith("wheels/")]
        assert sorted(f"./wheels/{name}" for name in bundled) == sorted(generated["wheels"])
        assert generated["platforms"] == [platform.replace("_", "-")]
        assert all(name.endswith((f"{tag}.whl", "any.whl")) for name in bundled)
        assert {package.parse_wheel(ROOT / name).package for name in bundled} == set(NAMES)
        assert sum(name.startswith("openexr") for name in bundled) == len(package.PYTHONS)
        assert {"assets/noisy_world_assets.blend", "assets/blender_assets.cats.txt", "LICENSE"} <= set(names)
        assert not [name for name in names if "numpy" in name or "bpy" in name.lower() or "__pycache__" in name]


def blender(user, *arguments, cwd=None):
    """Run the Blender program with a profile, and nothing of ours in the environment."""
    user.mkdir(exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NOISY_WORLD", "PYTHON"))}
    environment = {**kept, "BLENDER_USER": str(user), "BLENDER_USER_RESOURCES": str(user)}
    command = [BLENDER, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment, cwd=cwd)
    return done.returncode, done.stdout + done.stderr


def install(user, path):
    return blender(user, "--command", "extension", "install-file", "-r", "user_default", "-e", path)


@pytest.fixture(scope="session")
def profile(zips, tmp_path_factory):
    """A clean profile with the extension installed."""
    user = tmp_path_factory.mktemp("profile")
    _, said = install(user, zips["linux_x64"])
    assert 'Installed "noisy_world"' in said
    assert not re.search(r"error|exception|traceback", said, re.IGNORECASE), said
    return user


PROBE = """
import json, sys
import bpy, cv2, deflate, OpenEXR, simplejpeg, yaml, tqdm, numpy
enabled = [item.module for item in bpy.context.preferences.addons]
files = [module.__file__ for module in (cv2, deflate, OpenEXR, simplejpeg, yaml, tqdm)]
print("@" + json.dumps([enabled, files, numpy.__file__]))
"""


@pytest.mark.long
@needs_blender
def test_a_clean_profile_has_all_that_it_needs(profile, tmp_path):
    (tmp_path / "probe.py").write_text(PROBE)
    _, said = blender(profile, "-b", "-P", tmp_path / "probe.py")
    enabled, files, numpy = json.loads(next(line[1:] for line in said.splitlines() if line.startswith("@")))
    assert f"bl_ext.user_default.{ID}" in enabled
    assert all(str(profile / "extensions/.local") in file for file in files), files
    assert str(profile) not in numpy


@pytest.mark.long
@needs_blender
def test_generate_works_in_that_profile(profile, tmp_path):
    # A checkout without the packages beside it, and the extension's own script, with and without the preferences.
    for name in ("addon", "headless"):
        shutil.copytree(ROOT / name, tmp_path / "checkout" / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "blender_manifest.toml", tmp_path / "checkout")
    world = write_world(tmp_path / "world", frames=2, settings=[{"name": "fog", "perturb": [{"fog": {"severity": 3}}]}])
    own = profile / f"extensions/user_default/{ID}/headless/generate.py"
    made = []
    for k, words in enumerate(
        (["-P", tmp_path / "checkout/headless/generate.py"], ["-P", own], ["--factory-startup", "-P", own])
    ):
        status, said = blender(profile, "-b", *words, "--", world, "--out", tmp_path / f"out{k}")
        assert status == 0, said
        assert "2 frames rendered" in said
        # A window that is open at the same time still needs them.
        assert list(profile.glob("extensions/.local/lib/*/site-packages/cv2/__init__.py")), "the run deleted packages"
        made.append((tmp_path / f"out{k}/manifest.json").read_bytes())
    assert made[0] == made[1] == made[2]


@pytest.mark.long
@needs_blender
def test_another_platforms_zip_is_refused_in_a_line(zips, tmp_path):
    _, said = install(tmp_path / "user", zips["macos_arm64"])
    assert re.search(r"ERROR noisy_world: This platform \(linux-\w+\) isn't one of \(macos-arm64\)", said), said
    assert "Traceback" not in said
    assert not (tmp_path / f"user/extensions/user_default/{ID}").exists()


def without_wheels(source, target, dropped):
    """Copy a zip without the wheels whose names hold `dropped`, in its files and its manifest."""
    with zipfile.ZipFile(source) as whole, zipfile.ZipFile(target, "w") as less:
        for name in whole.namelist():
            if name.startswith("wheels/") and dropped in name:
                continue
            content = whole.read(name)
            if name == "blender_manifest.toml":
                text = re.sub(rf'^  "\./wheels/[^"]*{dropped}[^"]*",\n', "", content.decode(), flags=re.MULTILINE)
                head, _, rest = text.partition("# BEGIN GENERATED CONTENT.")
                generated = re.search(r"platforms = .*", rest)[0]
                content = (head + f"[build.generated]\n{generated}\n").encode()
            less.writestr(name, content)
    return target


@pytest.mark.long
@needs_blender
def test_an_extension_without_a_package_names_it_and_its_python(zips, tmp_path):
    path = without_wheels(zips["linux_x64"], tmp_path / "less.zip", "openexr")
    _, said = install(tmp_path / "user", path)
    lines = [line for line in said.splitlines() if "OpenEXR" in line]
    assert len(lines) == 1, said
    assert re.search(r"OpenEXR: missing in this Blender's Python 3\.\d+ on linux; install the zip", lines[0])
    assert "Traceback" not in said
    own = tmp_path / f"user/extensions/user_default/{ID}/headless/generate.py"
    status, said = blender(tmp_path / "user", "-b", "-P", own, "--", "--list", "keys")
    lines = [line for line in said.splitlines() if line.startswith("generate.py: ")]
    assert status == 1
    assert len(lines) == 1
    assert "OpenEXR" in lines[0]
    assert "enable the add-on, or install the zip" in lines[0]


@pytest.mark.long
@needs_blender
def test_no_address_is_asked_for(profile):
    assert "network" not in tomllib.loads(
        (profile / f"extensions/user_default/{ID}/blender_manifest.toml").read_text()
    ).get("permissions", {})
    assert yaml.safe_load((profile / f"extensions/user_default/{ID}/presets/demo.yaml").read_text())["scenes"]
