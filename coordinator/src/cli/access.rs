//! Who may join: the flags, the token command, and the line to type on other machines.

use std::io::{IsTerminal, stderr};
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use coordinator::ListenAddr;
use coordinator::access::{Access, AccessError, Pki, State, TokenFrom};

use super::console::Console;
use super::exit::{Exit, Failure};
use super::files::Files;

/// The variable that may hold the token.
const TOKEN_VARIABLE: &str = "TESSERA_TOKEN";

/// Who may join.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct AccessFlags {
    /// Where workers' token is kept; made on first use [default: in the user's state folder, or what TESSERA_TOKEN holds]
    #[arg(long, value_name = "FILE", help_heading = "Farm")]
    pub(super) token_file: Option<PathBuf>,
    /// The coordinator's certificate and its chain (PEM), of an authority of your own; the token names the last of the chain
    #[arg(long, value_name = "FILE", requires = "tls_key", help_heading = "Farm")]
    tls_cert: Option<PathBuf>,
    /// The certificate's key (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert", help_heading = "Farm")]
    tls_key: Option<PathBuf>,
    /// Authorities (PEM) of whom workers must have a certificate; they need no token then
    #[arg(long, value_name = "FILE", requires = "tls_cert", conflicts_with = "token_file", help_heading = "Farm")]
    tls_client_ca: Option<PathBuf>,
    /// Listen beyond this machine without TLS and without a token: whoever reaches the port may read the scene and paint the picture
    #[arg(long, conflicts_with_all = ["token_file", "tls_cert", "tls_client_ca"], help_heading = "Farm")]
    insecure: bool,
}

/// Where pictures of the scene may lie.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct PictureFlags {
    /// Folder that pictures of the scene are also taken from, with all below it; may be repeated [default: only the scene's own folder and below]
    #[arg(long, value_name = "DIR", help_heading = "Scene")]
    pub(crate) allow_pictures: Vec<PathBuf>,
}

/// What to do with the token.
#[derive(Clone, Copy, Debug, Default, Subcommand)]
pub(crate) enum TokenCommand {
    /// Print it; it is made if there is none yet
    #[default]
    Show,
    /// Make another: the one before lets nobody in any more, whoever is in stays
    Renew,
}

fn failed(error: &AccessError) -> Failure {
    Failure::usage(error)
}

/// Prints the token.
pub(crate) fn token(command: TokenCommand, user: bool, console: &Console) -> Result<Exit, Failure> {
    let state = State::of_user().map_err(|e| failed(&e))?;
    let token = match (command, user) {
        (TokenCommand::Show, false) => state.token(),
        (TokenCommand::Renew, false) => state.renew_token(),
        (TokenCommand::Show, true) => state.user_token(),
        (TokenCommand::Renew, true) => state.renew_user_token(),
    };
    console.out(&format!("{}\n", token.map_err(|e| failed(&e))?.reveal()))?;
    Ok(Exit::Done)
}

impl AccessFlags {
    /// Whom a listener there is to let in: everybody on loopback, unless more is asked for.
    pub(crate) fn access(&self, listen: ListenAddr, console: &Console) -> Result<Access, Failure> {
        let loopback = match listen {
            ListenAddr::Loopback => true,
            ListenAddr::Socket(addr) => addr.ip().to_canonical().is_loopback(),
        };
        if self.insecure {
            if !loopback {
                console.warning(
                    "--insecure: whoever reaches this port may read the scene and paint the picture, and whoever \
                     is on the line sees both",
                );
            }
            return Ok(Access::open());
        }
        let asked = self.token_file.is_some() || self.tls_cert.is_some();
        if loopback && !asked {
            return Ok(Access::open());
        }
        let variable = std::env::var(TOKEN_VARIABLE).ok().filter(|t| !t.is_empty());
        let token = match (&self.token_file, variable) {
            (Some(path), _) => Some(TokenFrom::File(path.clone())),
            (None, Some(text)) => Some(TokenFrom::Text { text, from: TOKEN_VARIABLE.into() }),
            (None, None) => None,
        };
        let state = State::of_user();
        let access = match (&self.tls_cert, &self.tls_key) {
            (Some(cert), Some(key)) => {
                let client_ca = self.tls_client_ca.clone();
                Access::by_pki(&Pki { cert: cert.clone(), key: key.clone(), client_ca }, state.ok().as_ref(), token)
            }
            _ => state.and_then(|state| Access::guarded(&state, token)),
        };
        access.map_err(|e| failed(&e))
    }

    /// Adds the files that are read.
    ///
    /// # Errors
    /// When one of them is written, too.
    pub(crate) fn files(&self, files: &mut Files) -> Result<(), Failure> {
        let named = [
            ("the token", &self.token_file),
            ("the certificate", &self.tls_cert),
            ("the certificate's key", &self.tls_key),
            ("the authority of workers", &self.tls_client_ca),
        ];
        for (what, path) in named.iter().filter_map(|(what, path)| Some((what, path.as_ref()?))) {
            files.reads(what, path)?;
        }
        State::of_user()
            .map_or(Ok(()), |state| state.files().iter().try_for_each(|(what, path)| files.reads(what, path)))
    }

    /// Whether a listener there asks for a token.
    pub(crate) fn asks(&self, listen: SocketAddr) -> bool {
        let asked = self.token_file.is_some() || self.tls_cert.is_some();
        !self.insecure && (asked || !listen.ip().to_canonical().is_loopback())
    }

    /// What to type elsewhere. The token itself is for a terminal alone: other outputs are kept and read by others.
    pub(crate) fn invitation(&self, addr: SocketAddr, access: &Access) -> String {
        let host = if addr.ip().is_unspecified() {
            gethostname::gethostname().to_string_lossy().into_owned()
        } else {
            addr.ip().to_string()
        };
        let to = SocketAddr::new(addr.ip(), addr.port());
        let dial = if host.contains(':') { to.to_string() } else { format!("{host}:{}", addr.port()) };
        let how = match access.token() {
            _ if access.is_open() => String::new(),
            None => " --tls-ca FILE --tls-cert FILE --tls-key FILE".into(),
            Some(token) if stderr().is_terminal() => format!(" --token {}", token.reveal()),
            Some(_) => match &self.token_file {
                Some(path) => format!(" --token-file FILE, a copy of '{}'", path.display()),
                None => " --token-file FILE, which holds what 'coordinator token' prints here".into(),
            },
        };
        format!("worker --connect {dial}{how}")
    }
}
