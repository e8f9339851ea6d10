//! Archives of arrays: a zip file whose members are `NAME.npy`.
//!
//! Ours are stored, not compressed, so that an element has an offset in the file; their members have a fixed order and
//! the first day that zip can express, so that equal arrays give equal bytes. Those of other programs may be deflated.

use super::durable::{SEAL_SIZE, read_exact_at};
use super::npy::{Element, ElementType, Header, decode};
use super::{Error, Result};
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, System, ZipArchive, ZipWriter};

/// The most members that an archive may have: SciPy writes 5, the patch table has 11.
const MEMBERS_MAX: usize = 64;

/// Most bytes of an archive's compressed arrays, in sizes of its file; [`INFLATED_MIN`] where that is more.
const INFLATED_RATIO_MAX: u64 = 10;

/// Bytes that compressed arrays may take of the smallest archive.
const INFLATED_MIN: u64 = 64 << 20;

/// Elements that are encoded or decoded at a time.
const CHUNK: usize = 1 << 14;

/// Bytes that are read at a time to be held against their CRC.
const VERIFIED_AT_A_TIME: usize = 1 << 18;

/// Writes arrays into an archive, one after another: what `numpy.load` opens. Equal arrays give equal bytes.
///
/// ```
/// use hemicube_store::NpzWriter;
/// use std::io::Cursor;
///
/// let write = |values: &[f64]| -> std::io::Result<Vec<u8>> {
///     let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
///     npz.array("radiosity", &[2, 1], values)?;
///     Ok(npz.finish()?.into_inner())
/// };
/// let bytes = write(&[0.5, 0.25])?;
/// assert_eq!(bytes, write(&[0.5, 0.25])?, "no clock in the file");
/// assert!(bytes.windows(8).any(|number| number == 0.25_f64.to_le_bytes()), "nothing is compressed");
/// # Ok::<(), std::io::Error>(())
/// ```
pub struct NpzWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
}

impl<W: Write + Seek> std::fmt::Debug for NpzWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NpzWriter").finish_non_exhaustive()
    }
}

impl<W: Write + Seek> NpzWriter<W> {
    /// An archive without members.
    pub fn new(writer: W) -> Self {
        Self {
            zip: ZipWriter::new(writer),
        }
    }

    /// Begins a member; its elements follow through [`Self::push`].
    ///
    /// # Errors
    /// What writing gives.
    pub fn begin(&mut self, name: &str, element: ElementType, shape: &[u64]) -> io::Result<()> {
        let header = Header::bytes(element, shape);
        let count = shape
            .iter()
            .fold(1u64, |product, &length| product.saturating_mul(length));
        let size = count.saturating_mul(element.size()).saturating_add(header.len() as u64);
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default())
            .system(System::Unix)
            .unix_permissions(0o644)
            .large_file(size >= u64::from(u32::MAX));
        self.zip.start_file(format!("{name}.npy"), options)?;
        self.zip.write_all(&header)
    }

    /// Adds elements to the member that was begun last.
    ///
    /// # Errors
    /// What writing gives.
    pub fn push<T: Element>(&mut self, elements: &[T]) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(elements.len().min(CHUNK) * size_of::<T>());
        for chunk in elements.chunks(CHUNK) {
            bytes.clear();
            for &element in chunk {
                element.put(&mut bytes);
            }
            self.zip.write_all(&bytes)?;
        }
        Ok(())
    }

    /// A whole member.
    ///
    /// # Errors
    /// What writing gives.
    pub fn array<T: Element>(&mut self, name: &str, shape: &[u64], elements: &[T]) -> io::Result<()> {
        self.begin(name, T::TYPE, shape)?;
        self.push(elements)
    }

    /// Writes what `scipy.sparse` reads first: the format's name and the shape.
    ///
    /// # Errors
    /// What writing gives.
    pub fn csr_preamble(&mut self, rows: u64, columns: u64) -> io::Result<()> {
        self.preamble(b"csr", rows, columns)
    }

    /// Likewise for a format of another name, which `scipy.sparse` then refuses by that name.
    pub(crate) fn preamble(&mut self, format: &[u8; 3], rows: u64, columns: u64) -> io::Result<()> {
        self.begin("format", ElementType::Bytes(3), &[])?;
        self.zip.write_all(format)?;
        self.begin("shape", ElementType::I64, &[2])?;
        self.push(&[rows, columns])
    }

    /// The bytes that `members` of these names and sizes (header included) take in all, to a few hundred.
    pub fn size(members: &[(&str, u64)]) -> u64 {
        // Local header 30, central header 46, and the name twice; zip64 fields 20 and 28; end record 22, 56 and 20 for
        // zip64.
        members.iter().fold(98, |size, &(name, bytes)| {
            size.saturating_add(bytes)
                .saturating_add(30 + 46 + 20 + 28 + 2 * (name.len() as u64 + 4))
        })
    }

    /// Ends the archive and hands back what it was written to.
    ///
    /// # Errors
    /// What writing gives.
    pub fn finish(self) -> io::Result<W> {
        Ok(self.zip.finish()?)
    }

    /// Ends the archive with room for a seal: a comment of as many zeros.
    #[doc(hidden)]
    pub fn finish_unsealed(mut self) -> io::Result<W> {
        let room = usize::try_from(SEAL_SIZE).unwrap_or(0);
        self.zip.set_raw_comment(vec![b'0'; room].into_boxed_slice())?;
        self.finish()
    }
}

impl<W: Write + Seek> Write for NpzWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.zip.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.zip.flush()
    }
}

/// Place of an array in an archive.
#[derive(Clone, Debug)]
struct Member {
    name: String,
    header: Header,
    count: u64,
    /// Start of the elements in the archive, if they are stored.
    offset: Option<u64>,
    /// CRC-32 of header and elements, by the archive's directory.
    crc: u32,
}

/// An open archive of arrays. Every claimed length has been held against the size of the file.
pub struct Npz {
    path: PathBuf,
    file: File,
    archive: ZipArchive<io::BufReader<File>>,
    members: Vec<Member>,
    /// True if arrays that are read whole are held against their CRC.
    verifies: bool,
}

/// The elements of an array, in the file or, if they were compressed, in memory.
#[derive(Debug)]
pub(crate) enum Elements {
    /// At this offset in the archive.
    Stored(u64),
    /// Encoded as in the file.
    Memory(Vec<u8>),
}

impl Npz {
    /// Opens an archive and reads the headers of its arrays.
    ///
    /// # Errors
    /// When it cannot be read, or is no archive of arrays.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |error| Error::io(path, "read", error);
        let file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
        let metadata = file.metadata().map_err(io)?;
        if metadata.is_dir() {
            return Err(Error::malformed(path, "is a directory, not an archive of arrays"));
        }
        let length = metadata.len();
        let no_archive = |error: zip::result::ZipError| match error {
            zip::result::ZipError::Io(error) => io(error),
            error => Error::malformed(path, format!("is no readable `.npz` archive: {error}")),
        };
        // Nothing may stand before the archive: offsets count from the start of the file.
        let config = zip::read::Config {
            archive_offset: zip::read::ArchiveOffset::Known(0),
        };
        let reader = io::BufReader::new(file.try_clone().map_err(io)?);
        let mut archive = ZipArchive::with_config(config, reader).map_err(no_archive)?;
        if archive.len() > MEMBERS_MAX || archive.has_duplicate_names() {
            return Err(Error::malformed(path, "has too many members, or two of one name"));
        }
        let mut members = Vec::with_capacity(archive.len());
        let (mut taken, mut inflated) = (0u64, 0u64);
        for index in 0..archive.len() {
            let mut member = archive.by_index(index).map_err(no_archive)?;
            let file_name = member.name().map_err(no_archive)?.into_owned();
            let Some(name) = file_name.strip_suffix(".npy") else {
                return Err(Error::malformed(
                    path,
                    format!("has a member `{file_name}` that is no array"),
                ));
            };
            let of_member = |reason: &str| Error::malformed(path, format!("has a member `{file_name}` that {reason}"));
            let (size, compressed) = (member.size(), member.compressed_size());
            let data_start = member
                .data_start()
                .ok_or_else(|| of_member("has no place in the file"))?;
            let stored = match member.compression() {
                CompressionMethod::Stored => true,
                CompressionMethod::Deflated => false,
                _ => {
                    return Err(Error::unsupported(
                        path,
                        "is compressed by another method than deflate; save it again",
                    ));
                }
            };
            if data_start.checked_add(compressed).is_none_or(|end| end > length) {
                return Err(of_member("reaches past the end of the file: it is truncated"));
            }
            taken = taken.saturating_add(compressed);
            if stored && size != compressed || taken > length {
                return Err(of_member("claims a size that it cannot have"));
            }
            if !stored {
                inflated = inflated.saturating_add(size);
            }
            let inflated_max = length.saturating_mul(INFLATED_RATIO_MAX).max(INFLATED_MIN);
            if inflated > inflated_max {
                let reason = format!(
                    "has compressed arrays of {inflated} bytes or more, and {inflated_max} at most are read of a file \
                     of its size; save it uncompressed"
                );
                return Err(Error::unsupported(path, reason));
            }
            let crc = member.crc32();
            let header = Header::read(&mut member)
                .map_err(io)?
                .map_err(|reason| of_member(&reason))?;
            if header.total_size() != Some(size) {
                return Err(of_member("has another number of elements than its shape says"));
            }
            if header.fortran_order && header.shape.len() > 1 {
                return Err(of_member(
                    "is in Fortran order; save it as `numpy.ascontiguousarray` makes it",
                ));
            }
            let count = header.count().unwrap_or(0);
            let offset = stored.then_some(data_start + header.size);
            members.push(Member {
                name: name.to_owned(),
                header,
                count,
                offset,
                crc,
            });
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            archive,
            members,
            verifies: true,
        })
    }

    /// Takes stored arrays as they are: their CRC was checked before.
    pub(crate) fn verified(mut self) -> Self {
        self.verifies = false;
        self
    }

    /// Checks the CRC of all stored arrays, before rows are read at their offsets.
    pub(crate) fn verify(&mut self) -> Result<()> {
        for member in self.members.iter().filter(|member| member.offset.is_some()) {
            let mut hasher = self.header_crc(member)?;
            let (mut at, mut left) = (member.offset.unwrap_or(0), member.count * member.header.element.size());
            let mut buffer = vec![0; VERIFIED_AT_A_TIME];
            while left > 0 {
                let size = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
                read_exact_at(&self.file, &mut buffer[..size], at)
                    .map_err(|error| Error::io(&self.path, "read", error))?;
                hasher.update(&buffer[..size]);
                at += size as u64;
                left -= size as u64;
            }
            self.require_crc(member, hasher)?;
        }
        self.verifies = false;
        Ok(())
    }

    /// The CRC so far of a stored array's header.
    fn header_crc(&self, member: &Member) -> Result<crc32fast::Hasher> {
        let mut hasher = crc32fast::Hasher::new();
        let start = member.offset.unwrap_or(0).saturating_sub(member.header.size);
        let mut header = vec![0; usize::try_from(member.header.size).unwrap_or(0)];
        read_exact_at(&self.file, &mut header, start).map_err(|error| Error::io(&self.path, "read", error))?;
        hasher.update(&header);
        Ok(hasher)
    }

    fn require_crc(&self, member: &Member, hasher: crc32fast::Hasher) -> Result<()> {
        if hasher.finalize() == member.crc {
            return Ok(());
        }
        let reason = format!(
            "has an array `{}` whose CRC is not that of its bytes: it is damaged; restore it from a copy or write it \
             again",
            member.name
        );
        Err(Error::malformed(&self.path, reason))
    }

    fn member(&self, name: &str) -> Result<(usize, &Member)> {
        self.members
            .iter()
            .enumerate()
            .find(|(_, member)| member.name == name)
            .ok_or_else(|| Error::malformed(&self.path, format!("has no array `{name}`")))
    }

    /// Returns whether there is an array of this name.
    pub fn has(&self, name: &str) -> bool {
        self.members.iter().any(|member| member.name == name)
    }

    /// The header of an array.
    pub(crate) fn header(&self, name: &str) -> Result<&Header> {
        Ok(&self.member(name)?.1.header)
    }

    /// The number of elements of an array.
    pub(crate) fn count(&self, name: &str) -> Result<u64> {
        Ok(self.member(name)?.1.count)
    }

    pub(crate) fn into_file(self) -> File {
        self.file
    }

    /// Place of the elements of an array; decompressed if they are not simply stored.
    pub(crate) fn elements(&mut self, name: &str) -> Result<Elements> {
        let (index, member) = self.member(name)?;
        match member.offset {
            Some(offset) => Ok(Elements::Stored(offset)),
            None => {
                let (skip, wanted) = (member.header.size, member.count * member.header.element.size());
                self.inflate(index, skip, wanted).map(Elements::Memory)
            }
        }
    }

    /// All bytes of an array's elements.
    pub(crate) fn bytes(&mut self, name: &str) -> Result<Vec<u8>> {
        match self.elements(name)? {
            Elements::Memory(bytes) => Ok(bytes),
            Elements::Stored(offset) => {
                let (_, member) = self.member(name)?;
                let size = usize::try_from(member.count * member.header.element.size())
                    .map_err(|_| Error::unsupported(&self.path, "is too large for this machine's memory"))?;
                let mut bytes = vec![0; size];
                read_exact_at(&self.file, &mut bytes, offset).map_err(|error| Error::io(&self.path, "read", error))?;
                if self.verifies {
                    let mut hasher = self.header_crc(member)?;
                    hasher.update(&bytes);
                    self.require_crc(member, hasher)?;
                }
                Ok(bytes)
            }
        }
    }

    /// A whole array of `T` and of exactly this shape.
    pub(crate) fn shaped<T: Element>(&mut self, name: &str, shape: &[u64]) -> Result<Vec<T>> {
        let found = &self.header(name)?.shape;
        if found != shape {
            return Err(Error::malformed(
                &self.path,
                format!("has an array `{name}` of the shape {found:?}, where {shape:?} belongs"),
            ));
        }
        self.array(name)
    }

    /// A whole array of `T`.
    pub fn array<T: Element>(&mut self, name: &str) -> Result<Vec<T>> {
        let element = self.header(name)?.element;
        if element != T::TYPE {
            return Err(Error::malformed(
                &self.path,
                format!("has an array `{name}` of {element:?}, where {:?} belongs", T::TYPE),
            ));
        }
        Ok(decode(&self.bytes(name)?))
    }

    /// Refuses an array that does not have one dimension.
    pub(crate) fn require_vector(&self, name: &str) -> Result<()> {
        if self.header(name)?.shape.len() == 1 {
            return Ok(());
        }
        Err(Error::malformed(
            &self.path,
            format!("has an array `{name}` that does not have one dimension"),
        ))
    }

    /// A whole array of signed whole numbers, 4 or 8 bytes wide, none negative.
    pub(crate) fn counts(&mut self, name: &str) -> Result<Vec<u64>> {
        self.require_vector(name)?;
        let numbers = match self.header(name)?.element {
            ElementType::I32 => self.array::<i32>(name)?.into_iter().map(u64::try_from).collect(),
            _ => self.array::<i64>(name)?.into_iter().map(u64::try_from).collect(),
        };
        let numbers: std::result::Result<_, _> = numbers;
        numbers.map_err(|_| Error::malformed(&self.path, format!("has a negative number in `{name}`")))
    }

    /// Memory grows with what really comes out, not with what the file claims.
    fn inflate(&mut self, index: usize, skip: u64, wanted: u64) -> Result<Vec<u8>> {
        let path = &self.path;
        let member = self
            .archive
            .by_index(index)
            .map_err(|error| Error::malformed(path, format!("is no readable `.npz` archive: {error}")))?;
        let mut bytes = Vec::new();
        let mut reader = member.take(skip.saturating_add(wanted).saturating_add(1));
        io::copy(&mut reader.by_ref().take(skip), &mut io::sink())
            .and_then(|_| reader.read_to_end(&mut bytes))
            .map_err(|error| Error::malformed(path, format!("cannot be decompressed: {error}")))?;
        if bytes.len() as u64 != wanted {
            return Err(Error::malformed(
                path,
                "holds less or more than it claims: it is truncated or damaged",
            ));
        }
        Ok(bytes)
    }
}
