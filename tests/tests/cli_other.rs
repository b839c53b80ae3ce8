//! `check`, `compare`, `completions` and help.

use glam::DVec3;
use serde_json::Value;
use tempfile::tempdir;
use tessera_core::film::PixelsRef;
use tessera_core::film::file::{Depth, Output};
use tessera_core::settings::Transfer;
use tessera_tests::generate::{Document, Look};
use tessera_tests::program::{run, scene};

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect(text)
}

#[test]
fn check_describes_a_valid_scene() {
    let at = tempdir().expect("a folder");
    let path = scene("demo.xml");
    let path = path.to_str().expect("text");
    let ended = run(at.path(), ["check", path]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    for words in ["valid", "15 spheres", "2 triangles", "1 plane", "512x256", "needs"] {
        assert!(ended.out.contains(words), "'{words}' is not in: {}", ended.out);
    }
    let value = json(&run(at.path(), ["check", path, "--json"]).out);
    assert_eq!((&value["valid"], &value["errors"]), (&true.into(), &0.into()));
    assert_eq!((&value["scene"]["objects"], &value["scene"]["lights"]), (&18.into(), &2.into()));
}

/// Equal objects, exact planes and what they hold, a planet: what is decided for a scene is said.
#[test]
fn check_says_what_is_decided_for_the_scene() {
    let at = tempdir().expect("a folder");
    let (grey, v) = (Look::matte(0.5, 0.5, 0.5), |x: f64, y: f64, z: f64| DVec3::new(x, y, z));
    let poster = [v(0.0, 0.0, 5.0), v(1.0, 0.0, 5.0), v(0.0, 1.0, 5.0)];
    let d = Document::new(DVec3::ZERO, DVec3::Z)
        .plane(DVec3::Z, 5.0, grey)
        .triangle(poster, grey)
        .triangle(poster, grey)
        .sphere(v(0.0, 0.0, 3.0), 0.5, grey)
        .sphere(v(0.0, 0.0, 3.0), 0.5, grey)
        .sphere(v(0.0, -6e6 - 1.7, 0.0), 6e6, grey)
        .plane(DVec3::X, 0.0, grey)
        .light(2.0, 2.0, 5.0);
    d.write(at.path(), "made").expect("written");
    let value = json(&run(at.path(), ["check", "made.xml", "--json"]).out);
    let condition = &value["condition"];
    for (name, count) in [
        ("coinciding_triangles", 1),
        ("coinciding_spheres", 1),
        ("shared_planes", 1),
        ("planes_with_a_light", 1),
        ("planes_with_the_eye", 1),
        ("giants", 1),
    ] {
        assert_eq!(condition[name], count, "{name} of {value}");
    }
    let people = run(at.path(), ["check", "made.xml"]).out;
    for words in ["left out", "in one exact plane", "with a light in it", "through the eye", "far larger"] {
        assert!(people.contains(words), "'{words}' is not in: {people}");
    }
}

#[test]
fn check_tells_machines_what_it_tells_people() {
    let at = tempdir().expect("a folder");
    let text = std::fs::read_to_string(scene("lights.xml")).expect("a scene");
    std::fs::write(at.path().join("bad.xml"), text.replacen("radius", "radus", 1)).expect("written");
    let ended = run(at.path(), ["check", "bad.xml", "--json"]);
    let value = json(&ended.out);
    assert_eq!((ended.code, &value["valid"]), (Some(3), &false.into()));
    let first = &value["diagnostics"][0];
    assert_eq!((&first["severity"], &first["file"]), (&"error".into(), &"bad.xml".into()));
    let people = run(at.path(), ["check", "bad.xml"]);
    let place = format!("bad.xml:{}:{}", first["line"], first["column"]);
    assert!(people.code == Some(3) && people.out.is_empty() && people.err.contains(&place), "{place}: {}", people.err);
    // Warnings are told, and are no reason to refuse.
    let dark = text.replace("<light>", "<!--").replace("</light>", "-->");
    std::fs::write(at.path().join("dark.xml"), dark).expect("written");
    let ended = run(at.path(), ["check", "dark.xml"]);
    assert!(
        ended.code == Some(0) && ended.err.contains("warning") && ended.out.contains("with 1 warning"),
        "{ended:?}"
    );
}

#[test]
fn compare_says_how_far_and_whether_too_far() {
    let at = tempdir().expect("a folder");
    let write = |name: &str, pixels: &[[f32; 3]], width: u32| {
        let output = Output::plan(&at.path().join(name), Depth::Eight, Transfer::Linear).expect(name);
        output.write(width, pixels.len() as u32 / width, PixelsRef::F32(pixels)).expect(name);
    };
    let flat = vec![[0.5_f32; 3]; 12];
    let mut off = flat.clone();
    off[7][1] += 6.0 / 255.0;
    write("a.pfm", &flat, 4);
    write("b.pfm", &off, 4);
    write("a.exr", &flat, 4);
    write("small.pfm", &flat, 3);
    let compare = |arguments: &str| run(at.path(), ["compare"].into_iter().chain(arguments.split(' ')));
    let same = compare("a.pfm a.exr");
    assert!(same.code == Some(0) && same.out.contains("the same"), "{same:?}");
    // One component of 36 is off by 6 steps: the RMSE is 1.
    let value = json(&compare("a.pfm b.pfm --json").out);
    assert!((value["rmse"].as_f64().expect("a number") - 1.0).abs() < 1e-5, "{value}");
    assert!((value["largest"].as_f64().expect("a number") - 6.0).abs() < 1e-4, "{value}");
    assert_eq!(value["largest_at"], Value::from(vec![3, 1]));
    for (tolerance, code) in [("0.99", 1), ("1.01", 0), ("1/254", 0), ("1/256", 1)] {
        assert_eq!(compare(&format!("a.pfm b.pfm --tolerance {tolerance}")).code, Some(code), "{tolerance}");
    }
    assert_eq!(compare("a.pfm b.pfm --tolerance 9 --diff d.png").code, Some(0));
    assert!(tessera_core::film::file::read(&at.path().join("d.png")).is_ok());
    let sizes = compare("a.pfm small.pfm");
    assert!(sizes.code == Some(1) && sizes.err.contains("4x3") && sizes.err.contains("3x4"), "{sizes:?}");
    for bad in ["a.pfm none.pfm", "a.pfm a.gif", "a.pfm b.pfm --tolerance -1", "a.pfm b.pfm --diff d.exr"] {
        assert_eq!(compare(bad).code, Some(2), "{bad}");
    }
}

#[test]
fn a_picture_equals_itself_in_any_kind_of_file() {
    let at = tempdir().expect("a folder");
    let path = scene("demo.xml");
    let path = path.to_str().expect("text");
    for name in ["a.png", "a.ppm", "a.pfm"] {
        assert_eq!(run(at.path(), ["render", path, "--size", "40x30", "-o", name]).code, Some(0));
    }
    assert_eq!(run(at.path(), ["compare", "a.png", "a.ppm"]).code, Some(0));
    // Rounding to a code is off by half a step at most.
    let ended = run(at.path(), ["compare", "a.png", "a.pfm", "--tolerance", "0.5", "--json"]);
    let value = json(&ended.out);
    assert!(ended.code == Some(0) && value["largest"].as_f64() <= Some(0.501) && value["rmse"].as_f64() > Some(0.0));
}

#[test]
fn help_and_completions_go_to_stdout() {
    let at = tempdir().expect("a folder");
    for arguments in [&["--help"][..], &["render", "--help"], &["help", "compare"], &["--version"]] {
        let ended = run(at.path(), arguments);
        assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""), "{arguments:?}");
        assert!(!ended.out.is_empty());
    }
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let ended = run(at.path(), ["completions", shell]);
        assert!(ended.code == Some(0) && ended.out.contains("plane-height"), "{shell}");
    }
}

#[test]
fn bash_completes_the_numbers_of_a_farms_jobs() {
    let at = tempdir().expect("a folder");
    let script = run(at.path(), ["completions", "bash"]).out;
    std::fs::write(at.path().join("script"), script).expect("written");
    let completed = |words: &str, last: &str, before: &str| {
        let text = format!(
            "source ./script; coordinator() {{ [ \"$*\" = 'jobs --ids' ] && printf '3\\n14\\n15\\n'; }}
             COMP_WORDS=(coordinator {words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
             _coordinator_and_ids coordinator '{last}' '{before}'; echo \"${{COMPREPLY[@]}}\""
        );
        let ended = std::process::Command::new("bash").current_dir(at.path()).args(["-c", &text]).output();
        String::from_utf8(ended.expect("bash runs").stdout).expect("text").trim().to_owned()
    };
    assert_eq!(completed("cancel ''", "", "cancel"), "3 14 15");
    assert_eq!(completed("fetch 1", "1", "fetch"), "14 15");
    assert!(completed("fetch -", "-", "fetch").contains("--partial"));
    assert!(completed("rend", "rend", "coordinator").contains("render"));
}
