# SPDX-License-Identifier: GPL-3.0-or-later
"""`example`, `docs`, `completion`: what a newcomer asks for: a file to begin with, a page, words that complete."""

import argparse
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import InputError, NoisyWorldError, StorageError, did_you_mean
from ..core.file_access import read_text
from ..core.packages import found_shipped, project_address
from .arguments import Parser, out_path
from .command import COMMANDS, PROGRAM, Command
from .entry import Entry, say
from .shell_completion import SHELLS, manual_page, script

# --- `example` ---


def example_files() -> dict[str, list[Path]]:
    """Return the examples by name: a file, files of one stem, such as a system and its program, or a folder."""
    folder = found_shipped("docs/examples")
    found: dict[str, list[Path]] = {}
    for path in [] if folder is None else sorted(folder.iterdir()):
        if not path.name.startswith(("_", ".")):
            found.setdefault(path.stem, []).append(path)
    return found


def about_example(files: list[Path]) -> str:
    """Return what an example says of itself: the first line of its comment, docstring or heading."""
    first = min(files, key=lambda path: path.suffix != ".yaml")
    if first.is_dir():
        first = first / "pyproject.toml"
    for line in read_text(first).splitlines():
        if found := re.match(r'(?:(?:#|//) (?!SPDX)|"""| +"# )(.+?)(?:\\n",|""")?$', line):
            return found[1]
    return ""


def _example_options(parser: Parser) -> None:
    parser.option("name NAME", "which; without it they are listed", nargs="?")
    parser.option("--out DIR", "the folder to write into (default: this one)", type=out_path, default=Path())
    parser.flag("--overwrite", "replace what is there")


def _example(options: argparse.Namespace, _: Entry) -> int:
    examples = example_files()
    if options.name is None:
        width = max(map(len, examples), default=0)
        for name, files in examples.items():
            print(f"{name:<{width}}  {', '.join(path.name for path in files)}: {about_example(files)}")
        return 0
    by_file = {path.name: name for name, files in examples.items() for path in files}
    asked: str = options.name
    name = by_file.get(asked, asked)
    if name not in examples:
        remedy = did_you_mean(name, [*examples, *by_file]) or f"'{PROGRAM} example' lists them"
        raise InputError(options.name, "no such example", remedy=remedy)
    outs = {path: options.out / path.name for path in examples[name]}
    for out in outs.values():
        if out.exists() and not options.overwrite:
            raise StorageError("is there already", file=out, remedy="--overwrite replaces it")
    for path, out in outs.items():
        _copy(path, out)
        print(f"wrote {out}")
    return 0


def _copy(path: Path, out: Path) -> None:
    """Copy a file or a folder, whole or not at all."""
    from ..core.atomic_files import ELSEWHERE, made_beside, storage_errors

    with storage_errors(out, ELSEWHERE):
        out.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_dir():
        with made_beside(out) as made:
            shutil.copyfile(path, made)
        return
    for file in sorted(item for item in path.rglob("*") if item.is_file() and "__pycache__" not in item.parts):
        _copy(file, out / file.relative_to(path))


EXAMPLE = Command(
    name="example",
    order=3,
    group="begin",
    help="write a file to begin with: a preset, a system, a package with a perturbation, a notebook",
    description="Write an example into this folder: a preset, a SLAM system of yours, a package with a perturbation of "
    "yours, a notebook. Without a name they are listed.",
    options=_example_options,
    run=_example,
    needs=(),
)


# --- `docs` ---


def pages() -> dict[str, Path]:
    """Return the pages of the docs that come along, by name: without their folder and ending."""
    folder = found_shipped("docs")
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.md"))}


def _docs_options(parser: Parser) -> None:
    parser.option("page PAGE", "print this page, such as recordings; without it all are named", nargs="?")
    parser.option("--man DIR", "write a manual page for each subcommand into DIR instead", type=out_path)


def _docs(options: argparse.Namespace, _: Entry) -> int:
    if options.man is not None:
        return _write_manual(options.man)
    known = pages()
    if not known:
        where = f"read them at {address}" if (address := project_address()) else "they are in the project's folder docs"
        raise NoisyWorldError("the pages do not come along with this installation", remedy=where)
    if options.page is None:
        width = max(map(len, known))
        for name, path in known.items():
            print(f"{name:<{width}}  {title(path)}")
        say(f"they lie in {next(iter(known.values())).parent}" + _site())
        return 0
    name = Path(options.page).stem
    if name not in known:
        remedy = did_you_mean(name, known) or f"'{PROGRAM} docs' names them"
        raise InputError(options.page, "no such page", remedy=remedy)
    sys.stdout.write(re.sub(r'^--8<-- "(.+)"$', _included, read_text(known[name]), flags=re.MULTILINE))
    return 0


def _included(line: re.Match[str]) -> str:
    """Return the text of a file that a page shows; the line itself where the file does not come along."""
    file = found_shipped(line[1])
    return line[0] if file is None else read_text(file).rstrip("\n")


def _write_manual(folder: Path) -> int:
    from ..core.atomic_files import ELSEWHERE, storage_errors
    from ..core.packages import package_version

    with storage_errors(folder, ELSEWHERE):
        folder.mkdir(parents=True, exist_ok=True)
        for command, parser in parsers():
            page = manual_page(command, parser, package_version())
            (folder / f"{PROGRAM}-{command.name}.1").write_text(page, encoding="utf-8")
    print(f"wrote {len(COMMANDS)} manual pages into {folder}")
    return 0


def _site() -> str:
    return f"; the project is at {address}" if (address := project_address()) else ""


def title(page: Path) -> str:
    """Return a page's title."""
    found = re.search(r"^# (.+)$", read_text(page), re.MULTILINE)
    return found[1] if found else page.stem


DOCS = Command(
    name="docs",
    order=6,
    group="begin",
    help="name the pages that come along, or print one; write manual pages",
    description="Name the pages of the docs that come along with this installation and where they lie, or print one "
    "of them. With --man write a manual page for each subcommand.",
    options=_docs_options,
    run=_docs,
    needs=(),
)


# --- `completion` ---


def _completion_options(parser: Parser) -> None:
    parser.option("shell SHELL", ", ".join(SHELLS), choices=SHELLS)


def _completion(options: argparse.Namespace, _: Entry) -> int:
    sys.stdout.write(script(options.shell, parsers()))
    return 0


def parsers() -> Iterator[tuple[Command, Parser]]:
    """Yield every subcommand with the parser of its options."""
    for command in COMMANDS.values():
        yield command, command.parser(f"{PROGRAM} {command.name}")


COMPLETION = Command(
    name="completion",
    order=9,
    group="begin",
    help="print what makes a shell complete subcommands and options",
    description="Print a script that makes a shell complete subcommands, options and their values.",
    epilog=f"For bash add to ~/.bashrc: source <({PROGRAM} completion bash). For zsh, to ~/.zshrc after compinit: "
    f"source <({PROGRAM} completion zsh). For fish: {PROGRAM} completion fish > "
    f"~/.config/fish/completions/{PROGRAM}.fish.",
    options=_completion_options,
    run=_completion,
    needs=(),
)

COMMAND = EXAMPLE, DOCS, COMPLETION
