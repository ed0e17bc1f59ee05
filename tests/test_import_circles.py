# SPDX-License-Identifier: GPL-3.0-or-later
"""No module imports itself by way of others, and packages import downwards, inside functions and for types too."""

import ast
import re

from worlds import ROOT

SEARCHED = (ROOT / "addon", ROOT / "headless")


def modules_of(folders):
    """Return the files by the names under which they are imported."""
    found = {}
    for folder in folders:
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(name, path, modules):
    """Return the modules that one imports, wherever the import stands in it, but for the packages that hold it."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inside = {f"{base}.{alias.name}" for alias in node.names} & set(modules)
            found |= inside or {base}
            # `from package import module, name` needs the package itself for the name alone.
            found |= {base} if len(inside) < len(node.names) else set()
    return {other for other in found & set(modules) if other != name}


def circles(modules):
    """Return the groups of modules that reach one another (Tarjan's strongly connected components)."""
    graph = {name: imports_of(name, path, modules) for name, path in modules.items()}
    order, low, stack, found = {}, {}, [], []

    def visit(name):
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in graph[name]:
            if other not in order:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == order[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    for name in graph:
        if name not in order:
            visit(name)
    return found


def test_no_import_circles():
    modules = modules_of(SEARCHED)
    assert {"noisy_world.dataset.run", "bench.report", "tools.package", "generate", "pictures.street"} <= set(modules)
    assert circles(modules) == []


def write_package(folder, **files):
    (folder / "house").mkdir(parents=True)
    for name, text in {"__init__": "", **files}.items():
        (folder / "house" / f"{name}.py").write_text(text)
    return modules_of([folder])


def test_a_circle_would_be_found(tmp_path):
    straight = {"report": "from . import tables", "tables": "from .results import Row", "results": "Row = 1"}
    assert circles(write_package(tmp_path / "straight", **straight)) == []
    hidden = {
        "for_types": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.report import Row",
        "in_function": "def row():\n    from .report import Row",
        "relative": "from . import report",
        "plain": "import house.report",
    }
    for name, text in hidden.items():
        modules = write_package(tmp_path / name, **{**straight, "results": text})
        assert circles(modules) == [["house.report", "house.results", "house.tables"]], name


def test_a_circle_through_a_package_would_be_found(tmp_path):
    modules = write_package(tmp_path, __init__="from .fog import FOG", fog="from . import ORDER\nFOG = 1")
    assert circles(modules) == [["house", "house.fog"]]


def test_packages_import_those_alone_that_stand_lower_in_the_drawing():
    drawing = (ROOT / "docs/architecture.svg").read_text(encoding="utf-8")
    height = {name: float(y) for y, name in re.findall(r'class="package" x="[\d.]+" y="([\d.]+)"[^>]*>(\w+)<', drawing)}
    modules = modules_of((ROOT / "addon",))
    inside = {name: path for name, path in modules.items() if name.count(".") and "other_name" not in name}
    packages = {name.split(".")[1] for name in inside} - {"__main__"}
    assert set(height) == packages
    seen = {
        (name.split(".")[1], other.split(".")[1])
        for name, path in inside.items()
        for other in imports_of(name, path, modules)
        if other in inside and "__main__" not in (name.split(".")[1], other.split(".")[1])
    }
    assert ("sources", "render") in seen, "imports inside functions count"
    assert [pair for pair in sorted(seen) if pair[0] != pair[1] and height[pair[0]] >= height[pair[1]]] == []
