//! Text in pictures: its width, wrapping and shortening.

use svg::node::element::{Group, Text};

use crate::font::advance;

/// The height of a line relative to the size of its letters.
pub(crate) const LINE_HEIGHT: f32 = 1.3;

/// Removes control characters and the characters that XML 1.0 does not allow.
pub(crate) fn printable(text: &str) -> String {
    let is_allowed = |c: &char| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}');
    text.chars().filter(is_allowed).collect()
}

/// Creates a line of text with letters of `size` pixels. Its baseline begins at `[x, y]`.
pub(crate) fn text_line(text: &str, [x, y]: [f32; 2], size: f32, colour: &str) -> Text {
    Text::new(printable(text))
        .set("x", x)
        .set("y", y)
        .set("font-size", size)
        .set("fill", colour)
}

/// Creates lines of text below each other. The baseline of the first line begins at `[x, y]`.
pub(crate) fn text_block(lines: &[String], [x, y]: [f32; 2], size: f32, colour: &str) -> Group {
    let lines = lines.iter().enumerate();
    lines.fold(Group::new(), |group, (index, text)| {
        let y = y + index as f32 * size * LINE_HEIGHT;
        group.add(text_line(text, [x, y], size, colour))
    })
}

/// Breaks a text between words into at most `max_lines` lines of at most `max_width` pixels. Text that does not fit is cut
/// off and replaced by `…`.
pub(crate) fn wrap(text: &str, size: f32, max_width: f32, max_lines: usize) -> Vec<String> {
    // Line breaks and tabs separate words too.
    let words: Vec<String> = text.split_whitespace().map(printable).collect();
    let mut rest = words.join(" ");
    let mut lines = Vec::new();
    while !rest.is_empty() {
        if fits(&rest, size, max_width) {
            lines.push(rest);
            break;
        }
        if lines.len() + 1 == max_lines.max(1) {
            lines.push(shorten(&rest, size, max_width));
            break;
        }
        let end = longest_fit(&rest, size, max_width, "");
        // Break at the last space, or within a word that is too long for a line.
        let ends_at_word = rest[end..].starts_with(' ');
        let end = match rest[..end].rfind(' ') {
            Some(space) if !ends_at_word => space,
            _ => end,
        };
        let after = rest.split_off(end);
        lines.push(std::mem::replace(&mut rest, after.trim_start().to_owned()));
    }
    lines
}

/// Shortens a text to a width in pixels. If it is cut off, it ends in `…`.
pub(crate) fn shorten(text: &str, size: f32, max_width: f32) -> String {
    if fits(text, size, max_width) {
        return text.to_owned();
    }
    let mut end = longest_fit(text, size, max_width, "…");
    // Words are not cut, except a word that fills more than half of the line.
    let word = text[..end].rfind(' ').filter(|&space| space > end / 2);
    if let Some(space) = word.filter(|_| !text[end..].starts_with(' ')) {
        end = space;
    }
    format!("{}…", text[..end].trim_end_matches([' ', ',', ';']))
}

/// Returns whether a text is at most `max_width` pixels wide.
fn fits(text: &str, size: f32, max_width: f32) -> bool {
    bounded_prefix(text, size, max_width).len() == text.len() && text_width(text, size) <= max_width
}

/// Returns a prefix of a text that is certainly too long or the whole text, so that very long texts are not typeset as a
/// whole.
fn bounded_prefix(text: &str, size: f32, max_width: f32) -> &str {
    /// Every letter of the font is wider than the font size divided by this number.
    const SIZE_TO_NARROWEST: f32 = 8.0;
    let most = (SIZE_TO_NARROWEST * max_width.max(0.0) / size.max(f32::MIN_POSITIVE)) as usize;
    match text.char_indices().nth(most.max(1)) {
        Some((end, _)) => &text[..end],
        None => text,
    }
}

/// Returns the length in bytes of the longest prefix that fits together with `tail`. It has at least one character.
fn longest_fit(text: &str, size: f32, max_width: f32, tail: &str) -> usize {
    let ends: Vec<usize> = bounded_prefix(text, size, max_width)
        .char_indices()
        .map(|(at, c)| at + c.len_utf8())
        .collect();
    let fits = |&end: &usize| text_width(&format!("{}{tail}", &text[..end]), size) <= max_width;
    let count = ends.partition_point(fits);
    ends.get(count.max(1) - 1).copied().unwrap_or(0)
}

/// Computes the width of a line in pixels in the embedded font. This font is wide, so other fonts that browsers choose
/// seldom need more space. Kerning, which moves a few pairs of letters closer together, is left out.
pub(crate) fn text_width(text: &str, size: f32) -> f32 {
    text.chars().map(|letter| advance(letter) * size).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROMPT: &str = "a person walks forward slowly, looks around, then turns to the left and \
                          waves with the right hand while the other arm hangs down at the side";

    #[test]
    fn control_characters_are_left_out() {
        assert_eq!(
            printable("a \u{1}\u{b}person\njumps ü 😀"),
            "a personjumps ü 😀"
        );
    }

    #[test]
    fn widths_grow_with_letters_and_size() {
        assert_eq!(text_width("", 20.0), 0.0);
        let [i, m] = ["iiii", "mmmm"].map(|text| text_width(text, 20.0));
        assert!(0.0 < i && i < m && m < 4.0 * 20.0, "{i} {m}");
        assert!((text_width("mmmm", 40.0) - 2.0 * m).abs() < 0.5);
        assert!((text_width("人人", 20.0) - 40.0).abs() < 4.0);
        assert!(text_width("a < b & c", 20.0) > text_width("a b c", 20.0));
    }

    #[test]
    fn long_texts_are_typeset_only_as_far_as_a_line_can_hold() {
        let text = "i l ".repeat(250_000);
        assert!(bounded_prefix(&text, 17.0, 500.0).len() < 1000);
        let lines = wrap(&text, 17.0, 500.0, 3);
        assert_eq!(lines.len(), 3);
        assert!(lines[2].ends_with('…') && text_width(&lines[2], 17.0) <= 500.0);
        // The bound is larger than a line of the narrowest letters.
        let thin = "i".repeat(bounded_prefix(&"i".repeat(5000), 17.0, 500.0).len());
        assert!(text_width(&thin, 17.0) > 500.0);
    }

    #[test]
    fn lines_fit_and_hold_every_word() {
        let lines = wrap(PROMPT, 17.0, 500.0, 9);
        assert!(lines.len() >= 3);
        assert!(
            lines.iter().all(|line| text_width(line, 17.0) <= 500.0),
            "{lines:?}"
        );
        assert_eq!(lines.join(" "), PROMPT);
    }

    #[test]
    fn text_that_does_not_fit_is_marked() {
        let lines = wrap(PROMPT, 17.0, 500.0, 2);
        assert_eq!(lines.len(), 2);
        assert!(
            lines[1].ends_with('…') && text_width(&lines[1], 17.0) <= 500.0,
            "{lines:?}"
        );
        let kept = lines.join(" ");
        let (kept, _) = kept.split_once('…').unwrap();
        assert!(
            PROMPT[kept.len()..].starts_with([' ', ',']),
            "whole words: {lines:?}"
        );
        assert_eq!(
            wrap("a \n person\tjumps", 17.0, 500.0, 2),
            ["a person jumps"]
        );
        assert!(wrap(" ", 17.0, 500.0, 2).is_empty());
    }

    #[test]
    fn very_long_words_are_broken_anywhere() {
        for word in ["ü".repeat(200), "人".repeat(200)] {
            let lines = wrap(&word, 17.0, 300.0, 3);
            assert_eq!(lines.len(), 3);
            assert!(
                lines.iter().all(|line| text_width(line, 17.0) <= 300.0),
                "{lines:?}"
            );
        }
        // Even without any space, every line has one character, and the function returns.
        assert_eq!(wrap("jump", 17.0, 0.0, 9), ["j", "u", "m", "p"]);
    }
}
