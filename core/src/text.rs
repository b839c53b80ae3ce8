//! Text from elsewhere, made fit to be shown on a terminal.

/// Whether `c` could do anything else to a line of text than stand in it: move the cursor, colour, hide or
/// reorder what is around it, or break the line.
#[must_use]
pub fn disturbs(c: char) -> bool {
    c.is_control()
        || matches!(c,
            // Soft hyphen, marks of direction, zero width, line and paragraph separators, embeddings, isolates,
            // invisible operators, the byte order mark, annotations, tags.
            '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

/// `text` with a replacement character for everything that [`disturbs`]; line feeds stay where `lines` says so.
#[must_use]
pub fn printable(text: &str, lines: bool) -> String {
    text.chars().map(|c| if disturbs(c) && !(lines && c == '\n') { '\u{fffd}' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_disturbs_is_left_and_all_else_is() {
        let hostile = "a\u{1b}[2Jb\r\u{9b}31m\u{202e}c\u{2028}\u{200d}\u{7f}\u{0}";
        assert!(!printable(hostile, false).chars().any(disturbs));
        for plain in ["bert", "Größe", "日本語", "наук", "émoji 🎉", "a  b"] {
            assert_eq!(printable(plain, false), plain);
        }
        assert_eq!(printable("a\nb", true), "a\nb");
    }
}
