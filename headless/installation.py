# SPDX-License-Identifier: GPL-3.0-or-later
"""How the scripts find the add-on's package, in a checkout or in the installed extension.

A checkout has the package in addon/. In the extension the package is the folder above the scripts, which Blender may
have loaded as bl_ext.<repository>.noisy_world: the scripts' import of noisy_world then gives these loaded modules.
The module also reads the scripts' arguments and ends them, since a Blender program does both in its own way.
"""

import importlib
import importlib.util
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from noisy_world.cli.entry import Entry

PACKAGE = "noisy_world"
BUG = 70  # EX_SOFTWARE of sysexits.h
SCRIPTS = Path(__file__).resolve().parent
ROOT = SCRIPTS.parent
# The extension's folder is a package; a checkout's is not.
INSTALLED = (ROOT / "__init__.py").is_file()


def prepare_imports() -> None:
    """Make the package importable and, in a Blender program, the packages that `make blender-env` installed for it."""
    if INSTALLED:
        use_extension(ROOT)
        # Blender unpacks extensions' wheels here, but does not import from here with --factory-startup.
        unpacked = ROOT.parents[1] / f".local/lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
        if unpacked.is_dir() and str(unpacked) not in sys.path:
            sys.path.append(str(unpacked))
        return
    sys.path.insert(0, str(ROOT / "addon"))
    side = ROOT / ".blender-env" / str(sys.implementation.cache_tag)
    # Last on the path, so that Blender's own packages, numpy above all, come first.
    if inside_blender() and side.is_dir():
        sys.path.append(str(side))


def inside_blender() -> bool:
    """Tell whether this is a Blender program, not a Python with the bpy package."""
    bpy = sys.modules.get("bpy")
    return bpy is not None and bool(bpy.app.binary_path)


def script_arguments() -> list[str]:
    """Return the command line's arguments; in a Blender program, those after --."""
    if not inside_blender():
        return sys.argv[1:]
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []


def entry(script: Path) -> "Entry":
    """Return how a script was started; call `prepare_imports` first."""
    from noisy_world.cli.entry import Entry  # importable only now
    from noisy_world.core.packages import install_remedy

    binary = sys.modules["bpy"].app.binary_path if inside_blender() else ""
    words = (binary, "-b", "-P", str(script), "--") if binary else (sys.executable, str(script))
    if INSTALLED:
        remedy = f"enable the add-on, or {install_remedy(ROOT)}"
    elif binary:
        remedy = f"run: make -C {ROOT} blender-env BLENDER={binary}"
    else:
        remedy = f"run: make -C {ROOT} venv, then use {ROOT / '.venv/bin/python'}"
    return Entry(script.name, words, "this Blender's " if binary else "", remedy, blender_remedy=remedy)


def run_subcommand(name: str, script: Path) -> NoReturn:
    """Run a subcommand of `noisy-world` as a script, and end the process with its status.

    A Blender program would go on after an exception.
    """
    try:
        prepare_imports()
        from noisy_world.cli import command  # importable only now
        from noisy_world.cli.entry import exit_status

        status = exit_status(lambda: command.run(name, script_arguments(), entry(script)))
    except Exception:  # noqa: BLE001 - a bug keeps its traceback
        traceback.print_exc()
        status = BUG
    sys.exit(status)


def use_extension(folder: Path) -> None:
    """Make PACKAGE the package in this folder: the one that Blender has loaded, if it has, else imported anew."""
    if PACKAGE in sys.modules:
        return
    entry = folder / "__init__.py"
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.rpartition(".")[2] == PACKAGE and file is not None and Path(file).resolve() == entry:
            importlib.import_module(f"{name}.other_name").give_other_name(PACKAGE, name)
            return
    spec = importlib.util.spec_from_file_location(PACKAGE, entry, submodule_search_locations=[str(folder)])
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules[PACKAGE] = package
    spec.loader.exec_module(package)
