//! Files that are written whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes a file under a temporary name in its own folder, then renames it. A reader never sees
/// half a file, and a failure leaves what was there before.
///
/// # Errors
///
/// Whatever `content` or the file system reports; the temporary file is then removed.
pub fn write_atomically(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    replace_atomically(path, |temporary| {
        let mut writer = BufWriter::new(File::create(temporary)?);
        content(&mut writer)?;
        writer.flush()
    })
}

/// As [`write_atomically`], for content that wants the path of the temporary file to write to.
///
/// # Errors
///
/// As [`write_atomically`].
pub fn replace_atomically(
    path: &Path,
    content: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // Temporary files are private; the finished one should be as readable as any other.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o644));
    }
    let temporary = builder.tempfile_in(folder)?;
    let permissions = temporary.as_file().metadata()?.permissions();
    content(temporary.path())?;
    // A library that replaces the file instead of filling it brings permissions of its own.
    std::fs::set_permissions(temporary.path(), permissions)?;
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_file_is_as_readable_as_any_other_even_if_its_content_replaced_it() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let plain = folder.path().join("plain");
        std::fs::write(&plain, "").unwrap();
        let path = folder.path().join("a.txt");
        replace_atomically(&path, |temporary| {
            let private = tempfile::NamedTempFile::new_in(folder.path())?;
            private.persist(temporary).map_err(|error| error.error)?;
            Ok(())
        })
        .unwrap();
        assert_eq!(mode(&path), mode(&plain) & 0o644);
    }

    #[test]
    fn a_failure_keeps_the_old_file_and_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomically(&path, |file| file.write_all(b"old")).unwrap();
        let failed = write_atomically(&path, |file| {
            file.write_all(b"new")?;
            Err(io::Error::other("stopped half way"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "stopped half way");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
