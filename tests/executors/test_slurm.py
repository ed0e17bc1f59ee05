# SPDX-License-Identifier: GPL-3.0-or-later
"""The script for Slurm: bash accepts it, and a `sbatch` of a few lines that runs arrays as Slurm does runs it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from noisy_world.cli import command
from noisy_world.executors import slurm
from noisy_world.executors.jobs import Task
from noisy_world.executors.slurm import SlurmJob, slurm_script

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")

# As sbatch does: options on the command line replace those in the file; each task gets its number; one id is printed.
SBATCH = r"""#!/bin/bash
here=$(dirname "$0")
id=$(( $(cat "$here/last" 2>/dev/null || echo 100) + 1 )); echo $id > "$here/last"
array=$(sed -n 's/^#SBATCH --array=//p' "${@: -1}")
cpus=$(sed -n 's/^#SBATCH --cpus-per-task=//p' "${@: -1}")
for word in "$@"; do
  case "$word" in --array=*) array=${word#--array=} ;; esac
  echo "$id $word" >> "$here/words"
done
cp "${@: -1}" "$here/spooled-$id"  # jobs run a copy, elsewhere
echo "$id;cluster"
for ((task = ${array%-*}; task <= ${array#*-}; task++)); do
  (cd / && SLURM_JOB_ID=$id SLURM_ARRAY_TASK_ID=$task SLURM_CPUS_PER_TASK=$cpus bash "$here/spooled-$id") \
    >> "$here/said" 2>&1 || echo "$id $task failed" >> "$here/said"
done
"""
NAMES = ["room0.000000-000010", "room 1@it's.000000-000010", "$(touch harm).000010-000020", "last.000000-000001"]
PRINT = (sys.executable, "-c", "import os, sys; print(os.environ['PYTHON_CPU_COUNT'], os.getcwd(), sys.argv[1:])")


def job(folder, names=NAMES, **values):
    return SlurmJob("my preset", folder, tasks(names), (*PRINT, "--shard"), (*PRINT, "merge it"), 1.0, **values)


def tasks(names, seconds=60.0):
    return [Task(name, "r", seconds=seconds) for name in names]


def submit(folder, script, *options):
    (folder / "fake").mkdir(exist_ok=True)
    sbatch = folder / "fake/sbatch"
    sbatch.write_text(SBATCH)
    sbatch.chmod(0o755)
    path = folder / "plan.sh"
    path.write_text(script)
    environment = {key: value for key, value in os.environ.items() if not key.startswith("SLURM")}
    environment["PATH"] = f"{folder / 'fake'}:{environment['PATH']}"
    return subprocess.run(
        ["bash", str(path), *options], capture_output=True, text=True, check=False, env=environment, timeout=60
    )


def said(folder):
    return (folder / "fake/said").read_text().splitlines()


def test_bash_accepts_it(tmp_path):
    for names in (NAMES, [f"r.{k:06d}-{k + 1:06d}" for k in range(2500)]):
        script = slurm_script(job(tmp_path, names))
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)
        if shutil.which("shellcheck"):
            subprocess.run(["shellcheck", "-"], input=script, text=True, check=True)


def test_every_shard_is_made_once_and_then_they_are_merged(tmp_path):
    folder = tmp_path / "a folder"
    folder.mkdir()
    done = submit(folder, slurm_script(job(folder, cpus=3)), "-p", "long")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "submitted 101, 4 shards in 4 jobs, and 102, which merges them\n"
    assert said(folder) == [f"3 {folder} {['--shard', name]}" for name in NAMES] + [f"3 {folder} {['merge it']}"]
    words = (folder / "fake/words").read_text().splitlines()
    assert words[:3] == ["101 --parsable", "101 -p", "101 long"]
    assert {"102 long", "102 --dependency=afterany:101", "102 --array=0"} <= set(words)
    assert (folder / "logs").is_dir()  # Slurm makes no folders for what jobs print
    assert not Path("/harm").exists()
    assert not (folder / "harm").exists()


def test_more_shards_than_an_array_may_have(tmp_path, monkeypatch):
    monkeypatch.setattr(slurm, "LARGEST_ARRAY", 3)
    names = [f"r.{k:06d}-{k + 1:06d}" for k in range(8)]
    submit(tmp_path, slurm_script(job(tmp_path, names)))
    made = [re.findall(r"r\.\d+-\d+", line) for line in said(tmp_path)[:-1]]
    assert made == [names[:3], names[3:6], names[6:]]  # neighbours are made by one process


@pytest.mark.parametrize(
    ("longest_s", "count", "time"), [(60.0, 4, "00:13:00"), (3600.0, 4, "03:10:00"), (3600.0, 2500, "09:10:00")]
)
def test_the_time_asked_for(tmp_path, longest_s, count, time):
    names = [f"r.{k:06d}-{k + 1:06d}" for k in range(count)]
    script = slurm_script(SlurmJob("p", tmp_path, tasks(names, longest_s), ("a",), ("b",), 1.0))
    assert f"#SBATCH --time={time}\n" in script  # three times the estimate and ten minutes, for each shard of a job


def test_the_command_prints_it(tmp_path, capsys, monkeypatch):
    preset = str(Path(__file__).resolve().parents[2] / "presets/demo.yaml")
    monkeypatch.chdir(tmp_path)
    assert command.main(["plan", preset, "--out", "my out", "--shards", "3", "--slurm", "--cpus", "4"]) == 0
    script = capsys.readouterr().out
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    assert "#SBATCH --array=1-3\n" in script
    assert f"cd {tmp_path}\n" in script
    assert f"--out '{tmp_path}/my out' --threads 4 --shard \"${{shards[@]:(SLURM_ARRAY_TASK_ID - 1) * 1:1}}\"" in script
    assert f"--out '{tmp_path}/my out' --shards 3\nfi" in script
    with pytest.raises(SystemExit):
        command.main(["plan", preset, "--slurm"])
    assert "--slurm needs --shards N" in capsys.readouterr().err
