//! Motions as a page that plays them: one HTML file with everything in it.
//!
//! ```text
//! page/page.html  the document, with {{holes}}    page/motion.js   the motions, decoded and interpolated
//! page/page.css   how it looks                    page/camera.js   the eye and the numbers of 3D
//! data.rs         motions and curves as JSON      page/body.js     the body around its joints
//! markup.rs       text as HTML, holes filled      page/colour.js, page/scene.js  the picture, on a 2D canvas
//! numbers.rs      the table of largest values     page/chart.js    the curves
//!                                                 page/player.js, page/controls.js, page/main.js
//! ```

mod data;
mod markup;
mod numbers;

use lamogen_motion::Motion;

use crate::Curve;
use crate::text::printable;
use markup::{escape, fill};

/// One motion of a [`Page`].
#[derive(Clone, Copy, Debug)]
pub struct Figure<'a> {
    /// What it is called.
    pub label: &'a str,
    /// How it moves.
    pub motion: &'a Motion,
    /// Its colour, red, green, blue.
    pub colour: [u8; 3],
}

impl<'a> Figure<'a> {
    /// A grey figure, in the colour of [`Curve::baseline`].
    pub fn baseline(motion: &'a Motion) -> Self {
        Figure {
            label: "baseline",
            motion,
            colour: [107, 114, 128],
        }
    }

    /// A red figure, in the colour of [`Curve::guided`].
    pub fn guided(motion: &'a Motion) -> Self {
        Figure {
            label: "guided",
            motion,
            colour: [194, 65, 12],
        }
    }
}

/// What a page shows.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// Its heading, such as the sentence.
    pub title: &'a str,
    /// A line below, such as the tags and the seed; may be empty.
    pub notes: &'a str,
    /// The motions, side by side or in one view; one to four are seen well. They may differ in length:
    /// the shorter stands still at its end.
    pub figures: &'a [Figure<'a>],
    /// Laban curves beside them; none leaves their place out.
    pub curves: &'a [Curve<'a>],
}

const SCRIPTS: [&str; 8] = [
    include_str!("page/motion.js"),
    include_str!("page/camera.js"),
    include_str!("page/body.js"),
    include_str!("page/colour.js"),
    include_str!("page/scene.js"),
    include_str!("page/chart.js"),
    include_str!("page/player.js"),
    include_str!("page/controls.js"),
];

/// The page as one HTML document, which plays its motions in 3D in any browser of the last years. It
/// loads nothing, from nowhere, and its Content-Security-Policy forbids it to; it may be sent by mail and
/// opened from a disk. The same page is always the same text.
///
/// The view can be turned, zoomed and moved, by mouse, fingers and keys; time can be dragged, stepped,
/// slowed and looped. Joints are embedded to half a tenth of a millimetre, unless one is farther than
/// 3.2 m from its pelvis; a pair of four seconds takes less than 100 kB.
///
/// `window.lamogen` is the player's state for tests: `time`, `frame`, `playing`, `speed`, `loop`,
/// `overlay`, `follow`, `trails`, `camera`, `motions[i].pose(seconds)` (`page/main.js`).
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
    let script = format!(
        "(() => {{\n\"use strict\";\n{}{}}})();\n",
        SCRIPTS.concat(),
        include_str!("page/main.js")
    );
    fill(
        include_str!("page/page.html"),
        &[
            ("version", env!("CARGO_PKG_VERSION")),
            ("title", &escape(page.title)),
            ("notes", &notes),
            ("style", include_str!("page/page.css")),
            ("figures", &labels),
            ("numbers", &numbers::table(page.curves)),
            ("data", &data::json(page.figures, page.curves)),
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

    /// A figure that sways, eighty frames.
    fn motion() -> Motion {
        let pose = |t: usize| {
            std::array::from_fn(|j| [(t as f32 * 0.1).sin(), j as f32 * 0.08, t as f32 * 0.02])
        };
        Motion::from_joints((0..80).map(pose).collect::<Vec<[[f32; 3]; JOINTS]>>()).unwrap()
    }

    fn of(title: &str, label: &str) -> String {
        let (motion, series) = (
            motion(),
            LabanSeries::from_tensor(Tensor::ones([80, 4], &Default::default())),
        );
        let guided = Figure::guided(&motion);
        page(&Page {
            title,
            notes: title,
            figures: &[Figure::baseline(&motion), Figure { label, ..guided }],
            curves: &[
                Curve::baseline(&series),
                Curve::target(&series),
                Curve {
                    label,
                    ..Curve::guided(&series)
                },
            ],
        })
    }

    #[test]
    fn a_title_cannot_break_out() {
        let calm = of("a person jumps", "strong");
        let hostile = "</script><b onload=\"x\">'&amp;<!--{{data}}{{script}}\u{2028}\u{0}";
        let page = of(hostile, hostile);
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
        let page = of("a person jumps", "strong");
        assert!(page.contains("Content-Security-Policy\" content=\"default-src 'none';"));
        // The one address is the name of a namespace.
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
        let page = of("a person jumps", "strong");
        assert!(page.len() < 100_000, "{} bytes", page.len());
        assert_eq!(page, of("a person jumps", "strong"));
    }

    #[test]
    fn every_hole_is_filled_and_every_tag_closed() {
        let page = of("a person jumps", "strong");
        assert!(!page.contains("{{"), "a hole is left");
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
        let figures = [Figure::baseline(&motion)];
        let (title, notes) = ("", "");
        let alone = page(&Page {
            title,
            notes,
            figures: &figures,
            curves: &[],
        });
        assert!(alone.contains("<bdi>baseline</bdi>") && !alone.contains("<table id"));
        let empty = page(&Page {
            title,
            notes,
            figures: &[],
            curves: &[],
        });
        assert!(empty.contains("\"motions\":[]"));
    }
}
