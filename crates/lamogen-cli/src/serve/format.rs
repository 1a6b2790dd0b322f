//! Which media type is which format.

use crate::output::OutputFormat;

/// The media types of motions. The first is that of clients that accept any.
pub const MEDIA_TYPES: [&str; 10] = [
    "application/json",
    "model/gltf-binary",
    "text/plain",
    "application/x-vrma",
    "application/x-npy",
    "text/csv",
    "image/gif",
    "image/png",
    "image/svg+xml",
    "text/html",
];

/// Returns the format of a media type.
pub fn format_of(media_type: &str) -> OutputFormat {
    match media_type {
        "model/gltf-binary" => OutputFormat::Glb,
        "text/plain" => OutputFormat::Bvh,
        "application/x-vrma" => OutputFormat::Vrma,
        "application/x-npy" => OutputFormat::Npy,
        "text/csv" => OutputFormat::Csv,
        "image/gif" => OutputFormat::Gif,
        "image/png" => OutputFormat::Png,
        "image/svg+xml" => OutputFormat::Svg,
        "text/html" => OutputFormat::Html,
        _ => OutputFormat::Json,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_media_type_is_a_format_of_its_own() {
        let mut endings = MEDIA_TYPES.map(|media_type| format_of(media_type).ending());
        endings.sort_unstable();
        let mut distinct = endings.to_vec();
        distinct.dedup();
        assert_eq!(distinct, endings);
    }
}
