//! The descriptor of a library: a C structure behind a C function, with a frozen layout, that says how the library was built.
//!
//! Between a program and a library that was built apart, Rust's types are the same types only when source, features, versions of all dependencies, profile
//! and compiler agree; nothing warns when they do not, downcasts just give nothing. The hash of the `TypeId` of a type of this crate
//! covers all of these but the text of the sources (cargo names a crate by its place and not by its text), so that a hash of that text is stored
//! beside it. The texts are there to report what differs. A hash is no proof.

use std::any::TypeId;
use std::hash::{Hash, Hasher};
use std::sync::OnceLock;

use foveate_node::LibraryError;

/// Opens every descriptor.
const MAGIC: [u8; 8] = *b"FOVEATE\x01";
/// Raised when fields are appended; what is there keeps its place for ever.
const LAYOUT: u32 = 1;
/// Longest text that is believed [bytes].
const LONGEST: usize = 1 << 16;

/// Text that lives as long as the image that it is in.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Text {
    start: *const u8,
    /// [bytes].
    length: usize,
}

/// What a library says of itself. The layout is frozen: fields are only ever appended.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Descriptor {
    magic: [u8; 8],
    layout: u32,
    /// Of the whole structure [bytes].
    size: u32,
    name: Text,
    version: Text,
    foveate: Text,
    rustc: Text,
    target_features: Text,
    profile: Text,
    sources: Text,
    canary: u64,
    string: u64,
}

/// The descriptor of one library, made once.
pub struct Lazy(OnceLock<Descriptor>);

impl Default for Lazy {
    fn default() -> Self {
        Self::new()
    }
}

#[expect(unsafe_code, reason = "the texts are constants of the image, which nothing ever writes or frees")]
// SAFETY: the pointers of a descriptor are to `'static` text that is only read.
unsafe impl Send for Text {}
#[expect(unsafe_code, reason = "as above")]
// SAFETY: as above.
unsafe impl Sync for Text {}

impl Lazy {
    /// Not made yet.
    pub const fn new() -> Self {
        Self(OnceLock::new())
    }

    /// That of the library that this code stands in.
    pub fn get(&self, name: &'static str, version: &'static str) -> *const Descriptor {
        self.0.get_or_init(|| Descriptor::of(name, version))
    }
}

impl Text {
    const fn of(text: &'static str) -> Self {
        Self { start: text.as_ptr(), length: text.len() }
    }

    fn read(self) -> String {
        if self.start.is_null() || self.length > LONGEST {
            return "unknown".to_owned();
        }
        #[expect(unsafe_code, reason = "reads the text of another image")]
        // SAFETY: a descriptor with our magic and layout holds the place and length of constant text, and its image is never unloaded.
        let bytes = unsafe { std::slice::from_raw_parts(self.start, self.length) };
        String::from_utf8_lossy(bytes).into_owned()
    }
}

/// Its `TypeId` differs with version, features, dependencies, profile and compiler.
struct Canary;

impl Descriptor {
    /// How this crate was built into the image that runs this: the program, or the library of that name.
    pub fn of(name: &'static str, version: &'static str) -> Self {
        Self {
            magic: MAGIC,
            layout: LAYOUT,
            size: size_of::<Descriptor>() as u32,
            name: Text::of(name),
            version: Text::of(version),
            foveate: Text::of(env!("CARGO_PKG_VERSION")),
            rustc: Text::of(env!("FOVEATE_BUILD_RUSTC")),
            target_features: Text::of(env!("FOVEATE_BUILD_TARGET_FEATURES")),
            profile: Text::of(env!("FOVEATE_BUILD_PROFILE")),
            sources: Text::of(env!("FOVEATE_BUILD_SOURCES")),
            canary: hash_of::<Canary>(),
            string: hash_of::<String>(),
        }
    }

    /// Of the program itself.
    pub fn of_program() -> Self {
        Self::of("foveate", env!("CARGO_PKG_VERSION"))
    }

    /// Reads the descriptor of a library.
    ///
    /// # Errors
    /// When it is none, or one of a later layout.
    ///
    /// # Safety
    /// `at` is null, or leads to 16 bytes that may be read, and to a whole descriptor where these open one.
    #[expect(unsafe_code, reason = "reads what a library gave")]
    pub unsafe fn read(at: *const Descriptor) -> Result<Descriptor, LibraryError> {
        if at.is_null() {
            return Err(LibraryError::new("its descriptor is missing: found nothing, expected how it was built"));
        }
        // SAFETY: magic, layout and size are the first 16 bytes.
        let (magic, layout, size) = unsafe { ((*at).magic, (*at).layout, (*at).size) };
        if magic != MAGIC {
            return Err(LibraryError::new("its descriptor is of something else: it is no plugin for foveate"));
        }
        if layout < LAYOUT || (size as usize) < size_of::<Descriptor>() {
            let what =
                format!("found a descriptor of layout {layout} and {size} bytes, expected layout {LAYOUT} or later");
            return Err(LibraryError::new(what).help(REBUILD));
        }
        // SAFETY: of our layout or a later one, which has our fields at their places.
        Ok(unsafe { *at })
    }

    /// Name and version of the crate: "star_finder 0.1.0".
    pub fn title(&self) -> String {
        format!("{} {}", self.name.read(), self.version.read())
    }

    /// What of `library` differs from this program in a way that keeps the two apart, one line each; none when they fit.
    pub fn differences(&self, library: &Descriptor) -> Vec<String> {
        let mut lines = Vec::new();
        let mut compare = |what: &str, here: String, there: String| {
            if here != there {
                lines.push(format!("{what}: the program has {here}, the library {there}"));
            }
        };
        compare("foveate", self.foveate.read(), library.foveate.read());
        compare("compiler", self.rustc.read(), library.rustc.read());
        compare("profile", self.profile.read(), library.profile.read());
        let features = [self, library].map(|it| it.target_features.read());
        if features[0] != features[1] {
            let [here, there] = only(&features[0], &features[1]);
            compare("target features", here, there);
        }
        compare("sources of foveate", self.sources.read(), library.sources.read());
        let identity = "types (features and versions of dependencies, profile, compiler)";
        compare(identity, format!("{:016x}", self.canary), format!("{:016x}", library.canary));
        compare("standard library", format!("{:016x}", self.string), format!("{:016x}", library.string));
        lines
    }
}

/// What to do about a library that does not fit.
pub const REBUILD: &str = "build it for this program: `foveate plugin build DIR`";

/// Of two lists with commas, what only one has.
fn only(first: &str, second: &str) -> [String; 2] {
    let has = |list: &str, it: &str| list.split(',').any(|other| other == it);
    let left = |list: &str, other: &str| {
        let words: Vec<&str> = list.split(',').filter(|it| !has(other, it)).collect();
        if words.is_empty() { "none besides".to_owned() } else { words.join(",") }
    };
    [left(first, second), left(second, first)]
}

fn hash_of<T: 'static>() -> u64 {
    let mut hasher = Fnv(0xcbf2_9ce4_8422_2325);
    TypeId::of::<T>().hash(&mut hasher);
    hasher.finish()
}

/// FNV-1a: the same in every image.
struct Fnv(u64);

impl Hasher for Fnv {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(it: &Descriptor) -> Result<Descriptor, LibraryError> {
        #[expect(unsafe_code, reason = "a whole descriptor")]
        // SAFETY: a reference to a whole descriptor.
        unsafe {
            Descriptor::read(it)
        }
    }

    #[test]
    fn a_descriptor_of_the_same_build_fits_and_says_its_name() {
        let (program, library) = (Descriptor::of_program(), Descriptor::of("star_finder", "0.3.0"));
        assert_eq!(program.differences(&read(&library).unwrap()), Vec::<String>::new());
        assert_eq!(library.title(), "star_finder 0.3.0");
    }

    #[test]
    fn each_difference_is_told_with_both_sides() {
        let program = Descriptor::of_program();
        let other = Descriptor {
            foveate: Text::of("9.9.9"),
            rustc: Text::of("1.2.3 (abc, m68k)"),
            profile: Text::of("opt-level 0"),
            sources: Text::of("0"),
            canary: 1,
            string: 2,
            ..Descriptor::of("other", "1.0.0")
        };
        let told = program.differences(&read(&other).unwrap());
        assert_eq!(told.len(), 6, "{told:?}");
        assert!(
            told[1].starts_with("compiler: the program has 1.") && told[1].ends_with("the library 1.2.3 (abc, m68k)")
        );
        let text = |it| Descriptor { target_features: Text::of(it), ..program };
        let told = text("fxsr,sse,sse2").differences(&text("avx2,fxsr,sse,sse2"));
        assert_eq!(told, ["target features: the program has none besides, the library avx2"]);
    }

    #[test]
    fn what_is_no_descriptor_is_refused() {
        let sound = Descriptor::of("x", "1.0.0");
        let refused = |it: Descriptor| read(&it).unwrap_err().what;
        assert!(refused(Descriptor { magic: *b"ELFELFEL", ..sound }).contains("no plugin for foveate"));
        assert!(refused(Descriptor { layout: 0, ..sound }).contains("layout 0"));
        assert!(refused(Descriptor { size: 24, ..sound }).contains("24 bytes"));
        #[expect(unsafe_code, reason = "null is refused before it is read")]
        // SAFETY: null is allowed.
        let nothing = unsafe { Descriptor::read(std::ptr::null()) };
        assert!(nothing.unwrap_err().what.contains("found nothing"));
        let torn = Text { start: std::ptr::null(), length: 5 };
        assert_eq!(torn.read(), "unknown");
        assert_eq!(Text { length: usize::MAX, ..Text::of("x") }.read(), "unknown");
    }
}
