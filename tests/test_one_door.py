# SPDX-License-Identifier: GPL-3.0-or-later
"""No file is read beside the one door, core/file_access, which lets regular files in and nothing else."""

import ast

import pytest
from worlds import ROOT

PACKAGE = ROOT / "addon" / "noisy_world"
BY_NAME = {
    "numpy": ("load", "fromfile", "memmap", "loadtxt", "genfromtxt", "fromregex"),
    "cv2": ("imread", "imreadmulti", "VideoCapture", "FileStorage"),
    "pandas": ("read_csv", "read_json", "read_table"),
    "OpenEXR": ("File", "InputFile"),
    "zipfile": ("ZipFile",),
    "io": ("open", "FileIO"),
}
SHORT = {"np": "numpy", "pd": "pandas"}
OPENED = ("file", "stream", "StringIO", "BytesIO")  # open already, through the door, or in memory
ELSEWHERE = {
    "core/file_access.py": "the door, and folders that are locked",
    "core/packages.py": "the files of our own modules, and the metadata of the installed package",
    "cli/entry.py": "opens standard streams that are closed on nothing",
    "render/engines.py": "a scratch file that Blender has just written",
    "images/video_files.py": "asks the door before OpenCV opens it by its name",
    "executors/worker_process.py": "carried to nodes without this package; it asks whether a file is a regular one",
    "evaluate/guard.py": "/proc, and run without this package",
    "evaluate/programs": "run in other Pythons, without this package",
}


def reads_of(text):
    """Return the lines of a module that read a file by its name."""
    return sorted(node.lineno for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call) and is_read(node))


def is_read(call):
    match call.func:
        case ast.Name("open"):
            return reads(call.args[1:2])
        case ast.Attribute(ast.Name("file_access"), _):
            return False
        case ast.Attribute(ast.Name("OpenEXR"), "File") if len(call.args) == 2:  # made of a header and channels
            return False
        case ast.Attribute(ast.Name("os"), "open"):
            return "O_WRONLY" not in ast.unparse(call)
        case ast.Attribute(_, "read_text" | "read_bytes"):
            return True
        case ast.Attribute(ast.Name(library), name) if name in BY_NAME.get(SHORT.get(library, library), ()):
            return not (call.args and first_name(call.args[0]) in OPENED)
        case ast.Attribute(_, "open"):
            return opens_to_read(call)
        case _:
            return False


def first_name(argument):
    called = argument.func if isinstance(argument, ast.Call) else argument
    if isinstance(argument, ast.Call) and isinstance(called, ast.Attribute):
        return called.attr
    return called.id if isinstance(called, ast.Name) else ""


def reads(modes):
    """Tell whether a file that is opened in a mode, or in none that is said, is there to be read."""
    mode = modes[0].value if modes and isinstance(modes[0], ast.Constant) else "r"
    return isinstance(mode, str) and set(mode) <= set("rbt") and "r" in mode


def opens_to_read(call):
    """Tell whether a call of a method `open` is that of a path, to read it; other things have such a method too."""
    if call.args:
        return isinstance(call.args[0], ast.Constant) and reads(call.args[:1])
    return all(item.arg in ("mode", "buffering", "encoding", "errors", "newline") for item in call.keywords)


def test_no_module_reads_files_beside_the_door():
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if not any(name == other or name.startswith(f"{other}/") for other in ELSEWHERE):
            found += [f"{name}:{line}" for line in reads_of(path.read_text(encoding="utf-8"))]
    assert not found, "read through core/file_access.py"


def test_what_is_excepted_is_there():
    for name in ELSEWHERE:
        files = [PACKAGE / name] if name.endswith(".py") else sorted((PACKAGE / name).rglob("*.py"))
        assert files
        assert any(reads_of(path.read_text(encoding="utf-8")) for path in files), f"{name} reads nothing: no exception"


@pytest.mark.parametrize(
    ("line", "reads"),
    [
        ("open(path)", True),
        ("path.open()", True),
        ("path.open('rb')", True),
        ("path.open(encoding='utf-8')", True),
        ("(folder / name).read_bytes()", True),
        ("path.read_text(encoding='utf-8')", True),
        ("np.load(path, allow_pickle=False)", True),
        ("np.memmap(self.path, np.uint8, 'r')", True),
        ("cv2.imread(str(path))", True),
        ("os.open(path, os.O_RDONLY)", True),
        ("pd.read_csv(path)", True),
        ("os.open(os.devnull, os.O_WRONLY)", False),
        ("path.open('xb')", False),
        ("open(path, 'wb')", False),
        ("prepared.open(paths, options)", False),
        ("dataset.open(identity, overwrite=True)", False),
        ("read_bytes(path)", False),
        ("file_access.read_text(path)", False),
        ("np.load(file)", False),
        ("pd.read_csv(StringIO(text))", False),
        ("np.load(io.BytesIO(data))", False),
    ],
)
def test_the_rule_tells_what_reads(line, reads):
    assert bool(reads_of(line)) == reads
