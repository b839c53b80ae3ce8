//! The curve: error against seconds, both logarithmic, a line a method.

mod axis;
mod drawing;
mod font;
mod labels;
mod raster;
mod svg;

use axis::Axis;
use drawing::{Anchor, Colour, Drawing, Position, Stroke, Text};
use labels::{Label, Labels};

use super::knob::Method;
use super::point::{Measured, Point};
use super::table::{rough, told};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 620;
/// The plot's own area.
const LEFT: f64 = 64.0;
const RIGHT: f64 = 936.0;
const TOP: f64 = 106.0;
const BOTTOM: f64 = 552.0;

const INK: Colour = [0x22, 0x26, 0x2b];
const QUIET: Colour = [0x63, 0x6b, 0x74];
const GRID: Colour = [0xec, 0xee, 0xf0];
const GRID_DECADE: Colour = [0xd5, 0xd9, 0xdd];
const SHADE: Colour = [0xf4, 0xf5, 0xf6];

/// Colours that are told apart by all eyes (after Okabe and Ito), dark enough for letters.
fn colour(method: Method) -> Colour {
    match method {
        Method::MaxError | Method::Quality => [0x00, 0x62, 0x9c],
        Method::Samples => [0xc8, 0x55, 0x00],
        Method::Scrambled => [0x8a, 0x6d, 0x00],
        Method::MaxDepth => [0x00, 0x80, 0x5d],
        Method::PovRay => [0x9c, 0x4f, 0x82],
    }
}

/// What a method's line is called.
fn title(method: Method) -> &'static str {
    match method {
        Method::MaxError => "--max-error",
        Method::Quality => "--quality",
        Method::Samples => "--samples",
        Method::Scrambled => "scrambled",
        Method::MaxDepth => "--max-depth",
        Method::PovRay => "POV-Ray",
    }
}

/// What a point is called.
fn name(point: &Point) -> String {
    match (point.method, point.value.as_str()) {
        (Method::PovRay, "-A") => "no anti-aliasing".into(),
        (Method::PovRay, "+A0.3 +AM1 +R3") => "default".into(),
        _ => point.value.clone(),
    }
}

/// A drawing of what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot(Drawing);

impl Plot {
    /// The plot; `None` where there is no point to show.
    #[must_use]
    pub fn new(measured: &Measured) -> Option<Self> {
        if measured.points.is_empty() {
            return None;
        }
        let mut sheet = Sheet::new(measured);
        sheet.heading();
        sheet.axes();
        sheet.levels();
        sheet.lines();
        // Names first: the white around letters must not cut into a marker.
        sheet.names();
        sheet.markers();
        Some(Self(sheet.drawing))
    }

    /// As SVG.
    #[must_use]
    pub fn to_svg(&self) -> String {
        svg::write(&self.0)
    }

    /// As sRGB codes, `scale` times as large as the SVG says it is: width, height and rows from the
    /// top. `None` where there is no memory for it.
    #[must_use]
    pub fn to_pixels(&self, scale: u32) -> Option<(u32, u32, Vec<[u8; 3]>)> {
        raster::render(&self.0, scale)
    }
}

/// A plot being drawn.
struct Sheet<'a> {
    measured: &'a Measured,
    drawing: Drawing,
    x: Axis,
    y: Axis,
    /// The reference's own error, where it is near enough to be shown.
    own_error: Option<f64>,
}

impl<'a> Sheet<'a> {
    fn new(measured: &'a Measured) -> Self {
        let view = &measured.settings.view;
        let title = format!("{}, {}×{}: what accuracy costs", measured.scene, view.width(), view.height());
        let drawing = Drawing { width: WIDTH, height: HEIGHT, title, shapes: Vec::new() };
        let errors = || measured.points.iter().map(|p| p.metrics.rmse_steps()).filter(|e| *e > 0.0);
        let least = errors().fold(f64::INFINITY, f64::min);
        let own_error =
            measured.reference.as_ref().and_then(|r| r.own_error).map(|e| 255.0 * e).filter(|e| *e > least / 5.0);
        let x = Axis::around(measured.points.iter().map(|p| p.trace.as_secs_f64()), 1.35);
        let y = Axis::around(errors().chain([measured.target]).chain(own_error), 1.35);
        Self { measured, drawing, x, y, own_error }
    }

    fn right(&self, seconds: f64) -> f64 {
        LEFT + self.x.place(seconds) * (RIGHT - LEFT)
    }

    fn down(&self, error: f64) -> f64 {
        BOTTOM - self.y.place(error) * (BOTTOM - TOP)
    }

    fn place(&self, p: &Point) -> Position {
        (self.right(p.trace.as_secs_f64()), self.down(p.metrics.rmse_steps()))
    }

    fn heading(&mut self) {
        let m = self.measured;
        let title = Text::new((24.0, 40.0), 21.0, INK, self.drawing.title.clone()).medium();
        self.drawing.text(title);
        let s = |n: usize| if n == 1 { "" } else { "s" };
        let (w, t) = (m.workers, m.threads);
        let against = m.reference.as_ref().map(told).unwrap_or_default();
        for (y, line) in [
            (62.0, format!("Against {against}")),
            (80.0, format!("{w} worker{}, {t} thread{}, at most {} rays a path", s(w), s(t), m.settings.max_depth)),
        ] {
            self.drawing.text(Text::new((24.0, y), 13.0, QUIET, line));
        }
    }

    fn axes(&mut self) {
        let (right, down) = (self.x.ticks(14), self.y.ticks(12));
        let line = |decade: bool| Stroke::solid(if decade { GRID_DECADE } else { GRID }, 1.0);
        for tick in &right {
            let x = self.right(tick.value);
            self.drawing.line(vec![(x, TOP), (x, BOTTOM)], line(tick.decade));
            let label = Text::new((x, BOTTOM + 20.0), 13.0, INK, tick.label.clone());
            self.drawing.text(label.anchored(Anchor::Middle));
        }
        for tick in &down {
            let y = self.down(tick.value);
            self.drawing.line(vec![(LEFT, y), (RIGHT, y)], line(tick.decade));
            let label = Text::new((LEFT - 10.0, y + 4.5), 13.0, INK, tick.label.clone());
            self.drawing.text(label.anchored(Anchor::End));
        }
        let middle = 0.5 * (TOP + BOTTOM);
        let upward = Text::new((22.0, middle), 13.0, QUIET, "RMSE, 8-bit steps");
        self.drawing.text(upward.upward().anchored(Anchor::Middle));
        let seconds = Text::new((RIGHT, BOTTOM + 46.0), 13.0, QUIET, "trace time, seconds");
        self.drawing.text(seconds.anchored(Anchor::End));
        let legend = "Filled: on the Pareto front, nothing measured is both quicker and closer. Hollow: beaten.";
        self.drawing.text(Text::new((LEFT, BOTTOM + 46.0), 12.0, QUIET, legend));
    }

    /// The error asked for, and the one below which the reference cannot tell.
    fn levels(&mut self) {
        if let Some(own) = self.own_error {
            let y = self.down(own);
            let corners = vec![(LEFT, y), (RIGHT, y), (RIGHT, BOTTOM), (LEFT, BOTTOM)];
            self.drawing.polygon(corners, Some(SHADE), None);
            // Where the band is too low for words, the heading has said it.
            if BOTTOM - y >= 22.0 {
                let text = format!("the reference's own error: {}", rough(own));
                self.drawing.text(Text::new((LEFT + 8.0, y + 16.0), 12.0, QUIET, text));
            }
        }
        let y = self.down(self.measured.target);
        let dashes = Stroke { colour: QUIET, width: 1.2, dashed: true };
        self.drawing.line(vec![(LEFT, y), (RIGHT, y)], dashes);
        let text = Text::new((LEFT + 8.0, y - 6.0), 12.0, QUIET, format!("target {}", self.measured.target));
        self.drawing.text(text.on_seam());
    }

    fn of(&self, method: Method) -> Vec<&'a Point> {
        self.measured.points.iter().filter(|p| p.method == method).collect()
    }

    /// The line of a method; named qualities are points of that of errors.
    fn path(&self, method: Method) -> Vec<Position> {
        let mut points = match method {
            Method::Quality => return Vec::new(),
            Method::MaxError => [self.of(Method::MaxError), self.of(Method::Quality)].concat(),
            _ => self.of(method),
        };
        points.sort_by_key(|p| p.trace);
        points.into_iter().map(|p| self.place(p)).collect()
    }

    fn lines(&mut self) {
        for method in Method::ALL {
            let path = self.path(method);
            if path.len() > 1 {
                self.drawing.line(path, Stroke::solid(colour(method), 2.0));
            }
        }
    }

    fn markers(&mut self) {
        if let Some(p) = self.measured.recommended() {
            self.drawing.circle(self.place(p), 11.0, Some([255; 3]), Some(Stroke::solid(INK, 1.8)));
        }
        for method in Method::ALL.into_iter().rev() {
            for p in self.of(method) {
                let (at, colour) = (self.place(p), colour(method));
                let fill = Some(if p.front { colour } else { [255; 3] });
                let stroke = Some(Stroke::solid(colour, 1.8));
                match outline(method, at) {
                    Some(points) => self.drawing.polygon(points, fill, stroke),
                    None => self.drawing.circle(at, 4.2, fill, stroke),
                }
            }
        }
    }

    fn names(&mut self) {
        let mut labels = Labels::within((LEFT, TOP), (RIGHT, BOTTOM));
        for p in &self.measured.points {
            labels.keep_clear(self.place(p), if self.measured.recommended() == Some(p) { 11.0 } else { 6.0 });
        }
        for method in Method::ALL {
            labels.avoid(&self.path(method));
        }
        let level = self.down(self.measured.target);
        labels.avoid(&[(LEFT, level), (RIGHT, level)]);
        labels.block((LEFT, level - 20.0), (LEFT + 80.0, level));

        if let Some(p) = self.measured.recommended() {
            let text = Text::new((0.0, 0.0), 14.0, INK, format!("recommended: {}", p.flags.join(" "))).medium();
            labels.put(Label { text, near: vec![self.place(p)], gap: 15.0, needed: true });
        }
        for method in Method::ALL {
            let path = self.path(method);
            let (Some(&first), Some(&last)) = (path.first(), path.last()) else { continue };
            let text = Text::new((0.0, 0.0), 14.0, colour(method), title(method)).medium();
            labels.put(Label { text, near: vec![last, first], gap: 10.0, needed: true });
        }
        // Names first, for they say more than numbers do.
        let order =
            [Method::Quality, Method::MaxError, Method::Samples, Method::PovRay, Method::Scrambled, Method::MaxDepth];
        for p in order.into_iter().flat_map(|method| self.of(method)) {
            if self.measured.recommended() == Some(p) {
                continue;
            }
            let named = p.method == Method::Quality;
            let text = Text::new((0.0, 0.0), if named { 13.0 } else { 12.0 }, colour(p.method), name(p));
            let text = if named { text.medium() } else { text };
            labels.put(Label { text, near: vec![self.place(p)], gap: if named { 9.0 } else { 7.0 }, needed: named });
        }
        for text in labels.done() {
            self.drawing.text(text.on_seam());
        }
    }
}

/// The marker of a method around a place; `None` is a circle.
fn outline(method: Method, (x, y): Position) -> Option<Vec<Position>> {
    let at = |d: &[(f64, f64)]| Some(d.iter().map(|(dx, dy)| (x + dx, y + dy)).collect());
    match method {
        Method::MaxError => None,
        Method::Quality => at(&[(0.0, -6.6), (6.6, 0.0), (0.0, 6.6), (-6.6, 0.0)]),
        Method::Samples => at(&[(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)]),
        Method::Scrambled => at(&[(-5.0, 0.0), (0.0, -3.4), (5.0, 0.0), (0.0, 3.4)]),
        Method::MaxDepth => at(&[(0.0, -5.4), (5.0, 3.6), (-5.0, 3.6)]),
        Method::PovRay => at(&[(0.0, 5.4), (5.0, -3.6), (-5.0, -3.6)]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::table::tests::measured;

    #[test]
    fn the_plot_names_scene_methods_qualities_target_and_advice() {
        let svg = Plot::new(&measured()).expect("there are points").to_svg();
        for words in [
            "demo, 4×3",
            "--samples",
            "--max-error",
            "POV-Ray",
            ">final<",
            "target 0.5",
            "recommended: --max-error 0.5",
        ] {
            assert!(svg.contains(words), "'{words}' is missing");
        }
    }

    #[test]
    fn the_front_is_filled_and_the_rest_is_hollow() {
        let measured = measured();
        let sheet = Sheet::new(&measured);
        let Plot(drawing) = Plot::new(&measured).expect("there are points");
        for p in measured.points.iter().filter(|p| p.method == Method::Samples) {
            let corners = outline(p.method, sheet.place(p)).expect("a square");
            let fills: Vec<Option<Colour>> = drawing
                .shapes
                .iter()
                .filter_map(|s| match s {
                    drawing::Shape::Polygon { points, fill, .. } if *points == corners => Some(*fill),
                    _ => None,
                })
                .collect();
            assert_eq!(fills, [Some(if p.front { colour(p.method) } else { [255; 3] })], "{}", p.value);
        }
    }

    #[test]
    fn pixels_show_the_same_at_any_scale() {
        let plot = Plot::new(&measured()).expect("there are points");
        let ink = |scale: u32| {
            let (w, h, pixels) = plot.to_pixels(scale).expect("memory");
            assert_eq!((w, h), (WIDTH * scale, HEIGHT * scale));
            pixels.iter().map(|p| 1.0 - f64::from(p[1]) / 255.0).sum::<f64>() / pixels.len() as f64
        };
        let (once, twice) = (ink(1), ink(2));
        // Letters, lines and markers are there, and on white.
        assert!(once > 0.005 && once < 0.2 && (once / twice - 1.0).abs() < 0.1, "{once} {twice}");
    }

    #[test]
    fn pictures_without_error_or_points_are_no_trouble() {
        let mut measured = measured();
        for p in &mut measured.points {
            p.metrics.rmse = 0.0;
        }
        assert!(!Plot::new(&measured).expect("there are points").to_svg().contains("NaN"));
        measured.points.clear();
        assert_eq!(Plot::new(&measured), None);
    }
}
