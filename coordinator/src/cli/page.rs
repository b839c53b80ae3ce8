//! Where the page is: `--http` of `serve` and of `render`.

use std::fmt::Display;
use std::net::SocketAddr;
use std::path::PathBuf;

use coordinator::access::{Access, State};
use coordinator::web::Page;
use coordinator::{Farm, ListenAddr};

use super::access::AccessFlags;
use super::console::Console;
use super::exit::{Exit, Failure};

/// Who may see the page of a farm.
pub(super) struct Readers<'a> {
    pub(super) flags: &'a AccessFlags,
    /// As the farm itself is reached; with users, where it asks for anything.
    pub(super) access: &'a Access,
    pub(super) user_token_file: Option<&'a PathBuf>,
}

/// Lets users in beside workers, where anything is asked for.
pub(super) fn with_users(access: Access, file: Option<&PathBuf>) -> Result<Access, Failure> {
    if access.is_open() {
        return Ok(access);
    }
    let path = match file {
        Some(path) => path.clone(),
        None => State::of_user().map_err(Failure::usage)?.user_token_path(),
    };
    access.with_users(path).map_err(Failure::usage)
}

/// Listens for the page's readers, and says where.
pub(super) async fn bind(
    http: &str,
    readers: &Readers<'_>,
    farm: &Farm,
    console: &Console,
) -> Result<Option<Page>, Failure> {
    if http == "none" {
        return Ok(None);
    }
    let wrong = |why: &dyn Display| Failure::usage(format!("--http {http}: {why}"));
    let at = resolve(http).await?;
    let busy = |e| Failure::new(Exit::Failed, format!("cannot listen on {at}: {e}; another place is given by --http"));
    if at.ip().to_canonical().is_loopback() {
        let page = Page::bind(at, farm.strangers()).await.map_err(busy)?;
        console.say(&format!("the page is at http://{}/", page.addr()));
        return Ok(Some(page));
    }
    let access = if readers.access.user_token().is_some() {
        readers.access.clone()
    } else {
        with_users(readers.flags.access(ListenAddr::Socket(at), console)?, readers.user_token_file)?
    };
    if access.is_open() {
        return Err(wrong(&"beyond this machine the page is only with TLS and a login, and so not with --insecure"));
    }
    let page = Page::bind(at, farm.strangers()).await.map_err(busy)?;
    let host = gethostname::gethostname().to_string_lossy().into_owned();
    let mut names = vec![host.clone(), "localhost".to_owned()];
    let shown = if at.ip().is_unspecified() {
        format!("{host}:{}", page.addr().port())
    } else {
        names.push(at.ip().to_string());
        page.addr().to_string()
    };
    let page = page.guarded(access, names).map_err(|e| wrong(&e))?;
    let token = match readers.user_token_file {
        Some(path) => format!("'{}'", path.display()),
        None => "'coordinator token show --user'".into(),
    };
    console.say(&format!(
        "the page is at https://{shown}/; log in by the token in {token}. Its certificate's SHA-256 is {}",
        page.certificate().unwrap_or_default()
    ));
    Ok(Some(page))
}

/// The address that `--http` means: HOST:PORT, or a port of this machine.
async fn resolve(http: &str) -> Result<SocketAddr, Failure> {
    let port_alone = !http.is_empty() && http.bytes().all(|b| b.is_ascii_digit());
    let addr = if port_alone { format!("127.0.0.1:{http}") } else { http.to_owned() };
    let wrong = |why: &dyn Display| Failure::usage(format!("--http {http}: {why}"));
    let found = tokio::net::lookup_host(&addr).await.map_err(|e| wrong(&e))?.next();
    found.ok_or_else(|| wrong(&"no address"))
}
