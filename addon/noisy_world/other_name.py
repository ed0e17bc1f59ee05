# SPDX-License-Identifier: GPL-3.0-or-later
"""A second name for a package that is loaded.

Blender loads the extension as bl_ext.<repository>.noisy_world. Scripts and installed perturbations know it as
noisy_world, which then has to lead to the modules that are there: a second copy of a class would be another class.
"""

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


def give_other_name(alias: str, name: str) -> None:
    """Let `import alias` lead to the loaded package `name`, unless the alias leads to something already."""
    if alias not in sys.modules and not any(isinstance(finder, OtherName) for finder in sys.meta_path):
        sys.meta_path.insert(0, OtherName(alias, name))


def take_other_names() -> None:
    """Take the second names away, so that another version of the package can have them."""
    for finder in [item for item in sys.meta_path if isinstance(item, OtherName)]:
        sys.meta_path.remove(finder)
        for name in finder.given:
            sys.modules.pop(name, None)


class OtherName(MetaPathFinder, Loader):
    """Gives a package that is loaded another name, under which its modules are the same objects, not loaded again."""

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
        """Claim what is named after the alias."""
        if fullname != self._alias and not fullname.startswith(f"{self._alias}."):
            return None
        real = importlib.util.find_spec(self._name + fullname.removeprefix(self._alias))
        if real is None:
            return None
        return ModuleSpec(fullname, self, is_package=real.submodule_search_locations is not None)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Hand out the module under its own name; the import system is about to replace its spec."""
        module = importlib.import_module(self._name + spec.name.removeprefix(self._alias))
        self._specs[module.__name__] = module.__spec__
        self.given.add(spec.name)
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its spec back: it has been executed."""
        module.__spec__ = self._specs.pop(module.__name__)
