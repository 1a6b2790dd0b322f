//! Files that take the place of others.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// As many of the first bytes of a file tell.
const PLACEHOLDER_BYTES: usize = 512;

/// What a file is that a download or a version control system put in the place of the one that is meant, by its first bytes: a pointer of Git LFS,
/// or a web page. To be asked before a file is read by whatever format its name says, so that the error speaks of what happened.
pub fn placeholder(bytes: &[u8]) -> Option<&'static str> {
    const LFS: &[u8] = b"version https://git-lfs.github.com/spec/";
    const PAGES: [&[u8]; 4] = [b"<!doctype html", b"<html", b"<head", b"<body"];
    let bytes = &bytes[..bytes.len().min(PLACEHOLDER_BYTES)];
    if bytes.starts_with(LFS) {
        return Some(
            "expected the file itself, found a pointer of Git LFS to it; git lfs pull fetches the file",
        );
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = text.trim_ascii_start();
    let begins = |page: &&[u8]| {
        { text.get(..page.len()) }.is_some_and(|start| start.eq_ignore_ascii_case(page))
    };
    { PAGES.iter().any(begins) }
        .then_some("expected the file itself, found a web page (HTML); the address that it was loaded from gives no file without a browser")
}

/// What a file is, as [`placeholder`] tells it; nothing of one that cannot be read, which is left to whoever reads it as a whole.
pub fn placeholder_at(path: &Path) -> Option<&'static str> {
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
