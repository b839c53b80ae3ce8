//! `coordinator jobs`, `workers`, `pause`, `resume` and `cancel`.

use std::time::Duration;

use coordinator::columns;
use coordinator::web::worker_json;
use coordinator::{is_final, state_name};
use serde_json::{Value, json};
use tessera_proto::control::{Job, State, Worker};
use tessera_proto::convert::printable;

use super::args::{ChangeJob, Jobs, Workers};
use super::console::Console;
use super::exit::{Exit, Failure};
use super::farm::{Change, Client};
use super::progress;
use super::runtime::{cores, on_runtime};

/// Between two looks at the jobs.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Lists jobs.
pub(crate) fn list(raw: &Jobs, console: &Console) -> Result<Exit, Failure> {
    on_runtime(cores(), async {
        let mut client = Client::connect(&raw.farm).await?;
        let mut said = String::new();
        loop {
            let jobs = match raw.id {
                Some(id) => vec![client.job(id).await?],
                None => client.jobs().await?,
            };
            if raw.ids {
                let numbers: String = jobs.iter().map(|job| format!("{}\n", job.id)).collect();
                console.out(&numbers)?;
                return Ok(Exit::Done);
            }
            let text = match raw.json {
                true => format!("{:#}\n", Value::Array(jobs.iter().map(as_json).collect())),
                false => table(&jobs),
            };
            if text != said {
                console.out(&text)?;
                said = text;
            }
            if !raw.watch || jobs.iter().all(|job| is_final(job.state())) {
                return Ok(Exit::Done);
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    })
}

/// Changes jobs' states.
pub(crate) fn change(raw: &ChangeJob, change: Change, console: &Console) -> Result<Exit, Failure> {
    on_runtime(cores(), async {
        let mut client = Client::connect(&raw.farm).await?;
        for &id in &raw.ids {
            let job = client.change(id, change).await?;
            console.say(&format!("job {id} is {}", state_name(job.state())));
        }
        Ok(Exit::Done)
    })
}

/// Lists workers.
pub(crate) fn workers(raw: &Workers, console: &Console) -> Result<Exit, Failure> {
    on_runtime(cores(), async {
        let mut client = Client::connect(&raw.farm).await?;
        let workers = client.workers().await?;
        let text = match raw.json {
            true => format!("{:#}\n", Value::Array(workers.iter().map(worker_json).collect())),
            false => worker_table(&workers),
        };
        console.out(&text)?;
        Ok(Exit::Done)
    })
}

/// What a job that ended means for whoever waited for it.
pub(super) fn verdict(job: &Job) -> Result<(), Failure> {
    let id = job.id;
    match job.state() {
        State::Done if job.result.as_ref().is_some_and(|r| r.target_met == Some(false)) => {
            Err(Failure::new(Exit::TargetMissed, format!("job {id}: the error asked for was not reached")))
        }
        State::Done => Ok(()),
        State::Failed => Err(Failure::new(Exit::Failed, format!("job {id} failed: {}", printable(&job.failure)))),
        state => Err(Failure::new(Exit::Failed, format!("job {id} is {}", state_name(state)))),
    }
}

fn table(jobs: &[Job]) -> String {
    let head = ["ID", "STATE", "DONE", "OWNER", "PRIORITY", "SIZE", "NAME"].map(String::from).to_vec();
    let rows = jobs.iter().map(|job| {
        let spec = job.spec.clone().unwrap_or_default();
        let size = spec
            .region
            .map_or_else(String::new, |r| format!("{}x{}", r.x1.saturating_sub(r.x0), r.y1.saturating_sub(r.y0)));
        let share = match (&job.progress, job.state()) {
            (_, State::Done) => "100 %".into(),
            (Some(p), _) => {
                let to_go =
                    p.remaining_us.map(|us| format!(", {} to go", progress::duration(Duration::from_micros(us))));
                format!("{:.0} %{}", 100.0 * p.share, to_go.unwrap_or_default())
            }
            (None, _) => String::new(),
        };
        let mut name = printable(&spec.name);
        if !job.failure.is_empty() {
            name += &format!(" ({})", printable(&job.failure));
        }
        let (id, state) = (job.id.to_string(), state_name(job.state()).to_owned());
        vec![id, state, share, printable(&spec.owner), spec.priority.to_string(), size, name]
    });
    columns(&std::iter::once(head).chain(rows).collect::<Vec<_>>(), &[])
}

fn worker_table(workers: &[Worker]) -> String {
    let head = ["NAME", "ADDRESS", "THREADS", "JOB", "TILES", "LOST", "MRAYS/S"].map(String::from).to_vec();
    let rows = workers.iter().map(|w| {
        let job = match (w.draining, w.job) {
            (true, _) => "leaving".into(),
            (false, 0) => "-".into(),
            (false, id) => id.to_string(),
        };
        let speed = format!("{:.1}", mega_rays(w));
        let counts = [w.tiles.to_string(), w.lost.to_string()];
        let [tiles, lost] = counts;
        vec![printable(&w.name), printable(&w.address), w.threads.to_string(), job, tiles, lost, speed]
    });
    columns(&std::iter::once(head).chain(rows).collect::<Vec<_>>(), &[])
}

fn mega_rays(w: &Worker) -> f64 {
    if w.busy_us > 0 { w.rays as f64 / w.busy_us as f64 } else { 0.0 }
}

fn as_json(job: &Job) -> Value {
    let spec = job.spec.clone().unwrap_or_default();
    let time = |ms: u64| (ms > 0).then_some(ms);
    json!({
        "id": job.id,
        "state": state_name(job.state()),
        "name": spec.name,
        "owner": spec.owner,
        "priority": spec.priority,
        "group": spec.group,
        "deadline_ms": time(spec.deadline_ms),
        "submitted_ms": job.submitted_ms,
        "started_ms": time(job.started_ms),
        "ended_ms": time(job.ended_ms),
        "failure": (!job.failure.is_empty()).then_some(&job.failure),
        "same_as": time(job.same_as),
        "share": job.progress.as_ref().map(|p| p.share),
        "remaining_seconds": job.progress.as_ref().and_then(|p| p.remaining_us).map(|us| us as f64 / 1e6),
        "workers": job.progress.as_ref().map(|p| p.workers),
        "pixels_sha256": job.result.as_ref().map(|r| r.pixels_sha256.iter().map(|b| format!("{b:02x}")).collect::<String>()),
        "target_met": job.result.as_ref().and_then(|r| r.target_met),
    })
}

#[cfg(test)]
mod tests {
    use tessera_proto::control::Spec;

    use super::*;

    #[test]
    fn tables_line_up_and_say_why_a_job_failed() {
        let spec = |name: &str| Some(Spec { name: name.into(), owner: "ann".into(), ..Spec::default() });
        let mut jobs = [
            Job { id: 1, spec: spec("a"), ..Job::default() },
            Job { id: 12, spec: spec("b\u{1b}[31m"), failure: "no".into(), ..Job::default() },
        ];
        jobs[0].set_state(State::Done);
        jobs[1].set_state(State::Failed);
        let text = table(&jobs);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[1].starts_with("1   done    100 %  ann"), "{text}");
        assert!(lines[2].contains("(no)") && !text.contains('\u{1b}'), "{text}");
    }
}
