//! The terms under which motions may be used, in the pictures of them.

use lamogen_motion::Motion;
use svg::Node;
use svg::node::Text;
use svg::node::element::Element;

use crate::text::printable;

/// The element of an SVG document that holds the terms.
const ELEMENT: &str = "metadata";

/// Returns the terms of motions, each once, one after the other; `None` if no motion has any.
pub(crate) fn copyright_of<'m>(motions: impl Iterator<Item = &'m Motion>) -> Option<String> {
    let mut all: Vec<&str> = Vec::new();
    for copyright in motions.filter_map(Motion::copyright) {
        if !all.contains(&copyright) {
            all.push(copyright);
        }
    }
    let lines = all.iter().flat_map(|copyright| copyright.lines());
    let lines: Vec<String> = lines.map(|line| printable(line).to_string()).collect();
    (!lines.is_empty()).then(|| lines.join("\n"))
}

/// Returns the element of an SVG document with the terms.
pub(crate) fn metadata(copyright: &str) -> Element {
    let mut element = Element::new(ELEMENT);
    element.append(Text::new(copyright));
    element
}

/// Returns the terms under which the motions of a picture may be used, which an SVG document of this crate holds.
pub fn copyright_in_svg(svg: &str) -> Option<String> {
    let (_, rest) = svg.split_once(&format!("<{ELEMENT}>"))?;
    let (text, _) = rest.split_once(&format!("</{ELEMENT}>"))?;
    let mut text = text.trim().to_owned();
    for (entity, letter) in [
        ("&lt;", "<"),
        ("&gt;", ">"),
        ("&quot;", "\""),
        ("&apos;", "'"),
        ("&#39;", "'"),
        ("&amp;", "&"),
    ] {
        text = text.replace(entity, letter);
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Animation, LabelledMotion, Page, PageFigure, page, sheet, strip};
    use lamogen_motion::JOINTS;

    const TERMS: &str = "Made with a model under <CC-BY-4.0> & others:\n\"a\", 'b'";

    fn motion(copyright: Option<&str>) -> Motion {
        let motion = Motion::from_joints(vec![[[0.0, 0.5, 0.0]; JOINTS]; 2]).unwrap();
        motion.with_copyright(copyright)
    }

    #[test]
    fn every_kind_of_picture_holds_the_terms_once_where_nobody_sees_them() {
        let (ours, free) = (motion(Some(TERMS)), motion(None));
        let row = |motion| LabelledMotion::new("walk", motion);
        let rows = [row(&ours), row(&free), row(&ours)];
        let pictures = [strip(&rows, 2), sheet("walk", &rows, 2, &[]).unwrap()];
        for svg in pictures {
            assert_eq!(svg.matches("<metadata>").count(), 1);
            assert_eq!(copyright_in_svg(&svg).as_deref(), Some(TERMS));
            let visible = svg.split("<metadata>").next().unwrap();
            assert!(!visible.contains("CC-BY"));
        }
        let animation = Animation::new(&rows, None).unwrap();
        assert_eq!(animation.copyright().as_deref(), Some(TERMS));
        let text = page(&Page {
            title: "walk",
            notes: "",
            figures: &[PageFigure::guided(&ours)],
            curves: &[],
            captions: &[],
        });
        let meta =
            "<meta name=\"copyright\" content=\"Made with a model under &lt;CC-BY-4.0&gt; &amp;";
        assert!(text.contains(meta), "{text}");

        // Without terms there is nothing.
        let svg = strip(&[row(&free)], 2);
        assert!(!svg.contains("metadata") && copyright_in_svg(&svg).is_none());
        let animation = Animation::new(&[row(&free)], None).unwrap();
        assert_eq!(animation.copyright(), None);
        let text = page(&Page {
            title: "walk",
            notes: "",
            figures: &[PageFigure::guided(&free)],
            curves: &[],
            captions: &[],
        });
        assert!(!text.contains("copyright\""));
    }
}
