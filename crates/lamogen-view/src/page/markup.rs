//! HTML and JSON escaping, and the template of the page.

use crate::text::printable;

/// Escapes text for an HTML element or for a quoted attribute.
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

/// Escapes JSON for a `script` element. The characters that could end the element or start a comment occur only in
/// strings, in which the escapes have the same meaning.
pub(super) fn escape_json(json: &str) -> String {
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

/// Returns a script without indentation and without comments that have lines of their own. The scripts of the page have no
/// texts of several lines.
pub(super) fn without_comments(script: &str) -> String {
    let mut shorter = String::with_capacity(script.len());
    let mut is_comment = false;
    for line in script.lines().map(str::trim_start) {
        is_comment |= line.starts_with("/*");
        if !is_comment && !line.is_empty() && !line.starts_with("//") {
            shorter.push_str(line);
            shorter.push('\n');
        }
        is_comment &= !line.ends_with("*/");
    }
    shorter
}

/// Replaces the placeholders `{{name}}` of a template. Placeholders in inserted texts are not replaced.
///
/// # Panics
///
/// If the template has a placeholder for which there is no text.
pub(super) fn fill_template(template: &str, texts: &[(&str, &str)]) -> String {
    let mut pieces = template.split("{{");
    let mut filled = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, rest) = piece.split_once("}}").expect("a placeholder ends");
        let entry = texts.iter().find(|(key, _)| *key == name);
        let (_, text) = entry.unwrap_or_else(|| panic!("there is no text for {name}"));
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
        let escaped = escape_json(&value.to_string());
        assert!(!escaped.contains(['<', '>', '&', '\u{2028}']));
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&escaped).unwrap(),
            value
        );
    }

    #[test]
    fn comments_are_left_out_of_scripts_and_code_is_not() {
        let script = "// a\n/** b */\nclass A {\n  /**\n   * c\n   */\n  d() { return 6 /* e */ / 2; } // f\n\n}\n";
        assert_eq!(
            without_comments(script),
            "class A {\nd() { return 6 /* e */ / 2; } // f\n}\n"
        );
    }

    #[test]
    fn placeholders_in_inserted_texts_stay() {
        assert_eq!(
            fill_template("<{{a}}|{{b}}|{{a}}>", &[("a", "{{b}}"), ("b", "2")]),
            "<{{b}}|2|{{b}}>"
        );
    }
}
