//! The letters of plots: a subset of Roboto (Google, Apache-2.0), carried with the program so
//! that no machine needs fonts of its own.

use std::sync::OnceLock;

use ttf_parser::{Face, GlyphId, OutlineBuilder};

static REGULAR: &[u8] = include_bytes!("../../../fonts/Roboto-Regular.ttf");
static MEDIUM: &[u8] = include_bytes!("../../../fonts/Roboto-Medium.ttf");

/// A face of the family.
pub(super) struct Font(Option<Face<'static>>);

impl Font {
    /// The regular or the medium face.
    pub(super) fn get(medium: bool) -> &'static Self {
        static FACES: OnceLock<[Font; 2]> = OnceLock::new();
        let faces = FACES.get_or_init(|| [REGULAR, MEDIUM].map(|bytes| Font(Face::parse(bytes, 0).ok())));
        &faces[usize::from(medium)]
    }

    /// How wide `text` is where letters are `size` high.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        self.glyphs(text, size).map(|(.., advance)| advance).sum()
    }

    /// Every letter with its left end, from 0 on, and its advance. A letter that the face does not have is
    /// its empty box.
    fn glyphs(&self, text: &str, size: f64) -> impl Iterator<Item = (GlyphId, f64, f64)> {
        let mut x = 0.0;
        text.chars().filter_map(move |c| {
            let face = self.0.as_ref()?;
            let glyph = face.glyph_index(c).unwrap_or(GlyphId(0));
            let advance = f64::from(face.glyph_hor_advance(glyph)?) * size / f64::from(face.units_per_em());
            let at = x;
            x += advance;
            Some((glyph, at, advance))
        })
    }

    /// The outline of `text`, its base line's left end at the origin, y downward.
    pub(super) fn outline(&self, text: &str, size: f64, to: &mut tiny_skia::PathBuilder) {
        let Some(face) = &self.0 else { return };
        let scale = size / f64::from(face.units_per_em());
        for (glyph, x, _) in self.glyphs(text, size) {
            face.outline_glyph(glyph, &mut Pen { to, x, scale });
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

impl OutlineBuilder for Pen<'_> {
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
                assert!(face.glyph_index(c).is_some(), "'{c}'");
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
