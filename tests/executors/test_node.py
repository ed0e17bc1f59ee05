# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node does for a task, without Ray: how a command's end is told, and what keeps a node from taking part."""

import ast
import hashlib
import importlib.util
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from noisy_world.executors import worker_process
from noisy_world.executors.worker_process import NodeTask, carried, carry_out
from noisy_world.core.packages import package_version

ADDON = str(Path(__file__).resolve().parents[2] / "addon")


def done(program, **values):
    told = []
    result = carry_out(NodeTask("shard", ("-c", textwrap.dedent(program)), **values), told.append)
    return result["status"], result["line"], told


def test_what_is_carried_to_the_nodes_imports_the_standard_library_alone():
    modules = carried()
    known = {module.__name__ for module in modules}
    for module in modules:
        for item in ast.parse(Path(module.__file__).read_text()).body:
            if isinstance(item, ast.Import):
                assert {name.name.split(".")[0] for name in item.names} <= {*sys.stdlib_module_names}
            if isinstance(item, ast.ImportFrom):
                place = importlib.util.resolve_name("." * item.level + (item.module or ""), module.__package__)
                names = {f"{place}.{name.name}" for name in item.names}
                assert place.split(".")[0] in sys.stdlib_module_names or {place} <= known or names <= known


@pytest.mark.parametrize(
    ("program", "status", "line"),
    [
        ("print('much')", 0, ""),
        ("import sys; print('a', file=sys.stderr); sys.exit('scene: wrong')", 1, "scene: wrong"),
        ('import sys; print(\'@noisy-world {"error": "in words"}\'); sys.exit(1)', 1, "in words"),
        ("import os; os._exit(7)", 7, "ended with status 7: it said nothing"),
        ("import os; os.write(2, b'1\\n\\n2\\n'); os.abort()", -signal.SIGABRT, "was ended by signal 6: 1 | 2"),
        ("import sys; sys.exit(3)", 3, ""),
    ],
)
def test_how_a_command_ends(program, status, line):
    assert done(program)[:2] == (status, line)


def test_what_the_driver_is_told(monkeypatch):
    program = """
        import sys, time
        assert [sys.stdin.readline() for _ in range(2)] == ["order\\n", "shard\\n"]
        print("Blender speaks" + "@noisy-world " + '{"advance": 2}')
        print("@noisy-world " + '{"advance": 3')  # cut off
        print("@noisy-world " + '{"advance": 1}', flush=True)
        time.sleep(0.5)
        print("@noisy-world " + '{"note": "n", "subject": "s"}')
        print("@noisy-world " + '{"advance": 4}')
        print("@noisy-world " + '{"made": "shard", "report": {"frames_rendered": 7}}', flush=True)
        assert sys.stdin.readline() == ""
        """
    monkeypatch.setattr(worker_process, "TELL_EVERY_S", 0.1)
    told = []
    result = carry_out(NodeTask("shard", ("-c", textwrap.dedent(program)), "order"), told.append)
    assert (result["status"], result["line"], result["report"]) == (0, "", {"frames_rendered": 7})
    assert {"note": "n", "subject": "s"} in told
    assert sum(message.get("advance", 0) for message in told) == 7
    assert len(told) > 2  # what came before the pause was told in the pause


def test_a_shard_that_another_process_makes_is_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(worker_process, "TELL_EVERY_S", 0.01)
    program = f"""
        import os, sys
        with open({str(tmp_path / "tries")!r}, "a") as file:
            file.write("x")
            tries = file.tell()
        sys.exit(0 if tries == 3 else 75)
        """
    assert done(program)[0] == 0
    monkeypatch.setattr(worker_process, "BUSY_FOR_S", 0.0)
    assert done("import os; os._exit(75)")[0] == 75


def test_what_keeps_a_node_from_taking_part(tmp_path):
    status, line, _ = done("", version="0.0.9", search_path=ADDON)
    assert (status, line) == (
        3, f"has Noisy World {package_version()}; install the version of the driver there, 0.0.9",
    )  # fmt: skip
    assert done("", version=package_version(), search_path=ADDON)[0] == 0
    status, line, _ = done("", version="0.0.9", environment={"PYTHONPATH": str(tmp_path)}, search_path="/nowhere")
    assert (status, line.split(";")[0]) == (3, f"has no Noisy World for {sys.executable}")
    file = tmp_path / "identity.json"
    digest = hashlib.sha256(b"{}").hexdigest()
    assert done("", seen=str(file), sha256=digest)[:2] == (
        3, f"sees nothing at {file}, which all nodes have to share, under one path",
    )  # fmt: skip
    file.write_bytes(b"[]")
    assert done("", seen=str(file), sha256=digest)[1].startswith("sees another file at")
    file.write_bytes(b"{}")
    assert done("", seen=str(file), sha256=digest)[0] == 0


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is Linux's")
def test_a_command_ends_with_the_process_that_runs_it(tmp_path):
    program = f"import os, time; open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    driver = f"""
        from noisy_world.executors.worker_process import NodeTask, carry_out
        carry_out(NodeTask("shard", ("-c", {program!r})), print)
        """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(driver)], env=os.environ | {"PYTHONPATH": ADDON})
    end_s = time.monotonic() + 300
    while not ((tmp_path / "pid").exists() and (tmp_path / "pid").read_text()) and time.monotonic() < end_s:
        time.sleep(0.02)
    process.kill()
    process.wait(60)
    pid = int((tmp_path / "pid").read_text())
    while Path(f"/proc/{pid}").exists() and time.monotonic() < end_s:
        if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
            break
        time.sleep(0.02)
    assert time.monotonic() < end_s
