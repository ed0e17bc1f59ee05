# SPDX-License-Identifier: GPL-3.0-or-later
"""How much code one frame takes: modules imported, files and functions run, and files run for each further frame.

    python headless/bench/frame_way.py [-v]

A frame of an embedded room by Embree and the reference, with one step of colour and one of depth. Only modules of
`noisy_world` count, and a function counts once, however often it is called.
"""

import sys
import tempfile
import threading
from collections import Counter, defaultdict
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from installation import entry, prepare_imports

PACKAGE = str(Path(__file__).resolve().parents[2] / "addon" / "noisy_world")
FURTHER = 4  # frames beside the first
PRESET = """\
seed: 5
scenes:
  - {name: room, mesh: "embedded:room", trajectory: {handheld: {frames: FRAMES, rate_hz: 4}}}
camera: {width: 160, height: 120, fx: 80, fy: 80, cx: 79.5, cy: 59.5}
render: {engine: embree, samples: 1, backend: reference}
settings:
  - {name: noisy, perturb: [{fog: {severity: 3}}, {depth_gaussian_noise: {severity: 3}}]}
output: {layout: tum, image: png}
"""


class Calls:
    """How often each function of Noisy World is called, in any thread."""

    def __init__(self) -> None:
        """Begin with none."""
        self.counts = Counter[CodeType]()

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        """Hear of an event."""
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and code.co_name != "<module>":
            self.counts[code] += 1


def generated(frames: int, folder: Path) -> Counter[CodeType]:
    """Make a dataset of some frames; return how often each function was called."""
    from noisy_world.cli import command  # importable only now

    preset = folder / f"{frames}.yaml"
    preset.write_text(PRESET.replace("FRAMES", str(frames)))
    calls = Calls()
    threading.setprofile(calls)
    sys.setprofile(calls)
    try:
        command.run("generate", [str(preset), "--out", str(folder / f"{frames}")], entry(Path(__file__)))
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return calls.counts


def by_file(functions: set[CodeType]) -> dict[str, list[str]]:
    """Return the functions' names by their file, the file with the most first."""
    found: dict[str, list[str]] = defaultdict(list)
    for code in functions:
        found[code.co_filename.removeprefix(f"{PACKAGE}/")].append(code.co_qualname)
    return dict(sorted(found.items(), key=lambda item: (-len(item[1]), item[0])))


def main() -> None:
    """Print the figures, with -v also the functions."""
    prepare_imports()
    with tempfile.TemporaryDirectory() as name:
        one = generated(1, Path(name))
        imported = sorted(name for name in sys.modules if name.split(".")[0] == "noisy_world")
        more = generated(1 + FURTHER, Path(name))
    again = {code for code, count in more.items() if count >= one.get(code, 0) + FURTHER}
    files = by_file(set(one))
    print(f"{len(imported)} modules imported, {len(files)} files and {len(one)} functions run for one frame")
    print(f"{len(by_file(again))} files and {len(again)} functions run for each further frame")
    if "-v" in sys.argv:
        for title, functions in (("ONE FRAME", set(one)), ("EACH FURTHER", again)):
            print(title)
            for file, names in by_file(functions).items():
                print(f"{len(names):4} {file}: {', '.join(sorted(names))}")
        run = {file.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for file in files}
        print("IMPORTED, NOT RUN:", *(name for name in imported if name.removeprefix("noisy_world.") not in run))


if __name__ == "__main__":
    main()
