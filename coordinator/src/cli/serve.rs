//! `coordinator serve`: a farm that stays.

use std::net::SocketAddr;

use coordinator::access::Access;
use coordinator::fleet::InCluster;
use coordinator::{Farm, Queue, open_files};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use super::args::Serve;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::fleet::Own;
use super::options::resolve;
use super::page::{self, Readers, with_users};
use super::runtime::{cores, on_runtime};
use super::signals;

/// Serves until a signal comes.
pub(crate) fn run(raw: &Serve, console: &Console) -> Result<Exit, Failure> {
    raw.fleet.check(true)?;
    if raw.fleet.flags.print {
        return on_runtime(1, raw.fleet.print(&raw.listen, &raw.access, (|| Ok(InCluster::Serve), false, console)));
    }
    let stop = signals::stop_on_signal(console);
    let threads = raw.threads.map_or_else(cores, usize::from);
    on_runtime(threads, serve(raw, threads, console, stop))
}

async fn serve(raw: &Serve, threads: usize, console: &Console, stop: CancellationToken) -> Result<Exit, Failure> {
    open_files::raise();
    let listen = resolve(&raw.listen).await?;
    let access = with_users(raw.access.access(listen, console)?, raw.user_token_file.as_ref())?;
    let (queue, orders) =
        Queue::open(&raw.state, raw.keep.unwrap_or_default()).map_err(|e| Failure::new(Exit::Failed, e))?;
    let farm = Farm::bind_serving(listen, &access, &queue).await.map_err(|e| Failure::from(&e))?;
    let addr = farm.addr();
    console.say(&format!("the farm is at {addr}; start workers by: {}", raw.access.invitation(addr, &access)));
    let token = match (access.is_open(), &raw.user_token_file) {
        (true, _) => String::new(),
        (false, Some(path)) => format!(" --user-token FILE, a copy of '{}'", path.display()),
        (false, None) => " --user-token FILE, which holds what 'coordinator token show --user' prints here".into(),
    };
    console.say(&format!("submit jobs by: coordinator submit SCENE --farm {}{token}", named(addr)));
    let closed = CancellationToken::new();
    let readers = Readers { flags: &raw.access, access: &access, user_token_file: raw.user_token_file.as_ref() };
    let page = page::bind(&raw.http, &readers, &farm, console).await?;
    let shown = page.map(|page| tokio::spawn(page.show(queue.clone(), closed.clone())));
    let fleet = raw.fleet.start(addr, (&access, &raw.access), (false, false))?;
    if let Some(fleet) = &fleet {
        fleet.follow_queue(queue.clone());
    }
    let mut here = workers(raw, threads, addr, &access, &closed);
    {
        let served = farm.serve(&queue, orders, closed.clone());
        tokio::pin!(served);
        tokio::select! {
            () = &mut served => return Err(Failure::new(Exit::Failed, "the farm ended by itself")),
            () = stop.cancelled() => {}
        }
        if let Some(fleet) = &fleet {
            fleet.stop();
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
    if let Some(shown) = shown {
        let _ = shown.await;
    }
    if let Some(Err(left)) = fleet.map(Own::end) {
        console.warning(&left.message);
    }
    console.say("the farm is closed; what is done is kept, and the same command goes on with it");
    Ok(Exit::Interrupted)
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
