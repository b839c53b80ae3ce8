//! A fleet's jobs in a batch system.

use super::call::{CallError, call};
use super::engine::{Batch, List};
use super::placement::Standing;
use super::{Fleet, TokenSource, script};

/// See the [module](self).
#[derive(Debug)]
pub(super) struct BatchJobs {
    batch: &'static Batch,
    /// Jobs submitted, those that have ended included.
    jobs: Vec<String>,
    /// Whether there may be jobs: also where a submission was not answered.
    begun: bool,
    /// Tasks of one array that the site allows, as far as is known.
    most: usize,
}

impl BatchJobs {
    pub(super) fn new(batch: &'static Batch) -> Self {
        Self { batch, jobs: Vec::new(), begun: false, most: batch.most }
    }

    /// Submits `count` workers. Some may be there although it fails.
    pub(super) async fn add(&mut self, fleet: &Fleet, count: usize) -> Result<(), CallError> {
        let mut left = count;
        while left > 0 {
            let tasks = left.min(self.most);
            match self.submit(fleet, tasks).await {
                Ok(job) => {
                    self.begun = true;
                    self.jobs.push(job);
                    left -= tasks;
                }
                // Sites that set a lower limit than usual do not all say which.
                Err(CallError::Refused(why)) if tasks > 1 && why.to_lowercase().contains("array") => {
                    self.most = tasks / 2;
                }
                Err(e) => {
                    self.begun |= matches!(e, CallError::Silent(_));
                    return Err(e);
                }
            }
        }
        Ok(())
    }

    async fn submit(&self, fleet: &Fleet, tasks: usize) -> Result<String, CallError> {
        let script = script::array(self.batch, fleet, tasks);
        let mut environment: Vec<_> = self.batch.unset.iter().map(|&name| (name, None)).collect();
        // A token of another farm would only be in the way of one that asks for none.
        environment.push(match &fleet.order.token {
            TokenSource::Environment(token) => ("TESSERA_TOKEN", Some(token.reveal())),
            _ => ("TESSERA_TOKEN", None),
        });
        let words: Vec<String> = self.batch.submit.iter().map(ToString::to_string).collect();
        let said = call(&words, &script, &environment).await?;
        job_number(&said)
            .ok_or_else(|| CallError::Refused(format!("'{}' names no job: {}", self.batch.submit[0], said.trim())))
    }

    /// What is there now.
    pub(super) async fn standing(&self, fleet: &Fleet) -> Result<Standing, CallError> {
        if !self.begun {
            return Ok(Standing::default());
        }
        match call(&self.filled(self.batch.query, fleet), "", &[]).await {
            Ok(list) => Ok(read(&list, &self.batch.list)),
            Err(CallError::Refused(why)) if self.is_none_left(&why) => Ok(Standing::default()),
            Err(e) => Err(e),
        }
    }

    /// Ends tasks.
    pub(super) async fn remove(&self, tasks: &[String]) -> Result<(), CallError> {
        // What one command line holds.
        for some in tasks.chunks(200) {
            let words: Vec<String> =
                self.batch.cancel.iter().map(ToString::to_string).chain(some.iter().cloned()).collect();
            self.ended(call(&words, "", &[]).await)?;
        }
        Ok(())
    }

    /// Ends all.
    pub(super) async fn remove_all(&self, fleet: &Fleet) -> Result<(), CallError> {
        if !self.begun {
            return Ok(());
        }
        self.ended(call(&self.filled(self.batch.cancel_all, fleet), "", &[]).await)
    }

    /// What to type to end all.
    pub(super) fn remedy(&self, fleet: &Fleet) -> String {
        self.filled(self.batch.cancel_all, fleet).join(" ")
    }

    /// What ended meanwhile is no error.
    fn ended(&self, said: Result<String, CallError>) -> Result<(), CallError> {
        match said {
            Err(CallError::Refused(why)) if self.is_none_left(&why) => Ok(()),
            said => said.map(drop),
        }
    }

    fn is_none_left(&self, said: &str) -> bool {
        self.batch.none_left.iter().any(|part| said.contains(part))
    }

    fn filled(&self, words: &[&str], fleet: &Fleet) -> Vec<String> {
        let user = ["USER", "LOGNAME"].into_iter().find_map(|name| std::env::var(name).ok()).filter(|u| !u.is_empty());
        let mut filled = Vec::new();
        for word in words {
            match (*word, &user) {
                ("{jobs}", _) => filled.extend(self.jobs.iter().cloned()),
                // The name is nobody else's.
                (word, None) if word.contains("{user}") => {}
                (word, user) => {
                    let word = word.replace("{name}", &fleet.name);
                    filled.push(word.replace("{user}", user.as_deref().unwrap_or_default()));
                }
            }
        }
        filled
    }
}

/// The job's number in what a submission prints: `17`, `17;cluster`, `17[].server`, `Job <17> is submitted`.
fn job_number(said: &str) -> Option<String> {
    let last = said.lines().rfind(|line| line.contains(|c: char| c.is_ascii_digit()))?;
    if let Some((_, rest)) = last.split_once("Job <") {
        return rest.split_once('>').map(|(number, _)| number.to_owned());
    }
    let word = last.split([';', ' ']).next()?;
    (word.starts_with(|c: char| c.is_ascii_digit())).then(|| word.to_owned())
}

fn read(text: &str, list: &List) -> Standing {
    let mut standing = Standing::default();
    for line in text.lines() {
        let columns: Vec<&str> = match list.separator {
            Some(separator) => line.split(separator).map(str::trim).collect(),
            None => line.split_whitespace().collect(),
        };
        let (Some(id), Some(state)) = (columns.get(list.id), columns.get(list.state)) else { continue };
        let task = match list.index.and_then(|index| columns.get(index)) {
            Some(index) => format!("{id}[{index}]"),
            None => (*id).to_owned(),
        };
        if list.runs.contains(state) {
            standing.running.push(task);
        } else if list.waits.contains(state) {
            let reason = list.reason.and_then(|reason| columns.get(reason)).map(ToString::to_string);
            standing.waiting.push((task, reason));
        }
    }
    standing
}

#[cfg(test)]
mod tests {
    use super::super::Engine;
    use super::*;

    fn batch(name: &str) -> &'static Batch {
        match name.parse().unwrap() {
            Engine::Batch(batch) => batch,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn submissions_name_their_job() {
        for (said, number) in [
            ("17\n", "17"),
            ("17;cluster\n", "17"),
            ("sbatch: a word from the site\n17", "17"),
            ("17[].server.example\n", "17[].server.example"),
            ("Job <17> is submitted to default queue <normal>.\n", "17"),
        ] {
            assert_eq!(job_number(said).as_deref(), Some(number), "{said}");
        }
        assert_eq!(job_number("queued"), None);
        assert_eq!(job_number(""), None);
    }

    #[test]
    fn lists_say_what_waits_and_what_runs() {
        let slurm = read("17_0|R|None\n17_1|PD|Resources\n17_2|CG|None\n", &batch("slurm").list);
        assert_eq!(slurm.running, ["17_0"]);
        assert_eq!(slurm.waiting, [("17_1".to_owned(), Some("Resources".to_owned()))]);
        let pbs = "Job id            Name             User              Time Use S Queue\n\
                   ----------------  ---------------- ----------------  -------- - -----\n\
                   17[].server       tessera          ann                      0 B workq\n\
                   17[0].server      tessera          ann               00:00:01 R workq\n\
                   17[1].server      tessera          ann                      0 Q workq\n\
                   17[2].server      tessera          ann               00:00:01 X workq\n";
        let pbs = read(pbs, &batch("pbs").list);
        assert_eq!((pbs.running, pbs.waiting.len()), (vec!["17[0].server".to_owned()], 1));
        let lsf = read("17|1|RUN\n17|2|PEND\n17|3|DONE\n", &batch("lsf").list);
        assert_eq!(lsf.running, ["17[1]"]);
        assert_eq!(lsf.waiting, [("17[2]".to_owned(), None)]);
    }
}
