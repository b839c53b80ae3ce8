//! Completions for shells, which also know the farm's jobs.

use clap::CommandFactory;
use clap_complete::Shell;

use super::args::Args;

/// The commands that take a job's number.
const OF_JOBS: &str = "jobs pause resume cancel fetch";

/// Before the first function of zsh's script.
const ZSH: &str = "\
_coordinator_ids() {
    local -a ids
    ids=(${(f)\"$(coordinator jobs --ids 2>/dev/null)\"})
    compadd -a ids
}

";
const ZSH_FIRST: &str = "(( $+functions[_coordinator_commands] )) ||";

/// Completes after bash's own script did.
const BASH: &str = r#"
_coordinator_and_ids() {
    _coordinator "$@"
    case " OF_JOBS " in
        *" ${COMP_WORDS[1]} "*)
            if [[ ${COMP_CWORD} -ge 2 && $2 != -* && $3 != -* ]]; then
                COMPREPLY=($(compgen -W "$(coordinator jobs --ids 2>/dev/null)" -- "$2"))
            fi
            ;;
    esac
}
complete -F _coordinator_and_ids -o nosort -o bashdefault -o default coordinator 2>/dev/null ||
    complete -F _coordinator_and_ids -o bashdefault -o default coordinator
"#;

/// The script for a shell.
pub(super) fn script(shell: Shell) -> String {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Args::command(), "coordinator", &mut text);
    let text = String::from_utf8_lossy(&text).into_owned();
    match shell {
        Shell::Bash => text + &BASH.replace("OF_JOBS", OF_JOBS),
        Shell::Zsh => text
            .replace("ids -- The jobs'\\'' numbers:_default", "ids -- The jobs'\\'' numbers:_coordinator_ids")
            .replace("id -- The job'\\''s number:_default", "id -- The job'\\''s number:_coordinator_ids")
            .replace("id -- Only this one:_default", "id -- Only this one:_coordinator_ids")
            .replacen(ZSH_FIRST, &format!("{ZSH}{ZSH_FIRST}"), 1),
        Shell::Fish => {
            let line = |command| {
                format!(
                    "complete -c coordinator -n \"__fish_coordinator_using_subcommand {command}\" -f -a \
                     \"(coordinator jobs --ids 2>/dev/null)\"\n"
                )
            };
            text + &OF_JOBS.split(' ').map(line).collect::<String>()
        }
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_that_takes_a_job_asks_for_their_numbers() {
        let zsh = script(Shell::Zsh);
        // Named after `jobs` once, after `fetch` once, after the others once each; and the function.
        assert_eq!(zsh.matches("_coordinator_ids").count(), 6, "{zsh}");
        assert_eq!(script(Shell::Fish).matches("jobs --ids").count(), 5);
        assert!(script(Shell::Bash).contains(&format!("case \" {OF_JOBS} \"")));
    }
}
