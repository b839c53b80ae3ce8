//! `coordinator render`: a scene file to a picture file.

use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::access::Access;
use coordinator::journal::Journal;
use coordinator::web::{Page, Single};
use coordinator::{Farm, Progress, RenderError, RenderJob, Rendered, SceneSource, Scratch, Unfinished, open_files};
use tessera_core::film::ErrorEstimate;
use tessera_core::film::file::Output;
use tessera_core::scene::Scene;
use tessera_core::settings::{Detail, Quality};
use tessera_core::trace::PreparedScene;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::{Span, info, info_span};
use worker::spans::SPANS;

use super::args::{ProgressArg, Render};
use super::console::Console;
use super::describe::Description;
use super::exit::{Exit, Failure};
use super::files::Files;
use super::finish::Rest;
use super::fleet::{Own, scene_in_cluster};
use super::options::{Accuracy, Options, ReportTo, resolve};
use super::page::{self, Readers};
use super::report::Phases;
use super::runtime::{blocking, on_runtime, unless_stopped};
use super::{journal, progress, remote, scene, signals, verification};

/// Renders as the flags say; `began` is when the program started.
pub(crate) fn run(raw: Render, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let mut fleet = None;
    let done = run_with(raw, &mut fleet, (console, began));
    // The picture is written: whatever the engine does now, it is there.
    match (done, fleet.map_or(Ok(()), Own::end)) {
        // Nobody interrupted it: it was given up for want of workers.
        (Err(Failure { exit: Exit::Interrupted, .. }), Err(refused)) if refused.exit == Exit::NoWorkers => Err(refused),
        (done, Ok(())) => done,
        (done, Err(left)) => {
            console.warning(&left.message);
            done
        }
    }
}

/// Renders; `fleet` is where workers are that an engine starts for it, whatever ends it.
fn run_with(raw: Render, fleet: &mut Option<Own>, (console, began): (&Console, Instant)) -> Result<Exit, Failure> {
    let options = Arc::new(Options::new(raw)?);
    for note in &options.notes {
        console.warning(note);
    }
    if options.fleet.flags.print {
        let listen = options.listen.as_deref().unwrap_or_default();
        let inside = || scene_in_cluster(&options.scene, options.output.path());
        return on_runtime(1, options.fleet.print(listen, &options.access, (inside, true, console)));
    }
    let files = files(&options)?;
    let stop = signals::stop_on_signal(console);
    let (width, height) = (options.region.width(), options.region.height());
    let room = options.output.reserve(width, height).map_err(Failure::usage)?;
    // A farm that stays keeps its own.
    let journal = if options.farm.is_some() { None } else { journal::open(&options)? };
    let scene = options.scene.file_stem().unwrap_or_default().to_string_lossy();
    let span = info_span!(target: SPANS, parent: None, "render", scene = &*scene);
    let job = render(options.clone(), (files, journal.clone(), fleet), (console, stop), (began, &span));
    let ended = on_runtime(options.threads, job)?;
    // The farm is closed: whatever its peers do, the picture is written.
    let Ended { rendered, error, phases, description } = match ended {
        Ok(ended) => ended,
        Err(error) => return Err(with_journal(Failure::from(&error), journal.as_deref())),
    };
    let output = if error.is_none() { options.output.clone() } else { options.output.partial() };
    let rest =
        Rest { options: &options, description: description.as_ref(), phases, began, journal: journal.as_deref() };
    let writing = info_span!(target: SPANS, parent: &span, "write picture");
    rest.finish(&output, &rendered, room)?;
    drop(writing);
    if let Some(warning) = verification::warning(&rendered.verification) {
        console.warning(&warning);
    }
    let summary = summary(&output, &rendered, began);
    match error {
        None => {
            // All is in its place.
            if let Some(journal) = &journal {
                if rendered.earlier.tiles > 0 {
                    // Of the earlier run, should it have been interrupted.
                    let _ = std::fs::remove_file(options.output.partial().path());
                }
                journal.remove();
            }
            match options.progress {
                ProgressArg::None => {}
                // Whoever reads the lines of JSON reads them to the end.
                ProgressArg::Json => console.say(&progress::done_json(output.path(), began.elapsed())),
                _ => console.say(&summary),
            }
            match missed(&options, &rendered) {
                Some(why) => Err(Failure::new(Exit::TargetMissed, why)),
                None => Ok(Exit::Done),
            }
        }
        Some(error) => {
            let mut failure = with_journal(Failure::from(&error), journal.as_deref());
            failure.message = format!("{}\n{summary}", failure.message);
            Err(failure)
        }
    }
}

/// Makes sure that no file is both read and written, as far as is known without the scene.
fn files(options: &Options) -> Result<Files, Failure> {
    let mut files = Files::default();
    files.reads("the scene", &options.scene)?;
    options.access.files(&mut files)?;
    files.writes("the picture", options.output.path())?;
    files.writes("the picture of what is done at an interruption", options.output.partial().path())?;
    if let Some(ReportTo::File(path)) = &options.report {
        files.writes("the report", path)?;
    }
    if let Some(path) = &options.journal {
        files.writes("the journal", path)?;
    }
    Ok(files)
}

/// `failure`, and from where the render can go on.
fn with_journal(mut failure: Failure, journal: Option<&Journal>) -> Failure {
    if let Some(path) = journal.and_then(Journal::kept) {
        failure.message += &format!("; the same command goes on from what is kept in '{}'", path.display());
    }
    failure
}

/// What a render came to.
struct Ended {
    rendered: Rendered,
    /// Why that is not all.
    error: Option<RenderError>,
    phases: Phases,
    description: Option<Description>,
}

/// Reads the scene, and tells what is wrong with it.
async fn read(
    options: &Options,
    (files, phases): (&mut Files, &mut Phases),
    (console, stop): (&Console, &CancellationToken),
    span: &Span,
) -> Result<Arc<Scene>, Failure> {
    let (reading, reading_span) = (Instant::now(), info_span!(target: SPANS, parent: span, "read scene"));
    let (path, folders) = (options.scene.clone(), options.pictures.clone());
    let read = unless_stopped(stop, blocking(move || scene::read(&path, folders))).await??;
    drop(reading_span);
    phases.read = reading.elapsed();
    info!(seconds = phases.read.as_secs_f64(), "scene read");
    for path in &read.pictures {
        files.reads("a picture of the scene", path)?;
    }
    scene::accept(read, &options.scene, console)
}

/// The scene as the farm takes it: prepared, where this process has workers.
async fn source(
    options: &Options,
    scene: Arc<Scene>,
    phases: &mut Phases,
    (stop, span): (&CancellationToken, &Span),
) -> Result<SceneSource, Failure> {
    if options.workers == 0 {
        return Ok(SceneSource::Resolved(scene));
    }
    let (building, _span) = (Instant::now(), info_span!(target: SPANS, parent: span, "prepare scene"));
    let prepared = unless_stopped(stop, blocking(move || PreparedScene::build(scene))).await??;
    phases.build = building.elapsed();
    info!(seconds = phases.build.as_secs_f64(), "structures built");
    Ok(SceneSource::Prepared(Arc::new(prepared)))
}

/// What the farm is asked for.
fn job(options: &Options, source: SceneSource, journal: Option<Arc<Journal>>, span: &Span) -> RenderJob {
    RenderJob {
        region: options.region,
        pixels: options.pixels,
        tile: options.tile,
        workers: options.workers,
        threads: options.threads,
        goal: options.goal(),
        verify: options.verify,
        patience: options.patience,
        journal,
        span: info_span!(target: SPANS, parent: span, "job"),
        scratch: Scratch { folder: options.output.path().parent().map(Into::into), ..Scratch::default() },
        ..RenderJob::new(source, options.settings)
    }
}

async fn render(
    options: Arc<Options>,
    (mut files, journal, fleet): (Files, Option<Arc<Journal>>, &mut Option<Own>),
    (console, stop): (&Console, CancellationToken),
    (began, span): (Instant, &Span),
) -> Result<Result<Ended, RenderError>, Failure> {
    let (mut farm, over) = (None, CancellationToken::new());
    let mut watching = None;
    if options.farm.is_none() {
        // They connect while the scene is read.
        let (mut bound, access, page) = bind(&options, console).await?;
        bound.hire(options.workers, options.threads);
        farm = Some((bound, access));
        watching = page.map(|page| watch_single(page, &options, stop.clone(), over.clone()));
    }
    let mut phases = Phases::default();
    let scene = read(&options, (&mut files, &mut phases), (console, &stop), span).await?;
    let description = options.report.is_some().then(|| Description::new(&options.scene.display().to_string(), &scene));

    let Some((farm, access)) = farm else {
        let rendered = remote::rendered(&options, scene, (console, &stop), span).await?;
        return Ok(Ok(Ended { rendered, error: None, phases, description }));
    };
    let source = source(&options, scene, &mut phases, (&stop, span)).await?;
    let mut job = job(&options, source, journal, span);
    if let Some(journal) = job.journal.clone() {
        let checked = job.clone();
        let share = unless_stopped(&stop, blocking(move || journal::check(&journal, &checked))).await???;
        if let Some(said) = share.and_then(|share| progress::going_on(options.progress, share)) {
            console.say(&said);
        }
    }
    job.spent = began.elapsed();
    let last = job.scene.clone();
    let (tell, watched) = watch::channel(Progress::default());
    if let Some((single, _)) = &watching {
        job.canvas = Some(single.canvas());
        single.begin(watched.clone());
    }
    *fleet = options.fleet.start(farm.addr(), (&access, &options.access), (true, options.workers == 0))?;
    if let Some(fleet) = &fleet {
        fleet.follow(watched.clone());
    }
    let shown = tokio::spawn(progress::show(progress::Style::of(options.progress), watched, console.clone()));
    let given_up = stop.child_token();
    let ended = {
        let rendered = farm.render(job, tell, given_up.clone());
        tokio::pin!(rendered);
        tokio::select! {
            ended = &mut rendered => ended,
            () = failed(fleet.as_ref()) => {
                given_up.cancel();
                rendered.await
            }
        }
    };
    if let Some(fleet) = &fleet {
        fleet.stop();
    }
    // A large scene takes a while to be given back: the picture is written meanwhile.
    rayon::spawn(move || drop(last));
    // It ends by itself, its sender being gone; the bar must be off the screen before the next line.
    let _ = shown.await;
    if let Some((_, page)) = watching {
        over.cancel();
        let _ = page.await;
    }
    Ok(match ended {
        Ok(rendered) => Ok(Ended { rendered, error: None, phases, description }),
        Err(Unfinished { error, partial }) => match partial.filter(|p| !p.done.is_empty()) {
            Some(partial) => Ok(Ended { rendered: *partial, error: Some(error), phases, description }),
            None => Err(error),
        },
    })
}

/// Waits until a fleet is of no use; for ever where there is none, or where this process has workers itself.
async fn failed(fleet: Option<&Own>) {
    match fleet {
        Some(fleet) => fleet.failed().await,
        None => std::future::pending().await,
    }
}

/// Why the accuracy asked for was not reached.
fn missed(options: &Options, rendered: &Rendered) -> Option<String> {
    let wanted = steps(options.accuracy.target()?);
    if rendered.target_met != Some(false) {
        return None;
    }
    let got = rendered.error.map_or_else(|| "not known".into(), |e| told(&e));
    Some(match options.accuracy {
        Accuracy::Time { limit, .. } if rendered.timed_out => {
            format!("time was up after {}: the error is {got}, not surely below {wanted}", progress::duration(limit))
        }
        _ => format!("the error asked for was not reached: it is {got}, not surely below {wanted}"),
    })
}

/// Shows the render on `page` until it is `over`.
fn watch_single(
    page: Page,
    options: &Options,
    stop: CancellationToken,
    over: CancellationToken,
) -> (Single, tokio::task::JoinHandle<()>) {
    let name = options.scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let picture = (options.settings, options.region, options.pixels);
    let single = Single::new(name, picture, options.accuracy.target(), stop);
    let shown = tokio::spawn(page.show_single(single.clone(), over));
    (single, shown)
}

/// Listens before anything is read, so that a port in use costs no time.
async fn bind(options: &Options, console: &Console) -> Result<(Farm, Access, Option<Page>), Failure> {
    open_files::raise();
    let listen = match &options.listen {
        Some(text) => resolve(text).await?,
        None => coordinator::ListenAddr::Loopback,
    };
    let access = options.access.access(listen, console)?;
    let farm = Farm::bind_guarded(listen, &access).await.map_err(|e| match &e {
        RenderError::Listen { source, .. } if source.kind() == std::io::ErrorKind::AddrInUse => Failure::new(
            Exit::Failed,
            format!("{e}; another program listens there: choose another port, or 0 for any free one"),
        ),
        _ => Failure::from(&e),
    })?;
    if (options.listen.is_some() || options.workers == 0) && options.fleet.fleet.is_none() {
        let how = options.access.invitation(farm.addr(), &access);
        console.say(&format!("workers are awaited on {}; start them by: {how}", farm.addr()));
    }
    let readers = Readers { flags: &options.access, access: &access, user_token_file: None };
    let page = page::bind(&options.http, &readers, &farm, console).await?;
    Ok((farm, access, page))
}

/// One line about what was written.
fn summary(output: &Output, rendered: &Rendered, began: Instant) -> String {
    let rays = rendered.rays.total();
    let seconds = rendered.trace.as_secs_f64();
    let traced = rays.saturating_sub(rendered.earlier.rays.total());
    let speed = if seconds > 0.0 { traced as f64 / seconds / 1e6 } else { 0.0 };
    let part = if rendered.is_complete() {
        String::new()
    } else {
        let done: u64 = rendered.done.iter().map(|r| r.area()).sum();
        format!(", {:.0} % of it", 100.0 * done as f64 / rendered.region.area() as f64)
    };
    let coarse = match rendered.pass.map(|p| p.detail) {
        Some(Detail::Coarse { step }) => format!(", coarse: a point in {step}x{step} pixels where time was up"),
        _ => String::new(),
    };
    let error = rendered.error.map_or_else(String::new, |e| format!("\nerror (RMSE): {}{}", told(&e), ahead(rendered)));
    format!(
        "{}: {}x{} pixels{part} in {}, {:.1} Mrays, {speed:.1} Mrays/s{coarse}{error}",
        output.path().display(),
        rendered.region.width(),
        rendered.region.height(),
        progress::duration(began.elapsed()),
        rays as f64 / 1e6,
    )
}

/// An error in 8-bit steps, with two digits or so.
fn steps(fraction: f64) -> String {
    let steps = 255.0 * fraction;
    match steps {
        s if !s.is_finite() => "not known".into(),
        s if s >= 9.95 => format!("{s:.0}"),
        s if s >= 0.995 => format!("{s:.1}"),
        s if s >= 0.0995 => format!("{s:.2}"),
        s if s >= 0.00095 || s == 0.0 => format!("{s:.3}"),
        s => format!("{s:.1e}"),
    }
}

/// An error and how sure it is.
fn told(error: &ErrorEstimate) -> String {
    let (low, high) = error.interval();
    if error.audited == 0 {
        return "not known".into();
    }
    format!("{} 8-bit steps, 95 % sure to lie in {} to {}", steps(error.rmse()), steps(low), steps(high))
}

/// What the next quality would take.
fn ahead(rendered: &Rendered) -> String {
    let Some((forecast, error)) = rendered.forecast.zip(rendered.error) else { return String::new() };
    let better = Quality::ALL.into_iter().find(|q| q.rmse() < 0.9 * error.rmse());
    let seconds = better.and_then(|q| Some((q, forecast.seconds(q.rmse())?)));
    seconds.map_or_else(String::new, |(quality, seconds)| {
        let time = Duration::try_from_secs_f64(seconds).map_or_else(|_| "years".into(), progress::duration);
        format!("; --quality {} ({}) would take about {time}", quality.name(), steps(quality.rmse()))
    })
}
