// SPDX-License-Identifier: GPL-3.0-or-later
// A job type for Flamenco Manager: a dataset in shards, one a task, and a last task that merges them.
// It goes into the folder `scripts` beside the Manager's program, and is then called noisy_world_flamenco.

const JOB_TYPE = {
    label: "Noisy World Dataset",
    settings: [
        { key: "preset", type: "string", subtype: "file_path", required: true,
          description: "The preset, on the disk that all workers share" },
        { key: "out", type: "string", subtype: "dir_path", required: true,
          description: "The dataset's folder, on the same disk" },
        { key: "shards", type: "int32", default: 20, required: true,
          description: "Into how many tasks the dataset is cut" },
        { key: "threads", type: "int32", default: 0,
          description: "Threads of the renderer in each task; 0 for all that a worker has" },
        { key: "noisy_world", type: "string", default: "noisy-world",
          description: "The command as workers find it" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    if (settings.shards < 1) {
        throw new Error("shards has to be at least 1");
    }
    const dataset = [settings.preset, "--out", settings.out];
    const threads = settings.threads > 0 ? ["--threads", `${settings.threads}`] : [];

    const merge = author.Task("merge", "misc");
    merge.addCommand(author.Command("exec", {
        exe: settings.noisy_world,
        args: ["merge", ...dataset, "--shards", `${settings.shards}`],
    }));
    for (let number = 1; number <= settings.shards; number++) {
        const task = author.Task(`shard-${number}`, "blender");
        task.addCommand(author.Command("exec", {
            exe: settings.noisy_world,
            args: ["shard", ...dataset, ...threads, "--part", `${number}/${settings.shards}`],
        }));
        merge.addDependency(task);
        job.addTask(task);
    }
    job.addTask(merge);
}
