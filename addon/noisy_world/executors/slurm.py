# SPDX-License-Identifier: GPL-3.0-or-later
"""The shards of a plan as one bash script for Slurm: it submits itself as an array of jobs, and a job that merges."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .jobs import Task

LARGEST_ARRAY = 1000  # Slurm's MaxArraySize is 1001 unless a cluster says otherwise
MARGIN = 3.0  # of the time asked for over the estimate, as nodes differ, and a shared disk may be slow; chosen
START_S = 600.0  # asked for besides: loading Blender and a scene from a shared disk; chosen


@dataclass(frozen=True)
class SlurmJob:
    """What the script submits.

    name: of the jobs. folder: where the commands' relative paths begin. shards: as tasks, in order, with the seconds
    that each takes by the estimate. shard, merge: the words of the commands; to those of `shard` names are added. cpus:
    of each job. merge_s: what merging takes. logs: the folder for what the jobs print.
    """

    name: str
    folder: Path
    shards: Sequence[Task]
    shard: Sequence[str]
    merge: Sequence[str]
    merge_s: float
    cpus: int = 2
    logs: str = "logs"

    @property
    def each(self) -> int:
        """How many shards a job of the array makes: one, unless there are more than Slurm takes jobs."""
        return -(-len(self.shards) // LARGEST_ARRAY)


SCRIPT = """\
#!/bin/bash
# {name}: {count} shards, {cpus} processors each, and a last job that merges them.
#
#   bash THIS_FILE             submits an array of {array} jobs, and the merging job, which waits for them
#   bash THIS_FILE -p long     hands -p long on to sbatch, and any other option
#
# Submit it again after anything went wrong: shards that are finished are checked and not made again.
# Folder, Python and files have to be on a disk that all nodes share, under the same names.
#SBATCH --job-name={name}
#SBATCH --array=1-{array}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task={cpus}
#SBATCH --time={time}
#SBATCH --output={logs}/%x-%A_%a.txt
set -euo pipefail
cd {folder}

if [ -z "${{SLURM_ARRAY_TASK_ID:-}}" ]; then # nobody's job: submit
  mkdir -p {logs}
  array=$(sbatch --parsable "$@" "$0")
  array=${{array%%;*}}
  merging=$(sbatch --parsable "$@" --dependency="afterany:$array" --array=0 --time={merge_time} "$0")
  echo "submitted $array, {count} shards in {array} jobs, and ${{merging%%;*}}, which merges them"
  exit
fi

export PYTHON_CPU_COUNT="${{SLURM_CPUS_PER_TASK:-{cpus}}}" OMP_NUM_THREADS="${{SLURM_CPUS_PER_TASK:-{cpus}}}"
if [ "$SLURM_ARRAY_TASK_ID" -eq 0 ]; then
  exec {merge}
fi
shards=(
{shards}
)
exec {shard} "${{shards[@]:(SLURM_ARRAY_TASK_ID - 1) * {each}:{each}}}"
"""


def slurm_script(job: SlurmJob) -> str:
    """Return the script. It needs bash and, where it is submitted, sbatch."""
    longest_s = max(task.seconds for task in job.shards)
    return SCRIPT.format(
        name=_job_name(job.name),
        count=len(job.shards),
        each=job.each,
        array=-(-len(job.shards) // job.each),
        cpus=job.cpus,
        time=_time(job.each * longest_s * MARGIN + START_S),
        merge_time=_time(job.merge_s * MARGIN + START_S),
        logs=shlex.quote(job.logs),
        folder=shlex.quote(str(job.folder)),
        merge=shlex.join(job.merge),
        shard=shlex.join(job.shard),
        shards="\n".join(f"  {shlex.quote(task.name)}" for task in job.shards),
    )


def _job_name(text: str) -> str:
    """Return a name that Slurm takes in a line of options: letters, digits, dots, hyphens."""
    return "".join(letter if letter.isalnum() or letter in ".-_" else "-" for letter in text) or "noisy-world"


def _time(seconds: float) -> str:
    """Return a duration as Slurm's hours:minutes:seconds, in whole minutes upwards."""
    minutes = math.ceil(seconds / 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}:00"
