//! The headers of a shared library, judged before the system's loader maps it. The loader trusts them: of a truncated
//! file it maps missing pages, and the program dies of a SIGBUS.
//!
//! Only ELF is judged, for Linux and the BSDs; other formats are left to their loaders.

use crate::load::LoadError;
use object::elf;
use object::read::ReadCache;
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};
use object::{Endianness, ReadRef};
use std::fs::File;
use std::path::Path;

#[cfg(target_pointer_width = "64")]
type Header = elf::FileHeader64<Endianness>;
#[cfg(not(target_pointer_width = "64"))]
type Header = elf::FileHeader32<Endianness>;

/// Bytes of `e_ident` and the two numbers behind it: the file's type, and its machine.
const IDENTITY: u64 = 20;

/// Machines by their names in Rust.
const MACHINES: [(u16, &str); 9] = [
    (elf::EM_X86_64, "x86_64"),
    (elf::EM_386, "x86"),
    (elf::EM_AARCH64, "aarch64"),
    (elf::EM_ARM, "arm"),
    (elf::EM_RISCV, "riscv64"),
    (elf::EM_PPC64, "powerpc64"),
    (elf::EM_S390, "s390x"),
    (elf::EM_LOONGARCH, "loongarch64"),
    (elf::EM_MIPS, "mips"),
];

/// Refuses an ELF file of another machine, and one shorter than its headers say.
pub(crate) fn judge(path: &Path) -> Result<(), LoadError> {
    let refused = |error: std::io::Error| LoadError::Refused(error.to_string());
    let file = File::open(path).map_err(refused)?;
    let size = file.metadata().map_err(refused)?.len();
    let data = &ReadCache::new(file);
    let identity = data.read_bytes_at(0, IDENTITY.min(size)).unwrap_or_default();
    if !identity.starts_with(&elf::ELFMAG) {
        // No ELF file: the loader says so.
        return Ok(());
    }
    let cut_short = |named: u64| LoadError::CutShort { size, named };
    let &[_, _, _, _, class, order, .., low, high] = identity else {
        return Err(cut_short(IDENTITY));
    };
    if identity.len() as u64 != IDENTITY {
        return Err(cut_short(IDENTITY));
    }
    let is_big = order == elf::ELFDATA2MSB;
    let machine = if is_big { u16::from_be_bytes } else { u16::from_le_bytes }([low, high]);
    let bits = if class == elf::ELFCLASS64 { 64 } else { 32 };
    let ours = MACHINES.iter().find(|(_, name)| *name == std::env::consts::ARCH);
    let is_of_order = is_big == cfg!(target_endian = "big");
    if ours.is_some_and(|(ours, _)| *ours != machine) || bits != usize::BITS || !is_of_order {
        let name = MACHINES.iter().find(|(number, _)| *number == machine);
        let name = name.map_or_else(|| format!("machine {machine}"), |(_, name)| (*name).to_owned());
        let order = if is_of_order { "" } else { ", the other byte order" };
        return Err(LoadError::Machine {
            found: format!("{name} ({bits} bits{order})"),
        });
    }
    let named = named_by_headers(data, size)
        .map_err(|_| LoadError::Refused("its ELF headers cannot be read; copy or build it again".to_owned()))?;
    if named > size {
        return Err(cut_short(named));
    }
    Ok(())
}

/// Returns the end named by the headers of a file of `size` bytes: that of its tables, and if these are complete, of
/// all their contents.
fn named_by_headers<'a>(data: &'a ReadCache<File>, size: u64) -> object::Result<u64> {
    let header = size_of::<Header>() as u64;
    if size < header {
        return Ok(header);
    }
    let header: &'a Header = Header::parse(data)?;
    let endian = header.endian()?;
    let segments = table(
        header.e_phoff(endian),
        header.e_phnum(endian),
        header.e_phentsize(endian),
    );
    let sections = table(
        header.e_shoff(endian),
        header.e_shnum(endian),
        header.e_shentsize(endian),
    );
    let tables = segments.max(sections);
    if tables > size {
        return Ok(tables);
    }
    let segments = header.program_headers(endian, data)?.iter();
    let segments = segments.map(|segment| segment.file_range(endian));
    let sections = header.section_headers(endian, data)?.iter();
    // Segments without bytes in the file have no range.
    let sections = sections.filter_map(|section| section.file_range(endian));
    let ends = segments
        .chain(sections)
        .map(|(start, length)| start.saturating_add(length));
    Ok(ends.max().unwrap_or(0).max(tables))
}

/// The end of a table of `count` entries of `each` bytes.
fn table(start: impl Into<u64>, count: u16, each: u16) -> u64 {
    start.into().saturating_add(u64::from(count) * u64::from(each))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// This test's own file: an ELF image of this machine.
    fn own() -> Vec<u8> {
        std::fs::read(std::env::current_exe().expect("a path")).expect("a file")
    }

    #[test]
    fn an_image_is_whole_at_its_full_length_and_at_no_other() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("image");
        let whole = own();
        std::fs::write(&path, &whole).expect("a file");
        assert_eq!(judge(&path), Ok(()));
        let lengths = (4..120)
            .chain((1..40).map(|k| whole.len() * k / 40))
            .chain([whole.len() - 1]);
        for length in lengths {
            std::fs::write(&path, &whole[..length]).expect("a file");
            let judged = judge(&path);
            let is_cut =
                matches!(judged, Err(LoadError::CutShort { size, named }) if size == length as u64 && named > size);
            assert!(is_cut, "{length} of {}: {judged:?}", whole.len());
        }
        std::fs::write(&path, b"no image").expect("a file");
        assert_eq!(judge(&path), Ok(()), "for the loader to refuse");
    }

    #[test]
    fn an_image_of_another_machine_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("image");
        let other = MACHINES
            .iter()
            .find(|(_, name)| *name != std::env::consts::ARCH)
            .expect("another");
        let mut image = own();
        image[18..20].copy_from_slice(&other.0.to_ne_bytes());
        std::fs::write(&path, &image).expect("a file");
        let error = judge(&path).expect_err("another machine").to_string();
        assert!(
            error.contains(other.1) && error.contains(std::env::consts::ARCH),
            "{error}"
        );
        let mut image = own();
        image[4] = if cfg!(target_pointer_width = "64") {
            elf::ELFCLASS32
        } else {
            elf::ELFCLASS64
        };
        std::fs::write(&path, &image).expect("a file");
        assert!(matches!(judge(&path), Err(LoadError::Machine { .. })));
    }
}
