//! `coordinator submit`: scenes to a farm that stays.

use std::path::Path;
use std::sync::Arc;

use coordinator::PixelFormat;
use tessera_core::scene::Scene;
use tracing::info_span;
use worker::spans::SPANS;

use super::args::Submit;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::farm::{Asking, Client};
use super::jobs::verdict;
use super::options::Wanted;
use super::runtime::{blocking, cores, on_runtime};
use super::scene;

/// Submits the scenes and prints the jobs' numbers.
pub(crate) fn run(raw: Submit, console: &Console) -> Result<Exit, Failure> {
    let wanted = Wanted::new(&raw.view)?;
    on_runtime(cores(), async {
        let mut client = Client::connect(&raw.farm).await?;
        let group = match raw.scenes.len() {
            1 => String::new(),
            _ => format!("{:016x}", fastrand::u64(..)),
        };
        let mut submitted = Vec::new();
        for path in &raw.scenes {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let span = info_span!(target: SPANS, parent: None, "submit", scene = &*stem);
            let reading = info_span!(target: SPANS, parent: &span, "read scene");
            let read = read(path, &raw, console).await?;
            drop(reading);
            let named = client.put_scene(read).await?;
            // Several keep their numbering in the names.
            let name = match &raw.name {
                Some(name) if raw.scenes.len() == 1 => name.clone(),
                Some(name) => format!("{name} {stem}"),
                None => stem.into_owned(),
            };
            let asking = Asking {
                settings: wanted.settings,
                region: wanted.region,
                pixels: match raw.bits.as_str() {
                    "8" => PixelFormat::Rgb8,
                    "16" => PixelFormat::Rgb16,
                    _ => PixelFormat::F32,
                },
                goal: wanted.accuracy.goal(),
                tile: raw.view.tile(),
                verify: raw.view.verify,
                name: &name,
                owner: raw.owner.as_deref(),
                priority: raw.priority,
                group: &group,
                deadline: raw.deadline,
            };
            let job = client.submit(asking.spec(named), &span).await?;
            console.out(&format!("{}\n", job.id))?;
            submitted.push(job.id);
        }
        if !raw.wait {
            return Ok(Exit::Done);
        }
        let mut exit = Exit::Done;
        for id in submitted {
            let mut watched = client.watch(id).await?;
            let mut last = None;
            while let Some(job) = watched.next().await? {
                last = Some(job);
            }
            match last.as_ref().map(verdict) {
                Some(Ok(())) => {}
                Some(Err(Failure { exit: bad, message })) => {
                    console.error(&message);
                    exit = bad;
                }
                None => return Err(Failure::new(Exit::Failed, format!("nothing is known of job {id} any more"))),
            }
        }
        Ok(exit)
    })
}

async fn read(path: &Path, raw: &Submit, console: &Console) -> Result<Arc<Scene>, Failure> {
    let (at, folders) = (path.to_path_buf(), raw.pictures.allow_pictures.clone());
    let read = blocking(move || scene::read(&at, folders)).await?;
    scene::accept(read, path, console)
}
