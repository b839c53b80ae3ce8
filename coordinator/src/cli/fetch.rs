//! `coordinator fetch`: the picture of a farm's job into a file.

use super::args::Fetch;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::farm::Client;
use super::picture;
use super::runtime::{cores, on_runtime};

/// Fetches the picture and writes it.
pub(crate) fn run(raw: &Fetch, console: &Console) -> Result<Exit, Failure> {
    // What can be known to fail is found out before anything is sent.
    let depth = tessera_core::film::file::Depth::Eight;
    let transfer = tessera_core::settings::Transfer::Srgb;
    tessera_core::film::file::Output::plan(&raw.output, depth, transfer).map_err(Failure::usage)?;
    let partial = on_runtime(cores(), async {
        let mut client = Client::connect(&raw.farm).await?;
        client.picture(raw.id, raw.partial).await
    })?;
    picture::write(partial, &raw.output, raw.bits.as_deref(), raw.missing, console)
}
