//! The choice of a media type by the header `Accept` (RFC 9110, section 12.5.1).

use axum::http::{HeaderMap, header};

/// One range of media types that a client accepts.
struct MediaRange<'a> {
    kind: &'a str,
    subtype: &'a str,
    quality: f32,
}

impl<'a> MediaRange<'a> {
    /// Parses a range such as `model/*;q=0.5`. Returns `None` if it has no slash.
    fn parse(text: &'a str) -> Option<MediaRange<'a>> {
        let mut parts = text.split(';').map(str::trim);
        let (kind, subtype) = parts.next()?.split_once('/')?;
        let quality = parts.find_map(|parameter| {
            let (name, value) = parameter.split_once('=')?;
            let is_quality = name.trim().eq_ignore_ascii_case("q");
            is_quality.then(|| value.trim().parse::<f32>().unwrap_or(0.0))
        });
        Some(MediaRange {
            kind,
            subtype,
            quality: quality.unwrap_or(1.0).clamp(0.0, 1.0),
        })
    }

    /// Returns how closely the range names a media type: 2 by its full name, 1 by its first part, 0 as one of all;
    /// `None` if it does not contain it.
    fn closeness(&self, media_type: &str) -> Option<u8> {
        let (kind, subtype) = media_type.split_once('/')?;
        match (self.kind, self.subtype) {
            ("*", "*") => Some(0),
            (own, "*") if own.eq_ignore_ascii_case(kind) => Some(1),
            (own, sub) if own.eq_ignore_ascii_case(kind) && sub.eq_ignore_ascii_case(subtype) => {
                Some(2)
            }
            _ => None,
        }
    }
}

/// Returns the media type of `offered` that the client prefers; of equally preferred ones, the first. Without the header,
/// all are accepted. Returns `None` if the client accepts none of them.
pub(crate) fn choose_media_type<'o>(headers: &HeaderMap, offered: &[&'o str]) -> Option<&'o str> {
    let values = headers.get_all(header::ACCEPT).iter();
    let text: Vec<&str> = values.filter_map(|value| value.to_str().ok()).collect();
    let text = text.join(",");
    if text.trim().is_empty() {
        return offered.first().copied();
    }
    let ranges: Vec<MediaRange<'_>> = text.split(',').filter_map(MediaRange::parse).collect();
    let quality = |media_type: &str| {
        let closeness = |range: &MediaRange<'_>| range.closeness(media_type);
        let containing = ranges
            .iter()
            .filter_map(|range| Some((closeness(range)?, range)));
        containing
            .max_by_key(|(closeness, _)| *closeness)
            .map_or(0.0, |(_, range)| range.quality)
    };
    let mut best = None;
    for &media_type in offered {
        let found = quality(media_type);
        if found > best.map_or(0.0, |(_, quality)| quality) {
            best = Some((media_type, found));
        }
    }
    best.map(|(media_type, _)| media_type)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFERED: [&str; 4] = [
        "application/json",
        "model/gltf-binary",
        "text/plain",
        "image/gif",
    ];

    fn chosen(accept: &str) -> Option<&'static str> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        choose_media_type(&headers, &OFFERED)
    }

    #[test]
    fn the_type_of_the_highest_quality_is_chosen() {
        for (accept, media_type) in [
            ("*/*", "application/json"),
            ("", "application/json"),
            ("model/gltf-binary", "model/gltf-binary"),
            ("Model/GLTF-Binary;v=2", "model/gltf-binary"),
            ("text/plain;q=0.5, image/*;q=0.8", "image/gif"),
            ("*/*;q=0.1, text/*", "text/plain"),
            ("application/json;q=0, */*", "model/gltf-binary"),
        ] {
            assert_eq!(chosen(accept), Some(media_type), "{accept}");
        }
        assert_eq!(
            choose_media_type(&HeaderMap::new(), &OFFERED),
            Some("application/json")
        );
    }

    #[test]
    fn types_that_nobody_offers_are_none() {
        for accept in [
            "application/xml",
            "image/gif;q=0",
            "nonsense",
            "image/gif;q=x",
        ] {
            assert_eq!(chosen(accept), None, "{accept}");
        }
    }
}
