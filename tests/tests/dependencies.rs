//! Every dependency's licence is one that a user can live with, and none builds C.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Permissive licences: they ask for a notice at most.
const ALLOWED: [&str; 11] = [
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Zlib",
];

/// Crates that build or look for C libraries.
const C_BUILDERS: [&str; 5] = ["bindgen", "cc", "cmake", "pkg-config", "vcpkg"];

/// Whether an SPDX expression can be met by allowed licences alone.
fn allowed(expression: &str) -> bool {
    // Old manifests write "MIT/Apache-2.0" for OR.
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let tokens: Vec<&str> = spaced.split_whitespace().collect();
    let mut at = 0;
    either(&tokens, &mut at) && at == tokens.len()
}

/// `a OR b OR …`, which binds less than AND.
fn either(tokens: &[&str], at: &mut usize) -> bool {
    let mut met = both(tokens, at);
    while tokens.get(*at) == Some(&"OR") {
        *at += 1;
        met |= both(tokens, at);
    }
    met
}

/// `a AND b AND …`.
fn both(tokens: &[&str], at: &mut usize) -> bool {
    let mut met = one(tokens, at);
    while tokens.get(*at) == Some(&"AND") {
        *at += 1;
        met &= one(tokens, at);
    }
    met
}

/// A licence, with an exception or not, or an expression in parentheses.
fn one(tokens: &[&str], at: &mut usize) -> bool {
    let token = tokens.get(*at).copied().unwrap_or("");
    *at += 1;
    if token == "(" {
        let met = either(tokens, at);
        *at += 1;
        return met;
    }
    // An exception only adds rights.
    if tokens.get(*at) == Some(&"WITH") {
        *at += 2;
    }
    ALLOWED.contains(&token)
}

/// The one exception: ring, the arithmetic under TLS, is C and assembly that gcc alone builds from its package.
fn only_for_ring(name: &str, packages: &[Value]) -> bool {
    let needs = |package: &&Value| {
        package["dependencies"]
            .as_array()
            .is_some_and(|all| all.iter().any(|d| d["name"] == name && d["kind"] == "build"))
    };
    name == "cc" && packages.iter().filter(needs).all(|p| p["name"] == "ring")
}

#[test]
fn expressions_are_understood() {
    for yes in ["MIT", "MIT OR Apache-2.0", "MIT/Apache-2.0", "GPL-3.0 OR MIT", "(MIT OR GPL-2.0) AND Unicode-3.0"] {
        assert!(allowed(yes), "{yes}");
    }
    assert!(allowed("Apache-2.0 WITH LLVM-exception OR GPL-2.0"));
    for no in ["", "GPL-3.0", "MIT AND AGPL-3.0", "(MIT OR GPL-2.0) AND MPL-2.0", "MIT Apache-2.0"] {
        assert!(!allowed(no), "{no}");
    }
}

#[test]
fn every_dependency_is_permissively_licensed_and_pure_rust() {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let told = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--locked", "--manifest-path"])
        .arg(manifest)
        .output()
        .expect("cargo runs");
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let metadata: Value = serde_json::from_slice(&told.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    assert!(packages.len() > 20, "this cannot be all: {}", packages.len());
    let mut bad = Vec::new();
    for package in packages {
        let name = package["name"].as_str().expect("a name");
        let licence = package["license"].as_str().unwrap_or("");
        if !allowed(licence) {
            bad.push(format!("{name}: '{licence}' is not permissive"));
        }
        if C_BUILDERS.contains(&name) && !only_for_ring(name, packages) {
            bad.push(format!("{name} builds or looks for C libraries"));
        }
        // Nothing from a version control system: a registry's versions stay what they are.
        if package["source"].as_str().is_some_and(|s| !s.starts_with("registry+")) {
            bad.push(format!("{name} does not come from a registry"));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}
