//! How a run is recorded.

/// `[record]` of a rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// The session; `None`: `session.mcap` in the results folder.
    pub file: Option<String>,
    /// How pictures are recorded.
    pub pictures: PictureForm,
    /// Quality of those that are JPEG, 1 to 100.
    pub jpeg_quality: u8,
    /// How those of single cameras are, by patterns of their names; the first that matches decides.
    pub cameras: Vec<(String, PictureForm)>,
    /// Parts of pictures that are recorded black, by patterns of cameras' names: left, top, width, height [px].
    pub hide_px: Vec<(String, Vec<[u32; 4]>)>,
    /// Scales that are recorded black in pictures of other scales, and whose own pictures are not recorded.
    pub hide_scales: Vec<String>,
    /// How the file is compressed.
    pub compression: SessionPacking,
    /// What may wait for the disk [MB].
    pub memory_mb: u32,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            file: None,
            pictures: PictureForm::Lossless,
            jpeg_quality: 90,
            cameras: Vec::new(),
            hide_px: Vec::new(),
            hide_scales: Vec::new(),
            compression: SessionPacking::Lz4,
            // Two seconds of 18 wide cameras: a disk pauses for less.
            memory_mb: 256,
        }
    }
}

/// How a picture is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureForm {
    /// Every level of every pixel.
    Lossless,
    /// As JPEG.
    Jpeg,
    /// Not at all.
    None,
}

/// How a session is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionPacking {
    /// Not at all: the least work.
    None,
    /// LZ4: little work.
    Lz4,
    /// Zstandard, its fastest level: smaller, and slower.
    Zstd,
}
