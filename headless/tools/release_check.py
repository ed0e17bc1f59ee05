# SPDX-License-Identifier: GPL-3.0-or-later
"""Install what a release is made of as strangers do, and run one thing each: the wheel, and the extension in Blender.

    python headless/tools/release_check.py [--dist dist] [--blender BLENDER]

The wheel is installed by pip into a fresh environment of each of Python 3.11 to 3.14 that is here; the zip for this
platform into a fresh profile of a Blender program. What is not here is named, and does not count as checked. Ends with
1 where something fails, or where nothing could be checked.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
EXTENSION = "extensions/user_default/noisy_world"
# One thing of each kind: the library perturbs, the command lists, an example is written, a manual page is made.
LIBRARY = (
    "import numpy as np, noisy_world.perturb as p; a = np.full((8, 8, 3), 99, np.uint8); "
    "assert (p.apply(a, 'fog', 3) != a).any()"
)


class CheckError(Exception):
    """The reason, in one line, why a check failed."""


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="release_check.py", description="Install what was built, and run it.")
    parser.add_argument("--dist", type=Path, default=ROOT / "dist", help="where wheel and zips lie (default: dist)")
    parser.add_argument("--blender", type=Path, help="a Blender program of version 5.2")
    options = parser.parse_args(arguments)
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    checked, failed = 0, 0
    for name, check in checks(options.dist, options.blender, version):
        if isinstance(check, str):
            print(f"{name}: not checked: {check}", flush=True)
            continue
        try:
            with tempfile.TemporaryDirectory(prefix="release_check-") as folder:
                run_all(check, Path(folder))
            print(f"{name}: installed and run", flush=True)
            checked += 1
        except CheckError as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            failed += 1
    return 1 if failed or not checked else 0


Commands = Sequence[tuple[Sequence[str], str]]
"""Programs with their arguments, {folder} being an empty one, and what each has to print; "" for anything."""


def checks(dist: Path, blender: Path | None, version: str) -> Iterator[tuple[str, Commands | str]]:
    """Yield what is to be checked: a name, and the commands or the reason why it cannot be."""
    wheel = dist / f"noisy_world-{version}-py3-none-any.whl"
    for python in PYTHONS:
        program = find_python(python)
        reason = f"{wheel} is missing: make wheel" if not wheel.is_file() else f"there is no Python {python} here"
        yield f"wheel, Python {python}", of_wheel(program, wheel, version) if program and wheel.is_file() else reason
    zips = sorted(dist.glob(f"noisy_world-{version}-{platform()}.zip"))
    if blender is None or not zips:
        missing = "no --blender is named" if blender is None else f"{dist} has no zip for {platform()}: make extension"
        yield "extension", missing
    else:
        yield "extension", of_extension(blender, zips[0])


def find_python(version: str) -> str | None:
    """Return a program of a Python that can make environments; None where there is none."""
    for program in (f"python{version}", f"/usr/bin/python{version}"):
        told = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2], sys.executable)"
        found = shutil.which(program)
        if found is None:
            continue
        done = subprocess.run([found, "-c", told], capture_output=True, text=True, check=False)
        if done.returncode == 0 and done.stdout.startswith(f"{version} "):
            return done.stdout.split(maxsplit=1)[1].strip()  # a shim would choose by the folder
    return None


def platform() -> str:
    """Return this platform as the zips' names have it."""
    return {"linux": "linux_x64", "darwin": "macos_arm64", "win32": "windows_x64"}.get(sys.platform, sys.platform)


def of_wheel(python: str, wheel: Path, version: str) -> Commands:
    """Return what installs the wheel into an environment and runs it."""
    folder = "Scripts" if os.name == "nt" else "bin"
    own, command = f"{{folder}}/venv/{folder}/python", f"{{folder}}/venv/{folder}/noisy-world"
    return (
        ([python, "-m", "venv", "{folder}/venv"], ""),
        ([own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(wheel)], ""),
        ([command, "--version"], f"noisy-world {version}"),
        ([command, "describe", "fog"], "severities 1 to 5"),
        ([command, "example", "tour", "--out", "{folder}"], "tour.yaml"),
        ([command, "docs", "tutorial"], "noisy-world"),
        ([command, "docs", "--man", "{folder}/man"], "manual pages"),
        ([own, "-c", LIBRARY], ""),
    )


def of_extension(blender: Path, path: Path) -> Commands:
    """Return what installs a zip into a fresh profile of Blender and renders a frame with it."""
    preset = "presets/perturbations/fog.yaml"
    script = f"{{folder}}/{EXTENSION}/headless/generate.py"
    small = ["camera.width=96", "camera.height=64", "camera.fx=60", "camera.fy=60", "camera.cx=48", "camera.cy=32"]
    words = [preset, "--frames", "0:1", "--out", "{folder}/out", "--set", *small]
    install = ["extension", "install-file", "--repo", "user_default", "--enable", str(path.resolve())]
    return (
        ([str(blender), "--command", *install], ""),
        ([str(blender), "-b", "-P", script, "--", *words], " rendered, "),
    )


def run_all(commands: Commands, folder: Path) -> None:
    """Run commands one after another. Raises CheckError for the first that fails or says something else."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    environment |= {"BLENDER_USER_RESOURCES": str(folder), "BLENDER_USER": str(folder), "HOME": str(folder)}
    for words, expected in commands:
        line = [word.replace("{folder}", str(folder)) for word in words]
        done = subprocess.run(line, capture_output=True, text=True, env=environment, cwd=folder, check=False)
        said = done.stdout + done.stderr
        if done.returncode or expected not in said:
            last = (said.strip().splitlines() or ["it said nothing"])[-1]
            raise CheckError(f"{' '.join(words[:3])} ... ended with {done.returncode}: {last}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
