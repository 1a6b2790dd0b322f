//! Files that are written whole or not at all.
//!
//! ```text
//! content ──▶ .lamogen-XXXXXX, locked, registered as in progress ──rename──▶ the file
//!                 │ after a signal: remove_temporaries
//!                 │ after a kill:   remove_stale_temporaries of a later run
//! ```

use std::collections::BTreeSet;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

/// The prefix of the names of temporary files and folders.
pub const TEMPORARY_PREFIX: &str = ".lamogen-";

/// The name of the file in a temporary folder that is locked while the folder is in use.
const LOCK_NAME: &str = ".lock";

/// The temporary files and folders that this process is writing.
static IN_PROGRESS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn in_progress() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    IN_PROGRESS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A registered temporary file or folder.
///
/// [`remove_temporaries`] removes the file or folder as long as this value lives.
#[derive(Debug)]
pub struct TemporaryPath {
    path: PathBuf,
    /// The lock that shows other processes that the file or folder is in use.
    _lock: Option<File>,
}

impl TemporaryPath {
    /// Registers a temporary folder and locks it for as long as the returned value lives.
    ///
    /// The lock protects the folder from [`remove_stale_temporaries`].
    ///
    /// # Errors
    ///
    /// If the lock file cannot be created in the folder.
    pub fn lock_folder(path: &Path) -> io::Result<TemporaryPath> {
        let lock = File::create(path.join(LOCK_NAME))?;
        try_lock(&lock);
        Ok(TemporaryPath::register(path, Some(lock)))
    }

    /// Removes the lock file of a folder that is no longer temporary, so that the folder is kept.
    ///
    /// # Errors
    ///
    /// If the lock file cannot be removed.
    pub fn unlock_folder(self) -> io::Result<()> {
        std::fs::remove_file(self.path.join(LOCK_NAME))
    }

    fn register(path: &Path, lock: Option<File>) -> TemporaryPath {
        in_progress().insert(path.to_owned());
        TemporaryPath {
            path: path.to_owned(),
            _lock: lock,
        }
    }
}

impl Drop for TemporaryPath {
    fn drop(&mut self) {
        in_progress().remove(&self.path);
    }
}

/// Removes all temporary files and folders that this process is writing.
///
/// A program calls this function when it is about to end because of a signal. Until the process has ended, other
/// threads cannot start to write files with the functions of this module.
pub fn remove_temporaries() {
    let paths = in_progress();
    for path in paths.iter() {
        // A later run removes the files that cannot be removed now.
        let _ = match path.is_dir() {
            true => std::fs::remove_dir_all(path),
            false => std::fs::remove_file(path),
        };
    }
    // The mutex stays locked, so that no thread registers or writes another file before the process ends.
    std::mem::forget(paths);
}

/// Tries to lock a file, on systems where a lock does not stop the file's other handles from writing.
///
/// Not every file system supports locks. Without locks, only the age shows which files are stale.
fn try_lock(file: &File) {
    if cfg!(unix) {
        let _ = file.try_lock();
    }
}

/// The minimum age of a stale temporary file.
const STALE_AGE: Duration = Duration::from_secs(if cfg!(unix) { 60 } else { 24 * 3600 });

/// Removes the temporary files and folders that killed processes left in a folder.
///
/// A temporary file or folder is stale if no process holds its lock and it was last modified more than a minute ago (on
/// systems without such locks, more than a day ago).
pub fn remove_stale_temporaries(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_temporary = name
            .to_str()
            .is_some_and(|name| name.starts_with(TEMPORARY_PREFIX));
        if !is_temporary {
            continue;
        }
        let path = entry.path();
        let is_folder = path.is_dir();
        let lock = match is_folder {
            true => path.join(LOCK_NAME),
            false => path.clone(),
        };
        let modified = { std::fs::symlink_metadata(&lock) }
            .or_else(|_| entry.metadata())
            .and_then(|metadata| metadata.modified());
        let is_old = modified.is_ok_and(|modified| {
            { SystemTime::now().duration_since(modified) }.is_ok_and(|age| age > STALE_AGE)
        });
        let is_in_use = File::open(&lock)
            .is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)));
        if is_old && !is_in_use {
            let _ = match is_folder {
                true => std::fs::remove_dir_all(&path),
                false => std::fs::remove_file(&path),
            };
        }
    }
}

/// Writes a file under a temporary name in the same folder, then renames it.
///
/// A reader never sees half a file, and after a failure the old file is unchanged. A file that is replaced keeps its
/// permissions. If the path is a symbolic link, its target is written.
///
/// # Errors
///
/// Any error of `content` or of the file system. The temporary file is then removed.
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

/// Writes a file like [`write_atomically`], but gives `content` the path of the temporary file instead of a writer.
///
/// # Errors
///
/// The same as those of [`write_atomically`].
pub fn replace_atomically(
    path: &Path,
    content: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<()> {
    let path = &resolve_links(path)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_PREFIX);
    let replaced = std::fs::metadata(path).ok().filter(|file| file.is_file());
    #[cfg(unix)]
    {
        // Temporary files are private by default, but the finished file should be as readable as any other file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o644));
    }
    let temporary = builder.tempfile_in(folder)?;
    let lock = temporary.as_file().try_clone()?;
    try_lock(&lock);
    let _registration = TemporaryPath::register(temporary.path(), Some(lock));
    let permissions = match replaced {
        Some(replaced) => replaced.permissions(),
        None => temporary.as_file().metadata()?.permissions(),
    };
    content(temporary.path())?;
    // A library that replaces the temporary file instead of filling it sets permissions of its own.
    std::fs::set_permissions(temporary.path(), permissions)?;
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Returns the target of a chain of symbolic links, or the path itself if it is no link.
///
/// The target need not exist yet.
fn resolve_links(path: &Path) -> io::Result<PathBuf> {
    const MAX_LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        if !path.is_symlink() {
            return Ok(path);
        }
        let target = std::fs::read_link(&path)?;
        path = match path.parent() {
            Some(folder) => folder.join(target),
            None => target,
        };
    }
    Err(io::Error::other(format!(
        "more than {MAX_LINKS} links in a row"
    )))
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
    #[cfg(unix)]
    fn a_link_stays_one_and_a_replaced_file_keeps_its_mode() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        let target = elsewhere.path().join("target.txt");
        std::fs::write(&target, "old").unwrap();
        std::fs::set_permissions(&target, std::fs::Permissions::from_mode(0o600)).unwrap();
        let link = folder.path().join("link.txt");
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_atomically(&link, |file| file.write_all(b"new")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert_eq!(
            target.metadata().unwrap().permissions().mode() & 0o777,
            0o600
        );
        // The target of a link need not exist yet.
        std::fs::remove_file(&target).unwrap();
        write_atomically(&link, |file| file.write_all(b"newest")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&target).unwrap(), b"newest");
        // A link to itself is an error.
        let circle = folder.path().join("circle.txt");
        std::os::unix::fs::symlink(&circle, &circle).unwrap();
        let failed = write_atomically(&circle, |file| file.write_all(b"x"));
        assert!(failed.unwrap_err().to_string().contains("links in a row"));
    }

    #[test]
    fn what_was_left_behind_is_removed_and_what_is_in_use_stays() {
        let folder = tempfile::tempdir().unwrap();
        let old = SystemTime::now() - 2 * STALE_AGE;
        let file = |name: &str| {
            let path = folder.path().join(name);
            let file = File::create(&path).unwrap();
            file.set_modified(old).unwrap();
            (path, file)
        };
        let (left, _) = file(".lamogen-left");
        let (in_use, lock) = file(".lamogen-used");
        lock.try_lock().unwrap();
        let (other, _) = file(".other");
        let fresh = folder.path().join(".lamogen-fresh");
        File::create(&fresh).unwrap();
        let temporary = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir(&path).unwrap();
            let held = TemporaryPath::lock_folder(&path).unwrap();
            { File::options().write(true).open(path.join(LOCK_NAME)) }
                .unwrap()
                .set_modified(old)
                .unwrap();
            (path, held)
        };
        let (left_folder, held) = temporary(".lamogen-left-folder");
        drop(held);
        let (used_folder, _held) = temporary(".lamogen-used-folder");
        remove_stale_temporaries(folder.path());
        assert!(!left.exists() && !left_folder.exists());
        assert!(in_use.exists() && other.exists() && fresh.exists() && used_folder.exists());
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
