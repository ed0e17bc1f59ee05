# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node does for a task, without Ray: how a command's end is told, and what keeps a node from taking part."""

import ast
import hashlib
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from noisy_world.cli import entry
from noisy_world.cluster import remote
from noisy_world.cluster.remote import Task, carry_out
from noisy_world.core import progress
from noisy_world.core.datasets.provenance import package_version

ADDON = str(Path(__file__).resolve().parents[2] / "addon")


def done(program, **values):
    told = []
    result = carry_out(Task("shard", ("-c", textwrap.dedent(program)), **values), told.append)
    return result["status"], result["line"], told


def test_what_is_carried_to_the_nodes_imports_the_standard_library_alone():
    nodes = list(ast.walk(ast.parse(Path(remote.__file__).read_text())))
    froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    names = [item.name for node in nodes if isinstance(node, ast.Import) for item in node.names]
    assert not any(node.level for node in froms)
    assert {name.split(".")[0] for name in [*names, *(node.module for node in froms)]} <= {
        "ray",
        *sys.stdlib_module_names,
    }


def test_both_sides_speak_alike():
    assert remote.MARK == progress.MARK
    assert (remote.REFUSED, remote.BUSY, remote.INTERRUPTED) == (entry.REFUSED, entry.BUSY, entry.INTERRUPTED)


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
        assert sys.stdin.readline() == "order\\n"
        print("Blender speaks" + "@noisy-world " + '{"advance": 2}')
        print("@noisy-world " + '{"advance": 3')  # cut off
        print("@noisy-world " + '{"advance": 1}', flush=True)
        time.sleep(0.5)
        print("@noisy-world " + '{"note": "n", "subject": "s"}')
        print("@noisy-world " + '{"made": "shard"}', flush=True)
        assert sys.stdin.readline() == "end\\n"
        print("@noisy-world " + '{"advance": 4}')
        print("@noisy-world " + '{"report": {"frames_rendered": 7}}')
        """
    monkeypatch.setattr(remote, "TELL_EVERY_S", 0.1)
    told = []
    order = Task("shard", ("-c", textwrap.dedent(program)), told="order\n", then="end\n")
    result = carry_out(order, told.append)
    assert (result["status"], result["line"], result["report"]) == (0, "", {"frames_rendered": 7})
    assert {"note": "n", "subject": "s"} in told
    assert sum(message.get("advance", 0) for message in told) == 7
    assert len(told) > 2  # what came before the pause was told in the pause


def test_a_shard_that_another_process_makes_is_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(remote, "TELL_EVERY_S", 0.01)
    program = f"""
        import os, sys
        with open({str(tmp_path / "tries")!r}, "a") as file:
            file.write("x")
            tries = file.tell()
        sys.exit(0 if tries == 3 else 75)
        """
    assert done(program)[0] == 0
    monkeypatch.setattr(remote, "BUSY_FOR_S", 0.0)
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
    program = f"import os, time; open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    driver = f"""
        from noisy_world.cluster.remote import Task, carry_out
        carry_out(Task("shard", ("-c", {program!r})), print)
        """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(driver)], env=os.environ | {"PYTHONPATH": ADDON})
    end_s = time.monotonic() + 20
    while not ((tmp_path / "pid").exists() and (tmp_path / "pid").read_text()) and time.monotonic() < end_s:
        time.sleep(0.02)
    process.kill()
    process.wait()
    pid = int((tmp_path / "pid").read_text())
    while Path(f"/proc/{pid}").exists() and time.monotonic() < end_s:
        if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
            break
        time.sleep(0.02)
    assert time.monotonic() < end_s
