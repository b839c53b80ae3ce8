//! A batch system of the test's own: `sbatch`, `squeue` and `scancel` that really start workers on this machine.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Takes partition `lab` and no other; each task is a process of its own session. A file of each task in `jobs` holds
/// its job's name and its process.
const SBATCH: &str = r##"#!/bin/sh
jobs=FOLDER/jobs
mkdir -p "$jobs"
script=$(mktemp FOLDER/script.XXXXXX)
cat > "$script"
option() { sed -n "s/^#SBATCH.*--$1=\([^ ]*\).*/\1/p" "$script" | tail -n 1; }
partition=$(option partition)
if [ "${partition:-lab}" != lab ]; then
    echo "sbatch: error: invalid partition specified: $partition" >&2
    echo "sbatch: error: Batch job submission failed: Invalid partition name specified" >&2
    exit 1
fi
last=$(option array | sed 's/^0-//')
if [ "$last" -ge 2 ]; then
    echo "sbatch: error: Batch job submission failed: Invalid job array specification" >&2
    exit 1
fi
job=$(ls "$jobs" FOLDER/ended 2>/dev/null | sed -n 's/_.*//p' | sort -n | tail -n 1)
job=$((${job:-0} + 1))
for task in $(seq 0 "$last"); do
    SLURM_ARRAY_JOB_ID=$job SLURM_ARRAY_TASK_ID=$task SLURM_CPUS_PER_TASK=1 \
        setsid sh "$script" </dev/null >>FOLDER/log 2>&1 &
    echo "$(option job-name) $!" > "$jobs/${job}_$task"
done
echo "$job"
"##;

/// Lists the tasks whose process is there.
const SQUEUE: &str = r##"#!/bin/sh
mkdir -p FOLDER/ended
for file in FOLDER/jobs/*; do
    [ -e "$file" ] || continue
    read -r name pid < "$file"
    state=$(sed 's/.*) //; s/ .*//' "/proc/$pid/stat" 2>/dev/null)
    case $state in
        '' | Z | X) mv "$file" FOLDER/ended ;;
        *) case " $* " in *" --name=$name "*) echo "$(basename "$file")|R|None" ;; esac ;;
    esac
done
"##;

/// Ends tasks by name, or all of a job's name.
const SCANCEL: &str = r##"#!/bin/sh
wanted=$(for word in "$@"; do case $word in --name=*) echo "${word#--name=}" ;; esac; done)
for file in FOLDER/jobs/*; do
    [ -e "$file" ] || continue
    read -r name pid < "$file"
    case " $* " in *" $(basename "$file") "*) name=$wanted ;; *) [ -n "$wanted" ] || continue ;; esac
    [ "$name" = "$wanted" ] && kill -TERM "$pid" 2>/dev/null
done
exit 0
"##;

/// See the [module](self). What it started is killed when it is dropped.
#[derive(Debug)]
pub struct FakeSlurm {
    folder: tempfile::TempDir,
}

impl Default for FakeSlurm {
    fn default() -> Self {
        Self::new()
    }
}

impl FakeSlurm {
    /// One without jobs.
    ///
    /// # Panics
    /// When there is no folder for it.
    #[must_use]
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in [("sbatch", SBATCH), ("squeue", SQUEUE), ("scancel", SCANCEL)] {
            let path = folder.path().join(name);
            let text = text.replace("FOLDER", folder.path().to_str().expect("a plain path"));
            fs::write(&path, text).expect("it can be written");
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("it is ours");
        }
        Self { folder }
    }

    /// Where its programs are.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Has `command` find its programs first.
    pub fn first_in_path<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        let rest = std::env::var_os("PATH").unwrap_or_default();
        let mut path = self.folder.path().as_os_str().to_owned();
        path.push(":");
        path.push(rest);
        command.env("PATH", path).env("USER", "somebody")
    }

    /// The processes of its tasks that are there, by the tasks' names.
    #[must_use]
    pub fn running(&self) -> Vec<(String, u32)> {
        let files = fs::read_dir(self.folder.path().join("jobs"));
        let mut found: Vec<(String, u32)> = files
            .into_iter()
            .flatten()
            .filter_map(|file| {
                let path: PathBuf = file.ok()?.path();
                let pid = fs::read_to_string(&path).ok()?.split_whitespace().nth(1)?.parse().ok()?;
                let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
                let state = stat.rsplit_once(") ")?.1.chars().next()?;
                let name = path.file_name()?.to_str()?.to_owned();
                (!"ZX".contains(state)).then_some((name, pid))
            })
            .collect();
        found.sort();
        found
    }

    /// What its workers said.
    #[must_use]
    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }
}

impl Drop for FakeSlurm {
    fn drop(&mut self) {
        for (_, pid) in self.running() {
            let _ = Command::new("kill").args(["-KILL", &pid.to_string()]).status();
        }
    }
}
