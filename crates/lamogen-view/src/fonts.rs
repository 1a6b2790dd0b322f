//! Letters for pictures in pixels: the same on every machine.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use resvg::usvg::fontdb::{Database, ID, Source, Stretch, Style, Weight};
use resvg::usvg::{FontResolver, Options};

/// DejaVu Sans for the scripts of Europe; its origin and licence lie beside it.
const EMBEDDED: &[u8] = include_bytes!("../fonts/DejaVuSans-subset.ttf");

/// Where letters come from that the embedded font lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Missing {
    /// A font of the machine, if it has one.
    FromSystem,
    /// From nowhere: they are drawn as boxes.
    Boxes,
}

/// How SVG is read: every family is the embedded font.
pub(crate) fn options(missing: Missing) -> Options<'static> {
    let (database, id) = embedded();
    Options {
        fontdb: Arc::clone(database),
        font_resolver: FontResolver {
            select_font: Box::new(|_, _| Some(*id)),
            select_fallback: Box::new(move |letter, used, database| match missing {
                Missing::Boxes => None,
                Missing::FromSystem => {
                    let font = system_font(letter).filter(|font| !used.contains(font))?;
                    // It holds the embedded font under the same id.
                    *database = Arc::clone(with_system());
                    Some(font)
                }
            }),
        },
        ..Options::default()
    }
}

fn embedded() -> &'static (Arc<Database>, ID) {
    static FONT: OnceLock<(Arc<Database>, ID)> = OnceLock::new();
    FONT.get_or_init(|| {
        let mut database = Database::new();
        let ids = database.load_font_source(Source::Binary(Arc::new(EMBEDDED)));
        (Arc::new(database), ids[0])
    })
}

/// The embedded font and those of the machine. Looking for them takes a while and is only done for
/// a text that needs them.
fn with_system() -> &'static Arc<Database> {
    static FONTS: OnceLock<Arc<Database>> = OnceLock::new();
    FONTS.get_or_init(|| {
        let mut database = Database::clone(&embedded().0);
        database.load_system_fonts();
        Arc::new(database)
    })
}

/// A font of the machine that has the letter, upright and of usual weight where there is one.
/// Looked for once: every font file is read.
fn system_font(letter: char) -> Option<ID> {
    static FOUND: OnceLock<Mutex<HashMap<char, Option<ID>>>> = OnceLock::new();
    let found = FOUND.get_or_init(Mutex::default);
    let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
    *found.entry(letter).or_insert_with(|| {
        let default = FontResolver::default_fallback_selector();
        let plain = |database: &Database, id| {
            database.face(id).is_some_and(|face| {
                (face.style, face.weight, face.stretch)
                    == (Style::Normal, Weight::NORMAL, Stretch::Normal)
            })
        };
        let mut database = Arc::clone(with_system());
        let mut tried = vec![embedded().1];
        while let Some(id) = default(letter, &tried, &mut database) {
            tried.push(id);
            if plain(&database, id) {
                return Some(id);
            }
        }
        tried.get(1).copied()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_font_is_a_font_and_small() {
        assert_eq!(embedded().0.len(), 1);
        assert!(EMBEDDED.len() < 200_000);
    }
}
