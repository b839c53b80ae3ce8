//! A drawing of a few kinds of shapes, in pixels from the upper left corner: what the SVG and
//! the PNG of a plot both show.

/// Red, green, blue.
pub(super) type Colour = [u8; 3];

/// A point: right, down.
pub(super) type Position = (f64, f64);

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub(super) colour: Colour,
    pub(super) width: f64,
    pub(super) dashed: bool,
}

impl Stroke {
    pub(super) fn solid(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: false }
    }
}

/// Which end of a text is at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A line of text; its place is on its base line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    pub(super) at: Position,
    pub(super) text: String,
    pub(super) size: f64,
    pub(super) medium: bool,
    pub(super) colour: Colour,
    pub(super) anchor: Anchor,
    /// Reads upward rather than to the right.
    pub(super) upward: bool,
    /// On a white seam, for texts that lines may pass under.
    pub(super) seam: bool,
}

impl Text {
    pub(super) fn new(at: Position, size: f64, colour: Colour, text: impl Into<String>) -> Self {
        let text = text.into();
        Self { at, text, size, medium: false, colour, anchor: Anchor::Start, upward: false, seam: false }
    }

    pub(super) fn medium(self) -> Self {
        Self { medium: true, ..self }
    }

    pub(super) fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    pub(super) fn upward(self) -> Self {
        Self { upward: true, ..self }
    }

    pub(super) fn on_seam(self) -> Self {
        Self { seam: true, ..self }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// A closed outline; filled, stroked or both.
    Polygon {
        points: Vec<Position>,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    },
    /// An open line with round joins and ends.
    Line {
        points: Vec<Position>,
        stroke: Stroke,
    },
    Circle {
        at: Position,
        radius: f64,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    },
    Text(Text),
}

/// Shapes on white, later ones over earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Drawing {
    pub(super) width: u32,
    pub(super) height: u32,
    /// What it shows, in a few words, for those who cannot see it.
    pub(super) title: String,
    pub(super) shapes: Vec<Shape>,
}

impl Drawing {
    pub(super) fn polygon(&mut self, points: Vec<Position>, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.shapes.push(Shape::Polygon { points, fill, stroke });
    }

    pub(super) fn line(&mut self, points: Vec<Position>, stroke: Stroke) {
        self.shapes.push(Shape::Line { points, stroke });
    }

    pub(super) fn circle(&mut self, at: Position, radius: f64, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.shapes.push(Shape::Circle { at, radius, fill, stroke });
    }

    pub(super) fn text(&mut self, text: Text) {
        self.shapes.push(Shape::Text(text));
    }
}
