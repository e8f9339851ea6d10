//! One shared library: opened for good, its table looked up and judged before a function of it is called.

use crate::Device;
use crate::loaded::{Answer, Guarded};
use hemicube_abi::types::{HC_ABI_VERSION, HcBackend, HcDevice, HcHost, SYMBOL, TABLE_MIN};
use hemicube_abi::{DeviceKind, capabilities_from_raw};
use hemicube_contract::backend::BackendError;
use std::ffi::{CStr, c_char, c_void};
use std::path::{Path, PathBuf};

/// Bytes of the longest name.
const NAME_MAX: usize = 32;
/// Bytes of the longest version.
const VERSION_MAX: usize = 63;
/// More devices than any machine offers.
const DEVICES_MAX: usize = 64;

/// Whether this program can open libraries. One that is linked with all of its C library, as for musl, cannot: its `dlopen`
/// refuses every file.
pub const OPENS_LIBRARIES: bool = !cfg!(all(unix, target_feature = "crt-static"));

/// A reason against a file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// There is no such file.
    #[error("no such file")]
    Missing,
    /// The program itself is static: [`OPENS_LIBRARIES`].
    #[error("this program is static, and opens no libraries")]
    Static,
    /// Not all of the file is there: mapping it would end the program.
    #[error("cut short: it has {size} bytes, and its headers name {named}; copy or build it again")]
    CutShort {
        /// Its size in bytes.
        size: u64,
        /// Bytes named by its headers.
        named: u64,
    },
    /// It was built for another machine.
    #[error("built for {found}, this program for {}", std::env::consts::ARCH)]
    Machine {
        /// Its machine.
        found: String,
    },
    /// The system's loader refused it.
    #[error("not loaded: {0}")]
    Refused(String),
    /// It does not export the table.
    #[error("not a hemicube backend: it exports no `hemicube_backend`")]
    NoTable,
    /// It was built for another version of the ABI.
    #[error("built for ABI {found}, this program speaks ABI {HC_ABI_VERSION}")]
    Abi {
        /// Its version.
        found: u32,
    },
    /// Its table is smaller than any of this version is.
    #[error("truncated table: it says {found} bytes, ABI {HC_ABI_VERSION} has at least {TABLE_MIN}")]
    Truncated {
        /// Its message.
        found: u32,
    },
    /// A required function is NULL.
    #[error("its table has no `{0}`")]
    NoFunction(&'static str),
    /// Its name or version is malformed.
    #[error("its {what} {defect}")]
    Text {
        /// Name or version.
        what: &'static str,
        /// Kind of defect.
        defect: String,
    },
    /// It has another name than its file or whoever asked for it says.
    #[error("it calls itself `{found}`, not `{wanted}`")]
    Misnamed {
        /// Its name.
        found: String,
        /// The one asked for.
        wanted: String,
    },
}

/// A library with a valid table. Stays loaded until the process ends.
///
/// ```
/// use hemicube_host::{Library, LoadError, file_name};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join(file_name("mine"));
///
/// assert_eq!(Library::load(&path).err(), Some(LoadError::Missing));
///
/// // A file of the right name is not yet a library: the system's loader refuses it.
/// std::fs::write(&path, "not a library")?;
/// assert!(matches!(Library::load(&path), Err(LoadError::Refused(_))));
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Library {
    table: HcBackend,
    path: PathBuf,
    name: String,
    version: String,
    /// The context of the plugin's log. Leaked: the plugin may keep it forever.
    log: &'static LogContext,
}

#[derive(Debug)]
struct LogContext {
    name: String,
}

impl Library {
    /// Opens a library and judges its table. Runs its initialisers, if it has any.
    ///
    /// # Errors
    /// [`LoadError`], with the loader's own words if the loader refused.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let path = std::path::absolute(path).map_err(|error| LoadError::Refused(error.to_string()))?;
        if !path.is_file() {
            return Err(LoadError::Missing);
        }
        if !OPENS_LIBRARIES {
            return Err(LoadError::Static);
        }
        #[cfg(unix)]
        crate::image::judge(&path)?;
        let address = open(&path)?;
        if address.is_null() || !address.is_aligned() {
            return Err(LoadError::NoTable);
        }
        // SAFETY: the library exports the symbol, and stays loaded. Nobody can prove its type; two numbers are read
        // first, and tables of all versions begin with these.
        let (abi_version, struct_size) = unsafe { (address.cast::<u32>().read(), address.cast::<u32>().add(1).read()) };
        if abi_version != HC_ABI_VERSION {
            return Err(LoadError::Abi { found: abi_version });
        }
        if (struct_size as usize) < TABLE_MIN {
            return Err(LoadError::Truncated { found: struct_size });
        }
        // SAFETY: it says to be a table of this version and of so many bytes, and it is never unloaded. What is beyond
        // its end stays zero, which is NULL in a table of pointers and numbers.
        let table = unsafe {
            let mut table = std::mem::MaybeUninit::<HcBackend>::zeroed();
            let bytes = (struct_size as usize).min(size_of::<HcBackend>());
            std::ptr::copy_nonoverlapping(address.cast::<u8>(), table.as_mut_ptr().cast::<u8>(), bytes);
            table.assume_init()
        };
        for (name, missing) in [
            ("devices", table.devices.is_none()),
            ("open", table.open.is_none()),
            ("load", table.load.is_none()),
            ("rows", table.rows.is_none()),
            ("close", table.close.is_none()),
        ] {
            if missing {
                return Err(LoadError::NoFunction(name));
            }
        }
        // SAFETY: NULL, or a C string in the image; no more than the limits is read.
        let (name, version) = unsafe {
            (
                text("name", table.name, NAME_MAX)?,
                text("version", table.version, VERSION_MAX)?,
            )
        };
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if !name.chars().all(allowed) {
            return Err(LoadError::Text {
                what: "name",
                defect: format!("`{name}` is not of a-z, 0-9 and `-`"),
            });
        }
        Ok(Self {
            table,
            path,
            log: Box::leak(Box::new(LogContext { name: name.clone() })),
            name,
            version,
        })
    }

    /// Opens a library of that name, and judges its table.
    ///
    /// # Errors
    /// [`LoadError`]; [`LoadError::Misnamed`] if it has another name.
    pub fn named(self, wanted: &str) -> Result<Self, LoadError> {
        if self.name == wanted {
            return Ok(self);
        }
        Err(LoadError::Misnamed {
            found: self.name,
            wanted: wanted.to_owned(),
        })
    }

    /// The backend's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The version of its arithmetic.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn table(&self) -> HcBackend {
        self.table
    }

    pub(crate) fn host(&self) -> HcHost {
        #[allow(clippy::cast_possible_truncation, reason = "some dozens of bytes")]
        HcHost {
            struct_size: size_of::<HcHost>() as u32,
            reserved: 0,
            context: std::ptr::from_ref(self.log).cast_mut().cast(),
            log: Some(log),
        }
    }

    /// Lists its devices, best first.
    ///
    /// # Errors
    /// The plugin's message, if it cannot tell.
    pub fn devices(&self) -> Result<Vec<Device>, BackendError> {
        let Some(devices) = self.table.devices else {
            unreachable!("judged when it was loaded")
        };
        let empty = HcDevice {
            name: [0; 128],
            capabilities: 0,
            kind: 0,
            max_resolution: 0,
            preferred_rows: 0,
            reserved: [0; 9],
        };
        let mut raw = Guarded::new([empty; DEVICES_MAX]);
        let mut count = Guarded::new(0u32);
        let mut answer = Answer::new();
        #[allow(clippy::cast_possible_truncation, reason = "64")]
        // SAFETY: a function of the table, any-thread; room for as many devices as it is told of.
        let status = unsafe {
            devices(
                raw.as_mut_ptr().cast(),
                DEVICES_MAX as u32,
                count.as_mut_ptr(),
                answer.as_mut_ptr(),
            )
        };
        raw.check(self, "devices");
        count.check(self, "devices");
        answer.read(self, "devices", status)?;
        Ok(raw
            .get()
            .iter()
            .take(count.get() as usize)
            .map(|raw| Device {
                name: until_nul(&raw.name),
                kind: DeviceKind::from_raw(raw.kind),
                capabilities: capabilities_from_raw(raw.capabilities),
                max_resolution: raw.max_resolution,
                preferred_rows: raw.preferred_rows.max(1) as usize,
            })
            .collect())
    }
}

/// Reads the text of an array up to its NUL, or all of it; marks invalid UTF-8.
pub(crate) fn until_nul(text: &[c_char]) -> String {
    let bytes: Vec<u8> = text
        .iter()
        .map(|&c| c.cast_unsigned_byte())
        .take_while(|&byte| byte != 0)
        .collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// `c_char` is signed on some platforms and not on others.
trait Byte {
    fn cast_unsigned_byte(self) -> u8;
}

impl Byte for i8 {
    fn cast_unsigned_byte(self) -> u8 {
        self.cast_unsigned()
    }
}

impl Byte for u8 {
    fn cast_unsigned_byte(self) -> u8 {
        self
    }
}

/// # Safety
/// NULL, or readable up to a NUL or `max + 1` bytes.
unsafe fn text(what: &'static str, pointer: *const c_char, max: usize) -> Result<String, LoadError> {
    let bad = |defect: String| LoadError::Text { what, defect };
    if pointer.is_null() {
        return Err(bad("is NULL".to_owned()));
    }
    let mut bytes = Vec::new();
    loop {
        // SAFETY: within what is readable: there was no NUL so far, and no more than `max` bytes.
        let byte = unsafe { pointer.add(bytes.len()).read() }.cast_unsigned_byte();
        if byte == 0 {
            break;
        }
        bytes.push(byte);
        if bytes.len() > max {
            return Err(bad(format!("is longer than {max} bytes")));
        }
    }
    if bytes.is_empty() {
        return Err(bad("is empty".to_owned()));
    }
    String::from_utf8(bytes).map_err(|_| bad("is not UTF-8".to_owned()))
}

/// Passes a plugin's log on to the program's log.
unsafe extern "C" fn log(context: *mut c_void, level: i32, message: *const c_char) {
    if context.is_null() || message.is_null() {
        return;
    }
    // SAFETY: the context is the leaked one that `open` was given; the message is a C string by the ABI.
    let (context, message) = unsafe { (&*context.cast::<LogContext>(), CStr::from_ptr(message)) };
    let (backend, message) = (context.name.as_str(), message.to_string_lossy());
    match level {
        hemicube_abi::types::HC_LOG_ERROR => tracing::error!(target: "hemicube::plugin", "{backend}: {message}"),
        hemicube_abi::types::HC_LOG_WARN => tracing::warn!(target: "hemicube::plugin", "{backend}: {message}"),
        hemicube_abi::types::HC_LOG_INFO => tracing::info!(target: "hemicube::plugin", "{backend}: {message}"),
        _ => tracing::debug!(target: "hemicube::plugin", "{backend}: {message}"),
    }
}

#[cfg(unix)]
fn open(path: &Path) -> Result<*const HcBackend, LoadError> {
    use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
    // SAFETY: initialisers of the library run: the user naming a backend trusts it like the program itself.
    let library = unsafe { Library::open(Some(path), RTLD_NOW | RTLD_LOCAL) }.map_err(|error| refused(path, &error))?;
    // Never unloaded, whatever comes: its initialisers may have started threads.
    let library = std::mem::ManuallyDrop::new(library);
    // SAFETY: only the address is taken.
    let symbol = unsafe { library.get::<*const HcBackend>(SYMBOL.to_bytes_with_nul()) };
    symbol
        .map(|symbol| symbol.as_raw_ptr().cast_const().cast())
        .map_err(|_| LoadError::NoTable)
}

#[cfg(windows)]
fn open(path: &Path) -> Result<*const HcBackend, LoadError> {
    use libloading::os::windows::{LOAD_LIBRARY_SEARCH_DEFAULT_DIRS, LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR, Library};
    let flags = LOAD_LIBRARY_SEARCH_DEFAULT_DIRS | LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR;
    // SAFETY: initialisers of the library run: the user naming a backend trusts it like the program itself.
    let library = unsafe { Library::load_with_flags(path, flags) }.map_err(|error| refused(path, &error))?;
    // Never unloaded, whatever comes: its initialisers may have started threads.
    let library = std::mem::ManuallyDrop::new(library);
    // SAFETY: only the address is taken.
    let symbol = unsafe { library.get::<*const HcBackend>(SYMBOL.to_bytes_with_nul()) };
    symbol
        .map(|symbol| symbol.as_raw_ptr().cast_const().cast())
        .map_err(|_| LoadError::NoTable)
}

/// Returns the loader's own words without the leading path: the caller names it.
fn refused(path: &Path, error: &libloading::Error) -> LoadError {
    let text = std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string);
    let prefix = format!("{}: ", path.display());
    LoadError::Refused(text.replace(&prefix, ""))
}
