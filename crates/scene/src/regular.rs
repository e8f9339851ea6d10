//! Opens regular files only, so that nothing waits for a pipe or reads a device without end.

use crate::text::{IS_UTF_16, unmarked};
use std::fs::{File, FileType, Metadata};
use std::io;
#[cfg(any(feature = "obj", feature = "gltf", feature = "abaqus"))]
use std::path::Component;
use std::path::Path;

/// Opens a file for reading, if it is a regular one or a link to one; at once, whatever it is.
///
/// # Errors
/// As [`File::open`]; [`io::ErrorKind::InvalidInput`] for directories, pipes, sockets and devices.
///
/// ```
/// let folder = std::env::temp_dir();
/// let error = hemicube_scene::open_regular(&folder).expect_err("a directory");
/// assert_eq!(error.to_string(), "it is a directory, and a regular file is needed");
/// ```
pub fn open_regular(path: &Path) -> io::Result<File> {
    // Checked before opening, because opening some devices has effects; and again on the opened file, because its name
    // may have been given to another one in between.
    check(&std::fs::metadata(path)?)?;
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        // A pipe without a writer would be waited for. For regular files the flag means nothing.
        options.custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed());
    }
    let file = options.open(path)?;
    check(&file.metadata()?)?;
    Ok(file)
}

/// Reads the bytes of a regular file.
///
/// # Errors
/// As [`open_regular`], and when it cannot be read.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    use io::Read;
    let mut file = open_regular(path)?;
    let mut bytes = Vec::new();
    let length = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX);
    bytes
        .try_reserve_exact(length)
        .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads the text of a regular file.
///
/// # Errors
/// As [`read_regular`]; [`io::ErrorKind::InvalidData`] where it is not UTF-8.
pub fn read_regular_text(path: &Path) -> io::Result<String> {
    let invalid = |reason: String| io::Error::new(io::ErrorKind::InvalidData, reason);
    let bytes = read_regular(path)?;
    unmarked(&bytes).map_err(|error| invalid(format!("it {error}")))?;
    // ASCII in UTF-16 has a 0 in every second byte.
    if matches!(bytes[..], [0, _, ..] | [_, 0, ..]) {
        return Err(invalid(format!("it {IS_UTF_16}")));
    }
    String::from_utf8(bytes).map_err(|_| invalid("it is no text in UTF-8".to_owned()))
}

/// Opens a file named by a scene, if it lies in the scene's folder or beneath it once all links are followed. A scene
/// may come from anywhere, and the bytes of the file come out again as coordinates or colours.
///
/// # Errors
/// As [`open_regular`]; [`io::ErrorKind::PermissionDenied`] for a name that leads out of the folder.
#[cfg(any(feature = "obj", feature = "gltf", feature = "abaqus"))]
pub(crate) fn open_beside(folder: &Path, name: &str) -> io::Result<File> {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let path = folder.join(name);
    // Refused whether the file exists or not: not even its existence is told.
    let leads_out = || io::Error::new(io::ErrorKind::PermissionDenied, "it leads out of the scene's folder");
    let mut depth = 0_u32;
    for component in Path::new(name).components() {
        match component {
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::ParentDir => depth = depth.checked_sub(1).ok_or_else(leads_out)?,
            Component::RootDir | Component::Prefix(_) => return Err(leads_out()),
        }
    }
    let path = path.canonicalize()?;
    if path.starts_with(folder.canonicalize()?) {
        open_regular(&path)
    } else {
        Err(leads_out())
    }
}

fn check(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    Err(io::Error::new(
        io::ErrorKind::InvalidInput,
        format!("it is {}, and a regular file is needed", kind(metadata.file_type())),
    ))
}

fn kind(file: FileType) -> &'static str {
    if file.is_dir() {
        return "a directory";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if file.is_fifo() {
            return "a pipe";
        }
        if file.is_socket() {
            return "a socket";
        }
        if file.is_block_device() || file.is_char_device() {
            return "a device";
        }
    }
    "something else"
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn regular_files_and_links_to_them_are_opened_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "text").expect("a file");
        std::os::unix::fs::symlink(path("file"), path("link")).expect("a link");
        assert_eq!(read_regular_text(&path("link")).expect("a text"), "text");
        std::fs::write(path("bytes"), [0xff]).expect("a file");
        let error = read_regular_text(&path("bytes")).expect_err("no UTF-8");
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);

        let made = std::process::Command::new("mkfifo").arg(path("pipe")).status();
        assert!(made.expect("mkfifo").success());
        std::os::unix::fs::symlink("/dev/zero", path("zero")).expect("a link");
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).expect("a socket");
        for (name, what) in [
            ("pipe", "a pipe"),
            ("zero", "a device"),
            ("socket", "a socket"),
            (".", "a directory"),
        ] {
            let error = open_regular(&path(name)).expect_err(name);
            assert!(error.to_string().contains(what), "{name}: {error}");
        }
        assert_eq!(
            open_regular(&path("none")).expect_err("none").kind(),
            io::ErrorKind::NotFound
        );
    }

    #[test]
    #[cfg(any(feature = "obj", feature = "gltf", feature = "abaqus"))]
    fn what_a_scene_names_lies_beside_it() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().join("scene");
        std::fs::create_dir_all(folder.join("sub")).expect("a folder");
        std::fs::write(place.path().join("secret"), "secret").expect("a file");
        std::fs::write(folder.join("sub/own"), "own").expect("a file");
        let link = |to: &Path, name: &str| std::os::unix::fs::symlink(to, folder.join(name)).expect("a link");
        link(&place.path().join("secret"), "out");
        link(&folder.join("sub/own"), "in");
        link(place.path(), "up");
        for name in ["sub/own", "./sub/own", "sub/../sub/own", "in"] {
            assert!(open_beside(&folder, name).is_ok(), "{name}");
        }
        let whole = place.path().join("secret");
        for name in [
            "../secret",
            "sub/../../secret",
            "out",
            "up/secret",
            "../none",
            &*whole.to_string_lossy(),
        ] {
            let error = open_beside(&folder, name).expect_err(name);
            assert_eq!(error.kind(), io::ErrorKind::PermissionDenied, "{name}: {error}");
        }
    }
}
