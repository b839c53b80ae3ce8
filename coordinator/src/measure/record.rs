//! What was measured, for machines: CSV and JSON. Errors are in 8-bit steps where they are not
//! said to be shares; times in seconds.

use std::fmt::Write;

use serde::Serialize;
use tessera_core::settings::Quality;

use super::point::{Measured, Point};
use super::reference::Source;

#[derive(Debug, Serialize)]
struct Record<'a> {
    program: &'static str,
    version: &'static str,
    complete: bool,
    scene: &'a str,
    settings: SettingsRecord,
    seconds: Seconds,
    target: f64,
    clamped: bool,
    reference: Option<ReferenceRecord>,
    points: Vec<PointRecord<'a>>,
    skipped: Vec<SkippedRecord<'a>>,
    recommendation: Option<Advice>,
}

#[derive(Debug, Serialize)]
struct SettingsRecord {
    width: u32,
    height: u32,
    zoom: f64,
    plane_height: f64,
    max_depth: u32,
    transfer: &'static str,
    workers: usize,
    threads: usize,
}

#[derive(Debug, Serialize)]
struct Seconds {
    read: f64,
    build: f64,
}

#[derive(Debug, Serialize)]
struct ReferenceRecord {
    file: Option<String>,
    grids: Vec<u32>,
    samples_per_pixel: Option<u32>,
    own_rmse: Option<f64>,
}

#[derive(Debug, Serialize)]
struct PointRecord<'a> {
    method: &'static str,
    setting: &'a str,
    flags: &'a [String],
    seconds: PointSeconds,
    /// The closest quality that it is as close as.
    quality: Option<&'static str>,
    /// Of the quickest uniform sampling of the same error.
    uniform_seconds: Option<f64>,
    runs: u32,
    rays: Option<RaysRecord>,
    rmse: f64,
    /// `None` where the pictures are equal: JSON has no infinity.
    psnr: Option<f64>,
    largest: f64,
    largest_at: (u32, u32),
    share_beyond_255th: f64,
    share_beyond_510th: f64,
    ssim: f64,
    flip: f64,
    predicted_rmse: Option<f64>,
    predicted_upper: Option<f64>,
    beyond_reference: bool,
    pareto: bool,
    recommended: bool,
}

#[derive(Debug, Serialize)]
struct PointSeconds {
    trace: f64,
    /// The shortest and the longest run's.
    trace_least: f64,
    trace_most: f64,
    whole: f64,
}

#[derive(Debug, Serialize)]
struct RaysRecord {
    camera: u64,
    mirror: u64,
    shadow: Option<u64>,
    total: Option<u64>,
}

#[derive(Debug, Serialize)]
struct SkippedRecord<'a> {
    setting: &'a str,
    reason: &'a str,
}

#[derive(Debug, Serialize)]
struct Advice {
    flags: Vec<String>,
    command: String,
    rmse: f64,
    trace_seconds: f64,
}

impl<'a> PointRecord<'a> {
    fn new(p: &'a Point, recommended: bool) -> Self {
        let m = &p.metrics;
        Self {
            method: p.method.name(),
            setting: &p.value,
            flags: &p.flags,
            seconds: PointSeconds {
                trace: p.trace.as_secs_f64(),
                trace_least: p.spread.0.as_secs_f64(),
                trace_most: p.spread.1.as_secs_f64(),
                whole: p.whole.as_secs_f64(),
            },
            quality: p.quality().map(Quality::name),
            uniform_seconds: None,
            runs: p.runs,
            rays: p.rays.map(|r| RaysRecord { camera: r.camera, mirror: r.mirror, shadow: r.shadow, total: r.total() }),
            rmse: m.rmse_steps(),
            psnr: m.psnr.is_finite().then_some(m.psnr),
            largest: 255.0 * m.largest,
            largest_at: m.largest_at,
            share_beyond_255th: m.beyond_255th,
            share_beyond_510th: m.beyond_510th,
            ssim: m.ssim,
            flip: m.flip,
            predicted_rmse: p.predicted.map(|e| 255.0 * e.rmse),
            predicted_upper: p.predicted.map(|e| 255.0 * e.upper),
            beyond_reference: p.beyond_reference,
            pareto: p.front,
            recommended,
        }
    }
}

impl Measured {
    fn point_records(&self) -> Vec<PointRecord<'_>> {
        let recommended = self.recommendation.as_ref().map(|r| r.point);
        let mut records: Vec<_> =
            self.points.iter().enumerate().map(|(i, p)| PointRecord::new(p, recommended == Some(i))).collect();
        for (record, p) in records.iter_mut().zip(&self.points) {
            record.uniform_seconds = self.uniform_seconds(p.metrics.rmse);
        }
        records
    }

    /// Everything, as JSON. `command` gives the command line that renders a point.
    ///
    /// # Errors
    /// None that is known: numbers that JSON does not have are left out.
    pub fn to_json(&self, command: impl Fn(&Point) -> String) -> Result<String, serde_json::Error> {
        let view = &self.settings.view;
        let record = Record {
            program: "coordinator",
            version: env!("CARGO_PKG_VERSION"),
            complete: !self.interrupted && self.skipped.is_empty() && self.reference.is_some(),
            scene: &self.scene,
            settings: SettingsRecord {
                width: view.width(),
                height: view.height(),
                zoom: view.zoom(),
                plane_height: view.plane_height(),
                max_depth: self.settings.max_depth,
                transfer: self.settings.transfer.name(),
                workers: self.workers,
                threads: self.threads,
            },
            seconds: Seconds { read: self.read.as_secs_f64(), build: self.build.as_secs_f64() },
            target: self.target,
            clamped: self.clamped,
            reference: self.reference.as_ref().map(|r| ReferenceRecord {
                file: match &r.source {
                    Source::File(path, _) => Some(path.display().to_string()),
                    Source::Rendered(_) => None,
                },
                grids: match &r.source {
                    Source::Rendered(grids) => grids.clone(),
                    Source::File(..) => Vec::new(),
                },
                samples_per_pixel: r.samples(),
                own_rmse: r.own_error.map(|e| 255.0 * e),
            }),
            points: self.point_records(),
            skipped: self.skipped.iter().map(|s| SkippedRecord { setting: &s.what, reason: &s.why }).collect(),
            recommendation: self.recommended().map(|p| Advice {
                flags: p.flags.clone(),
                command: command(p),
                rmse: p.metrics.rmse_steps(),
                trace_seconds: p.trace.as_secs_f64(),
            }),
        };
        Ok(serde_json::to_string_pretty(&record)? + "\n")
    }

    /// The points as CSV (RFC 4180 but for its line ends): a line of names, then a line a point. What is
    /// not known is empty.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from(
            "method,setting,quality,trace_seconds,trace_least,trace_most,whole_seconds,uniform_seconds,runs,camera_rays,mirror_rays,shadow_rays,total_rays,rmse,\
             predicted_rmse,predicted_upper,psnr,largest,share_beyond_255th,share_beyond_510th,ssim,flip,\
             beyond_reference,pareto,recommended\n",
        );
        fn cell<T: ToString>(value: Option<T>) -> String {
            value.map_or_else(String::new, |v| v.to_string())
        }
        for p in self.point_records() {
            let rays = p.rays.as_ref();
            let cells = [
                p.method.to_owned(),
                p.setting.to_owned(),
                cell(p.quality),
                p.seconds.trace.to_string(),
                p.seconds.trace_least.to_string(),
                p.seconds.trace_most.to_string(),
                p.seconds.whole.to_string(),
                cell(p.uniform_seconds),
                p.runs.to_string(),
                cell(rays.map(|r| r.camera)),
                cell(rays.map(|r| r.mirror)),
                cell(rays.and_then(|r| r.shadow)),
                cell(rays.and_then(|r| r.total)),
                p.rmse.to_string(),
                cell(p.predicted_rmse),
                cell(p.predicted_upper),
                cell(p.psnr),
                p.largest.to_string(),
                p.share_beyond_255th.to_string(),
                p.share_beyond_510th.to_string(),
                p.ssim.to_string(),
                p.flip.to_string(),
                p.beyond_reference.to_string(),
                p.pareto.to_string(),
                p.recommended.to_string(),
            ];
            // Writing to a string does not fail.
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use crate::measure::table::tests::{command, measured};

    #[test]
    fn json_has_what_scripts_rely_on() {
        let text = measured().to_json(command).expect("numbers are finite");
        let value: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!((&value["scene"], &value["target"]), (&"demo".into(), &0.5.into()));
        assert_eq!(value["reference"]["samples_per_pixel"], 290);
        assert_eq!(value["complete"], false);
        let points = value["points"].as_array().expect("points");
        assert_eq!(points.len(), 7);
        let chosen: Vec<&Value> = points.iter().filter(|p| p["recommended"] == true).collect();
        assert_eq!(chosen.len(), 1);
        assert_eq!((&chosen[0]["method"], &chosen[0]["setting"]), (&"max-error".into(), &"0.5".into()));
        assert!(chosen[0]["predicted_rmse"].as_f64() > chosen[0]["rmse"].as_f64());
        assert_eq!(value["recommendation"]["command"], "coordinator render demo.xml --max-error 0.5");
    }

    #[test]
    fn csv_has_a_cell_for_every_name() {
        let text = measured().to_csv();
        let counts: Vec<usize> = text.lines().map(|l| l.split(',').count()).collect();
        assert_eq!(counts, [25; 8]);
        assert!(
            text.lines().any(|l| l.starts_with("max-error,0.5,normal,0.5,0.45,0.55,0.6,")
                && l.contains(",1,24,6,3000000,3000030,0.42,")),
            "{text}"
        );
    }
}
