//! A page that plays motions: one HTML file that contains everything it needs.
//!
//! ```text
//! page/page.html  the template of the document      page/motion.js   decoding and interpolation of motions
//! page/page.css   the style sheet                   page/camera.js   vectors, camera and projection
//! data.rs         motions and curves as JSON        page/body.js     the shapes of the body around its joints
//! markup.rs       HTML escaping, template filling   page/colour.js, page/scene.js  drawing on a 2D canvas
//! numbers.rs      the table of largest values       page/stage.js    the figures side by side or in one view
//!                                                   page/chart.js    the curves
//!                                                   page/captions.js what is said when
//!                                                   page/player.js, page/controls.js, page/main.js
//! ```

mod data;
mod markup;
mod numbers;

use lamogen_motion::{Motion, TimedCaption};

use crate::LabanCurve;
use crate::copyright::copyright_of;
use crate::text::printable;
use markup::{escape, fill_template, without_comments};

/// A motion of a [`Page`].
#[derive(Clone, Copy, Debug)]
pub struct PageFigure<'a> {
    /// The label of the motion.
    pub label: &'a str,
    /// The motion to play.
    pub motion: &'a Motion,
    /// The colour as red, green and blue.
    pub colour: [u8; 3],
}

impl<'a> PageFigure<'a> {
    /// Creates a grey figure, in the colour of [`LabanCurve::baseline`].
    pub fn baseline(motion: &'a Motion) -> Self {
        PageFigure {
            label: "baseline",
            motion,
            colour: [107, 114, 128],
        }
    }

    /// Creates a red figure, in the colour of [`LabanCurve::guided`].
    pub fn guided(motion: &'a Motion) -> Self {
        PageFigure {
            label: "guided",
            motion,
            colour: [194, 65, 12],
        }
    }
}

/// The content of a page.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// The heading, such as the sentence of the motions.
    pub title: &'a str,
    /// A line below the heading, such as the tags and the seed. It may be empty.
    pub notes: &'a str,
    /// The motions, side by side or in one view. One to four are easy to see. They may have different lengths: shorter
    /// ones stand still after their end.
    pub figures: &'a [PageFigure<'a>],
    /// The Laban curves beside the motions. If there are none, the page has no section for them.
    pub curves: &'a [LabanCurve<'a>],
    /// What is said beside the motions, and when, in the order of time. It may be empty.
    pub captions: &'a [TimedCaption],
}

/// The scripts of the player without its program, in this order.
pub(crate) const PLAYER_SCRIPTS: [&str; 10] = [
    include_str!("page/motion.js"),
    include_str!("page/camera.js"),
    include_str!("page/body.js"),
    include_str!("page/colour.js"),
    include_str!("page/scene.js"),
    include_str!("page/stage.js"),
    include_str!("page/chart.js"),
    include_str!("page/captions.js"),
    include_str!("page/player.js"),
    include_str!("page/controls.js"),
];

/// Creates a page as one HTML document, which plays its motions in 3D in every browser of recent years.
///
/// The page loads nothing, and its Content-Security-Policy does not allow it to load anything. It can be sent by mail and
/// opened from a disk. The same content always gives the same text.
///
/// The view can be turned, zoomed and moved with the mouse, fingers and keys. Time can be dragged, stepped, slowed down and
/// looped. The caption of the moment stands below the figures, and all of them along the bar of time. Positions of joints are embedded with an error of at most half a tenth of a millimetre, unless a joint is farther
/// than 3.2 m from the pelvis. A pair of motions of four seconds takes less than 100 kB.
///
/// `window.lamogen` gives tests access to the state of the player: `time`, `frame`, `playing`, `speed`, `loop`,
/// `overlay`, `follow`, `trails`, `camera`, `caption`, `motions[i].pose(seconds)` (`page/main.js`).
pub fn page(page: &Page<'_>) -> String {
    let labels: String = page
        .figures
        .iter()
        .map(|figure| format!("<li><bdi>{}</bdi></li>\n", escape(figure.label)))
        .collect();
    let notes = match printable(page.notes).trim() {
        "" => String::new(),
        notes => format!("<p dir=\"auto\">{}</p>\n", escape(notes)),
    };
    let copyright = copyright_of(page.figures.iter().map(|figure| figure.motion));
    let copyright = copyright.map_or(String::new(), |text| {
        format!("<meta name=\"copyright\" content=\"{}\">\n", escape(&text))
    });
    let script = format!(
        "(() => {{\n\"use strict\";\n{}{}}})();\n",
        without_comments(&PLAYER_SCRIPTS.concat()),
        without_comments(include_str!("page/main.js"))
    );
    fill_template(
        include_str!("page/page.html"),
        &[
            ("copyright", &copyright),
            ("version", env!("CARGO_PKG_VERSION")),
            ("title", &escape(page.title)),
            ("notes", &notes),
            ("style", include_str!("page/page.css")),
            ("figures", &labels),
            ("numbers", &numbers::table(page.curves)),
            (
                "data",
                &data::page_data(page.figures, page.curves, page.captions),
            ),
            ("script", &script),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Tensor;
    use lamogen_laban::LabanSeries;
    use lamogen_motion::JOINTS;

    /// Returns the motion of a figure that sways, with 80 frames.
    fn motion() -> Motion {
        let pose = |t: usize| {
            std::array::from_fn(|j| [(t as f32 * 0.1).sin(), j as f32 * 0.08, t as f32 * 0.02])
        };
        Motion::from_joints((0..80).map(pose).collect::<Vec<[[f32; 3]; JOINTS]>>()).unwrap()
    }

    fn example_page(title: &str, label: &str) -> String {
        let (motion, series) = (
            motion(),
            LabanSeries::from_tensor(Tensor::ones([80, 4], &Default::default())),
        );
        let guided = PageFigure::guided(&motion);
        page(&Page {
            title,
            notes: title,
            figures: &[
                PageFigure::baseline(&motion),
                PageFigure { label, ..guided },
            ],
            curves: &[
                LabanCurve::baseline(&series),
                LabanCurve::target(&series),
                LabanCurve {
                    label,
                    ..LabanCurve::guided(&series)
                },
            ],
            captions: &[],
        })
    }

    #[test]
    fn a_title_cannot_inject_markup() {
        let calm = example_page("a person jumps", "strong");
        let hostile = "</script><b onload=\"x\">'&amp;<!--{{data}}{{script}}\u{2028}\u{0}";
        let page = example_page(hostile, hostile);
        for tag in ["<b", "<!--", "<script", "</script"] {
            assert_eq!(
                page.matches(tag).count(),
                calm.matches(tag).count(),
                "{tag}"
            );
        }
        assert!(page.contains(
            "<h1 dir=\"auto\">&lt;/script&gt;&lt;b onload=&quot;x&quot;&gt;&#39;&amp;amp;"
        ));
        assert!(!page.contains('\u{0}'));
        let heading = page
            .split("<h1")
            .nth(1)
            .unwrap()
            .split("</h1>")
            .next()
            .unwrap();
        assert!(heading.ends_with("{{data}}{{script}}\u{2028}"), "{heading}");
    }

    #[test]
    fn nothing_is_loaded_from_anywhere() {
        let page = example_page("a person jumps", "strong");
        assert!(page.contains("Content-Security-Policy\" content=\"default-src 'none';"));
        // The only address is the name of an XML namespace.
        let addresses = page.matches("://").count();
        assert_eq!(
            addresses,
            page.matches("\"http://www.w3.org/2000/svg\"").count()
        );
        for word in [
            "fetch(",
            "XMLHttpRequest",
            "import(",
            "WebSocket",
            "@import",
            "url(",
            " src=",
            "sendBeacon",
        ] {
            assert!(!page.contains(word), "{word}");
        }
    }

    #[test]
    fn a_pair_of_four_seconds_is_small_and_always_the_same() {
        let page = example_page("a person jumps", "strong");
        assert!(page.len() < 100_000, "{} bytes", page.len());
        assert_eq!(page, example_page("a person jumps", "strong"));
    }

    #[test]
    fn every_placeholder_is_filled_and_every_tag_closed() {
        let page = example_page("a person jumps", "strong");
        assert!(!page.contains("{{"), "a placeholder is left");
        for tag in [
            "html", "head", "body", "main", "section", "div", "button", "svg", "script", "style",
            "table", "dialog",
        ] {
            let open = page.matches(&format!("<{tag} ")).count()
                + page.matches(&format!("<{tag}>")).count();
            assert_eq!(open, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
        assert!(page.contains("<noscript>"));
    }

    #[test]
    fn curves_alone_and_figures_alone_are_pages_too() {
        let motion = motion();
        let figures = [PageFigure::baseline(&motion)];
        let (title, notes) = ("", "");
        let alone = page(&Page {
            title,
            notes,
            figures: &figures,
            curves: &[],
            captions: &[],
        });
        assert!(alone.contains("<bdi>baseline</bdi>") && !alone.contains("<table id"));
        let empty = page(&Page {
            title,
            notes,
            figures: &[],
            curves: &[],
            captions: &[],
        });
        assert!(empty.contains("\"motions\":[]"));
    }
}
