//! A fleet in Kubernetes: manifests for `kubectl apply`, and the number of its workers.
//!
//! A coordinator outside has its workers as a Deployment, which it scales; `--print` of `render` and `serve` puts the
//! coordinator into the cluster, too, with an authority and tokens of its own.

use tessera_proto::limits::DEFAULT_PORT;

use super::call::{CallError, call};
use super::placement::Standing;
use super::{Fleet, TokenSource, seconds};
use crate::access::{AccessError, fresh_secrets};

const WORKERS: &str = include_str!("kubernetes/workers.yaml");
const SECRET: &str = include_str!("kubernetes/secret.yaml");
const FARM: &str = include_str!("kubernetes/farm.yaml");
const JOB: &str = include_str!("kubernetes/job.yaml");
const STATEFUL: &str = include_str!("kubernetes/stateful.yaml");

/// Bytes of a scene that go into a ConfigMap, which may have 1 MiB.
pub const MOST_SCENE_BYTES: usize = 900_000;

/// What a coordinator in the cluster does.
#[derive(Clone, Debug)]
pub enum InCluster {
    /// It renders one scene, of this name and text, with these flags.
    Render {
        /// The file's name.
        name: String,
        /// What is in it.
        text: String,
        /// What is said about the picture.
        flags: Vec<String>,
        /// The picture's file name.
        output: String,
    },
    /// It stays.
    Serve,
}

/// A list of words as YAML has it.
fn list(words: &[String]) -> String {
    serde_json::Value::from(words).to_string()
}

/// Text as one YAML scalar: JSON's strings are YAML's.
fn scalar(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

fn filled(template: &str, values: &[(&str, &str)]) -> String {
    let mut text = template.to_owned();
    for (name, value) in values {
        text = text.replace(&format!("{{{name}}}"), value);
    }
    text
}

/// The workers' manifests; `inside` says that the farm is in the cluster, too.
fn workers(fleet: &Fleet, replicas: usize, inside: bool) -> String {
    let order = &fleet.order;
    let mut args = vec!["--connect".to_owned(), order.connect.to_string(), "--name".into(), "$(NAME)".into()];
    args.extend(["--max-memory".into(), "1536M".into(), "--give-up-after".into(), seconds(order.give_up_after)]);
    if let Some(lifetime) = order.lifetime {
        args.extend(["--lifetime".into(), seconds(lifetime)]);
    }
    let name = &fleet.name;
    let token = match order.token {
        TokenSource::None => String::new(),
        _ => format!(
            "            - {{ name: TESSERA_TOKEN, valueFrom: {{ secretKeyRef: {{ name: {name}, key: token }} }} }}\n"
        ),
    };
    let peers = match inside {
        true => format!(
            "      to:\n        - podSelector:\n            matchLabels: {{ app.kubernetes.io/instance: {name}, \
             app.kubernetes.io/component: coordinator }}\n"
        ),
        false => String::new(),
    };
    let values = [
        ("name", name.as_str()),
        ("replicas", &replicas.to_string()),
        ("image", &scalar(&fleet.image)),
        ("args", &list(&args)),
        ("token", &token),
        ("port", &order.connect.port().to_string()),
        ("peers", &peers),
    ];
    filled(WORKERS, &values).trim_end().to_owned() + "\n"
}

fn secret(name: &str, entries: &[(&str, String)]) -> String {
    let data: String = entries.iter().map(|(key, value)| format!("  {key}: {}\n", scalar(value))).collect();
    filled(SECRET, &[("name", name), ("data", data.trim_end())])
}

/// The workers of a farm elsewhere, as they can be applied by hand.
pub(super) fn print(fleet: &Fleet) -> String {
    let name = &fleet.name;
    let how = match &fleet.order.token {
        TokenSource::None => String::new(),
        TokenSource::File(path) => format!(
            "# First, for the farm's token: kubectl create secret generic {name} --from-file=token={}\n",
            super::quoted(&path.to_string_lossy())
        ),
        TokenSource::Environment(_) => format!(
            "# First, for the farm's token: coordinator token > token && kubectl create secret generic {name} \
             --from-file=token && rm token\n"
        ),
    };
    how + &workers(fleet, fleet.scaling.size.max, false)
}

/// A farm in the cluster, whole.
///
/// # Errors
/// When no secrets can be made.
pub(super) fn print_farm(fleet: &Fleet, farm: &InCluster) -> Result<String, AccessError> {
    let name = fleet.name.as_str();
    let secrets = fresh_secrets()?;
    let entries = [
        ("authority.pem", secrets.authority),
        ("token", secrets.token + "\n"),
        ("user-token", secrets.user_token + "\n"),
    ];
    let strings = |words: &[&str]| words.iter().map(ToString::to_string).collect::<Vec<_>>();
    let listen = format!("0.0.0.0:{DEFAULT_PORT}");
    let mut text =
        format!("# Whoever has this file may join the farm: it holds its secrets.\n{}", secret(name, &entries));
    let worker_pods = format!(
        "[{{ podSelector: {{ matchLabels: {{ app.kubernetes.io/instance: {name}, app.kubernetes.io/component: worker }} }} }}]"
    );
    let (args, owner, restart, mounts, volumes, from) = match farm {
        InCluster::Render { name: file, text: scene, flags, output } => {
            text += &format!(
                "---\napiVersion: v1\nkind: ConfigMap\nmetadata:\n  name: {name}\ndata:\n  {}: {}\n",
                scalar(file),
                scalar(scene)
            );
            let mut args = strings(&["render", &format!("/scene/{file}"), "-o", &format!("/data/{output}")]);
            args.extend(strings(&["--listen", &listen, "--wait-for-workers", "forever", "--progress", "plain"]));
            args.extend(flags.iter().cloned());
            let mounts = "            - { name: scene, mountPath: /scene, readOnly: true }\n";
            let volumes = format!("        - {{ name: scene, configMap: {{ name: {name} }} }}\n");
            (args, JOB, "      restartPolicy: Never\n", mounts, volumes, worker_pods)
        }
        InCluster::Serve => {
            let args = strings(&["serve", "--state", "/data/farm", "--listen", &listen, "--http", "none"]);
            // Of this namespace.
            (args, STATEFUL, "", "", String::new(), "[{ podSelector: {} }]".to_owned())
        }
    };
    let owner = filled(owner, &[("name", name)]);
    let values = [
        ("owner", owner.trim_end()),
        ("name", name),
        ("image", &scalar(&fleet.image)),
        ("args", &list(&args)),
        ("restart", restart),
        ("mounts", mounts),
        ("volumes", &volumes),
        ("from", &from),
    ];
    text += "---\n";
    text += filled(FARM, &values).trim_end();
    text += "\n---\n";
    Ok(text + &workers(fleet, fleet.scaling.size.max, true))
}

/// The workers' Deployment, as far as this process made it.
#[derive(Debug, Default)]
pub(super) struct Cluster {
    /// Whether anything of it may be there, and whether all of it is.
    begun: bool,
    applied: bool,
}

/// `kubectl` with the user's own options.
fn kubectl(fleet: &Fleet, words: &[&str]) -> Vec<String> {
    let own = fleet.args.split_whitespace();
    std::iter::once("kubectl").chain(own).chain(words.iter().copied()).map(Into::into).collect()
}

/// What the fleet consists of, as `kubectl delete` has it.
fn parts(name: &str) -> [String; 4] {
    ["deployment", "poddisruptionbudget", "networkpolicy"]
        .map(|kind| format!("{kind}/{name}-workers"))
        .into_iter()
        .chain([format!("secret/{name}")])
        .collect::<Vec<_>>()
        .try_into()
        .unwrap_or_default()
}

/// What to type to end all.
pub(super) fn remedy(fleet: &Fleet) -> String {
    let parts = parts(&fleet.name);
    let words: Vec<&str> = std::iter::once("delete").chain(parts.iter().map(String::as_str)).collect();
    kubectl(fleet, &words).join(" ")
}

impl Cluster {
    /// Has so many workers there.
    pub(super) async fn scale(&mut self, fleet: &Fleet, replicas: usize) -> Result<(), CallError> {
        if self.applied {
            let (which, count) = (format!("deployment/{}-workers", fleet.name), format!("--replicas={replicas}"));
            return call(&kubectl(fleet, &["scale", &which, &count]), "", &[]).await.map(drop);
        }
        let token =
            match &fleet.order.token {
                TokenSource::None => None,
                TokenSource::Environment(token) => Some(token.reveal()),
                TokenSource::File(path) => Some(std::fs::read_to_string(path).map_err(|e| {
                    CallError::Refused(format!("the token in '{}' cannot be read: {e}", path.display()))
                })?),
            };
        let secret = token
            .map_or_else(String::new, |token| secret(&fleet.name, &[("token", token.trim().to_owned())]) + "---\n");
        // Also one that fails may have made some of it.
        self.begun = true;
        let applied =
            call(&kubectl(fleet, &["apply", "-f", "-"]), &(secret + &workers(fleet, replicas, false)), &[]).await;
        self.applied = applied.is_ok();
        applied.map(drop)
    }

    /// Pods that there are, those that wait included.
    pub(super) async fn standing(&self, fleet: &Fleet) -> Result<Standing, CallError> {
        if !self.begun {
            return Ok(Standing::default());
        }
        let which = format!("deployment/{}-workers", fleet.name);
        let path = "jsonpath={.spec.replicas} {.status.readyReplicas}";
        let said = call(&kubectl(fleet, &["get", &which, "--ignore-not-found", "-o", path]), "", &[]).await?;
        let mut numbers = said.split_whitespace().map(|n| n.parse::<usize>().unwrap_or(0).min(10_000));
        let (wanted, ready) = (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0));
        let pods = |range: std::ops::Range<usize>| range.map(|n| n.to_string());
        Ok(Standing {
            waiting: pods(ready.min(wanted)..wanted).map(|pod| (pod, None)).collect(),
            running: pods(0..ready.min(wanted)).collect(),
        })
    }

    /// Deletes all of it.
    pub(super) async fn remove_all(&mut self, fleet: &Fleet) -> Result<(), CallError> {
        if !self.begun {
            return Ok(());
        }
        let parts = parts(&fleet.name);
        let mut words = vec!["delete", "--ignore-not-found", "--wait=false"];
        words.extend(parts.iter().map(String::as_str));
        call(&kubectl(fleet, &words), "", &[]).await.map(drop)
    }
}
