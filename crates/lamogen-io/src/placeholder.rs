//! Recognition of files that were stored in place of others: Git LFS pointers and web pages.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The number of bytes at the start of a file that are examined.
const PLACEHOLDER_BYTES: usize = 512;

/// Recognises, from its first bytes, a file that a download or a version control system stored in place of another.
///
/// Returns an error message for a pointer of Git LFS and for a web page, and `None` for any other file. Call this
/// function before a file is parsed in the format that its name suggests, so that the error names the real cause.
pub fn placeholder(bytes: &[u8]) -> Option<&'static str> {
    const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";
    const HTML_STARTS: [&[u8]; 4] = [b"<!doctype html", b"<html", b"<head", b"<body"];
    let bytes = &bytes[..bytes.len().min(PLACEHOLDER_BYTES)];
    if bytes.starts_with(LFS_POINTER) {
        return Some(
            "expected the file itself, found a pointer of Git LFS to it; git lfs pull fetches the file",
        );
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = text.trim_ascii_start();
    let begins = |page: &&[u8]| {
        { text.get(..page.len()) }.is_some_and(|start| start.eq_ignore_ascii_case(page))
    };
    { HTML_STARTS.iter().any(begins) }
        .then_some("expected the file itself, found a web page (HTML); the address that it was loaded from gives no file without a browser")
}

/// Applies [`placeholder`] to the first bytes of the file at a path.
///
/// Returns `None` if the file cannot be read: the code that reads the whole file then reports the error.
pub fn describe_placeholder_at(path: &Path) -> Option<&'static str> {
    let mut start = Vec::with_capacity(PLACEHOLDER_BYTES);
    let file = File::open(path).ok()?;
    if !file.metadata().ok()?.is_file() {
        return None;
    }
    let mut first = file.take(PLACEHOLDER_BYTES as u64);
    first.read_to_end(&mut start).ok()?;
    placeholder(&start)
}

#[cfg(test)]
mod tests {
    use super::placeholder;

    #[test]
    fn pointers_and_pages_are_told_from_files() {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        assert!(placeholder(pointer).is_some_and(|text| text.contains("Git LFS")));
        for page in [
            &b"<!DOCTYPE html><html>"[..],
            b"\xef\xbb\xbf \n<HTML lang=en>",
            b"<head><title>Sign in</title>",
        ] {
            assert!(placeholder(page).is_some_and(|text| text.contains("web page")));
        }
        for file in [
            &b"HIERARCHY\nROOT"[..],
            b"glTF\x02\0\0\0",
            b"\x93NUMPY",
            b"{\"html\": 1}",
            b"<",
            b"",
            b"<?xml version=\"1.0\"?><svg/>",
        ] {
            assert_eq!(placeholder(file), None);
        }
    }
}
