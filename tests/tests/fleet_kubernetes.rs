//! Manifests for Kubernetes: what `--print` says, read as YAML and held against the restricted Pod Security standard.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tessera_tests::program::{Ended, coordinator, scene};

/// Runs `coordinator` where there is neither a farm nor `kubectl`, nor a user's token.
fn printed(at: &Path, args: &[&str]) -> Ended {
    let mut command = coordinator(at, args);
    command.env("PATH", at).env("XDG_STATE_HOME", at.join("state")).env_remove("TESSERA_TOKEN");
    command.output().unwrap().into()
}

fn documents(ended: &Ended) -> Vec<Value> {
    assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""), "{}", ended.out);
    let read: Result<Vec<Value>, _> = serde_saphyr::from_multiple(&ended.out);
    read.unwrap_or_else(|e| panic!("{e}\n{}", ended.out))
}

fn of_kind<'a>(documents: &'a [Value], kind: &str) -> Vec<&'a Value> {
    documents.iter().filter(|d| d["kind"] == kind).collect()
}

fn has(labels: &Value, selector: &Value) -> bool {
    let Some(wanted) = selector.as_object() else { return false };
    !wanted.is_empty() && wanted.iter().all(|(name, value)| labels[name] == *value)
}

/// <https://kubernetes.io/docs/concepts/security/pod-security-standards/#restricted>
fn is_restricted(template: &Value) {
    let pod = &template["spec"];
    let of_pod = &pod["securityContext"];
    assert_eq!(of_pod["runAsNonRoot"], true, "{pod}");
    assert_eq!(of_pod["seccompProfile"]["type"], "RuntimeDefault");
    assert!(of_pod["runAsUser"].as_u64().unwrap() > 0);
    for host in ["hostNetwork", "hostPID", "hostIPC"] {
        assert!(pod[host].is_null());
    }
    assert_eq!(pod["automountServiceAccountToken"], false);
    let kinds =
        ["configMap", "csi", "downwardAPI", "emptyDir", "ephemeral", "persistentVolumeClaim", "projected", "secret"];
    for volume in pod["volumes"].as_array().into_iter().flatten() {
        let kind = volume.as_object().unwrap().keys().find(|k| *k != "name").unwrap();
        assert!(kinds.contains(&kind.as_str()), "{volume}");
    }
    let containers = pod["containers"].as_array().unwrap();
    assert!(!containers.is_empty());
    for container in containers {
        let context = &container["securityContext"];
        assert_eq!(context["allowPrivilegeEscalation"], false);
        assert_eq!(context["readOnlyRootFilesystem"], true);
        assert_eq!(context["capabilities"], serde_json::json!({ "drop": ["ALL"] }));
        assert!(context["privileged"].is_null());
        assert!(container["resources"]["requests"]["memory"].is_string(), "{container}");
        assert!(container["resources"]["limits"]["memory"].is_string());
    }
    // A worker gives a tile back after 20 s.
    assert!(pod["terminationGracePeriodSeconds"].as_u64().unwrap() > 20);
}

/// What holds of all that is printed; gives the pods' templates.
fn check(documents: &[Value]) -> Vec<&Value> {
    let templates: Vec<&Value> = documents.iter().map(|d| &d["spec"]["template"]).filter(|t| t.is_object()).collect();
    for template in &templates {
        is_restricted(template);
        let labels = &template["metadata"]["labels"];
        let policies = of_kind(documents, "NetworkPolicy");
        let policed = policies.iter().any(|p| has(labels, &p["spec"]["podSelector"]["matchLabels"]));
        assert!(policed, "{labels}");
    }
    for document in documents {
        assert!(document["apiVersion"].is_string() && document["metadata"]["name"].is_string(), "{document}");
        let selector = &document["spec"]["selector"]["matchLabels"];
        if document["kind"] == "Deployment" || document["kind"] == "StatefulSet" {
            assert!(has(&document["spec"]["template"]["metadata"]["labels"], selector), "{document}");
        }
        if document["kind"] == "Service" {
            let pods = templates.iter().filter(|t| has(&t["metadata"]["labels"], &document["spec"]["selector"]));
            assert_eq!(pods.count(), 1, "{document}");
        }
    }
    assert!(!of_kind(documents, "PodDisruptionBudget").is_empty());
    // What is mounted or read is there.
    let names = |kind: &str| of_kind(documents, kind).iter().map(|d| d["metadata"]["name"].clone()).collect::<Vec<_>>();
    for volume in templates.iter().flat_map(|t| t["spec"]["volumes"].as_array().into_iter().flatten()) {
        let (kind, name) = if volume["secret"].is_object() {
            ("Secret", &volume["secret"]["secretName"])
        } else if volume["configMap"].is_object() {
            ("ConfigMap", &volume["configMap"]["name"])
        } else {
            ("PersistentVolumeClaim", &volume["persistentVolumeClaim"]["claimName"])
        };
        assert!(names(kind).contains(name), "{volume}");
    }
    templates
}

/// A scene without pictures.
fn plain_scene(at: &Path) -> std::path::PathBuf {
    let path = at.join("plain.xml");
    let text = "<scene><camera><location><vector x=\"0\" y=\"0\" z=\"-5\"/></location><sky><vector x=\"0\" y=\"1\" \
                z=\"0\"/></sky><look_at><vector x=\"0\" y=\"0\" z=\"0\"/></look_at></camera><world><sphere radius=\"1\">\
                <location><vector x=\"0\" y=\"0\" z=\"0\"/></location></sphere></world></scene>\n";
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_render_in_a_cluster_is_a_job_with_its_scene_and_its_workers() {
    let at = tempfile::tempdir().unwrap();
    let plain = plain_scene(at.path());
    let args = ["render", plain.to_str().unwrap(), "-o", "out.png", "--size", "200x100", "--max-error", "1/510"];
    let fleet = ["--fleet", "kubernetes", "--fleet-workers", "1..7", "--fleet-image", "example.org/t:1", "--print"];
    let ended = printed(at.path(), &[&args[..], &fleet].concat());
    let documents = documents(&ended);
    let templates = check(&documents);
    assert_eq!(templates.len(), 2);
    let job = &of_kind(&documents, "Job")[0]["spec"]["template"]["spec"];
    let words: Vec<&str> =
        job["containers"][0]["args"].as_array().unwrap().iter().map(|w| w.as_str().unwrap()).collect();
    assert_eq!(words[..4], ["render", "/scene/plain.xml", "-o", "/data/out.png"]);
    assert!(words.contains(&"--size=200x100") && words.contains(&"--max-error=1/510"), "{words:?}");
    assert!(!words.iter().any(|w| w.contains("fleet") || w.contains("print")), "{words:?}");
    let map = of_kind(&documents, "ConfigMap")[0];
    assert_eq!(map["data"]["plain.xml"], fs::read_to_string(plain).unwrap());
    let workers = of_kind(&documents, "Deployment")[0];
    assert_eq!(workers["spec"]["replicas"], 7);
    let worker = &workers["spec"]["template"]["spec"]["containers"][0];
    assert_eq!(worker["image"], "example.org/t:1");
    let service = of_kind(&documents, "Service")[0]["metadata"]["name"].as_str().unwrap();
    assert_eq!(worker["args"][1], format!("{service}:4747"));
    // The token is in the Secret and nowhere else.
    let secret = of_kind(&documents, "Secret")[0];
    let token = secret["stringData"]["token"].as_str().unwrap().trim();
    assert_eq!(ended.out.matches(token).count(), 1);
    // Nothing was written.
    assert!(!at.path().join("state").exists() && !at.path().join("out.png").exists());
}

#[test]
fn a_farm_in_a_cluster_keeps_its_state_on_a_volume() {
    let at = tempfile::tempdir().unwrap();
    let args = ["serve", "--state", "unused", "--fleet", "kubernetes", "--fleet-workers", "0..3", "--print"];
    let documents = documents(&printed(at.path(), &args));
    check(&documents);
    let farm = &of_kind(&documents, "StatefulSet")[0]["spec"]["template"]["spec"];
    let mounts = farm["containers"][0]["volumeMounts"].as_array().unwrap();
    assert!(mounts.iter().any(|m| m["mountPath"] == "/data"));
    for probe in ["startupProbe", "readinessProbe", "livenessProbe"] {
        assert!(farm["containers"][0][probe].is_object());
    }
    assert!(of_kind(&documents, "Secret")[0]["stringData"]["user-token"].is_string());
    assert!(!at.path().join("unused").exists());
}

#[test]
fn workers_alone_join_a_farm_elsewhere_and_print_no_token() {
    let at = tempfile::tempdir().unwrap();
    let token = coordinator(at.path(), ["token"]).env("XDG_STATE_HOME", at.path().join("state")).output().unwrap();
    let token = String::from_utf8(token.stdout).unwrap();
    let ended = printed(
        at.path(),
        &["fleet", "kubernetes", "--connect", "farm.example:5000", "--fleet-workers", "4", "--print"],
    );
    assert!(token.trim().len() > 40 && !ended.out.contains(token.trim()));
    assert!(ended.out.contains("kubectl create secret generic"), "{}", ended.out);
    let documents = documents(&ended);
    check(&documents);
    let worker = &of_kind(&documents, "Deployment")[0]["spec"]["template"]["spec"]["containers"][0];
    assert_eq!(worker["args"][1], "farm.example:5000");
    assert_eq!(worker["env"].as_array().unwrap().iter().filter(|e| e["name"] == "TESSERA_TOKEN").count(), 1);
}

#[test]
fn a_scene_with_pictures_is_sent_another_way() {
    let at = tempfile::tempdir().unwrap();
    let demo = scene("demo.xml");
    let fleet = ["--fleet", "kubernetes", "--fleet-workers", "1", "--print"];
    let ended = printed(at.path(), &[&["render", demo.to_str().unwrap()][..], &fleet].concat());
    assert_eq!(ended.code, Some(2));
    assert!(ended.err.contains("serve --fleet kubernetes"), "{}", ended.err);
}

/// Where CI has it; elsewhere it is looked for as any program is: `pip install kubernetes-validate`.
fn validator() -> PathBuf {
    let of_ci = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/judges/bin/kubernetes-validate");
    if of_ci.is_file() { of_ci } else { PathBuf::from("kubernetes-validate") }
}

#[test]
fn manifests_fit_the_schemas_of_old_and_new_clusters() {
    let validate = validator();
    if Command::new(&validate).arg("--version").output().is_err() {
        println!("skipped: kubernetes-validate is not installed");
        return;
    }
    let at = tempfile::tempdir().unwrap();
    let plain = plain_scene(at.path()).display().to_string();
    let fleet = ["--fleet", "kubernetes", "--fleet-workers", "1..7", "--print"];
    let all = [
        ("render", [&["render", &plain, "-o", "out.png"][..], &fleet].concat()),
        ("serve", [&["serve", "--state", "unused"][..], &fleet].concat()),
        ("fleet", vec!["fleet", "kubernetes", "--connect", "farm.example:5000", "--fleet-workers", "4", "--print"]),
    ];
    for (name, args) in all {
        let printed = printed(at.path(), &args);
        let file = at.path().join(format!("{name}.yaml"));
        fs::write(&file, &printed.out).unwrap();
        for version in ["1.25", "1.28", "1.31", "1.34"] {
            let judged = Command::new(&validate).args(["--strict", "-k", version]).arg(&file).output().unwrap();
            let said = String::from_utf8_lossy(&judged.stderr) + String::from_utf8_lossy(&judged.stdout);
            assert!(judged.status.success(), "{name} in {version}: {said}");
        }
    }
}
