//! A library with a descriptor written by hand: of another compiler, of a later layout, of something else, or with nothing behind it.

#[repr(C)]
pub struct Text(*const u8, usize);

#[repr(C)]
pub struct Descriptor {
    magic: [u8; 8],
    layout: u32,
    size: u32,
    texts: [Text; 7],
    canary: u64,
    string: u64,
}

const fn text(it: &'static str) -> Text {
    Text(it.as_ptr(), it.len())
}

unsafe impl Sync for Descriptor {}

static DESCRIPTOR: Descriptor = Descriptor {
    magic: if cfg!(other_magic) { *b"SOMETHNG" } else { *b"FOVEATE\x01" },
    layout: if cfg!(no_layout) { 0 } else { 1 },
    size: size_of::<Descriptor>() as u32,
    texts: [
        text("fake"),
        text("3.2.1"),
        text("99.0.0"),
        text("1.2.3 (0123456789, m68k-unknown-none)"),
        text("avx1024"),
        text("opt-level 9"),
        text("0"),
    ],
    canary: 1,
    string: 2,
};

#[unsafe(no_mangle)]
pub extern "C" fn foveate_plugin_descriptor() -> *const Descriptor {
    if cfg!(null) { std::ptr::null() } else { &DESCRIPTOR }
}

/// A program that calls this does not check first.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_plugin_contents() {
    std::process::abort()
}
