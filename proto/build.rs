//! Compiles `farm.proto`, `journal.proto` and `control.proto` without protoc, and takes the hash of the sources that decide pixels.

use std::error::Error;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// What decides a pixel: the tracer, which passes lead to a picture (a file or a folder), and the libraries
/// beneath both.
const DECISIVE: [&str; 4] = ["../core/src", "../coordinator/src/plan.rs", "../coordinator/src/plan", "../Cargo.lock"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=proto");
    let descriptors = protox::compile(["proto/farm.proto"], ["proto"])?;
    // Comments of the specification are prose, not rustdoc.
    tonic_prost_build::configure()
        .bytes(".tessera.farm.v1.TileDone.pixels")
        .bytes(".tessera.farm.v1.ScenePiece.data")
        .disable_comments(["."])
        .compile_fds(descriptors)?;
    let descriptors = protox::compile(["proto/journal.proto"], ["proto"])?;
    // Apart from the first, which it names and would write again, empty.
    let folder = PathBuf::from(std::env::var("OUT_DIR")?).join("journal");
    fs::create_dir_all(&folder)?;
    tonic_prost_build::configure()
        .out_dir(folder)
        .extern_path(".tessera.farm.v1", "crate::wire")
        .disable_comments(["."])
        .compile_fds(descriptors)?;
    let descriptors = protox::compile(["proto/control.proto"], ["proto"])?;
    let folder = PathBuf::from(std::env::var("OUT_DIR")?).join("control");
    fs::create_dir_all(&folder)?;
    tonic_prost_build::configure()
        .out_dir(folder)
        .extern_path(".tessera.farm.v1", "crate::wire")
        // A queue of thousands has neither of most of them.
        .boxed(".tessera.control.v1.Job.result")
        .boxed(".tessera.control.v1.Job.progress")
        .bytes(".tessera.control.v1.ScenePart.data")
        .bytes(".tessera.control.v1.PicturePart.data")
        .disable_comments(["."])
        .compile_fds(descriptors)?;
    println!("cargo::rustc-env=TESSERA_SOURCES={}", sources()?);
    Ok(())
}

/// Hash of the sources that decide pixels: of their contents rather than of a commit, so that it is the same
/// with git and without, and two states between commits differ.
fn sources() -> io::Result<String> {
    let mut hash = Sha256::new();
    for place in DECISIVE.into_iter().filter(|place| Path::new(place).exists()) {
        // Cargo looks through whole folders.
        println!("cargo::rerun-if-changed={place}");
        let mut files = Vec::new();
        list(Path::new(place), &mut files)?;
        files.sort();
        for file in files {
            // As git stores them, whatever ends a line here.
            let text: Vec<u8> = fs::read(&file)?.into_iter().filter(|b| *b != b'\r').collect();
            let name = file.to_string_lossy().replace('\\', "/");
            hash.update(format!("{name} {}\n", text.len()));
            hash.update(&text);
        }
    }
    Ok(hash.finalize().iter().take(6).map(|b| format!("{b:02x}")).collect())
}

/// Adds `place`, or all files in and below it.
fn list(place: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if !place.is_dir() {
        files.push(place.into());
        return Ok(());
    }
    for entry in fs::read_dir(place)? {
        list(&entry?.path(), files)?;
    }
    Ok(())
}
