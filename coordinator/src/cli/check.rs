//! `coordinator check`: what is wrong with a scene, and what is in it.

use std::sync::Arc;

use serde::Serialize;
use tessera_core::trace::PreparedScene;

use super::args::Check;
use super::condition::ConditionJson;
use super::console::Console;
use super::describe::Description;
use super::exit::{Exit, Failure};
use super::scene::{self, DiagnosticJson};

#[derive(Debug, Serialize)]
struct Checked<'a> {
    file: &'a str,
    valid: bool,
    errors: usize,
    warnings: usize,
    diagnostics: Vec<DiagnosticJson<'a>>,
    scene: Option<Description>,
    condition: Option<ConditionJson>,
}

/// Checks and describes the scene.
pub(crate) fn run(raw: &Check, console: &Console) -> Result<Exit, Failure> {
    let read = scene::read(&raw.scene, raw.pictures.allow_pictures.clone());
    let file = raw.scene.display().to_string();
    if !raw.json {
        let (_, warnings) = read.counts();
        let scene = scene::accept(read, &raw.scene, console)?;
        let verdict = match warnings {
            0 => "valid".to_owned(),
            1 => "valid, with 1 warning".to_owned(),
            n => format!("valid, with {n} warnings"),
        };
        let described = Description::new(&file, &scene).to_text();
        let condition = ConditionJson::from(PreparedScene::build(scene).condition());
        console.out(&format!("{file}: {verdict}\n{described}{}", condition.to_text()))?;
        return Ok(Exit::Done);
    }
    let (errors, warnings) = read.counts();
    let checked = Checked {
        file: &file,
        valid: read.scene.is_some(),
        errors,
        warnings,
        diagnostics: read.diagnostics.iter().map(DiagnosticJson::from).collect(),
        scene: read.scene.as_ref().map(|scene| Description::new(&file, scene)),
        condition: read.scene.as_ref().map(|scene| PreparedScene::build(Arc::new(scene.clone())).condition().into()),
    };
    let text = serde_json::to_string_pretty(&checked).map_err(|e| Failure::new(Exit::Failed, e))?;
    console.out(&(text + "\n"))?;
    Ok(if checked.valid { Exit::Done } else { Exit::Scene })
}
