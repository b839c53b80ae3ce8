//! Drawings as pixels.

use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Transform};

use super::drawing::{Anchor, Colour, Drawing, Position, Shape, Stroke, Text};
use super::font::Font;

/// The drawing at `scale` pixels a unit, as sRGB codes; `None` where there is no memory for it.
pub(super) fn render(drawing: &Drawing, scale: u32) -> Option<(u32, u32, Vec<[u8; 3]>)> {
    let mut canvas =
        Canvas { pixmap: Pixmap::new(drawing.width * scale, drawing.height * scale)?, scale: scale as f32 };
    canvas.pixmap.fill(tiny_skia::Color::WHITE);
    for shape in &drawing.shapes {
        match shape {
            Shape::Polygon { points, fill, stroke } => canvas.draw(path(points, true), *fill, *stroke),
            Shape::Line { points, stroke } => canvas.draw(path(points, false), None, Some(*stroke)),
            Shape::Circle { at, radius, fill, stroke } => {
                canvas.draw(PathBuilder::from_circle(at.0 as f32, at.1 as f32, *radius as f32), *fill, *stroke);
            }
            Shape::Text(text) => canvas.text(text),
        }
    }
    let pixels = canvas.pixmap.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]).collect();
    Some((canvas.pixmap.width(), canvas.pixmap.height(), pixels))
}

fn path(points: &[Position], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (i, &(x, y)) in points.iter().enumerate() {
        let (x, y) = (x as f32, y as f32);
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

struct Canvas {
    pixmap: Pixmap,
    scale: f32,
}

impl Canvas {
    /// Fills, then strokes. A path that is none (a line of one point) leaves no trace.
    fn draw(&mut self, path: Option<Path>, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.draw_at(path, fill, stroke, Transform::identity());
    }

    fn draw_at(&mut self, path: Option<Path>, fill: Option<Colour>, stroke: Option<Stroke>, at: Transform) {
        let Some(path) = path else { return };
        let transform = at.post_scale(self.scale, self.scale);
        if let Some(colour) = fill {
            self.pixmap.fill_path(&path, &paint(colour), FillRule::Winding, transform, None);
        }
        if let Some(s) = stroke {
            let stroke = tiny_skia::Stroke {
                width: s.width as f32,
                line_cap: if s.dashed { LineCap::Butt } else { LineCap::Round },
                line_join: LineJoin::Round,
                dash: s.dashed.then(|| tiny_skia::StrokeDash::new(vec![5.0, 4.0], 0.0)).flatten(),
                ..tiny_skia::Stroke::default()
            };
            self.pixmap.stroke_path(&path, &paint(s.colour), &stroke, transform, None);
        }
    }

    fn text(&mut self, t: &Text) {
        let font = Font::get(t.medium);
        let mut builder = PathBuilder::new();
        font.outline(&t.text, t.size, &mut builder);
        let back = match t.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        } * font.width(&t.text, t.size);
        let at = Transform::from_translate(-back as f32, 0.0)
            .post_rotate(if t.upward { -90.0 } else { 0.0 })
            .post_translate(t.at.0 as f32, t.at.1 as f32);
        let outline = builder.finish();
        if t.seam {
            self.draw_at(outline.clone(), None, Some(Stroke::solid([255; 3], 4.0)), at);
        }
        self.draw_at(outline, Some(t.colour), None, at);
    }
}

fn paint([r, g, b]: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, 255);
    paint.anti_alias = true;
    paint
}
