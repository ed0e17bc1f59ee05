# SPDX-License-Identifier: GPL-3.0-or-later
"""Write what pages and presets say of perturbations, channels, layouts and more from the objects that are told of.

A page has such a part between a line `<!-- made: NAME -->` and a line `<!-- end -->`; `make pages` writes all of them
anew, and the presets of single perturbations. With --check nothing is written, and what would change is told.

python headless/tools/pages.py
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from textwrap import fill

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon")]

from noisy_world.channels import CHANNELS, Channel
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import STAGES, Perturbation

WIDTH = 120  # of a line of prose
MOST_NAMED = 10  # parameters in a row of the table; of longer lists the first ones
STAGE_TITLES = {"post": "Post-processing"}
STAGE_NOTES = {"depth": "Warm is near, blue is far, grey is void."}


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status: 1 where --check finds that something would change."""
    parser = argparse.ArgumentParser(prog="pages.py", description="Write the parts of pages that objects tell.")
    parser.add_argument("--check", action="store_true", help="write nothing; tell what would change")
    check = parser.parse_args(arguments).check
    changed = {path: text for path, text in made_files(ROOT) if not path.is_file() or path.read_text("utf-8") != text}
    left = [path for path in (ROOT / "presets/perturbations").glob("*.yaml") if path.stem not in own_perturbations()]
    for path in sorted([*changed, *left]):
        print(f"{path.relative_to(ROOT)}: {'`make pages` changes it' if check else 'written anew'}")
    if check:
        return 1 if changed or left else 0
    for path, text in changed.items():
        path.write_text(text, encoding="utf-8")
    for path in left:
        path.unlink()
    return 0


def made_files(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file that is made, or has made parts, with its text."""
    for page in sorted((root / "docs").glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if "<!-- made: " in text:
            yield page, with_parts(text, PARTS, page.name)
    for item in own_perturbations().values():
        yield root / f"presets/perturbations/{item.name}.yaml", example_preset(item)


def with_parts(text: str, parts: Mapping[str, Callable[[], str]], page: str) -> str:
    """Return a page with its parts made anew. Raises SystemExit where it names a part that is not made."""

    def made(match: re.Match[str]) -> str:
        if (name := match[1]) not in parts:
            raise SystemExit(f"pages: {page}: no part is called {name}; known: {', '.join(parts)}")
        return f"<!-- made: {name} -->\n\n{parts[name]()}\n\n<!-- end -->"

    return re.sub(r"<!-- made: ([\w ]+) -->\n.*?<!-- end -->", made, text, flags=re.DOTALL)


def table(columns: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    head, *body = (f"| {' | '.join(row)} |" for row in (columns, *rows))
    return "\n".join((head, f"|{'---|' * len(columns)}", *body))


# --- perturbations ---


def own_perturbations() -> dict[str, Perturbation]:
    """Return those that come with Noisy World, by name, in the order of propagation."""
    return {name: item for name, item in registry().items() if item.distribution is None}


def perturbation_counts() -> str:
    """Return the sentence that counts them."""
    every = own_perturbations().values()
    papers = sum(item.about.of_paper for item in every)
    return wrapped(
        f"There are {len(every)}: all {papers} of the paper's taxonomy, and {len(every) - papers} of our own that look "
        "and act as in the world. The [gallery](gallery.md) shows every one of them."
    )


def perturbation_table() -> str:
    """Return the table of all of them."""
    every = own_perturbations().values()
    rows = ((f"{item.stage} {item.order}", f"`{item.name}`", law_of(item), parameters_of(item)) for item in every)
    return table(("stage, order", "name", "what it is", "parameters"), rows)


def law_of(item: Perturbation) -> str:
    """Return what a perturbation is."""
    law = item.about.law or f"{item.sentence[:1].lower()}{item.sentence[1:]}"
    return law if item.about.of_paper else f"our own: {law}"


def parameters_of(item: Perturbation) -> str:
    """Return the names of a perturbation's parameters, those that severity sets first."""
    names = sorted((field.name for field in fields(item.parameters)), key=lambda name: name not in item.severities)
    shown = names if len(names) <= MOST_NAMED else names[: MOST_NAMED - 3]
    return ", ".join(f"`{name}`" for name in shown) + (" and more" if len(shown) < len(names) else "")


def gallery() -> str:
    """Return the pictures of all of them, by stage."""
    parts: list[str] = []
    every = own_perturbations().values()
    for stage in STAGES:
        parts.append(f"## {STAGE_TITLES.get(stage, stage.capitalize())}")
        parts += [STAGE_NOTES[stage]] if stage in STAGE_NOTES else []
        for item in (item for item in every if item.stage == stage):
            about = item.about
            caption = (about.caption or about.law or item.sentence).removesuffix(".")
            parts += [
                f"### {item.label}",
                wrapped(f"`{item.name}`{'' if about.of_paper else ', ours'}: {caption}."),
                f"![{about.picture or f'{item.label} at severities 1, 3 and 5'}](gallery/{item.name}.jpg)",
            ]
    return "\n\n".join(parts)


def example_preset(item: Perturbation) -> str:
    """Return the preset that shows a perturbation in the embedded room."""
    example = item.about.example
    said = example.said or f"{item.label} in the embedded room, clean and at severities 1, 3 and 5."
    settings = example.settings or (f"{{sweep: {{perturb: [{item.name}], severities: [1, 3, 5]}}}}",)
    walk = f"{{handheld: {{frames: {example.frames}, rate_hz: {example.rate_hz}}}}}"
    lines = [
        f"# {said}",
        "seed: 7",
        "scenes:",
        f'  - {{name: room, mesh: "embedded:room", trajectory: {walk}}}',
        *([f"render: {example.render}"] if example.render else []),
        "settings:",
        "  - {name: clean}",
        *(f"  - {line}" for line in settings),
        "output: {overview: true}",
    ]
    return "\n".join(lines) + "\n"


def wrapped(text: str) -> str:
    """Return prose in lines."""
    return fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


# --- channels ---


def channel_table() -> str:
    """Return the table of the channels that come with Noisy World."""
    own = (item for name, item in CHANNELS.items() if CHANNELS.distribution(name) is None)
    rows = (
        (quoted(item.name), item.meaning, item.convention, values_of(item), item.unit, listed(item.kinds))
        for item in own
    )
    return table(("channel", "what it is", "what its files hold", "in memory", "unit", "files"), rows)


def values_of(item: Channel) -> str:
    """Return the shape and the type of a channel's values in memory."""
    return f"{'(H, W)' if item.components == 1 else f'(H, W, {item.components})'} {item.dtype}"


def listed(words: Iterable[str]) -> str:
    """Return words as code, one after another."""
    return ", ".join(map(quoted, words))


def quoted(word: str) -> str:
    """Return a word as code."""
    return f"`{word}`"


PARTS: dict[str, Callable[[], str]] = {
    "perturbation counts": perturbation_counts,
    "perturbation table": perturbation_table,
    "gallery": gallery,
    "channel table": channel_table,
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
