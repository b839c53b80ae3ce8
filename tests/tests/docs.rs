//! What the documents say is there: links, anchors, files, flags and command lines.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use tessera_tests::program::{program, run};

/// The README is for a user's first ten minutes.
const README_LINES: usize = 200;
/// The folders that paths in the documents begin with.
const ROOTS: [&str; 7] = ["core/", "proto/", "coordinator/", "worker/", "tests/", "docs/", ".github/"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A page, by its path from the root.
struct Page {
    name: String,
    text: String,
}

/// A part of a page.
enum Part<'a> {
    Line(&'a str),
    /// A fenced block: its language and its lines.
    Block(&'a str, Vec<&'a str>),
}

impl Page {
    fn read(name: &str) -> Self {
        let text = std::fs::read_to_string(root().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        Self { name: name.into(), text }
    }

    fn parts(&self) -> Vec<Part<'_>> {
        let (mut parts, mut lines) = (Vec::new(), self.text.lines());
        while let Some(line) = lines.next() {
            match line.trim_start().strip_prefix("```") {
                Some(language) => {
                    let block = lines.by_ref().take_while(|l| l.trim() != "```").collect();
                    parts.push(Part::Block(language.trim(), block));
                }
                None => parts.push(Part::Line(line)),
            }
        }
        parts
    }

    fn lines(&self) -> impl Iterator<Item = &str> {
        self.parts().into_iter().filter_map(|p| if let Part::Line(line) = p { Some(line) } else { None })
    }

    /// What stands between backticks, line by line.
    fn spans(&self) -> impl Iterator<Item = Vec<&str>> {
        self.lines().map(|line| line.split('`').skip(1).step_by(2).collect())
    }

    /// Names that its headings can be linked by, as GitHub makes them.
    fn anchors(&self) -> BTreeSet<String> {
        let mut seen = BTreeMap::<String, usize>::new();
        let headings = self.lines().filter(|l| l.starts_with('#')).map(|l| l.trim_start_matches('#').trim());
        headings
            .map(|heading| {
                let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
                let name: String = kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect();
                let count = seen.entry(name.clone()).or_insert(0);
                *count += 1;
                if *count == 1 { name } else { format!("{name}-{}", *count - 1) }
            })
            .collect()
    }

    /// Targets of its links, without those in code.
    fn links(&self) -> Vec<String> {
        let mut links = Vec::new();
        for line in self.lines() {
            let prose: String = line.split('`').step_by(2).collect();
            for after in prose.split("](").skip(1) {
                links.push(after.split([')', ' ']).next().unwrap_or("").to_owned());
            }
        }
        links
    }

    /// Command lines of its shell blocks, as words.
    fn commands(&self) -> Vec<Vec<String>> {
        let mut commands = Vec::new();
        for part in self.parts() {
            let Part::Block(language, lines) = part else { continue };
            let text = lines.join("\n").replace("\\\n", " ");
            for line in text.lines() {
                let typed = match language {
                    "sh" => Some(line),
                    "console" => line.strip_prefix("$ "),
                    _ => None,
                };
                commands.extend(typed.map(words).unwrap_or_default());
            }
        }
        commands
    }
}

/// The commands of a line of shell, each as its words from the program's name on.
fn words(line: &str) -> Vec<Vec<String>> {
    let (mut commands, mut command, mut word) = (Vec::new(), Vec::<String>::new(), None::<String>);
    let mut quote = None;
    let mut redirected = false;
    for c in line.chars().chain([' ', ';']) {
        match (quote, c) {
            (Some(q), c) if q == c => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, '#') if word.is_none() => break,
            (None, c) if c.is_whitespace() || ";&|<>".contains(c) => {
                let stream = c == '>' && word.as_ref().is_some_and(|w| w.chars().all(|c| c.is_ascii_digit()));
                let ended = word.take();
                let waits = redirected && ended.is_none() && c.is_whitespace();
                command.extend(ended.filter(|_| !redirected && !stream));
                redirected = waits || c == '>' || c == '<';
                if ";&|".contains(c) {
                    commands.push(std::mem::take(&mut command));
                }
            }
            (_, c) => word.get_or_insert_default().push(c),
        }
    }
    commands.push(command);
    for command in &mut commands {
        let assigned = command.iter().take_while(|w| w.contains('=') && !w.starts_with('-')).count();
        command.drain(..assigned);
    }
    commands.retain(|c| !c.is_empty());
    commands
}

fn pages() -> Vec<Page> {
    let mut names: Vec<String> = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(String::from).into();
    let mut folders = vec!["docs".to_owned(), ".github".to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(root().join(&folder)).unwrap_or_else(|e| panic!("{folder}: {e}")) {
            let entry = entry.expect("a folder can be read");
            let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                folders.push(name);
            } else if name.ends_with(".md") {
                names.push(name);
            }
        }
    }
    names.iter().map(|name| Page::read(name)).collect()
}

fn assert_none(wrong: &[String]) {
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// The flags and subcommands that our programs say they have.
struct Programs {
    /// Of `coordinator COMMAND` and of `worker`, by COMMAND or "worker".
    flags: BTreeMap<String, BTreeSet<String>>,
}

impl Programs {
    fn ask() -> Self {
        let mut flags = BTreeMap::new();
        flags.insert("worker".to_owned(), offered(&help("worker", &[])));
        let all = help("coordinator", &[]);
        let commands = all.lines().skip_while(|l| *l != "Commands:").skip(1).take_while(|l| !l.is_empty());
        // What is longer goes on in a line that is further in.
        let names = commands.filter(|l| !l.starts_with("   ")).filter_map(|l| l.split_whitespace().next());
        for command in names.filter(|c| *c != "help") {
            flags.insert(command.to_owned(), offered(&help("coordinator", &[command])));
        }
        // `workers` is a command, `worker` the program.
        assert!(flags.len() > 10, "these cannot be all: {flags:?}");
        flags.insert("coordinator".to_owned(), offered(&all));
        Self { flags }
    }

    /// Whether `flag` is one of `of`, or of any where `of` is no command.
    fn have(&self, of: &str, flag: &str) -> bool {
        match self.flags.get(of) {
            Some(flags) => flags.contains(flag),
            None => self.flags.values().any(|flags| flags.contains(flag)),
        }
    }
}

fn help(name: &str, command: &[&str]) -> String {
    let ended = Command::new(program(name)).args(command).arg("--help").stdin(Stdio::null()).output();
    let ended = ended.unwrap_or_else(|e| panic!("{name}: {e}"));
    assert!(ended.status.success(), "{name} {command:?}");
    String::from_utf8_lossy(&ended.stdout).into_owned()
}

/// The flags that a help text offers. It may also speak of others.
fn offered(help: &str) -> BTreeSet<String> {
    let items = help.lines().filter(|l| l.starts_with("  -") || l.starts_with("      --"));
    items.flat_map(|l| flags_in(l.trim().split("  ").next().unwrap_or(""))).collect()
}

/// All that begins with two hyphens, up to what cannot be in a flag's name.
fn flags_in(text: &str) -> BTreeSet<String> {
    let mut flags = BTreeSet::new();
    for (at, _) in text.match_indices("--") {
        let alone = text[..at].chars().next_back().is_none_or(|c| !c.is_alphanumeric() && c != '-');
        let name: String = text[at + 2..].chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
        if alone && name.starts_with(|c: char| c.is_ascii_lowercase()) {
            flags.insert(format!("--{}", name.trim_end_matches('-')));
        }
    }
    flags
}

#[test]
fn shell_is_split_into_words() {
    let split = |line| words(line).iter().map(|c| c.join("_")).collect::<Vec<_>>();
    assert_eq!(split("A=1 a 'b c' --d=\"e f\" # g"), ["a_b c_--d=e f"]);
    assert_eq!(split("a b > file c && d | e 2>/dev/null f; g"), ["a_b_c", "d", "e_f", "g"]);
    assert_eq!(split("a '#b' c#d"), ["a_#b_c#d"]);
    assert_eq!(split("# nothing"), [""; 0]);
    assert_eq!(flags_in("`--a-b C`, x--y --d=3 ---"), ["--a-b", "--d"].map(String::from).into());
}

#[test]
fn every_link_leads_somewhere() {
    let mut wrong = Vec::new();
    for page in pages() {
        for link in page.links() {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (path, anchor) = link.split_once('#').map_or((link.as_str(), None), |(path, a)| (path, Some(a)));
            let folder = Path::new(&page.name).parent().expect("a page has a folder");
            let target = if path.is_empty() { PathBuf::from(&page.name) } else { folder.join(path) };
            let whole = root().join(&target);
            if !whole.exists() {
                wrong.push(format!("{}: {link} leads to nothing", page.name));
            } else if let Some(anchor) = anchor
                && !Page::read(&target.to_string_lossy()).anchors().contains(anchor)
            {
                wrong.push(format!("{}: {link} leads to no heading", page.name));
            }
        }
    }
    assert_none(&wrong);
}

#[test]
fn every_file_that_is_named_is_there() {
    let mut wrong = Vec::new();
    for page in pages().iter().filter(|p| p.name != "CHANGELOG.md") {
        for spans in page.spans() {
            // "`folder/`: `a.rs`, `b.rs`"
            let mut folder = None;
            for span in spans.into_iter().filter(|s| !s.contains([' ', '*', '…', '<', '{'])) {
                let rooted = ROOTS.iter().any(|r| span.starts_with(r));
                let path = if rooted {
                    PathBuf::from(span)
                } else {
                    match folder {
                        Some(folder) if span.ends_with(".rs") => Path::new(folder).join(span),
                        _ => continue,
                    }
                };
                if !root().join(&path).exists() {
                    wrong.push(format!("{}: there is no {}", page.name, path.display()));
                }
                if rooted {
                    folder = span.ends_with('/').then_some(span);
                }
            }
        }
    }
    assert_none(&wrong);
}

#[test]
fn the_readme_is_short() {
    let lines = Page::read("README.md").text.lines().count();
    assert!(lines <= README_LINES, "{lines} lines: what is not for the first ten minutes goes to docs/");
}

#[test]
fn every_dependency_has_its_reason_in_the_readme() {
    let readme = Page::read("README.md").text;
    let table = readme.split("## Dependencies").nth(1).expect("a table of dependencies");
    let named: BTreeSet<&str> = table.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '_').collect();
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let told = Command::new(cargo)
        .args(["metadata", "--no-deps", "--format-version", "1", "--locked", "--manifest-path"])
        .arg(root().join("Cargo.toml"))
        .output()
        .expect("cargo runs");
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let metadata: Value = serde_json::from_slice(&told.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let of = |p: &Value| p["dependencies"].as_array().cloned().unwrap_or_default();
    let direct = packages.iter().flat_map(of).filter(|d| d["source"].is_string());
    let names: BTreeSet<String> = direct.filter_map(|d| d["name"].as_str().map(String::from)).collect();
    assert!(names.len() > 20, "these cannot be all: {names:?}");
    let missing: Vec<String> = names.into_iter().filter(|name| !named.contains(name.as_str())).collect();
    assert!(missing.is_empty(), "not in the README's table: {}", missing.join(", "));
}

#[test]
fn every_command_line_is_understood() {
    let at = tempfile::tempdir().expect("a folder");
    let (mut wrong, mut ours) = (Vec::new(), 0);
    for page in pages() {
        for command in page.commands() {
            let name = Path::new(&command[0]).file_name().and_then(OsStr::to_str).unwrap_or("");
            if let "coordinator" | "worker" = name {
                ours += 1;
                // Everything before `--help` is read and checked, and nothing is done.
                let asked =
                    Command::new(program(name)).current_dir(at.path()).args(&command[1..]).arg("--help").output();
                let asked = asked.expect("the program starts");
                if !asked.status.success() {
                    let why = String::from_utf8_lossy(&asked.stderr).into_owned();
                    wrong.push(format!("{}: {}: {why}", page.name, command.join(" ")));
                }
            } else if name == "cargo" {
                wrong.extend(missing_targets(&command).map(|m| format!("{}: there is no {m}", page.name)));
            } else if command[0].starts_with('.') && !root().join(&command[0]).exists() {
                wrong.push(format!("{}: there is no {}", page.name, command[0]));
            }
        }
    }
    assert_none(&wrong);
    assert!(ours > 15, "only {ours} commands were found");
}

/// Packages, programs, tests and benches that cargo is asked for and that are not there.
fn missing_targets(command: &[String]) -> impl Iterator<Item = String> {
    command.windows(2).filter_map(|pair| {
        let name = &pair[1];
        let places = match pair[0].as_str() {
            "-p" => vec![format!("{}/Cargo.toml", name.strip_prefix("tessera-").unwrap_or(name))],
            "--bin" => vec![format!("tests/src/bin/{name}.rs"), format!("tests/src/bin/{name}/main.rs")],
            "--test" => vec![format!("tests/tests/{name}.rs")],
            "--bench" => vec![format!("tests/benches/{name}.rs")],
            _ => return None,
        };
        (!places.iter().any(|p| root().join(p).exists())).then(|| format!("{} {name}", pair[0]))
    })
}

#[test]
fn every_flag_that_is_named_exists() {
    let programs = Programs::ask();
    let mut wrong = Vec::new();
    // The changelog may speak of what is gone.
    for page in pages().iter().filter(|p| p.name != "CHANGELOG.md") {
        // Of what a page shows of other programs, it may also speak.
        let others: BTreeSet<String> = page
            .parts()
            .iter()
            .filter_map(|p| if let Part::Block(_, lines) = p { Some(lines) } else { None })
            .flatten()
            .flat_map(|line| words(line))
            .filter(|c| !c[0].ends_with("coordinator") && !c[0].ends_with("worker"))
            .flat_map(|c| flags_in(&c.join(" ")))
            .collect();
        for span in page.spans().flatten() {
            let mut first = span.split_whitespace();
            let of = match (first.next(), first.next()) {
                (Some("coordinator"), Some(command)) if programs.flags.contains_key(command) => command,
                (Some("coordinator"), _) => "",
                (Some(command), _) if programs.flags.contains_key(command) => command,
                (Some(flag), _) if flag.starts_with('-') => "",
                _ => continue,
            };
            for flag in flags_in(span) {
                if !others.contains(&flag) && !programs.have(of, &flag) {
                    wrong.push(format!("{}: `{span}` names {flag}", page.name));
                }
            }
        }
    }
    assert_none(&wrong);
}

#[test]
fn tables_of_flags_are_complete_and_of_their_command() {
    let programs = Programs::ask();
    let mut wrong = Vec::new();
    for (command, page, heading) in [
        ("render", "README.md", "### Flags of `render`"),
        ("worker", "docs/farm.md", "## The worker"),
        ("measure", "docs/accuracy.md", "## Measuring"),
    ] {
        let page = Page::read(page);
        let section = page.lines().skip_while(|l| !l.starts_with(heading)).skip(1).take_while(|l| !l.starts_with('#'));
        // Rows begin with their flags.
        let cells = section.filter_map(|l| l.strip_prefix("| ")?.split(" | ").next());
        let named: BTreeSet<String> = cells.flat_map(flags_in).collect();
        for flag in named.difference(&programs.flags[command]) {
            wrong.push(format!("{}: {command} has no {flag}", page.name));
        }
        for flag in programs.flags[command].difference(&named) {
            if !["--help", "--version", "--verbose"].contains(&flag.as_str()) {
                wrong.push(format!("{}: nothing of {command}'s {flag}", page.name));
            }
        }
    }
    assert_none(&wrong);
}

#[test]
fn scenes_of_the_documents_are_valid() {
    let at = tempfile::tempdir().expect("a folder");
    let folder = root().join("docs/scenes");
    let mut checked = 0;
    for entry in std::fs::read_dir(&folder).expect("scenes of the documents") {
        let path = entry.expect("a folder can be read").path();
        if path.extension() == Some(OsStr::new("xml")) {
            let ended = run(at.path(), [OsStr::new("check"), path.as_os_str()]);
            assert!(ended.code == Some(0) && ended.err.is_empty(), "{}: {}", path.display(), ended.err);
            checked += 1;
        }
    }
    assert!(checked > 0, "there are none");
}
