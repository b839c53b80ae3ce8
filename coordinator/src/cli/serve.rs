//! `coordinator serve`: a farm that stays.

use std::net::SocketAddr;

use coordinator::access::{Access, State};
use coordinator::{Farm, Queue};
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use super::access::raise_open_files;
use super::args::Serve;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::options::resolve;
use super::render::{failure, on_runtime};
use super::signals;

/// Threads that this machine has.
pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Serves until a signal comes.
pub(crate) fn run(raw: &Serve, console: &Console) -> Result<Exit, Failure> {
    let stop = signals::stop_on_signal(console);
    let threads = raw.threads.map_or_else(cores, usize::from);
    on_runtime(threads, serve(raw, threads, console, stop))
}

async fn serve(raw: &Serve, threads: usize, console: &Console, stop: CancellationToken) -> Result<Exit, Failure> {
    raise_open_files();
    let listen = resolve(&raw.listen).await?;
    let mut access = raw.access.access(listen, console)?;
    if !access.is_open() {
        let path = match &raw.user_token_file {
            Some(path) => path.clone(),
            None => State::of_user().map_err(Failure::usage)?.user_token_path(),
        };
        access = access.with_users(path).map_err(Failure::usage)?;
    }
    let (queue, orders) =
        Queue::open(&raw.state, raw.keep.unwrap_or_default()).map_err(|e| Failure::new(Exit::Failed, e))?;
    let farm = Farm::bind_serving(listen, &access, &queue).await.map_err(|e| failure(&e))?;
    let addr = farm.addr();
    console.say(&format!("the farm is at {addr}; start workers by: {}", raw.access.invitation(addr, &access)));
    let token = match (access.is_open(), &raw.user_token_file) {
        (true, _) => String::new(),
        (false, Some(path)) => format!(" --user-token FILE, a copy of '{}'", path.display()),
        (false, None) => " --user-token FILE, which holds what 'coordinator token show --user' prints here".into(),
    };
    console.say(&format!("submit jobs by: coordinator submit SCENE --farm {}{token}", named(addr)));
    let closed = CancellationToken::new();
    let page = page(&raw.http).await?;
    if let Some(page) = page {
        let at = page.local_addr().map_err(|e| Failure::new(Exit::Failed, e))?;
        console.say(&format!("the page is at http://{at}/"));
        let (queue, closed) = (queue.clone(), closed.clone());
        tokio::spawn(async move {
            if let Err(e) = coordinator::web::serve(page, queue, closed).await {
                tracing::error!("the page ended: {e}");
            }
        });
    }
    let mut here = workers(raw, threads, addr, &access, &closed);
    {
        let served = farm.serve(&queue, orders, closed.clone());
        tokio::pin!(served);
        tokio::select! {
            () = &mut served => return Err(Failure::new(Exit::Failed, "the farm ended by itself")),
            () = stop.cancelled() => {}
        }
        // Jobs are stopped by the farm, and what is done of them is kept.
        tokio::select! {
            () = &mut served => {}
            () = queue.close() => {
                closed.cancel();
                served.await;
            }
        }
    }
    while here.join_next().await.is_some() {}
    console.say("the farm is closed; what is done is kept, and the same command goes on with it");
    Ok(Exit::Interrupted)
}

/// Listens for the page's readers.
async fn page(http: &str) -> Result<Option<TcpListener>, Failure> {
    if http == "none" {
        return Ok(None);
    }
    let port_alone = !http.is_empty() && http.bytes().all(|b| b.is_ascii_digit());
    let addr = if port_alone { format!("127.0.0.1:{http}") } else { http.to_owned() };
    let wrong = |why: &dyn std::fmt::Display| Failure::usage(format!("--http {http}: {why}"));
    let found = tokio::net::lookup_host(&addr).await.map_err(|e| wrong(&e))?.next();
    let found = found.ok_or_else(|| wrong(&"no address"))?;
    if !found.ip().to_canonical().is_loopback() {
        return Err(wrong(&"the page is for this machine alone: take 127.0.0.1, and ssh -L to see it from elsewhere"));
    }
    let busy =
        |e| Failure::new(Exit::Failed, format!("cannot listen on {found}: {e}; another place is given by --http"));
    TcpListener::bind(found).await.map(Some).map_err(busy)
}

/// An address as others type it.
fn named(addr: SocketAddr) -> String {
    if addr.ip().is_unspecified() {
        format!("{}:{}", gethostname::gethostname().to_string_lossy(), addr.port())
    } else {
        addr.to_string()
    }
}

/// Starts workers of this process, which are like any others.
fn workers(raw: &Serve, threads: usize, addr: SocketAddr, access: &Access, closed: &CancellationToken) -> JoinSet<()> {
    let mut tasks = JoinSet::new();
    let count = usize::from(raw.workers);
    let host = match addr.ip() {
        ip if ip.is_unspecified() => SocketAddr::new(std::net::Ipv4Addr::LOCALHOST.into(), addr.port()),
        _ => addr,
    };
    for n in 0..count {
        let access = access.token().and_then(|token| worker::Access::by_token(&token).ok()).unwrap_or_default();
        let config = worker::Config {
            threads: (threads / count + usize::from(n < threads % count)).max(1),
            name: format!("here-{}", n + 1),
            access,
            once: true,
            ..worker::Config::new(host.into())
        };
        let closed = closed.clone();
        tasks.spawn(async move {
            if let Err(e) = worker::run(config, closed).await {
                tracing::error!("a worker of this process: {e}");
            }
        });
    }
    tasks
}
