//! The page of the studio: a sentence and sliders, and the motion that follows them. A server answers its requests.
//!
//! ```text
//! studio/studio.html  the document                  studio/requests.js  requests to the server: one at a time, the newest wins
//! studio/studio.css   the style, after page.css     studio/wish.js      what is wished: fields, JSON, the address's fragment
//! studio/sliders.js   factors of components, parts  studio/timeline.js  keys of a factor over time
//! studio/segments.js  sentences in a row            studio/floor.js     places on the floor
//! studio/reaches.js   positions of hands, feet, head  studio/place_list.js  their numbers, and those of places
//! studio/character.js a mesh moved by bones         studio/steady.js    a view that stays
//! studio/history.js   thumbnails and undo           studio/files.js     files dropped on the page, files to keep
//! studio/studio.js    the program
//! ```
//!
//! Figures, curves and the controls of the player are those of [`page`](crate::page()).

use crate::page::PLAYER_SCRIPTS;

/// The files of the studio's page.
#[derive(Clone, Debug)]
pub struct Studio {
    /// The document, which loads `studio.js` and `studio.css` from its own folder and nothing else.
    pub page: String,
    /// The script.
    pub script: String,
    /// The style sheet.
    pub style: String,
}

/// The scripts of the studio, in this order, after those of the player.
const SCRIPTS: [&str; 13] = [
    include_str!("studio/requests.js"),
    include_str!("studio/character.js"),
    include_str!("studio/steady.js"),
    include_str!("studio/wish.js"),
    include_str!("studio/sliders.js"),
    include_str!("studio/timeline.js"),
    include_str!("studio/segments.js"),
    include_str!("studio/place_list.js"),
    include_str!("studio/floor.js"),
    include_str!("studio/reaches.js"),
    include_str!("studio/history.js"),
    include_str!("studio/files.js"),
    include_str!("studio/studio.js"),
];

/// Creates the files of the studio's page.
///
/// The page has no inline script or style, so that a Content-Security-Policy can forbid them. It asks the server that it comes from:
/// `GET api/v1/model`, `POST api/v1/generate`, `POST api/v1/laban`, `POST api/v1/character`.
///
/// `window.studio` gives tests access to its state (`studio/studio.js`).
pub fn studio() -> Studio {
    Studio {
        page: include_str!("studio/studio.html").replace("{{version}}", env!("CARGO_PKG_VERSION")),
        script: format!(
            "(() => {{\n\"use strict\";\n{}{}}})();\n",
            PLAYER_SCRIPTS.concat(),
            SCRIPTS.concat()
        ),
        style: concat!(
            include_str!("page/page.css"),
            include_str!("studio/studio.css")
        )
        .to_owned(),
    }
}
