//! A script that carries out a plan with Slurm.

use std::fmt::Write;
use std::path::Path;

use super::Project;
use crate::run::MemoryLimit;

/// Most tasks of a job array: the default of Slurm's `MaxArraySize`.
const MOST: usize = 1000;

/// The script: a job array for each stage, which waits for the stage before, and a job that writes the mesh. `program` and the folder of
/// the plan must be at the same place on all nodes.
pub fn slurm_script(
    project: &Project,
    folder: &Path,
    program: &Path,
    limit: Option<MemoryLimit>,
) -> String {
    let folder = folder.display().to_string();
    let program = quoted(&program.display().to_string());
    // Shell words within a shell word: the command of a task is an argument of sbatch.
    let item = quoted(&format!("exec {program} tiles item {}", quoted(&folder)));
    let run = quoted(&format!("exec {program} tiles run {} -q", quoted(&folder)));
    let (mut memory, mut task_limit) = (String::new(), String::new());
    if let Some(limit) = limit {
        let megabytes = limit.megabytes.ceil();
        // Slurm counts in units of 1024 * 1024 bytes, and less than is addressed is resident.
        memory = format!(" --mem={megabytes}M");
        task_limit = format!(" --memory-limit={megabytes}M");
    }
    let mut script = format!(
        "#!/bin/sh
# Carries out a plan of linecarve with Slurm: a job array for each stage, then a job that writes the mesh.
# Arguments go to every sbatch: sh this-script --partition=long --time=2:00:00
# Run again after a failure: tasks that are done end at once.
set -eu
work={work}
item={item}
run={run}
mkdir -p \"$work/log\"
after=
# Arguments: stage, first task, last index of the array, then those of sbatch. Prints the id of the job.
array() {{
    stage=$1 first=$2 last=$3
    shift 3
    sbatch --parsable --job-name=\"linecarve-$stage\" --array=\"0-$last\" $after --kill-on-invalid-dep=yes --requeue \\
        --cpus-per-task=1{memory} --output=\"$work/log/%x-%A-%a.txt\" \"$@\" \\
        --wrap \"$item $stage \\$(($first + SLURM_ARRAY_TASK_ID)) --threads 1{task_limit}\"
}}
",
        work = quoted(&folder),
    );
    for stage in project.stages() {
        let count = project.tasks(stage).count();
        let mut next = "--dependency=afterok".to_owned();
        for (part, first) in (0..count).step_by(MOST).enumerate() {
            let last = (count - first).min(MOST) - 1;
            let name = stage.name();
            // Writing to a string cannot fail.
            let _ = writeln!(script, "job{part}=$(array {name} {first} {last} \"$@\")");
            let _ = write!(next, ":${{job{part}%%;*}}");
        }
        let _ = writeln!(script, "after={next}");
    }
    script
        + &format!(
            "sbatch --parsable --job-name=linecarve-mesh $after --kill-on-invalid-dep=yes{memory} \\
    --output=\"$work/log/%x-%A.txt\" \"$@\" --wrap \"$run{task_limit}\"
"
        )
}

/// A word for a shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}
