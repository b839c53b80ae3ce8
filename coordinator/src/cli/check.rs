//! `coordinator check`: what is wrong with a scene, and what is in it.

use super::args::Check;
use super::console::Console;
use super::describe::Description;
use super::exit::{Exit, Failure};
use super::scene;

/// Checks and describes the scene.
pub(crate) fn run(raw: &Check, console: &Console) -> Result<Exit, Failure> {
    let scene = scene::accept(scene::read(&raw.scene), console)?;
    console.out(&Description::new(&raw.scene.display().to_string(), &scene).to_text());
    Ok(Exit::Done)
}
