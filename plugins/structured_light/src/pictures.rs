//! `structured_light.pictures`: sets of pictures of patterns, a folder each.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use foveate::prelude::*;
use foveate::scene::natural_order;
use foveate::scene::selection::matches;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::counter;
use crate::pattern::{MANIFEST, PatternSettings};
use crate::picture_file::{Gray, Levels, Note, decode};

ports! {
    PICTURES: Out<PatternPictures> = "pictures";
}

figures! {
    "pictures.sets.*": count, high, "Sets of pictures that were read, in a folder of the camera each";
    "pictures.unreadable.*": count, low, "Pictures of these sets that could not be read, or not at the size of the others; each counts as black";
}

/// Settings of [`Pictures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PicturesSettings {
    /// A folder of pictures (PNG, JPEG, TIFF, BMP, PGM, PPM) in the order of their names, numbers in them counting as numbers; or a folder of such folders, or several by `*` and `?` in its last part, as in
    /// `scans/pose_*`; `{camera}` is the camera's name, `${NAME}` an environment variable [–]
    pub path: String,
    /// Which files of a folder are pictures of the set, by `*` and `?` [–]
    #[serde(default = "default_files")]
    pub files: String,
    /// Sets a second, by which they get times: the first at 0 [Hz]
    #[serde(default = "default_rate")]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub rate_hz: f64,
}

fn default_files() -> String {
    "*".to_owned()
}

fn default_rate() -> f64 {
    1.0
}

/// Endings of files that are pictures.
const ENDINGS: [&str; 8] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm", "ppm"];
/// Pictures in a set, at most: another kind of folder is refused before it fills the memory.
const MAX_PICTURES: usize = 400;

/// Sets of pictures out, one for each folder.
pub struct Pictures {
    camera: CameraId,
    camera_name: String,
    rate_hz: f64,
    sets: Vec<Vec<PathBuf>>,
    next: usize,
    unreadable: Vec<String>,
    notes: Vec<String>,
}

impl Node for Pictures {
    const TYPE: &'static str = "structured_light.pictures";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads sets of pictures of projected patterns, one folder per set";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PicturesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PicturesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 0.001..=1000.0)?;
        let camera = setup.camera.ok_or_else(|| {
            ConfigError::node(format_args!("`{}` serves one camera: say which with `camera = \"name\"`", Self::TYPE))
        })?;
        let path = setup.path("path", &settings.path)?;
        let sets = sets(&path, &settings.files).map_err(|fault| ConfigError::at("path", fault))?;
        check_manifests(&sets, setup)?;
        let camera_name = setup.camera_name().unwrap_or(&setup.instance).to_owned();
        Ok(Self {
            camera,
            camera_name,
            rate_hz: settings.rate_hz,
            sets,
            next: 0,
            unreadable: Vec::new(),
            notes: Vec::new(),
        })
    }

    fn due(&mut self) -> Due {
        if self.next < self.sets.len() { Due::At(self.time()) } else { Due::Never }
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = self.time();
        let Some(files) = self.sets.get(self.next) else { return Ok(()) };
        self.next += 1;
        match read(files) {
            Ok(Read { mut set, faults, notes }) => {
                set.camera = self.camera;
                self.unreadable.extend(faults);
                self.notes.extend(notes);
                io.emit_at(&PICTURES, time, set);
            }
            Err(reason) => {
                self.unreadable.push(reason.clone());
                io.gap(&PICTURES, time, reason);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure(format!("pictures.sets.{}", self.camera_name), self.next as f64);
        report.figure(format!("pictures.unreadable.{}", self.camera_name), self.unreadable.len() as f64);
        self.unreadable.iter().chain(&self.notes).for_each(|it| report.remark(it.clone()));
        Ok(())
    }

    fn plan(settings: &PicturesSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), ..Plan::default() }
    }
}

impl Pictures {
    fn time(&self) -> Time {
        Time::from_s(self.next as f64 / self.rate_hz)
    }
}

/// The files of each set.
pub(crate) fn sets(path: &Path, files: &str) -> Result<Vec<Vec<PathBuf>>, String> {
    let last = path.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
    let folders = if last.contains(['*', '?']) && !path.exists() {
        let parent = path.parent().unwrap_or(Path::new(""));
        folders_in(parent)?.into_iter().filter(|it| matches(&last, &name_of(it))).collect()
    } else {
        let own = pictures_in(path, files)?;
        if !own.is_empty() {
            return check_count(path, vec![own]);
        }
        folders_in(path)?
    };
    let all: Vec<Vec<PathBuf>> = folders.iter().map(|it| pictures_in(it, files)).collect::<Result<_, _>>()?;
    check_count(path, all.into_iter().filter(|it| !it.is_empty()).collect())
}

fn check_count(path: &Path, sets: Vec<Vec<PathBuf>>) -> Result<Vec<Vec<PathBuf>>, String> {
    let shown = path.display();
    if sets.is_empty() {
        return Err(format!(
            "found no pictures in `{shown}`{}, expected PNG, JPEG, TIFF, BMP, PGM or PPM files, or folders of them",
            others(path)
        ));
    }
    match sets.iter().map(Vec::len).find(|it| *it > MAX_PICTURES) {
        Some(n) => {
            Err(format!("found {n} pictures in a folder of `{shown}`, expected at most {MAX_PICTURES} in a set"))
        }
        None => Ok(sets),
    }
}

/// What else is in a folder without pictures: pictures of other kinds, which other programs convert.
fn others(path: &Path) -> String {
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for it in entries(path).unwrap_or_default().iter().filter(|it| it.is_file()) {
        let ending = it.extension().map(|it| harmless(&it.to_string_lossy().to_lowercase()));
        *kinds.entry(ending.unwrap_or_default()).or_default() += 1;
    }
    let most = kinds.iter().filter(|it| !it.0.is_empty()).max_by_key(|it| *it.1);
    most.map(|(ending, count)| format!(" but {count} files `*.{ending}`")).unwrap_or_default()
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let list = fs::read_dir(folder).map_err(|error| format!("cannot read `{}`: {error}", folder.display()))?;
    let mut paths: Vec<PathBuf> = list.filter_map(|it| Some(it.ok()?.path())).collect();
    paths.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
    Ok(paths)
}

fn folders_in(folder: &Path) -> Result<Vec<PathBuf>, String> {
    Ok(entries(folder)?.into_iter().filter(|it| it.is_dir()).collect())
}

fn pictures_in(folder: &Path, files: &str) -> Result<Vec<PathBuf>, String> {
    let is_picture = |it: &PathBuf| {
        let ending = it.extension().map(|it| it.to_string_lossy().to_lowercase()).unwrap_or_default();
        // Hidden files are leavings of file systems and programs, `._0001.jpg` among them.
        let is_hidden = name_of(it).starts_with('.');
        ENDINGS.contains(&ending.as_str()) && !is_hidden && matches(files, &name_of(it)) && it.is_file()
    };
    let mut files: Vec<PathBuf> = entries(folder)?.into_iter().filter(is_picture).collect();
    kept_twice(folder, &files)?;
    let first = counter::first_taken(&files);
    files.rotate_left(first);
    Ok(files)
}

/// Refuses a folder in which pictures lie in two formats, as cameras keep them: they would count as two each.
fn kept_twice(folder: &Path, files: &[PathBuf]) -> Result<(), String> {
    let mut endings: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for it in files {
        let of = |part: Option<&std::ffi::OsStr>| part.map(|it| harmless(&it.to_string_lossy())).unwrap_or_default();
        endings.entry(of(it.file_stem())).or_default().push(of(it.extension()));
    }
    let mut twice = endings.values().filter(|it| it.len() > 1);
    match twice.next() {
        Some(kinds) if 2 * (twice.count() + 1) > endings.len() => Err(format!(
            "found pictures of the same names as {} in `{}`, expected each once: `files = \"*.{}\"` takes one kind",
            kinds.iter().map(|it| format!("`*.{it}`")).collect::<Vec<_>>().join(" and "),
            shown(folder),
            kinds[0]
        )),
        _ => Ok(()),
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default()
}

/// What the files beside pictures say of their patterns, where no set could be decoded by them.
fn check_manifests(sets: &[Vec<PathBuf>], setup: &Setup) -> Result<(), ConfigError> {
    let cameras = &setup.calibration.cameras;
    let fault_of = |set: &Vec<PathBuf>| -> Option<String> {
        let file = set.first()?.parent()?.join(MANIFEST);
        let text = fs::read_to_string(&file).ok()?;
        let size = match PatternSettings::read(&text) {
            Ok(settings) => settings.projector_px,
            Err(fault) => return Some(format!("`{}`: {}", shown(&file), fault.trim_end())),
        };
        let [columns, rows] = size;
        let is_there = cameras.len() < 2 || cameras.iter().any(|it| it.camera.image_size == size);
        (!is_there).then(|| {
            let sizes: Vec<String> = cameras
                .iter()
                .map(|it| format!("`{}` {} x {} px", it.name, it.camera.image_size[0], it.camera.image_size[1]))
                .collect();
            format!(
                "`{}` is for a projector of {columns} x {rows} px, expected the size of one in the calibration: {}",
                shown(&file),
                sizes.join(", ")
            )
        })
    };
    let faults: Vec<String> = sets.iter().filter_map(fault_of).collect();
    match faults.first() {
        Some(first) if faults.len() == sets.len() => Err(ConfigError::at("path", first)),
        _ => Ok(()),
    }
}

/// A set, what could not be read of it, and what is to be known of the rest.
pub(crate) struct Read {
    pub(crate) set: PatternPictures,
    pub(crate) faults: Vec<String>,
    pub(crate) notes: Vec<String>,
}

/// Reads a set, as many pictures at once as the machine has cores. A picture that cannot be read is black, so that the others keep their places.
pub(crate) fn read(files: &[PathBuf]) -> Result<Read, String> {
    let gray: Vec<Mutex<Option<Result<Gray, String>>>> = files.iter().map(|_| Mutex::new(None)).collect();
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(at) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|it| *it < files.len()) {
            *gray[at].lock().unwrap_or_else(PoisonError::into_inner) = Some(decode(&files[at]));
        }
    };
    std::thread::scope(|scope| {
        let helpers = std::thread::available_parallelism().map_or(1, |it| it.get()).min(files.len());
        (1..helpers).for_each(|_| drop(scope.spawn(work)));
        work();
    });
    let read = gray.into_iter().map(|it| it.into_inner().unwrap_or_else(PoisonError::into_inner));
    let read: Vec<Result<Gray, String>> = read.map(|it| it.unwrap_or_else(|| Err("was not read".to_owned()))).collect();
    let folder = files.first().and_then(|it| it.parent()).unwrap_or(Path::new(""));
    // The size that most have: the first may be the one that is wrong.
    let count = |size: [u32; 2]| read.iter().flatten().filter(|it| it.size == size).count();
    let size = read.iter().flatten().map(|it| it.size).max_by_key(|it| count(*it));
    let Some(size) = size else {
        let first = read.iter().find_map(|it| it.as_ref().err().cloned()).unwrap_or_default();
        let file = files.first().map(|it| shown(it)).unwrap_or_default();
        return Err(format!("no picture in `{}` can be read: `{file}` {first}", shown(folder)));
    };
    let notes = notes(files, &read);
    let shift = used_bits(&read).saturating_sub(8);
    let mut set = PatternPictures {
        name: harmless(&name_of(folder)),
        width: size[0],
        height: size[1],
        manifest: fs::read_to_string(folder.join(MANIFEST)).unwrap_or_default(),
        ..PatternPictures::default()
    };
    let n = size[0] as usize * size[1] as usize;
    let mut faults = Vec::new();
    for (path, one) in files.iter().zip(read) {
        let place = set.names.len() as u32;
        set.names.push(format!("{}/{}", set.name, harmless(&name_of(path))));
        let fault = match one {
            Ok(gray) if gray.size == size => {
                match gray.levels {
                    Levels::Eight(it) => set.pixels.extend(it),
                    Levels::Sixteen(it) => set.pixels.extend(it.iter().map(|it| (it >> shift) as u8)),
                }
                continue;
            }
            Ok(Gray { size: [columns, rows], .. }) => {
                format!("is {columns} x {rows} px, expected {} x {} px as the others", size[0], size[1])
            }
            Err(fault) => fault,
        };
        set.pixels.resize(set.pixels.len() + n, 0);
        set.unreadable.push(place);
        faults.push(format!("`{}` {fault}", shown(path)));
    }
    Ok(Read { set, faults, notes })
}

/// Bits that pictures of 16 use: cameras with 10 or 12 leave the upper ones empty. They are the same for all pictures of a set.
fn used_bits(read: &[Result<Gray, String>]) -> u32 {
    let largest = |it: &Gray| match &it.levels {
        Levels::Eight(_) => 0,
        Levels::Sixteen(levels) => levels.iter().copied().max().unwrap_or(0),
    };
    let largest = read.iter().flatten().map(largest).max().unwrap_or(0);
    (u16::BITS - largest.leading_zeros()).max(8)
}

/// What is to be known of pictures that can be read, a sentence for each kind of it.
fn notes(files: &[PathBuf], read: &[Result<Gray, String>]) -> Vec<String> {
    let both = || files.iter().zip(read).filter_map(|(file, gray)| Some((file, gray.as_ref().ok()?)));
    let mut kinds: BTreeMap<Note, (String, usize)> = BTreeMap::new();
    for (file, gray) in both() {
        for note in &gray.notes {
            kinds.entry(*note).or_insert_with(|| (shown(file), 0)).1 += 1;
        }
    }
    let n = both().count();
    let say = |(note, (first, count)): (Note, (String, usize))| {
        let who = match count {
            1 => format!("`{first}`"),
            _ => format!("{count} of {n} pictures, `{first}` the first,"),
        };
        let (has, says) = if count == 1 { ("has", "says") } else { ("have", "say") };
        match note {
            Note::Wide => {
                let bits = used_bits(read);
                let mixed = if count == n { "" } else { ", others 8" };
                format!("{who} {has} 16 bits a channel{mixed}; {bits} are used, and of these the upper 8")
            }
            Note::Alpha => format!("{who} {has} transparent pixels, whose transparency is ignored"),
            Note::Turned => format!(
                "{who} {says} by EXIF that they should be rotated, which is ignored: pixels stay as the camera gave them, as in its calibration"
            ),
        }
    };
    // The other way round they would have stood in the order of their names.
    let mut by_name = files.to_vec();
    by_name.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
    let first = counter::first_taken(&by_name);
    let counter = (first > 0).then(|| {
        let (before, after) = (shown(&by_name[by_name.len() - 1]), name_of(&by_name[0]));
        format!("the camera's counter wrapped around after `{before}`: `{after}` is the next picture")
    });
    kinds.into_iter().map(say).chain(counter).collect()
}

/// A path for people: what is in a name must not steer a terminal.
fn shown(path: &Path) -> String {
    harmless(&path.display().to_string())
}

fn harmless(words: &str) -> String {
    words.chars().map(|it| if it.is_control() { '\u{fffd}' } else { it }).collect()
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};

    use super::*;

    fn write(path: &Path, columns: u32, level: u8) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        GrayImage::from_pixel(columns, 2, Luma([level])).save(path).unwrap();
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Pictures>("path = \"scans/pose_*\"\nrate_hz = 2.0");
    }

    #[test]
    fn folders_and_their_pictures_come_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for (pose, picture) in [(10, 2), (10, 11), (9, 1), (10, 1)] {
            write(&folder.path().join(format!("pose_{pose}/{picture}.png")), 3, picture);
        }
        fs::write(folder.path().join("pose_10/notes.txt"), "none").unwrap();
        for path in [folder.path().to_owned(), folder.path().join("pose_*")] {
            let found = sets(&path, "*").unwrap();
            assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [1, 3]);
            let set = read(&found[1]).unwrap().set;
            assert_eq!(set.names, ["pose_10/1.png", "pose_10/2.png", "pose_10/11.png"]);
            assert_eq!((set.width, set.height, set.picture(2)), (3, 2, Some(&[11; 6][..])));
        }
        assert_eq!(sets(&folder.path().join("pose_9"), "*").unwrap().len(), 1);
        let few = sets(&folder.path().join("pose_10"), "1*.png").unwrap();
        assert_eq!(few[0].len(), 2);
    }

    #[test]
    fn pictures_stand_in_the_order_in_which_a_counter_that_began_anew_took_them() {
        let folder = tempfile::tempdir().unwrap();
        for (at, name) in ["DSC_9998", "DSC_9999", "DSC_0001", "DSC_0002"].iter().enumerate() {
            write(&folder.path().join(format!("{name}.png")), 3, at as u8);
        }
        let Read { set, notes, .. } = read(&sets(folder.path(), "*").unwrap()[0]).unwrap();
        assert_eq!([0, 1, 2, 3].map(|it| set.picture(it).unwrap()[0]), [0, 1, 2, 3]);
        assert!(notes[0].contains("DSC_9999.png`: `DSC_0001.png`"), "{notes:?}");
    }

    #[test]
    fn a_picture_that_cannot_be_read_is_named_and_the_others_keep_their_places() {
        let folder = tempfile::tempdir().unwrap();
        (0..4).for_each(|it| write(&folder.path().join(format!("{it}.png")), if it == 0 { 5 } else { 3 }, 7));
        fs::write(folder.path().join("2.png"), "no picture").unwrap();
        let found = sets(folder.path(), "*").unwrap();
        let Read { set, faults, .. } = read(&found[0]).unwrap();
        assert_eq!(set.unreadable, [0, 2]);
        assert!(faults[0].contains("0.png` is 5 x 2 px, expected 3 x 2 px"), "{faults:?}");
        assert!(faults[1].contains("2.png` cannot be"), "{faults:?}");
        assert_eq!((faults.len(), set.picture(2), set.picture(3)), (2, Some(&[0; 6][..]), Some(&[7; 6][..])));
    }

    #[test]
    fn a_jpeg_that_was_cut_off_is_named() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1.jpg", "2.jpg"] {
            GrayImage::from_fn(64, 48, |x, y| Luma([(x * y * 37) as u8])).save(folder.path().join(name)).unwrap();
        }
        let whole = fs::read(folder.path().join("2.jpg")).unwrap();
        fs::write(folder.path().join("2.jpg"), &whole[..whole.len() * 3 / 4]).unwrap();
        let Read { set, faults, .. } = read(&sets(folder.path(), "*").unwrap()[0]).unwrap();
        assert_eq!(set.unreadable, [1]);
        assert!(faults[0].contains("2.jpg` is a truncated JPEG"), "{faults:?}");
    }

    #[test]
    fn pictures_of_other_kinds_are_taken_and_told() {
        type Wide = image::ImageBuffer<Luma<u16>, Vec<u16>>;
        let folder = tempfile::tempdir().unwrap();
        // Twelve bits in sixteen.
        for (at, level) in [(0, 4095_u16), (1, 2048)] {
            Wide::from_pixel(4, 2, Luma([level])).save(folder.path().join(format!("{at}.png"))).unwrap();
        }
        let clear = image::Rgba([90, 90, 90, 0]);
        image::RgbaImage::from_pixel(4, 2, clear).save(folder.path().join("2.png")).unwrap();
        image::RgbImage::from_pixel(4, 2, image::Rgb([7, 7, 7])).save(folder.path().join("3\u{1b}.png")).unwrap();
        let Read { set, faults, notes } = read(&sets(folder.path(), "*").unwrap()[0]).unwrap();
        let levels: Vec<u8> = (0..4).map(|it| set.picture(it).unwrap()[0]).collect();
        assert_eq!((levels, faults), (vec![255, 128, 90, 7], Vec::<String>::new()));
        assert!(notes[0].contains("have 16 bits a channel, others 8; 12 are used"), "{notes:?}");
        assert!(notes[1].contains("2.png` has transparent pixels"), "{notes:?}");
        assert!(set.names[3].ends_with("/3\u{fffd}.png"), "{:?}", set.names);
    }

    #[test]
    fn bitmaps_are_read_and_hidden_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        for (at, ending) in ["bmp", "pgm", "png"].iter().enumerate() {
            write(&folder.path().join(format!("{at}.{ending}")), 3, 7 + at as u8);
        }
        fs::write(folder.path().join("._0.png"), "left by a file system").unwrap();
        let Read { set, faults, .. } = read(&sets(folder.path(), "*").unwrap()[0]).unwrap();
        assert_eq!((faults, set.names.len()), (Vec::new(), 3));
        assert_eq!([0, 1, 2].map(|it| set.picture(it).unwrap()[0]), [7, 8, 9]);
    }

    #[test]
    fn pictures_that_lie_there_in_two_formats_are_told() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1.png", "1.bmp", "2.png", "2.bmp", "notes.png"] {
            write(&folder.path().join(name), 3, 7);
        }
        let fault = sets(folder.path(), "*").unwrap_err();
        assert!(fault.contains("as `*.bmp` and `*.png`") && fault.contains("`files = \"*.bmp\"`"), "{fault}");
        assert_eq!(sets(folder.path(), "*.png").unwrap()[0].len(), 3);
    }

    #[test]
    fn folders_without_pictures_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(sets(folder.path(), "*").unwrap_err().contains("found no pictures"));
        fs::write(folder.path().join("0.webp"), "another kind").unwrap();
        assert!(sets(folder.path(), "*").unwrap_err().contains("but 1 files `*.webp`, expected PNG"));
        assert!(sets(&folder.path().join("gone"), "*").unwrap_err().contains("cannot read"));
    }
}
