//! The fonts of pictures in pixels, which are the same on every machine.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use lamogen_view::EMBEDDED_FONT;
use resvg::usvg::fontdb::{Database, ID, Source, Stretch, Style, Weight};
use resvg::usvg::{FontResolver, Options};

/// Returns the options for parsing SVG. Every font family is replaced by the embedded font. Characters that it lacks are drawn
/// in a font of the system, if one has them, and otherwise as boxes.
pub(crate) fn svg_options() -> Options<'static> {
    let (database, id) = embedded_font();
    Options {
        fontdb: Arc::clone(database),
        font_resolver: FontResolver {
            select_font: Box::new(|_, _| Some(*id)),
            select_fallback: Box::new(|letter, used, database| {
                let font = system_font(letter).filter(|font| !used.contains(font))?;
                // This database has the embedded font under the same id.
                *database = Arc::clone(embedded_and_system_fonts());
                Some(font)
            }),
        },
        ..Options::default()
    }
}

/// Returns a database with only the embedded font, and the id of that font.
fn embedded_font() -> &'static (Arc<Database>, ID) {
    static FONT: OnceLock<(Arc<Database>, ID)> = OnceLock::new();
    FONT.get_or_init(|| {
        let mut database = Database::new();
        let ids = database.load_font_source(Source::Binary(Arc::new(EMBEDDED_FONT)));
        (Arc::new(database), ids[0])
    })
}

/// Returns a database with the embedded font and the fonts of the system. Finding these takes time, so it is done only for
/// a text that needs them.
fn embedded_and_system_fonts() -> &'static Arc<Database> {
    static FONTS: OnceLock<Arc<Database>> = OnceLock::new();
    FONTS.get_or_init(|| {
        let mut database = Database::clone(&embedded_font().0);
        database.load_system_fonts();
        Arc::new(database)
    })
}

/// Returns a font of the system that has a letter, preferably an upright one of normal weight.
///
/// The result is cached for each letter, because the search reads every font file.
fn system_font(letter: char) -> Option<ID> {
    static CACHE: OnceLock<Mutex<HashMap<char, Option<ID>>>> = OnceLock::new();
    let cache = CACHE.get_or_init(Mutex::default);
    let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
    *cache.entry(letter).or_insert_with(|| {
        let default = FontResolver::default_fallback_selector();
        let is_normal = |database: &Database, id| {
            database.face(id).is_some_and(|face| {
                (face.style, face.weight, face.stretch)
                    == (Style::Normal, Weight::NORMAL, Stretch::Normal)
            })
        };
        let mut database = Arc::clone(embedded_and_system_fonts());
        let mut tried = vec![embedded_font().1];
        while let Some(id) = default(letter, &tried, &mut database) {
            tried.push(id);
            if is_normal(&database, id) {
                return Some(id);
            }
        }
        tried.get(1).copied()
    })
}
