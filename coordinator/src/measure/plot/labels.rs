//! Where names are written, so that they cover neither each other nor what they name.

use super::drawing::{Anchor, Position, Text};
use super::font::Font;

/// How far apart the places are that stand for a line.
const STEP: f64 = 5.0;

/// A rectangle: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Area {
    fn overlap(&self, o: &Self) -> f64 {
        let w = self.right.min(o.right) - self.left.max(o.left);
        let h = self.bottom.min(o.bottom) - self.top.max(o.top);
        if w > 0.0 && h > 0.0 { w * h } else { 0.0 }
    }

    fn holds(&self, (x, y): Position) -> bool {
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }

    fn within(&self, o: &Self) -> bool {
        self.left >= o.left && self.right <= o.right && self.top >= o.top && self.bottom <= o.bottom
    }
}

/// A name to be written near one of some places.
#[derive(Debug)]
pub(super) struct Label {
    pub(super) text: Text,
    pub(super) near: Vec<Position>,
    /// Between the place and the name.
    pub(super) gap: f64,
    /// Whether it is written even where it covers something.
    pub(super) needed: bool,
}

/// Names placed one after another, each where it covers least: greedy, and good enough for a few dozen.
#[derive(Debug)]
pub(super) struct Labels {
    frame: Area,
    taken: Vec<Area>,
    crossed: Vec<Position>,
    texts: Vec<Text>,
}

impl Labels {
    /// No names yet; all of them will be between these corners.
    pub(super) fn within(from: Position, to: Position) -> Self {
        let frame = Area { left: from.0, top: from.1, right: to.0, bottom: to.1 };
        Self { frame, taken: Vec::new(), crossed: Vec::new(), texts: Vec::new() }
    }

    /// Keeps names off a marker.
    pub(super) fn keep_clear(&mut self, (x, y): Position, radius: f64) {
        self.taken.push(Area { left: x - radius, top: y - radius, right: x + radius, bottom: y + radius });
    }

    /// Keeps names out of a rectangle.
    pub(super) fn block(&mut self, from: Position, to: Position) {
        self.taken.push(Area { left: from.0, top: from.1, right: to.0, bottom: to.1 });
    }

    /// Keeps names off a line, where that is possible.
    pub(super) fn avoid(&mut self, line: &[Position]) {
        for pair in line.windows(2) {
            let ((ax, ay), (bx, by)) = (pair[0], pair[1]);
            let steps = ((bx - ax).hypot(by - ay) / STEP).ceil().max(1.0);
            let places = (0..=steps as u32).map(|k| f64::from(k) / steps);
            self.crossed.extend(places.map(|t| (ax + t * (bx - ax), ay + t * (by - ay))));
        }
    }

    /// Writes a name where it covers least; leaves it out where that is too much.
    pub(super) fn put(&mut self, label: Label) {
        let size = label.text.size;
        let width = Font::get(label.text.medium).width(&label.text.text, size);
        let mut best: Option<(f64, Area)> = None;
        for (nth, &near) in label.near.iter().enumerate() {
            for (order, area) in around(near, (width, size), label.gap).into_iter().enumerate() {
                if !area.within(&self.frame) {
                    continue;
                }
                let cost = self.cost(&area) + order as f64 + 3.0 * nth as f64;
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, area));
                }
            }
        }
        let Some((_, area)) = best.filter(|(cost, _)| label.needed || *cost < 70.0) else { return };
        self.taken.push(area);
        // Letters without descenders end a fifth of their size above the area's bottom.
        self.texts.push(Text { at: (area.left, area.bottom - 0.2 * size), anchor: Anchor::Start, ..label.text });
    }

    /// How much a name in this area would cover.
    fn cost(&self, area: &Area) -> f64 {
        let covered: f64 = self.taken.iter().map(|t| area.overlap(t)).sum();
        let crossed = self.crossed.iter().filter(|p| area.holds(**p)).count();
        // Any place that covers nothing is better than one that covers a corner.
        let touched = if covered > 0.0 { 40.0 } else { 0.0 };
        touched + covered + 6.0 * crossed as f64
    }

    /// The names, placed.
    pub(super) fn done(self) -> Vec<Text> {
        self.texts
    }
}

/// Areas around a place, the ones that read best first.
fn around((x, y): Position, (width, size): (f64, f64), gap: f64) -> Vec<Area> {
    let height = size * 1.1;
    let mut areas = Vec::new();
    for gap in [gap, 2.0 * gap, 3.5 * gap] {
        let (over, under) = (y - gap - height, y + gap);
        let (after, before) = (x + gap, x - gap - width);
        let near = 0.9 * gap;
        for (left, top) in [
            (after, y - 0.5 * height),
            (x + near, y - near - height),
            (x + near, y + near),
            (x - 0.5 * width, over),
            (x - 0.5 * width, under),
            (before, y - 0.5 * height),
            (x - near - width, y - near - height),
            (x - near - width, y + near),
        ] {
            areas.push(Area { left, top, right: left + width, bottom: top + height });
        }
    }
    areas
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(text: &str, near: Position, needed: bool) -> Label {
        Label { text: Text::new((0.0, 0.0), 12.0, [0; 3], text), near: vec![near], gap: 6.0, needed }
    }

    #[test]
    fn names_do_not_cover_each_other_or_markers() {
        let mut labels = Labels::within((0.0, 0.0), (400.0, 300.0));
        let places = [(200.0, 150.0), (210.0, 152.0), (205.0, 160.0), (395.0, 5.0), (3.0, 298.0)];
        for place in places {
            labels.keep_clear(place, 4.0);
        }
        for place in places {
            labels.put(label("0.125", place, true));
        }
        let (markers, names) = labels.taken.split_at(places.len());
        assert_eq!(names.len(), places.len());
        for (i, a) in names.iter().enumerate() {
            assert!(a.within(&labels.frame));
            assert!(names[..i].iter().chain(markers).all(|b| a.overlap(b) == 0.0), "{i}: {names:?}");
        }
    }

    #[test]
    fn a_number_without_room_is_left_out_and_a_name_is_not() {
        let mut labels = Labels::within((0.0, 0.0), (100.0, 60.0));
        labels.block((0.0, 0.0), (100.0, 60.0));
        labels.put(label("12", (50.0, 30.0), false));
        assert!(labels.texts.is_empty());
        labels.put(label("final", (50.0, 30.0), true));
        assert_eq!(labels.done().len(), 1);
    }
}
