//! Lines of text that fit.

use resvg::usvg::{Node, Tree};
use svg::Document;
use svg::node::element::{Group, Text};

use crate::fonts::{Missing, options};

/// Height of a line of letters of size 1.
pub(crate) const LINE: f32 = 1.3;

/// Text without the characters that XML 1.0 has no place for.
pub(crate) fn printable(text: &str) -> String {
    let has_a_place = |c: &char| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}');
    text.chars().filter(has_a_place).collect()
}

/// One line of letters of `size` pixels, its baseline beginning at `[x, y]`.
pub(crate) fn line(text: &str, [x, y]: [f32; 2], size: f32, colour: &str) -> Text {
    Text::new(printable(text))
        .set("x", x)
        .set("y", y)
        .set("font-size", size)
        .set("fill", colour)
}

/// Lines below each other, the first one's baseline at `[x, y]`.
pub(crate) fn block(lines: &[String], [x, y]: [f32; 2], size: f32, colour: &str) -> Group {
    let lines = lines.iter().enumerate();
    lines.fold(Group::new(), |group, (index, text)| {
        let y = y + index as f32 * size * LINE;
        group.add(line(text, [x, y], size, colour))
    })
}

/// Breaks a text between words into at most `most` lines that are at most `room` pixels long; what
/// does not fit is cut off and marked with `…`.
pub(crate) fn wrapped(text: &str, size: f32, room: f32, most: usize) -> Vec<String> {
    // Line breaks and tabs part words too.
    let words: Vec<String> = text.split_whitespace().map(printable).collect();
    let mut rest = words.join(" ");
    let mut lines = Vec::new();
    while !rest.is_empty() {
        if fits(&rest, size, room) {
            lines.push(rest);
            break;
        }
        if lines.len() + 1 == most.max(1) {
            lines.push(shortened(&rest, size, room));
            break;
        }
        let end = fitting(&rest, size, room, "");
        // The line ends at the last space, or within a word that is too long for any line.
        let fits_to_a_word = rest[end..].starts_with(' ');
        let end = match rest[..end].rfind(' ') {
            Some(space) if !fits_to_a_word => space,
            _ => end,
        };
        let after = rest.split_off(end);
        lines.push(std::mem::replace(&mut rest, after.trim_start().to_owned()));
    }
    lines
}

/// As much of a text as fits, with `…` if that is not all.
pub(crate) fn shortened(text: &str, size: f32, room: f32) -> String {
    if fits(text, size, room) {
        return text.to_owned();
    }
    let mut end = fitting(text, size, room, "…");
    // A word is not cut, unless it is most of the line.
    let word = text[..end].rfind(' ').filter(|&space| space > end / 2);
    if let Some(space) = word.filter(|_| !text[end..].starts_with(' ')) {
        end = space;
    }
    format!("{}…", text[..end].trim_end_matches([' ', ',', ';']))
}

/// Whether a text fits on a line.
fn fits(text: &str, size: f32, room: f32) -> bool {
    beginning(text, size, room).len() == text.len() && width(text, size) <= room
}

/// As many characters of a text as a line can have at most, so that a long text is not set as a whole to find what fits.
fn beginning(text: &str, size: f32, room: f32) -> &str {
    /// The thinnest letters of the font are wider than one over this of its size.
    const THINNEST: f32 = 8.0;
    let most = (THINNEST * room.max(0.0) / size.max(f32::MIN_POSITIVE)) as usize;
    match text.char_indices().nth(most.max(1)) {
        Some((end, _)) => &text[..end],
        None => text,
    }
}

/// Where the longest beginning ends that fits together with `tail`; at least one character.
fn fitting(text: &str, size: f32, room: f32, tail: &str) -> usize {
    let ends: Vec<usize> = beginning(text, size, room)
        .char_indices()
        .map(|(at, c)| at + c.len_utf8())
        .collect();
    let fits = |&end: &usize| width(&format!("{}{tail}", &text[..end]), size) <= room;
    let fitting = ends.partition_point(fits);
    ends.get(fitting.max(1) - 1).copied().unwrap_or(0)
}

/// Width of a line in pixels, as the embedded font sets it. That is a wide font, so other fonts,
/// which browsers choose, seldom need more.
pub(crate) fn width(text: &str, size: f32) -> f32 {
    // The embedded font has no letters of East Asia, which are as wide as a dash is.
    let wide = |c: char| matches!(c, '\u{1100}'..'\u{1e00}' | '\u{2e80}'..);
    let text: String = text
        .chars()
        .map(|c| if wide(c) { '—' } else { c })
        .collect();
    let picture = Document::new().add(line(&text, [0.0, size], size, "black"));
    let tree = Tree::from_str(&picture.to_string(), &options(Missing::Boxes));
    let tree = tree.expect("a line of text is an SVG document");
    let widths = tree.root().children().iter().map(|node| match node {
        Node::Text(text) => text.bounding_box().width(),
        _ => 0.0,
    });
    widths.fold(0.0, f32::max)
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
        assert_eq!(width("", 20.0), 0.0);
        let [i, m] = ["iiii", "mmmm"].map(|text| width(text, 20.0));
        assert!(0.0 < i && i < m && m < 4.0 * 20.0, "{i} {m}");
        assert!((width("mmmm", 40.0) - 2.0 * m).abs() < 0.5);
        assert!((width("人人", 20.0) - 40.0).abs() < 4.0);
        assert!(width("a < b & c", 20.0) > width("a b c", 20.0));
    }

    #[test]
    fn long_texts_are_set_no_further_than_a_line_can_hold() {
        let text = "i l ".repeat(250_000);
        assert!(beginning(&text, 17.0, 500.0).len() < 1000);
        let lines = wrapped(&text, 17.0, 500.0, 3);
        assert_eq!(lines.len(), 3);
        assert!(lines[2].ends_with('…') && width(&lines[2], 17.0) <= 500.0);
        // The bound is none that a line of the thinnest letters reaches.
        let thin = "i".repeat(beginning(&"i".repeat(5000), 17.0, 500.0).len());
        assert!(width(&thin, 17.0) > 500.0);
    }

    #[test]
    fn lines_fit_and_hold_every_word() {
        let lines = wrapped(PROMPT, 17.0, 500.0, 9);
        assert!(lines.len() >= 3);
        assert!(
            lines.iter().all(|line| width(line, 17.0) <= 500.0),
            "{lines:?}"
        );
        assert_eq!(lines.join(" "), PROMPT);
    }

    #[test]
    fn what_does_not_fit_is_marked() {
        let lines = wrapped(PROMPT, 17.0, 500.0, 2);
        assert_eq!(lines.len(), 2);
        assert!(
            lines[1].ends_with('…') && width(&lines[1], 17.0) <= 500.0,
            "{lines:?}"
        );
        let kept = lines.join(" ");
        let (kept, _) = kept.split_once('…').unwrap();
        assert!(
            PROMPT[kept.len()..].starts_with([' ', ',']),
            "whole words: {lines:?}"
        );
        assert_eq!(
            wrapped("a \n person\tjumps", 17.0, 500.0, 2),
            ["a person jumps"]
        );
        assert!(wrapped(" ", 17.0, 500.0, 2).is_empty());
    }

    #[test]
    fn words_without_end_are_broken_anywhere() {
        for word in ["ü".repeat(200), "人".repeat(200)] {
            let lines = wrapped(&word, 17.0, 300.0, 3);
            assert_eq!(lines.len(), 3);
            assert!(
                lines.iter().all(|line| width(line, 17.0) <= 300.0),
                "{lines:?}"
            );
        }
        // No room at all still takes one character a line, and ends.
        assert_eq!(wrapped("jump", 17.0, 0.0, 9), ["j", "u", "m", "p"]);
    }
}
