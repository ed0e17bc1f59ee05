# SPDX-License-Identifier: GPL-3.0-or-later
"""Try mutated inputs by the thousand; the test suite tries a few hundred.

    python tests/fuzz_inputs.py --cases 20000
    python tests/fuzz_inputs.py --only presets --seed 4 --cases 5000 --keep found
    python tests/fuzz_inputs.py --only presets --seed 4 --case 123 --keep found

Each input has to be accepted with the meaning that an independent reader finds, or refused in one line that names its
file; within ten seconds, without a warning. Every input that is neither is kept with what was found. evo, plyfile and
Pillow are asked, too, where this Python has them.
"""

import argparse
import collections
import itertools
import shutil
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "addon"), str(HERE / "support")]

from fuzz.cases import AREAS, OF_BLENDER, write_case
from fuzz.pool import run_cases


def main():
    """Run the cases; the exit status is 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000, help="how many, over all areas")
    parser.add_argument("--case", type=int, help="only the case of this number, in each area")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=(*AREAS, *OF_BLENDER), default=tuple(AREAS), metavar="AREA",
                        help=f"of {', '.join(AREAS | OF_BLENDER)}")  # fmt: skip
    parser.add_argument("--keep", type=Path, default=Path("out/found"), help="where inputs are kept")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    numbers = itertools.count() if options.case is None else [options.case]
    cases = ((area, number) for number in numbers for area in options.only)
    total = options.cases if options.case is None else len(options.only)
    sys.exit(_run(itertools.islice(cases, total), total, options))


def _run(cases, total, options):
    ended = collections.Counter()
    found = collections.Counter()
    slowest = (0.0, "")
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as work:
        ends = run_cases(cases, options.seed, Path(work), processes=options.processes)
        for area, number, outcome, seconds in ends:
            ended[area, outcome.kind] += 1
            slowest = max(slowest, (seconds, f"{area} {number}"))
            if outcome.kind == "finding":
                found[area, outcome.told.rpartition(" (")[2] if outcome.told.startswith("trace") else outcome.told] += 1
                _keep(options.keep / area / f"{options.seed}-{number}", area, number, outcome.told, options.seed)
                print(f"{area} {number}: {outcome.told}", flush=True)
            if sum(ended.values()) % 1000 == 0:
                print(
                    f"{sum(ended.values())} of {total}, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True
                )
    for area in options.only:
        told = ", ".join(f"{ended[area, kind]} {kind}" for kind in ("accepted", "refused"))
        print(f"{area}: {told}, {ended[area, 'finding']} found")
    for (area, told), count in found.most_common():
        print(f"  {count} x {area}: {told[:200]}")
    print(f"slowest: {slowest[1]}, {slowest[0]:.1f} s; all: {time.monotonic() - began:.0f} s")
    return 1 if found else 0


def _keep(folder, area, number, told, seed):
    """Write the input of a case anew, beside what was found."""
    shutil.rmtree(folder, ignore_errors=True)
    write_case(area, seed, number, folder)
    (folder / "found.log").write_text(f"{area}, seed {seed}, case {number}\n{told}\n", errors="backslashreplace")


if __name__ == "__main__":
    main()
