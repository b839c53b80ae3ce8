//! Figures for Prometheus.

use std::fmt::Write;

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};

use super::Site;

pub(super) async fn metrics(State(site): State<Site>) -> Response {
    let mut text = String::new();
    let mut family = |name: &str, kind: &str, help: &str, rows: Vec<(String, f64)>| {
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        for (labels, value) in rows {
            let _ = writeln!(text, "{name}{labels} {value}");
        }
    };
    let counts = site.farm.counts();
    let states = counts.iter().map(|(state, count)| (format!("{{state=\"{state}\"}}"), *count as f64)).collect();
    family("tessera_jobs", "gauge", "Jobs by state.", states);
    let workers = site.farm.workers();
    let one = |value: f64| vec![(String::new(), value)];
    let sum = |of: fn(&tessera_proto::control::Worker) -> u64| workers.iter().map(of).sum::<u64>() as f64;
    family("tessera_workers", "gauge", "Workers that are connected.", one(workers.len() as f64));
    family("tessera_worker_threads", "gauge", "Their threads.", one(sum(|w| u64::from(w.threads))));
    let busy = workers.iter().filter(|w| w.job > 0).count() as f64;
    family("tessera_workers_busy", "gauge", "Workers that render for a job.", one(busy));
    // Of the workers that are connected: a sum over all that ever were would only grow.
    family("tessera_tiles_rendered", "gauge", "Tiles by connected workers.", one(sum(|w| w.tiles)));
    family("tessera_tiles_lost", "gauge", "Tiles lost with or by connected workers.", one(sum(|w| w.lost)));
    family("tessera_rays_traced", "gauge", "Rays by connected workers.", one(sum(|w| w.rays)));
    let seconds = sum(|w| w.busy_us) / 1e6;
    family("tessera_render_seconds", "gauge", "Seconds that connected workers rendered for.", one(seconds));
    let refused = site.strangers.total() as f64;
    family("tessera_refused_total", "counter", "Calls and logins without the right token.", one(refused));
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}
