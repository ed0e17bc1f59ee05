# SPDX-License-Identifier: GPL-3.0-or-later
"""How much code one frame takes: modules imported, files and functions run, and files run for each further frame.

    python headless/bench/frame_way.py

A frame of an embedded room by Embree and the reference, with one step of colour and one of depth. Only modules of
`noisy_world` count, and a function counts once, however often it is called.
"""

import sys
import threading
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from installation import entry

PACKAGE = str(Path(__file__).resolve().parents[2] / "addon" / "noisy_world")
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
    """The functions of Noisy World that run, of all threads."""

    def __init__(self) -> None:
        self.seen: set[CodeType] = set()
        self.by_frame: list[set[str]] = []

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        """Hear of a call."""
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and code.co_name != "<module>":
            self.seen.add(code)

    def start(self) -> None:
        """Hear of all calls from now on."""
        threading.setprofile(self)
        sys.setprofile(self)


def generated(frames: int, folder: Path) -> set[CodeType]:
    """Make a dataset of some frames; return the functions that ran."""
    from noisy_world.cli import generate  # noqa: PLC0415 - importable only now

    preset = folder / f"{frames}.yaml"
    preset.write_text(PRESET.replace("FRAMES", str(frames)))
    calls = Calls()
    calls.start()
    try:
        generate.main([str(preset), "--out", str(folder / f"out{frames}")], entry(Path(__file__)))
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return calls.seen


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = generated(1, folder)
        imported = [name for name in sys.modules if name.split(".")[0] == "noisy_world"]
        further = generated(FRAMES, folder)
    files = {code.co_filename for code in first}
    print(f"{len(imported)} modules imported, {len(files)} files and {len(first)} functions run for one frame")
    if "-v" in sys.argv:
        by_file: dict[str, list[str]] = {}
        for code in first:
            by_file.setdefault(code.co_filename.removeprefix(PACKAGE), []).append(code.co_qualname)
        for file, names in sorted(by_file.items(), key=lambda item: -len(item[1])):
            print(f"{len(names):4} {file}: {', '.join(sorted(names))}")
        print("not run:", *sorted(module for module in imported if not _ran(module, files)))
    _ = further


if __name__ == "__main__":
    main()
