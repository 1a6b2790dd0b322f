//! Text into HTML.

use crate::text::printable;

/// Text as HTML shows it, in an element or in a quoted attribute.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in printable(text).chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

/// JSON that can stand in a `script` element: whatever could end the element or open a comment in it is
/// only in strings, where an escape means the same.
pub(super) fn in_script(json: &str) -> String {
    let mut escaped = String::with_capacity(json.len());
    for letter in json.chars() {
        match letter {
            '<' | '>' | '&' | '\u{2028}' | '\u{2029}' => {
                escaped.push_str(&format!("\\u{:04x}", u32::from(letter)));
            }
            other => escaped.push(other),
        }
    }
    escaped
}

/// The document with its `{{name}}`s replaced. What is put in is not looked at again.
///
/// # Panics
///
/// If the document has a hole that nothing is named for.
pub(super) fn fill(document: &str, holes: &[(&str, &str)]) -> String {
    let mut pieces = document.split("{{");
    let mut filled = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, rest) = piece.split_once("}}").expect("a hole ends");
        let hole = holes.iter().find(|(hole, _)| *hole == name);
        let (_, text) = hole.unwrap_or_else(|| panic!("nothing fills {name}"));
        filled.push_str(text);
        filled.push_str(rest);
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_text() {
        assert_eq!(
            escape("<a href=\"x\">'&\u{7}ü"),
            "&lt;a href=&quot;x&quot;&gt;&#39;&amp;ü"
        );
    }

    #[test]
    fn json_in_a_script_is_the_same_json() {
        let value = serde_json::json!({ "label": "</script><!--&\u{2028}\"" });
        let escaped = in_script(&value.to_string());
        assert!(!escaped.contains(['<', '>', '&', '\u{2028}']));
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&escaped).unwrap(),
            value
        );
    }

    #[test]
    fn what_fills_a_hole_has_no_holes() {
        assert_eq!(
            fill("<{{a}}|{{b}}|{{a}}>", &[("a", "{{b}}"), ("b", "2")]),
            "<{{b}}|2|{{b}}>"
        );
    }
}
