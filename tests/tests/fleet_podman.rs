//! What is printed for Kubernetes, played by podman: a coordinator and two workers as pods, from the image that a release
//! makes. Skipped where there is no release in `target/dist`, or where podman cannot run a container with a name server.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::{PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use serde_json::{Value, json};
use tessera_tests::program::coordinator;
use tessera_tests::wait::{NEVER, until_within};

/// The user and group that the manifests name.
const USER: u32 = 65532;

fn podman(args: &[&str]) -> Option<Output> {
    Command::new("podman").args(args).output().ok()
}

fn does(args: &[&str]) -> bool {
    podman(args).is_some_and(|out| out.status.success())
}

/// An image, a network, and pods that are gone with this.
struct Pods {
    image: String,
    network: String,
    names: Vec<String>,
}

impl Pods {
    /// `None` where podman does not run here.
    fn new() -> Option<Self> {
        let dist = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/dist");
        let name = format!("tessera-test-{}", std::process::id());
        let pods = Self { image: format!("localhost/{name}:1"), network: name, names: Vec::new() };
        let has_release = dist.join("Containerfile").is_file();
        let runs = has_release
            && does(&["build", "-q", "-t", &pods.image, dist.to_str()?])
            && does(&["run", "--rm", "--network", "none", &pods.image, "/worker", "--version"])
            && does(&["network", "create", &pods.network]);
        let named = runs
            && podman(&["network", "inspect", &pods.network])
                .is_some_and(|out| String::from_utf8_lossy(&out.stdout).contains("\"dns_enabled\": true"));
        named.then_some(pods)
    }
}

impl Drop for Pods {
    fn drop(&mut self) {
        for name in &self.names {
            does(&["pod", "rm", "-f", name]);
        }
        does(&["network", "rm", "-f", &self.network]);
        does(&["rmi", "-f", &self.image]);
    }
}

fn kind_of(volume: &Value) -> &'static str {
    match volume {
        v if v["secret"].is_object() => "Secret",
        v if v["configMap"].is_object() => "ConfigMap",
        _ => "PersistentVolumeClaim",
    }
}

/// The pod of a template in podman's part of the language: it probes nothing by name, and knows of no secrets' modes.
fn pod(name: &str, template: &Value, restart: &str, root: &Path, token: &str) -> Value {
    let mut spec = template["spec"].clone();
    spec["restartPolicy"] = json!(restart);
    for volume in spec["volumes"].as_array_mut().into_iter().flatten() {
        let from = root.join(kind_of(volume));
        *volume = json!({ "name": volume["name"], "hostPath": { "path": from, "type": "Directory" } });
    }
    for container in spec["containers"].as_array_mut().unwrap() {
        let container = container.as_object_mut().unwrap();
        container.retain(|key, _| !key.ends_with("Probe"));
        for variable in container.get_mut("env").and_then(Value::as_array_mut).into_iter().flatten() {
            if variable["valueFrom"]["secretKeyRef"].is_object() {
                *variable = json!({ "name": variable["name"], "value": token });
            }
        }
    }
    let labels = &template["metadata"]["labels"];
    json!({ "apiVersion": "v1", "kind": "Pod", "metadata": { "name": name, "labels": labels }, "spec": spec })
}

/// Writes what a cluster would mount, as it would: of root's, for the pods' group.
fn mount(root: &Path, documents: &[Value]) {
    for document in documents {
        let kind = document["kind"].as_str().unwrap();
        if !["Secret", "ConfigMap", "PersistentVolumeClaim"].contains(&kind) {
            continue;
        }
        let at = root.join(kind);
        fs::create_dir(&at).unwrap();
        let files = document["stringData"].as_object().or(document["data"].as_object());
        for (name, text) in files.into_iter().flatten() {
            fs::write(at.join(name), text.as_str().unwrap()).unwrap();
            if kind == "Secret" {
                chown(at.join(name), Some(0), Some(USER)).unwrap();
                fs::set_permissions(at.join(name), fs::Permissions::from_mode(0o440)).unwrap();
            }
        }
        if kind == "PersistentVolumeClaim" {
            chown(&at, Some(USER), Some(USER)).unwrap();
        }
    }
}

fn of_kind<'a>(documents: &'a [Value], kind: &str) -> &'a Value {
    documents.iter().find(|d| d["kind"] == kind).unwrap()
}

#[test]
fn pods_of_what_is_printed_render_the_picture_of_one_process() {
    let Some(mut pods) = Pods::new() else {
        println!("skipped: there is no release, or podman does not run here");
        return;
    };
    let at = tempfile::tempdir().unwrap();
    fs::set_permissions(at.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let scene = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/mirrors.xml");
    let render = ["render", scene.to_str().unwrap(), "-o", "out.png", "--size", "320x240", "--samples", "16"];
    let fleet = ["--fleet", "kubernetes", "--fleet-workers", "2", "--fleet-image", &pods.image, "--print"];
    let state = at.path().join("state");
    let run = |args: &[&str]| coordinator(at.path(), args).env("XDG_STATE_HOME", &state).output().unwrap();
    let printed = run(&[&render[..], &fleet].concat());
    assert!(printed.status.success(), "{}", String::from_utf8_lossy(&printed.stderr));
    let documents: Vec<Value> = serde_saphyr::from_multiple(std::str::from_utf8(&printed.stdout).unwrap()).unwrap();
    mount(at.path(), &documents);
    let token = of_kind(&documents, "Secret")["stringData"]["token"].as_str().unwrap().trim();
    let (job, workers) = (of_kind(&documents, "Job"), of_kind(&documents, "Deployment"));
    let service = of_kind(&documents, "Service")["metadata"]["name"].as_str().unwrap();
    let mut played = vec![pod(service, &job["spec"]["template"], "Never", at.path(), token)];
    for n in 0..2 {
        let name = format!("{service}-worker-{n}");
        played.push(pod(&name, &workers["spec"]["template"], "OnFailure", at.path(), token));
    }
    pods.names = played.iter().map(|p| p["metadata"]["name"].as_str().unwrap().to_owned()).collect();
    // Every JSON document is one of YAML.
    let text: Vec<String> = played.iter().map(Value::to_string).collect();
    fs::write(at.path().join("pods.yaml"), text.join("\n---\n")).unwrap();
    let file = at.path().join("pods.yaml").display().to_string();
    let started = podman(&["play", "kube", "--network", &pods.network, &file]).unwrap();
    assert!(started.status.success(), "{}", String::from_utf8_lossy(&started.stderr));
    let picture = at.path().join("PersistentVolumeClaim/out.png");
    let logs = || String::from_utf8_lossy(&podman(&["pod", "logs", service]).unwrap().stdout).into_owned();
    until_within((NEVER, Duration::from_millis(100)), logs, || picture.is_file());
    let alone = run(&render);
    assert!(alone.status.success(), "{}", String::from_utf8_lossy(&alone.stderr));
    assert_eq!(fs::read(picture).unwrap(), fs::read(at.path().join("out.png")).unwrap());
}
