//! Small objects, and small shadows, that a pixel's corners do not show, from their outlines.

use super::cell::{Cell, Outcome};
use super::part::Part;
use super::side::Chain;
use super::small::{self, Mark, What};
use super::store::{SampleId, Store, UNIT, rms};
use crate::film::Region;
use crate::trace::Tracer;
use crate::trace::record::Want;

/// A small thing seen in a cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Feature {
    what: What,
    pub(crate) sample: SampleId,
    /// Where that is.
    at: (i32, i32),
    /// Its outline's overlap with the cell, in pixels.
    area: f64,
}

impl Feature {
    pub(crate) fn is_object(&self) -> bool {
        matches!(self.what, What::Object(_))
    }
}

/// A look at where a small thing should be.
pub(crate) struct Look {
    pixel: usize,
    mark: Mark,
    sample: SampleId,
    at: (i32, i32),
}

/// Looks at the small things of a pixel that its corners do not show.
pub(crate) fn look(store: &mut Store<'_>, (x, y): (u32, u32), cell: &Cell, pixel: usize, looks: &mut Vec<Look>) {
    let tracer = store.tracer;
    for &mark in tracer.marks().of(x, y) {
        let want = match mark.what {
            What::Object(object) => {
                if cell.corners.iter().any(|&s| store.object(s) == Some(object)) {
                    continue;
                }
                Want::Objects(1)
            }
            What::Shadow(light) => {
                let lit = |s| store.key(s, Part::Light(1, light)) != store.key(s, Part::From(1));
                if cell.corners.iter().any(|&s| !lit(s)) {
                    continue;
                }
                Want::Light(1, light)
            }
        };
        let unit = f64::from(UNIT);
        let place = |k: usize| ((f64::from(mark.at[k]) * unit).round() as i32).clamp(0, UNIT);
        let at = (cell.x + place(0), cell.y + place(1));
        looks.push(Look { pixel, mark, sample: store.ask(at.0, at.1, want), at });
    }
}

/// Hands the features found to `found`, with their pixels.
pub(crate) fn take(store: &mut Store<'_>, looks: Vec<Look>, mut found: impl FnMut(usize, Feature)) {
    let mut seen = Vec::new();
    for look in looks {
        let there = match look.mark.what {
            What::Object(object) => store.object(look.sample) == Some(object),
            What::Shadow(light) => {
                store.key(look.sample, Part::Light(1, light)) == store.key(look.sample, Part::From(1))
            }
        };
        if there {
            let sample = store.ask(look.at.0, look.at.1, Part::From(1).whole());
            let area = f64::from(look.mark.area);
            seen.push((look.pixel, Feature { what: look.mark.what, sample, at: look.at, area }));
        }
    }
    store.flush();
    for (pixel, feature) in seen {
        found(pixel, feature);
    }
}

/// Adds the features that neither the boundary nor the middle of a cell shows.
pub(crate) fn add(
    store: &Store<'_>,
    cell: &Cell,
    features: &[Feature],
    sides: [Option<&Chain>; 4],
    outcome: &mut Outcome,
) {
    let part = cell.part;
    let shown = |f: &Feature| {
        let shows = |s: SampleId| match f.what {
            What::Object(object) => store.object(s) == Some(object),
            What::Shadow(_) => store.key(s, part) == store.key(f.sample, part),
        };
        cell.corners.iter().any(|&s| shows(s)) || sides.iter().flatten().any(|c| c.iter().any(|e| shows(e.sample)))
    };
    let concerns = |f: &Feature| match (f.what, part) {
        (What::Object(_), _) => true,
        (What::Shadow(light), Part::Light(1, own)) => light == own,
        (What::Shadow(_), _) => false,
    };
    let hidden: Vec<&Feature> = features.iter().filter(|f| concerns(f) && !shown(f)).collect();
    if hidden.is_empty() {
        return;
    }
    let a = cell.edge();
    let total: f64 = hidden.iter().map(|f| f.area).sum();
    let share = (0.9 * a * a / total).min(1.0);
    let around = outcome.value / (a * a);
    for f in hidden {
        let (area, value) = (f.area * share, store.value(f.sample, part));
        outcome.value += (value - around) * area;
        let e = match f.what {
            What::Object(_) => 0.2 * rms(value - around) + 0.15 * rms(value),
            What::Shadow(_) => 0.4 * rms(value - around),
        };
        outcome.variance += e * area * e * area;
        outcome.chord = None;
        outcome.wants_centre = false;
    }
}

/// The features that are in a part of their cell.
pub(crate) fn inherit(tracer: &Tracer, features: &[Feature], region: Region, cell: &Cell) -> Vec<Feature> {
    let place = |v: i32, start: u32| f64::from(v) / f64::from(UNIT) + f64::from(start);
    let (x1, y1) = (cell.x + cell.size, cell.y + cell.size);
    let rectangle = [place(cell.x, region.x0), place(cell.y, region.y0), place(x1, region.x0), place(y1, region.y0)];
    let inside = |f: &Feature| match f.what {
        What::Object(object) => {
            let outline = small::outline(tracer, object)?;
            let area = small::area(&small::clip(&outline, rectangle)).0;
            (area > 0.0).then_some(Feature { area, ..*f })
        }
        What::Shadow(_) => {
            let (u, v) = f.at;
            let area = f.area.min(0.8 * cell.edge() * cell.edge());
            (u >= cell.x && u < x1 && v >= cell.y && v < y1).then_some(Feature { area, ..*f })
        }
    };
    features.iter().filter_map(inside).collect()
}
