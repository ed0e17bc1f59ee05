# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the extension's zips, one for each platform, and validate them.

    python headless/tools/package.py [--out FOLDER] [--blender BLENDER]

A zip holds everything that the extension needs: the package, the scripts that the panel starts, the presets, the asset
library, and wheels of the packages that Blender lacks, as requirements/base.lock pins them; never numpy, which is
Blender's own. Blender's own tool builds it: that of the bpy package or, with --blender, of a Blender program. Equal
sources give equal bytes.
"""

import argparse
import contextlib
import hashlib
import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "headless"))

from tools.blender_env import PACKAGES, pinned_requirements

PYTHONS = ("3.13", "3.14")  # Blender's own builds, and distributions'
# The newest system that a wheel may require on each of Blender's platforms; wheels for older systems are taken too.
PLATFORMS = {
    "linux-x64": "manylinux_2_28_x86_64",
    "linux-arm64": "manylinux_2_28_aarch64",
    "macos-arm64": "macosx_14_0_arm64",
    "macos-x64": "macosx_14_0_x86_64",
    "windows-x64": "win_amd64",
}
SCRIPTS = ("generate.py", "export_mesh.py", "run_odometry.py", "installation.py")
PACKAGE_FILES = (".py", ".jpg", ".png")
LIBRARY_FILES = (".blend", ".json", ".txt")
MANIFEST = "blender_manifest.toml"
LIBRARY_SCRIPTS = (
    "tools/assets.py",
    "pictures/gallery.py",
    "pictures/lit_chain.py",
    "pictures/street.py",
    "pictures/thumbnail.exr",
)
EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold


class PackageError(Exception):
    """The reason, in one line, why no zip was built."""


@dataclass(frozen=True)
class Wheel:
    """A wheel, and what its file name says about it."""

    path: Path
    package: str
    version: str
    pythons: tuple[str, ...]
    abi: str

    def serves(self, python: str) -> bool:
        """Tell whether it is for this Python, such as "3.13"."""
        minor = int(python.removeprefix("3."))
        if self.abi == "abi3":
            return any(int(tag.removeprefix("cp3")) <= minor for tag in self.pythons)
        return f"cp3{minor}" in self.pythons or "py3" in self.pythons


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="package.py", description="Build and validate the extension's zips.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="the zips' folder (default: dist)")
    parser.add_argument("--wheels", type=Path, default=ROOT / "dist/wheels", help="where fetched wheels are kept")
    parser.add_argument("--blender", help="a Blender program that builds instead of the bpy package's tool")
    parser.add_argument(
        "--platform", action="append", choices=PLATFORMS, help="only this platform; may be repeated (default: all)"
    )
    options = parser.parse_args(arguments)
    try:
        tool = [options.blender, "--command", "extension"] if options.blender else [sys.executable, str(bpy_tool())]
        zips = build(options.out, options.wheels, options.platform or list(PLATFORMS), tool)
    except PackageError as error:
        print(f"package.py: {error}", file=sys.stderr)
        return 1
    for path in zips:
        print(f"wrote {path}: {path.stat().st_size / 1e6:.1f} MB")
    return 0


def build(out: Path, cache: Path, platforms: Iterable[str], tool: list[str]) -> list[Path]:
    """Build and validate the zips of some platforms; return them.

    Raises PackageError where a wheel cannot be fetched or differs from the lock, or the tool refuses the zip.
    """
    pins = pinned_hashes((ROOT / "requirements/base.lock").read_text(encoding="utf-8"))
    wheels = {platform: fetch(platform, cache / platform, pins) for platform in platforms}
    make_library()
    out.mkdir(parents=True, exist_ok=True)
    return [build_one(out, platform, files, tool) for platform, files in wheels.items()]


def build_one(out: Path, platform: str, wheels: Collection[Path], tool: list[str]) -> Path:
    """Build and validate a platform's zip; its bytes do not depend on the other platforms built."""
    with tempfile.TemporaryDirectory(dir=out, prefix=".package.") as folder:
        staged, built = Path(folder, "staged"), Path(folder, "built")
        stage(staged, platform, wheels)
        built.mkdir()
        run_tool([*tool, "build", "--source-dir", str(staged), "--output-dir", str(built), "--split-platforms"])
        (path,) = built.glob("*.zip")
        final = Path(folder, path.name)
        repack(path, final)
        run_tool([*tool, "validate", str(final)])
        return final.replace(out / path.name)


# --- wheels ---


def fetch(platform: str, folder: Path, pins: Mapping[str, frozenset[str]]) -> list[Path]:
    """Return the wheels of a platform for every Python; those that the folder lacks are fetched.

    pins: the SHA-256 of each package's files, from the lock.
    """
    for python in PYTHONS:
        with contextlib.suppress(PackageError):
            choose(folder, python, pins)
            continue
        download(platform, python, folder)
    chosen = {wheel.path for python in PYTHONS for wheel in choose(folder, python, pins)}
    return sorted(chosen)


def choose(folder: Path, python: str, pins: Mapping[str, frozenset[str]]) -> list[Wheel]:
    """Return a wheel of each package for a Python, each the file that the lock pins.

    Raises PackageError for a wheel that is missing, does not belong there or is another file.
    """
    found: dict[str, Wheel] = {}
    for path in sorted(folder.glob("*.whl")):
        wheel = parse_wheel(path)
        if wheel.package not in pins:
            raise PackageError(f"{path}: this package does not belong in the extension; remove the file")
        if hashlib.sha256(path.read_bytes()).hexdigest() not in pins[wheel.package]:
            raise PackageError(f"{path}: not the file that requirements/base.lock pins; remove it")
        if wheel.serves(python):
            found[wheel.package] = wheel
    if missing := sorted(set(pins) - set(found)):
        raise PackageError(f"{folder}: no wheel of {', '.join(missing)} for Python {python}")
    return list(found.values())


def parse_wheel(path: Path) -> Wheel:
    """Read a wheel's name, NAME-VERSION[-BUILD]-PYTHONS-ABI-PLATFORMS.whl.

    Raises PackageError where the name is not like this.
    """
    found = re.fullmatch(r"([^-]+)-([^-]+)(?:-\d[^-]*)?-((?:cp3|py)\d+(?:\.py3)?)-([^-]+)-([^-]+)\.whl", path.name)
    if found is None:
        raise PackageError(f"{path}: not the name of a wheel for CPython")
    name, version, pythons, abi, _ = found.groups()
    return Wheel(path, name.replace("_", "-").lower(), version, tuple(pythons.split(".")), abi)


def download(platform: str, python: str, folder: Path) -> None:
    """Fetch a platform's wheels for a Python, hashes checked by pip.

    Raises PackageError where there are none, or the registry cannot be reached.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8") as wanted:
        wanted.write(pinned_requirements((ROOT / "requirements/base.lock").read_text(encoding="utf-8")))
        wanted.flush()
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
        options = ["--require-hashes", "--only-binary", ":all:", "--implementation", "cp", "--python-version", python]
        target = ["--platform", PLATFORMS[platform], "--dest", str(folder), "-r", wanted.name]
        got = subprocess.run([*pip, *options, *target], check=False, capture_output=True, text=True)
    if got.returncode != 0:
        why = next((line for line in got.stderr.splitlines() if line.startswith("ERROR: ")), "ERROR: no reason given")
        raise PackageError(f"pip got no wheels for {platform}, Python {python}: {why.removeprefix('ERROR: ')}")


def pinned_hashes(lock: str) -> dict[str, frozenset[str]]:
    """Return the SHA-256 of every file that the lock's text allows for each package."""
    entries = {entry.split("==")[0].strip(): entry for entry in pinned_requirements(lock).splitlines()}
    return {name: frozenset(re.findall(r"--hash=sha256:([0-9a-f]{64})", entries[name])) for name in PACKAGES}


# --- the zip's content ---


def stage(folder: Path, platform: str, wheels: Collection[Path]) -> None:
    """Put the content of a platform's zip, wheels included, into a new folder."""
    folder.mkdir(parents=True)
    for source, target in staged_files():
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, folder / target)
    (folder / "wheels").mkdir()
    for path in wheels:
        # Hard links where possible: wheels are tens of megabytes.
        try:
            (folder / "wheels" / path.name).hardlink_to(path)
        except OSError:
            shutil.copyfile(path, folder / "wheels" / path.name)
    text = (ROOT / MANIFEST).read_text(encoding="utf-8")
    (folder / MANIFEST).write_text(manifest(text, platform, sorted(path.name for path in wheels)), encoding="utf-8")


def staged_files() -> Iterator[tuple[Path, str]]:
    """Yield the files that every zip holds, and their names in it."""
    package = ROOT / "addon/noisy_world"
    for path in sorted(package.rglob("*")):
        inside = path.relative_to(package)
        if path.suffix in PACKAGE_FILES or (inside.parts[0] == "assets" and path.suffix in LIBRARY_FILES):
            yield path, inside.as_posix()
    for name in SCRIPTS:
        yield ROOT / "headless" / name, f"headless/{name}"
    for path in sorted((ROOT / "presets").rglob("*.yaml")):
        yield path, path.relative_to(ROOT).as_posix()
    yield ROOT / "LICENSE", "LICENSE"


def manifest(text: str, platform: str, wheels: Iterable[str]) -> str:
    """Add the platform and its wheels to the manifest's text, before its first table."""
    added = [f'platforms = ["{platform}"]', "wheels = ["]
    added += [f'  "./wheels/{name}",' for name in wheels]
    head, table, rest = text.partition("\n[")
    staged = head.rstrip("\n") + "\n" + "\n".join([*added, "]", ""]) + table + rest
    kept = {key: value for key, value in tomllib.loads(staged).items() if key not in ("platforms", "wheels")}
    if kept != tomllib.loads(text):
        raise PackageError(f"{MANIFEST}: holds platforms or wheels already, which are the build's to add")
    return staged


def make_library() -> None:
    """Write the asset library if it is missing or older than the definitions of its groups."""
    folder = ROOT / "addon/noisy_world/assets"
    stamp = ROOT / "dist/assets.sha256"
    now = definitions_hash()
    there = folder.is_dir() and any(folder.glob("*.blend"))
    if there and stamp.is_file() and stamp.read_text(encoding="utf-8").strip() == now:
        return
    print("writing the asset library", file=sys.stderr)
    subprocess.run([sys.executable, str(ROOT / "headless/tools/assets.py"), "--out", str(folder)], check=True)
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(now + "\n", encoding="utf-8")


def definitions_hash() -> str:
    """Return a hash of everything that decides the asset library's content."""
    package = ROOT / "addon/noisy_world"
    deciding = [path for name in ("core", "perturbations", "nodes") for path in (package / name).rglob("*")]
    sources = [path for path in deciding if path.suffix in PACKAGE_FILES]
    sources += [*(ROOT / "headless" / name for name in LIBRARY_SCRIPTS)]
    total = hashlib.sha256()
    for path in sorted(sources):
        total.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


# --- the tool, and its zips ---


def bpy_tool() -> Path:
    """Return Blender's tool for extensions in the bpy package.

    Raises PackageError where that package is not installed.
    """
    spec = importlib.util.find_spec("bpy")  # not imported, as that takes a second
    folder = Path(spec.origin).parent if spec is not None and spec.origin else None
    found = sorted(folder.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")) if folder else []
    if not found:
        raise PackageError("the bpy package, whose tool builds extensions, is not in this Python; run: make extension")
    return found[0]


def run_tool(command: list[str]) -> None:
    """Run the tool.

    Raises PackageError with the tool's last lines where it fails.
    """
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        raise PackageError(f"{' '.join(command[-4:])}: {'; '.join(lines[-3:])}")


def repack(path: Path, target: Path) -> None:
    """Write a zip's files again, sorted by name and with one time for all, so that its bytes depend on content only."""
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(target, "w", compresslevel=9) as packed:
        for item in sorted(source.infolist(), key=lambda item: (item.filename != MANIFEST, item.filename)):
            entry = zipfile.ZipInfo(item.filename, EPOCH)
            entry.compress_type = item.compress_type
            entry.create_system = 3
            entry.external_attr = 0o100644 << 16
            packed.writestr(entry, source.read(item))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
