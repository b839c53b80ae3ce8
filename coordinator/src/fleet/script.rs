//! The script that a batch system runs for each worker.

use std::fmt::Write;

use super::engine::Batch;
use super::{Fleet, TokenSource, quoted, seconds};

/// Seconds before the engine's limit that a worker leaves: it gives a tile back that takes longer than 20 s.
const BEFORE_THE_END: u32 = 45;
/// A limit of more seconds than these is none: a year.
const NO_LIMIT: u32 = 31_536_000;

/// A script for an array of `count` workers.
pub(super) fn array(batch: &Batch, fleet: &Fleet, count: usize) -> String {
    let mut text = String::from("#!/bin/sh\n");
    let last = (batch.first + count.max(1) - 1).to_string();
    for option in batch.options {
        let option = option.replace("{name}", &fleet.name).replace("{last}", &last);
        let _ = writeln!(text, "{} {option}", batch.directive);
    }
    // Later ones override those above.
    if !fleet.args.trim().is_empty() {
        let _ = writeln!(text, "{} {}", batch.directive, fleet.args.trim());
    }
    let order = &fleet.order;
    if let TokenSource::Environment(_) = order.token {
        text += "# The farm's token is in TESSERA_TOKEN, as 'coordinator token' prints it, when this is submitted.\n";
    }
    let mut words = vec![
        quoted(&fleet.program_there()),
        "--connect".into(),
        quoted(&order.connect.to_string()),
        "--name".into(),
        format!("\"{}\"", batch.worker_name),
        "--threads".into(),
        format!("\"{}\"", batch.threads),
        "--give-up-after".into(),
        seconds(order.give_up_after),
    ];
    if let TokenSource::File(path) = &order.token {
        words.extend(["--token-file".into(), quoted(&path.to_string_lossy())]);
    }
    if order.once {
        words.push("--once".into());
    }
    match order.lifetime {
        Some(lifetime) => words.extend(["--lifetime".into(), seconds(lifetime)]),
        None if batch.prologue.is_empty() => {}
        None => {
            text += "left=\n";
            for line in batch.prologue {
                let _ = writeln!(text, "{line}");
            }
            let _ = writeln!(
                text,
                "if [ \"${{left:-0}}\" -gt {} ] && [ \"$left\" -lt {NO_LIMIT} ]; then\n    \
                     set -- --lifetime \"$((left - {BEFORE_THE_END}))s\"\nelse\n    set --\nfi",
                2 * BEFORE_THE_END,
            );
            words.push("\"$@\"".into());
        }
    }
    // Signals are for the worker: no shell stays between.
    let _ = writeln!(text, "exec {}", words.join(" "));
    text
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tessera_proto::token::{Pin, Secret, Token};

    use super::super::{Engine, Program, Scaling, Size, WorkerOrder};
    use super::*;

    fn fleet(engine: &str) -> Fleet {
        let token = Token { pin: Pin::of(b"a certificate"), secret: Secret::new().unwrap() };
        Fleet {
            engine: engine.parse().unwrap(),
            name: "tessera-00c0ffee".into(),
            order: WorkerOrder {
                program: Program::Given("/opt/my tools/worker".into()),
                connect: "head:4747".parse().unwrap(),
                token: TokenSource::Environment(token),
                once: false,
                give_up_after: Duration::from_secs(120),
                lifetime: None,
            },
            args: "--partition=long --time=60".into(),
            image: String::new(),
            scaling: Scaling { size: Size { min: 0, max: 3 }, worth: Duration::ZERO, idle: Duration::ZERO },
        }
    }

    #[test]
    fn slurm_is_given_an_array_whose_options_the_user_can_override() {
        let text = fleet("slurm").print().unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "#!/bin/sh");
        assert!(lines.contains(&"#SBATCH --array=0-2") && lines.contains(&"#SBATCH --job-name=tessera-00c0ffee"));
        let last = lines.iter().rposition(|l| l.starts_with("#SBATCH")).unwrap();
        assert_eq!(lines[last], "#SBATCH --partition=long --time=60");
        assert!(lines[last + 1..].iter().all(|l| !l.starts_with("#SBATCH")));
        let exec = lines.last().unwrap();
        assert!(exec.starts_with("exec '/opt/my tools/worker' --connect head:4747 "), "{exec}");
        assert!(exec.contains("--give-up-after 120s") && exec.ends_with("\"$@\""));
    }

    #[test]
    fn no_script_holds_the_token() {
        for engine in ["slurm", "pbs", "lsf"] {
            let fleet = fleet(engine);
            let TokenSource::Environment(token) = &fleet.order.token else { unreachable!("as made above") };
            let secret = token.reveal();
            assert!(!fleet.print().unwrap().contains(&secret[secret.len() - 20..]), "{engine}");
        }
    }

    #[test]
    fn every_script_is_one_that_a_shell_takes() {
        for engine in ["slurm", "pbs", "lsf"] {
            for lifetime in [None, Some(Duration::from_millis(90_500))] {
                let mut fleet = fleet(engine);
                fleet.order.lifetime = lifetime;
                let Engine::Batch(batch) = fleet.engine else { unreachable!("all are") };
                let text = array(batch, &fleet, 2);
                assert_eq!(text.contains("--lifetime 90.5s"), lifetime.is_some());
                let shell = std::process::Command::new("sh").args(["-n", "-c", &text]).status();
                assert!(shell.unwrap().success(), "{text}");
            }
        }
    }
}
