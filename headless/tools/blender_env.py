# SPDX-License-Identifier: GPL-3.0-or-later
"""Install, beside the project, the packages that a Blender program's own Python lacks.

    .venv/bin/python headless/tools/blender_env.py /path/to/blender

The versions are those of requirements/base.lock, in builds for that Blender's Python; headless/generate.py finds them.
numpy stays Blender's own.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("deflate", "opencv-contrib-python-headless", "openexr", "pyyaml", "simplejpeg", "tqdm")
ASK = "import json, sys; print('@' + json.dumps([sys.implementation.cache_tag, '%d.%d' % sys.version_info[:2]]))"


def main(arguments: list[str]) -> int:
    """Install for the Blender that is named, or for the one on the path; return the exit status."""
    if len(arguments) != 1:
        print("usage: blender_env.py BLENDER", file=sys.stderr)
        return 2
    blender = shutil.which(arguments[0])
    if blender is None:
        print(f"{arguments[0]}: no such program; run: make blender-env BLENDER=/path/to/blender", file=sys.stderr)
        return 1
    tag, version = python_of(blender)
    folder = ROOT / ".blender-env" / tag
    wanted = ROOT / ".blender-env" / f"{tag}.txt"
    pinned = pinned_requirements((ROOT / "requirements/base.lock").read_text(encoding="utf-8"))
    stamp = folder / "requirements.txt"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == pinned:
        print(f"{folder.relative_to(ROOT)}: ready for Blender's Python {version}")
        return 0
    shutil.rmtree(folder, ignore_errors=True)
    wanted.parent.mkdir(exist_ok=True)
    wanted.write_text(pinned, encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    options = ["--require-hashes", "--only-binary", ":all:", "--python-version", version, "--implementation", "cp"]
    target = ["--target", str(folder), "-r", str(wanted)]
    installed = subprocess.run([*pip, *options, *target], check=False)
    if installed.returncode != 0:
        print(f"pip found no builds for Blender's Python {version}; its messages are above", file=sys.stderr)
        return 1
    stamp.write_text(pinned, encoding="utf-8")
    print(f"{folder.relative_to(ROOT)}: packages for Blender's Python {version}")
    return 0


def python_of(blender: str) -> tuple[str, str]:
    """Ask a Blender program for its Python: the tag of the implementation and the version."""
    asked = subprocess.run(
        [blender, "-b", "--factory-startup", "--python-expr", ASK], check=True, capture_output=True, text=True
    )
    answer = next(line for line in asked.stdout.splitlines() if line.startswith("@"))
    tag, version = json.loads(answer[1:])
    return tag, version


def pinned_requirements(lock: str) -> str:
    """Take the entries of PACKAGES out of the lock file's text."""
    entries = lock.replace("\\\n", " ").splitlines()
    chosen = [entry for entry in entries if entry.split("==")[0].strip() in PACKAGES]
    if len(chosen) != len(PACKAGES):
        raise ValueError(f"requirements/base.lock holds {len(chosen)} of {', '.join(PACKAGES)}")
    return "\n".join(chosen) + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
