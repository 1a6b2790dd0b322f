//! HumanML3D's caption files: every line is `caption#tokens#start#end`.

use std::ops::Range;

use lamogen_motion::FRAMES_PER_SECOND;

use crate::entry::Caption;

/// A line of a caption file: a caption and the part of the motion that it describes.
#[derive(Debug, PartialEq)]
pub(crate) struct CaptionLine {
    pub caption: Caption,
    /// The frames that the caption describes; `None` for the whole motion.
    pub part: Option<Range<usize>>,
}

/// Parses the lines of a caption file. The error says which line is invalid and why.
pub(crate) fn parse(text: &str) -> Result<Vec<CaptionLine>, String> {
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, text)| parse_line(text).map_err(|why| format!("line {}: {why}", index + 1)))
        .collect()
}

fn parse_line(text: &str) -> Result<CaptionLine, String> {
    // Fields are split from the right, because a caption may contain a #.
    let mut fields = text.trim().rsplitn(4, '#');
    let (Some(end), Some(start), Some(tokens), Some(caption)) =
        (fields.next(), fields.next(), fields.next(), fields.next())
    else {
        return Err(format!("expected caption#tokens#start#end, found {text:?}"));
    };
    let caption = caption.trim();
    if caption.is_empty() {
        return Err(format!(
            "expected a caption before the first #, found {text:?}"
        ));
    }
    let tokens = tokens.trim();
    let (from, to) = (seconds(start)?, seconds(end)?);
    let frame = |seconds: f64| (seconds * f64::from(FRAMES_PER_SECOND)) as usize;
    Ok(CaptionLine {
        caption: Caption {
            text: caption.to_owned(),
            tokens: (!tokens.is_empty()).then(|| tokens.to_owned()),
        },
        part: match from == 0.0 && to == 0.0 {
            true => None,
            false => Some(frame(from)..frame(to).max(frame(from))),
        },
    })
}

/// Parses a time in seconds from the start; NaN counts as 0, as in public code for HumanML3D.
fn seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(seconds) if seconds.is_nan() => Ok(0.0),
        Ok(seconds) if (0.0..1e6).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected seconds from 0, or nan, found {text:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_caption_with_tokens_of_the_whole_or_a_part() {
        let text = "a man walks.#a/DET man/NOUN walk/VERB#0.0#0.0\n\n\
                    he sits # down#he/PRON#1.5#4.05\r\na person waves##nan#nan";
        let lines = parse(text).unwrap();
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0].caption.text, "a man walks.");
        let tokens = lines[0].caption.tokens.as_deref();
        assert_eq!(tokens, Some("a/DET man/NOUN walk/VERB"));
        assert_eq!(lines[0].part, None);
        assert_eq!(lines[1].caption.text, "he sits # down");
        assert_eq!(lines[1].part, Some(30..81));
        assert_eq!((&lines[2].caption.tokens, &lines[2].part), (&None, &None));
        assert_eq!(parse("a#b#3.0#1.0").unwrap()[0].part, Some(60..60));
    }

    #[test]
    fn an_invalid_line_is_named_by_its_number() {
        for (text, part) in [
            ("a man walks", "caption#tokens#start#end"),
            ("a man#a/DET#0.0", "caption#tokens#start#end"),
            ("#a/DET#0.0#0.0", "a caption"),
            ("a man#a/DET#zero#0.0", "zero"),
            ("a man#a/DET#0.0#-1", "-1"),
            ("a man#a/DET#0.0#inf", "inf"),
        ] {
            let message = parse(&format!("a#b#0#0\n{text}\n")).unwrap_err();
            assert!(
                message.contains("line 2") && message.contains(part),
                "{message}"
            );
        }
    }
}
