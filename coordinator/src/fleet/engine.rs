//! Batch systems as data: what their commands are called, how their scripts begin, how their lists read.

/// How a batch system is talked to. Commands are words; `{name}`, `{user}` and `{jobs}` in them are filled in, the last
/// by as many words as there are jobs.
#[derive(Debug, PartialEq, Eq)]
pub struct Batch {
    /// As it is called on the command line.
    pub name: &'static str,
    /// Reads a script from stdin, and answers with the number of the job.
    pub(super) submit: &'static [&'static str],
    /// Lists the tasks that wait or run, a line each.
    pub(super) query: &'static [&'static str],
    /// What it says where there is none of them any more, though that is no error.
    pub(super) none_left: &'static [&'static str],
    /// How a line of the list reads.
    pub(super) list: List,
    /// Ends the tasks whose names follow.
    pub(super) cancel: &'static [&'static str],
    /// Ends all that the fleet has.
    pub(super) cancel_all: &'static [&'static str],
    /// Begins a line of options in a script.
    pub(super) directive: &'static str,
    /// Those options; `{last}` is the last task's number, that of the first is 0 or [`Batch::first`].
    pub(super) options: &'static [&'static str],
    /// The number of an array's first task.
    pub(super) first: usize,
    /// Tasks of an array, where the site allows as many.
    pub(super) most: usize,
    /// What the script does before it becomes the worker. It may set `left`, the seconds until the engine ends it.
    pub(super) prologue: &'static [&'static str],
    /// The worker's name and its threads, as a shell finds them in the environment.
    pub(super) worker_name: &'static str,
    pub(super) threads: &'static str,
    /// Whether tasks have the environment in which they were submitted, and nobody else is shown it.
    pub(super) hands_on_environment: bool,
    /// Variables that would change what the script asks for.
    pub(super) unset: &'static [&'static str],
}

/// A line of the engine's list.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct List {
    /// Between columns; blanks where there is none.
    pub(super) separator: Option<char>,
    /// The column of the task's name, of its state, and of why it waits.
    pub(super) id: usize,
    /// The column of its number in the array, where that is no part of the name.
    pub(super) index: Option<usize>,
    pub(super) state: usize,
    pub(super) reason: Option<usize>,
    /// States of tasks that wait, and of such that run; others have ended or are about to.
    pub(super) waits: &'static [&'static str],
    pub(super) runs: &'static [&'static str],
}

/// All of them.
pub(super) const ALL: [&Batch; 3] = [&SLURM, &PBS, &LSF];

/// <https://slurm.schedmd.com/sbatch.html>
const SLURM: Batch = Batch {
    name: "slurm",
    submit: &["sbatch", "--parsable"],
    query: &["squeue", "--noheader", "--array", "--user={user}", "--name={name}", "--format=%i|%t|%r"],
    none_left: &[],
    list: List {
        separator: Some('|'),
        id: 0,
        index: None,
        state: 1,
        reason: Some(2),
        waits: &["PD", "CF", "RD", "RQ", "RF", "RH", "SE", "RV"],
        runs: &["R", "S", "ST", "SO"],
    },
    cancel: &["scancel", "--quiet"],
    cancel_all: &["scancel", "--quiet", "--user={user}", "--name={name}"],
    directive: "#SBATCH",
    options: &[
        "--job-name={name}",
        "--array=0-{last}",
        "--ntasks=1",
        // A preempted task, or one whose node died, waits for another.
        "--requeue",
        "--open-mode=append",
        "--output=/dev/null",
        "--export=ALL",
        // Where the engine does not say when it will end the worker, it tells it a minute before.
        "--signal=B:TERM@60",
    ],
    first: 0,
    // MaxArraySize is 1001 where nobody set it.
    most: 1000,
    prologue: &[r#"if [ -n "$SLURM_JOB_END_TIME" ]; then left=$((SLURM_JOB_END_TIME - $(date +%s))); fi"#],
    worker_name: "slurm-${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}",
    threads: "${SLURM_CPUS_PER_TASK:-${SLURM_CPUS_ON_NODE:-1}}",
    hands_on_environment: true,
    unset: &["SBATCH_EXPORT", "SBATCH_ARRAY_INX", "SBATCH_JOB_NAME", "SBATCH_SIGNAL"],
};

/// OpenPBS and PBS Professional.
const PBS: Batch = Batch {
    name: "pbs",
    submit: &["qsub"],
    query: &["qstat", "-t", "{jobs}"],
    none_left: &["Unknown Job", "Job has finished"],
    list: List {
        separator: None,
        id: 0,
        index: None,
        state: 4,
        reason: None,
        waits: &["Q", "H", "W", "T"],
        runs: &["R", "S", "U"],
    },
    cancel: &["qdel"],
    cancel_all: &["qdel", "{jobs}"],
    directive: "#PBS",
    options: &["-N {name}", "-J 0-{last}", "-r y", "-j oe", "-o /dev/null"],
    first: 0,
    most: 1000,
    prologue: &[],
    worker_name: "pbs-${PBS_JOBID%%.*}",
    threads: "${NCPUS:-1}",
    // 'qstat -f' shows everybody the variables of a job.
    hands_on_environment: false,
    unset: &[],
};

/// IBM Spectrum LSF.
const LSF: Batch = Batch {
    name: "lsf",
    submit: &["bsub"],
    query: &["bjobs", "-noheader", "-J", "{name}", "-o", "jobid jobindex stat delimiter='|'"],
    none_left: &["is not found", "No unfinished job found"],
    list: List {
        separator: Some('|'),
        id: 0,
        index: Some(1),
        state: 2,
        reason: None,
        waits: &["PEND", "PROV", "WAIT", "PSUSP"],
        runs: &["RUN", "USUSP", "SSUSP"],
    },
    cancel: &["bkill"],
    cancel_all: &["bkill", "-J", "{name}", "0"],
    directive: "#BSUB",
    options: &[r#"-J "{name}[1-{last}]""#, "-n 1", "-r", "-o /dev/null", "-wa TERM -wt 1"],
    first: 1,
    most: 1000,
    prologue: &[],
    worker_name: "lsf-${LSB_JOBID}_${LSB_JOBINDEX}",
    threads: "${LSB_DJOB_NUMPROC:-1}",
    hands_on_environment: true,
    unset: &[],
};
