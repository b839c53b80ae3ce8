//! Drawings as SVG.

use std::fmt::Write;

use super::drawing::{Anchor, Colour, Drawing, Position, Shape, Stroke, Text};

/// The families tried, the embedded one's first: the texts fit with any of them.
const FAMILIES: &str = "Roboto, 'Helvetica Neue', Arial, sans-serif";

/// The document.
pub(super) fn write(drawing: &Drawing) -> String {
    let (w, h) = (drawing.width, drawing.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" role=\"img\" \
         font-family=\"{FAMILIES}\">\n<title>{}</title>\n<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n",
        escape(&drawing.title)
    );
    for s in &drawing.shapes {
        // Writing to a string does not fail.
        let _ = match s {
            Shape::Polygon { points, fill, stroke } => {
                writeln!(out, "<path d=\"{}Z\"{}{}/>", path(points), filled(*fill), stroked(*stroke))
            }
            Shape::Line { points, stroke } => writeln!(
                out,
                "<path d=\"{}\"{}{} stroke-linejoin=\"round\" stroke-linecap=\"{}\"/>",
                path(points),
                filled(None),
                stroked(Some(*stroke)),
                if stroke.dashed { "butt" } else { "round" }
            ),
            Shape::Circle { at, radius, fill, stroke } => writeln!(
                out,
                "<circle cx=\"{}\" cy=\"{}\" r=\"{}\"{}{}/>",
                number(at.0),
                number(at.1),
                number(*radius),
                filled(*fill),
                stroked(*stroke)
            ),
            Shape::Text(t) => text(&mut out, t),
        };
    }
    out.push_str("</svg>\n");
    out
}

fn text(out: &mut String, t: &Text) -> std::fmt::Result {
    let (x, y) = (number(t.at.0), number(t.at.1));
    write!(out, "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\"{}", number(t.size), filled(Some(t.colour)))?;
    if t.medium {
        out.push_str(" font-weight=\"500\"");
    }
    match t.anchor {
        Anchor::Start => {}
        Anchor::Middle => out.push_str(" text-anchor=\"middle\""),
        Anchor::End => out.push_str(" text-anchor=\"end\""),
    }
    if t.upward {
        write!(out, " transform=\"rotate(-90 {x} {y})\"")?;
    }
    if t.seam {
        out.push_str(" stroke=\"#ffffff\" stroke-width=\"4\" stroke-linejoin=\"round\" paint-order=\"stroke\"");
    }
    writeln!(out, ">{}</text>", escape(&t.text))
}

fn path(points: &[Position]) -> String {
    let mut d = String::new();
    for (i, (x, y)) in points.iter().enumerate() {
        let _ = write!(d, "{}{} {}", if i == 0 { "M" } else { "L" }, number(*x), number(*y));
    }
    d
}

/// At most two decimals, none that are 0.
fn number(x: f64) -> String {
    let text = format!("{x:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn filled(colour: Option<Colour>) -> String {
    colour.map_or_else(|| " fill=\"none\"".into(), |c| format!(" fill=\"{}\"", hex(c)))
}

fn stroked(stroke: Option<Stroke>) -> String {
    stroke.map_or_else(String::new, |s| {
        let dashes = if s.dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        format!(" stroke=\"{}\" stroke-width=\"{}\"{dashes}", hex(s.colour), number(s.width))
    })
}

/// As XML text; what XML cannot hold is replaced.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_name_is_well_formed() {
        let mut drawing = Drawing { width: 10, height: 10, title: "a<b & \"c\"".into(), shapes: Vec::new() };
        drawing.text(Text::new((1.0, 2.0), 9.0, [1, 2, 3], "]]> \u{1} \u{ffff}"));
        let text = write(&drawing);
        assert!(
            text.contains("<title>a&lt;b &amp; &quot;c&quot;</title>") && text.contains(">]]&gt; \u{fffd} \u{fffd}<")
        );
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 12.5, 7.1249, 100.0].map(number), ["0", "12.5", "7.12", "100"]);
    }
}
