# SPDX-License-Identifier: GPL-3.0-or-later
"""A second name for a loaded package.

Blender loads the extension as bl_ext.<repository>.noisy_world, but scripts and installed perturbations import
noisy_world. This name has to give the modules that are loaded already: a second copy of a class is another class.
"""

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


def give_other_name(alias: str, name: str) -> None:
    """Make `import alias` give the loaded package `name`, unless the alias can be imported already."""
    if alias not in sys.modules and not any(isinstance(finder, OtherName) for finder in sys.meta_path):
        sys.meta_path.insert(0, OtherName(alias, name))


def take_other_names() -> None:
    """Remove the second names, so that another version of the package can have them."""
    for finder in [item for item in sys.meta_path if isinstance(item, OtherName)]:
        sys.meta_path.remove(finder)
        for name in finder.given:
            sys.modules.pop(name, None)


class OtherName(MetaPathFinder, Loader):
    """Gives a loaded package another name, under which its modules are the same objects and not loaded again."""

    def __init__(self, alias: str, name: str) -> None:
        self._alias = alias
        self._name = name
        self._specs: dict[str, ModuleSpec | None] = {}
        self.given: set[str] = set()

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None = None,  # noqa: ARG002 - the protocol's
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """Return a spec for the alias and the modules inside it."""
        if fullname != self._alias and not fullname.startswith(f"{self._alias}."):
            return None
        real = importlib.util.find_spec(self._name + fullname.removeprefix(self._alias))
        if real is None:
            return None
        return ModuleSpec(fullname, self, is_package=real.submodule_search_locations is not None)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module of the package's own name; the import system then replaces its spec."""
        module = importlib.import_module(self._name + spec.name.removeprefix(self._alias))
        self._specs[module.__name__] = module.__spec__
        self.given.add(spec.name)
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the module's own spec; it has been executed already."""
        module.__spec__ = self._specs.pop(module.__name__)
