//! The letters of plots: a subset of Roboto (Google, Apache-2.0), carried with the program so
//! that no machine needs fonts of its own.

use std::sync::OnceLock;

use skrifa::instance::{LocationRef, Size};
use skrifa::outline::{DrawSettings, OutlinePen};
use skrifa::{FontRef, GlyphId, MetadataProvider};

static REGULAR: &[u8] = include_bytes!("../../../fonts/Roboto-Regular.ttf");
static MEDIUM: &[u8] = include_bytes!("../../../fonts/Roboto-Medium.ttf");

/// A face of the family.
pub(super) struct Font(Option<FontRef<'static>>);

impl Font {
    /// The regular or the medium face.
    pub(super) fn get(medium: bool) -> &'static Self {
        static FACES: OnceLock<[Font; 2]> = OnceLock::new();
        let faces = FACES.get_or_init(|| [REGULAR, MEDIUM].map(|bytes| Font(FontRef::new(bytes).ok())));
        &faces[usize::from(medium)]
    }

    /// How wide `text` is where letters are `size` high.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        self.glyphs(text, size).map(|(.., advance)| advance).sum()
    }

    /// Every letter with its left end, from 0 on, and its advance. A letter that the face does not have is
    /// its empty box.
    fn glyphs(&self, text: &str, size: f64) -> impl Iterator<Item = (GlyphId, f64, f64)> {
        let face = self.0.as_ref().map(|f| (f.charmap(), f.glyph_metrics(Size::unscaled(), LocationRef::default())));
        let scale = size * self.per_unit();
        let mut x = 0.0;
        text.chars().filter_map(move |c| {
            let (letters, metrics) = face.as_ref()?;
            let glyph = letters.map(c).unwrap_or(GlyphId::NOTDEF);
            let advance = f64::from(metrics.advance_width(glyph)?) * scale;
            let at = x;
            x += advance;
            Some((glyph, at, advance))
        })
    }

    /// A unit of the face's, as a share of its letters' size.
    fn per_unit(&self) -> f64 {
        let metrics = self.0.as_ref().map(|f| f.metrics(Size::unscaled(), LocationRef::default()));
        metrics.map_or(0.0, |m| 1.0 / f64::from(m.units_per_em))
    }

    /// The outline of `text`, its base line's left end at the origin, y downward.
    pub(super) fn outline(&self, text: &str, size: f64, to: &mut tiny_skia::PathBuilder) {
        let Some(face) = &self.0 else { return };
        let (outlines, scale) = (face.outline_glyphs(), size * self.per_unit());
        for (glyph, x, _) in self.glyphs(text, size) {
            if let Some(outline) = outlines.get(glyph) {
                // A letter that is broken is left as far as it goes: the faces are the program's own.
                let _ = outline
                    .draw(DrawSettings::unhinted(Size::unscaled(), LocationRef::default()), &mut Pen { to, x, scale });
            }
        }
    }
}

/// Places a letter's outline.
struct Pen<'a> {
    to: &'a mut tiny_skia::PathBuilder,
    x: f64,
    scale: f64,
}

impl Pen<'_> {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        ((self.x + self.scale * f64::from(x)) as f32, (-self.scale * f64::from(y)) as f32)
    }
}

impl OutlinePen for Pen<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.to.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.to.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.to.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.place(x1, y1), self.place(x2, y2), self.place(x, y));
        self.to.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.to.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_faces_have_what_plots_say() {
        for medium in [false, true] {
            let face = Font::get(medium).0.as_ref().expect("the embedded font is one");
            for c in "RMSE 0123456789.,:;%/×–≤≥≈-+*()' äöüßéñ".chars() {
                assert!(face.charmap().map(c).is_some(), "'{c}'");
            }
        }
    }

    #[test]
    fn widths_add_up() {
        let font = Font::get(false);
        let (a, b, both) = (font.width("0.5", 10.0), font.width(" s", 10.0), font.width("0.5 s", 10.0));
        assert!(a > 0.0 && (a + b - both).abs() < 1e-9);
        assert!((font.width("0.5", 20.0) - 2.0 * a).abs() < 1e-9);
        // Figures are all as wide as each other.
        assert_eq!(font.width("111", 10.0), font.width("888", 10.0));
    }
}
