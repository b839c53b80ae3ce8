//! What happened in a render, for machines: found by holding how far it is against how far it was.

use coordinator::Progress;
use serde_json::{Value, json};

/// What was told so far.
#[derive(Debug, Default)]
pub(super) struct Events {
    /// Of each worker, in order of arrival: its name, whether it was there, and the tiles it had lost.
    workers: Vec<(String, bool, u64)>,
    pass: u32,
    tiles_done: u64,
}

impl Events {
    /// What happened since it was asked last.
    pub(super) fn since(&mut self, now: &Progress) -> Vec<Value> {
        let mut found = Vec::new();
        for (place, w) in now.workers.iter().enumerate() {
            if self.workers.get(place).is_none_or(|(name, ..)| *name != w.name) {
                // A place may be another's after a worker that did nothing left.
                let new = (w.name.clone(), false, 0);
                match self.workers.get_mut(place) {
                    Some(old) => *old = new,
                    None => self.workers.push(new),
                }
            }
            let (_, connected, lost) = &mut self.workers[place];
            if w.lost > *lost {
                found.push(json!({ "event": "lost", "worker": w.name, "tiles": w.lost - *lost }));
                *lost = w.lost;
            }
            if w.connected != *connected {
                found.push(match w.connected {
                    true => json!({ "event": "joined", "worker": w.name, "threads": w.threads, "address": w.address }),
                    false => json!({ "event": "left", "worker": w.name, "cause": w.left }),
                });
                *connected = w.connected;
            }
        }
        if now.pass != self.pass {
            found.push(json!({ "event": "pass", "pass": now.pass, "look": now.is_look }));
            (self.pass, self.tiles_done) = (now.pass, 0);
        } else if now.tiles_done < self.tiles_done {
            found.push(json!({ "event": "redone", "tiles": self.tiles_done - now.tiles_done }));
        }
        self.tiles_done = now.tiles_done;
        found
    }
}

#[cfg(test)]
mod tests {
    use coordinator::WorkerStats;

    use super::*;

    #[test]
    fn whatever_changed_is_told_once() {
        let mut events = Events::default();
        let names =
            |found: Vec<Value>| found.iter().map(|e| e["event"].as_str().unwrap().to_owned()).collect::<Vec<_>>();
        let worker = WorkerStats { name: "bert".into(), connected: true, ..WorkerStats::default() };
        let mut now = Progress { pass: 1, workers: vec![worker], tiles_done: 7, ..Progress::default() };
        assert_eq!(names(events.since(&now)), ["joined", "pass"]);
        assert!(events.since(&now).is_empty());
        (now.tiles_done, now.workers[0].lost, now.workers[0].connected) = (4, 2, false);
        assert_eq!(names(events.since(&now)), ["lost", "left", "redone"]);
        (now.pass, now.tiles_done, now.workers[0].name) = (2, 0, "ernie".into());
        now.workers[0].connected = true;
        assert_eq!(names(events.since(&now)), ["lost", "joined", "pass"]);
    }
}
