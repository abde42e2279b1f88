//! `capture.images`: a folder of numbered pictures, one camera.
//!
//! Frame k has the capture time `start_s` + k / `rate_hz`, where k is the number in the file's name less the smallest number in the
//! folder (or less `first_number`). So cameras whose folders begin with the same number share their times, and a number
//! that is missing is a gap at its own time. A picture that cannot be used (truncated, corrupt, empty, of another size
//! than the calibration or the first good picture says) is a gap too, and the run continues.

use std::path::Path;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::decode::Decoder;
use crate::listing::Listing;
pub use crate::listing::Numbering;
use crate::settings::{Field, Format, Reasons, camera_of, frame_time, paths_of_cameras, where_others_have};

ports! {
    IMAGE: Out<Image> = "image";
}

/// Settings of [`Images`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImagesSettings {
    /// Folder of the pictures (`*.jpg`, `*.jpeg`, `*.png`), or a folder and a pattern with `*` and `?` as in
    /// `shots/{camera}/*.png`; `{camera}` is the camera's name, `${NAME}` an environment variable [–]
    pub path: String,
    /// Frame rate, which turns numbers into times [Hz]
    #[schemars(range(min = 0.001, max = 100000.0))]
    pub rate_hz: f64,
    /// Session time of the first frame, for cameras that started later than others [s]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub start_s: f64,
    /// What the pictures are decoded to [–]
    #[serde(default)]
    pub format: Format,
    /// Delay between capture and delivery of a picture, as of a real camera [ms]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub latency_ms: f64,
    /// How the frame of a file is found: by the number in its `name`, or by its place in the `order` of names [–]
    #[serde(default)]
    pub numbering: Numbering,
    /// Number of the frame at `start_s`; left out: the smallest number in the folders of all cameras, so that a
    /// camera whose first picture is missing stays in step. Files below it are left out [–]
    #[serde(default)]
    pub first_number: Option<u64>,
    /// Lines of interlaced frames that are kept, `odd` or `even`: the pictures then have half the height, and the calibration must be of such pictures [–]
    #[serde(default)]
    pub field: Field,
}

/// The smallest number over the folders of all cameras, where `path` names the camera.
fn smallest_number(settings: &ImagesSettings, setup: &Setup) -> Option<u64> {
    if settings.numbering == Numbering::Order || !settings.path.contains("{camera}") {
        return None;
    }
    let folders = paths_of_cameras(setup, &settings.path);
    // A folder that cannot be listed is its own camera's fault, and said there.
    folders.filter_map(|folder| Some(Listing::of(&folder, settings.numbering, None).ok()?.first)).min()
}

impl ImagesSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.001..=100_000.0)?;
        ConfigError::unless_in("start_s", self.start_s, 0.0..=1e6)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=60_000.0)
    }
}

/// Pictures out, in the order of their numbers.
pub struct Images {
    settings: ImagesSettings,
    sequence: Sequence,
    pool: Pool<Image>,
    instance: String,
}

/// Result of reading the next frame of a sequence.
#[derive(Debug)]
enum Next {
    Picture,
    Gap(String),
}

/// The frames of a folder in order.
struct Sequence {
    camera: CameraId,
    format: Format,
    field: Field,
    listing: Listing,
    /// Index of the next file in the listing.
    next_file: usize,
    /// Index of the next frame, present or not.
    next_index: u64,
    /// Columns, rows that every picture must have [px]; without a calibration unknown until the first good picture.
    size: Option<[u32; 2]>,
    decoder: Decoder,
    missing: Reasons,
    unusable: Reasons,
}

impl Sequence {
    fn is_over(&self) -> bool {
        self.next_index >= self.listing.length()
    }

    /// Decodes the next frame into `image`, or says why there is none; advances in both cases.
    fn read_next(&mut self, image: &mut Image) -> Next {
        let index = self.next_index;
        self.next_index += 1;
        let Some(frame) = self.listing.frames.get(self.next_file).filter(|it| it.index == index) else {
            self.missing.add((self.listing.first + index).to_string());
            // The same words for all of them, so that a log can count them.
            return Next::Gap("no file for this frame: its number is missing".to_owned());
        };
        self.next_file += 1;
        // The size of a whole frame is known by that of its field only after it was parted.
        let expected = self.size.filter(|_| self.field == Field::Whole);
        let read = self.decoder.read(&frame.path, self.format, expected, image).and_then(|()| {
            self.field.keep(image);
            let found = [image.width, image.height];
            match self.size.filter(|it| *it != found) {
                Some([columns, rows]) => {
                    let hint = if found == [columns, rows.div_ceil(2)] {
                        ": is this a calibration of whole frames? For fields, height, vertical focal length and vertical principal point are half as large"
                    } else {
                        ""
                    };
                    Err(format!("has fields of {} x {} px, expected {columns} x {rows} px{hint}", found[0], found[1]))
                }
                None => Ok(()),
            }
        });
        match read {
            Ok(()) => {
                self.size = Some([image.width, image.height]);
                image.camera = self.camera;
                Next::Picture
            }
            Err(fault) => {
                let reason = format!("`{}` {fault}", frame.path.display());
                self.unusable.add(reason.as_str());
                Next::Gap(reason)
            }
        }
    }
}

impl Node for Images {
    const TYPE: &'static str = "capture.images";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads numbered JPEG or PNG pictures of one camera from a folder";
    type Settings = ImagesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ImagesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let camera = camera_of(setup, Self::TYPE)?;
        let path = setup.path("path", &settings.path)?;
        let first_number = settings.first_number.or_else(|| smallest_number(&settings, setup));
        let listing = Listing::of(&path, settings.numbering, first_number).map_err(|fault| {
            let has = |path: &Path| Listing::of(path, settings.numbering, None).is_ok();
            ConfigError::at("path", fault + &where_others_have(setup, &settings.path, has))
        })?;
        let sequence = Sequence {
            camera,
            format: settings.format,
            field: settings.field,
            listing,
            next_file: 0,
            next_index: 0,
            size: setup.camera_model().map(|it| it.image_size),
            decoder: Decoder::default(),
            missing: Reasons::default(),
            unusable: Reasons::default(),
        };
        Ok(Self { settings, sequence, pool: Pool::default(), instance: setup.instance.clone() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = frame_time(self.settings.start_s, self.settings.rate_hz, self.sequence.next_index);
        let mut image = self.pool.take(Image::default);
        match self.sequence.read_next(&mut image) {
            Next::Picture => io.emit_at(&IMAGE, time, self.pool.share(image)),
            Next::Gap(reason) => {
                drop(self.pool.share(image));
                io.gap(&IMAGE, time, reason);
            }
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.sequence.is_over() {
            return Due::Never;
        }
        let time = frame_time(self.settings.start_s, self.settings.rate_hz, self.sequence.next_index);
        Due::At(time + Interval::from_ms(self.settings.latency_ms))
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let (sequence, instance) = (&self.sequence, &self.instance);
        if let Some(sentence) =
            sequence.unusable.sentence(&format!("{instance} could not use {}", pictures(sequence.unusable.count())))
        {
            report.remark(sentence);
        }
        let n_missing = sequence.missing.count();
        let what = format!("{instance} found no file for {n_missing} of {} frames, numbers", sequence.next_index);
        report.remarks.extend(sequence.missing.sentence(&what));
        if sequence.listing.before_first > 0 {
            report.remark(format!(
                "{instance} left out {} before first_number",
                pictures(sequence.listing.before_first as u64)
            ));
        }
        Ok(())
    }

    fn plan(settings: &ImagesSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), latency_s: settings.latency_ms * 1e-3, ..Plan::default() }
    }
}

fn pictures(count: u64) -> String {
    if count == 1 { "1 picture".to_owned() } else { format!("{count} pictures") }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;

    use super::*;
    use crate::decode::tests::jpeg;
    use crate::settings::tests::setup_with_camera;

    fn settings(path: &str) -> ImagesSettings {
        ImagesSettings {
            path: path.to_owned(),
            rate_hz: 20.0,
            start_s: 0.0,
            format: Format::Gray,
            latency_ms: 30.0,
            numbering: Numbering::Name,
            first_number: None,
            field: Field::Whole,
        }
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Images>("path = \"shots\"\nrate_hz = 60.0\nfirst_number = 3");
    }

    #[test]
    fn good_pictures_come_out_and_each_fault_is_a_gap_that_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let whole = jpeg(64, 48);
        let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
        write("a_007.jpg", &whole);
        write("a_008.jpg", &whole[..whole.len() / 2]);
        write("a_010.jpg", b"");
        write("a_011.jpg", b"hello");
        write("a_012.jpg", &jpeg(32, 48));
        write("a_013.jpg", &whole);
        let mut node = Images::new(settings(folder.path().to_str().unwrap()), &setup_with_camera([64, 48])).unwrap();
        let mut image = Image::default();
        let mut seen = Vec::new();
        while node.due() != Due::Never {
            seen.push(match node.sequence.read_next(&mut image) {
                Next::Picture => format!("{} x {}", image.width, image.height),
                Next::Gap(reason) => reason,
            });
        }
        let expected = [
            "64 x 48",
            "a_008.jpg` is a truncated",
            "number is missing",
            "a_010.jpg` is empty",
            "`hello`",
            "32 x 48 px, expected 64 x 48",
            "64 x 48",
        ];
        assert_eq!(seen.len(), expected.len());
        for (found, expected) in seen.iter().zip(expected) {
            assert!(found.contains(expected), "{found} lacks {expected}");
        }
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(
            report.remarks[0].contains("4 pictures") && report.remarks[0].contains("and 1 more"),
            "{:?}",
            report.remarks
        );
        assert!(report.remarks[1].contains("1 of 7 frames, numbers: 9"), "{:?}", report.remarks);
    }

    #[test]
    fn a_camera_without_pictures_beside_others_is_told_how_to_be_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(3));
        let path = format!("{}/{{camera}}/*.jpg", folder.path().display());
        let refused = || {
            let setup = Setup { calibration: calibration.clone(), camera: Some(CameraId(1)), ..Setup::for_tests() };
            Images::new(settings(&path), &setup).err().unwrap().message
        };
        assert!(!refused().contains("each"), "{}", refused());
        for camera in [0, 2] {
            let own = folder.path().join(&calibration.cameras[camera].name);
            fs::create_dir(&own).unwrap();
            fs::write(own.join("1.jpg"), jpeg(16, 16)).unwrap();
        }
        let expected = format!("2 of 3 cameras have theirs: `each = [\"*\", \"!{}\"]`", calibration.cameras[1].name);
        assert!(refused().contains(&expected), "{}", refused());
    }

    #[test]
    fn of_interlaced_frames_every_second_line_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        // Seven lines, each as bright as its number.
        let lines: Vec<u8> = (0..7 * 16).map(|it| it / 16 + 1).collect();
        image::save_buffer(folder.path().join("1.png"), &lines, 16, 7, image::ExtendedColorType::L8).unwrap();
        for (field, expected) in [(Field::Odd, vec![1, 3, 5, 7]), (Field::Even, vec![2, 4, 6])] {
            let settings = ImagesSettings { field, ..settings(folder.path().to_str().unwrap()) };
            let mut node = Images::new(settings.clone(), &setup_with_camera([16, expected.len() as u32])).unwrap();
            let mut image = Image::default();
            assert!(matches!(node.sequence.read_next(&mut image), Next::Picture));
            assert_eq!((image.width, image.height as usize), (16, expected.len()));
            assert_eq!(image.pixels.chunks(16).map(|it| it[3]).collect::<Vec<_>>(), expected);
            let mut node = Images::new(settings, &setup_with_camera([16, 7])).unwrap();
            let Next::Gap(reason) = node.sequence.read_next(&mut image) else { panic!("a field as high as a frame") };
            assert!(reason.contains("has fields of 16 x") && reason.contains("expected 16 x 7"), "{reason}");
        }
    }

    #[test]
    fn pictures_are_due_when_they_would_arrive() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("3.jpg"), jpeg(16, 16)).unwrap();
        fs::write(folder.path().join("4.jpg"), jpeg(16, 16)).unwrap();
        let mut node = Images::new(settings(folder.path().to_str().unwrap()), &setup_with_camera([16, 16])).unwrap();
        assert_eq!(node.due(), Due::At(Time::from_s(0.03)));
        node.sequence.read_next(&mut Image::default());
        assert_eq!(node.due(), Due::At(Time::from_s(0.08)));
    }

    #[test]
    fn what_cannot_run_is_refused_before_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let mut setup = setup_with_camera([16, 16]);
        setup.purpose = Purpose::Check;
        let refused = |settings: ImagesSettings, setup: &Setup| Images::new(settings, setup).map(|_| ()).unwrap_err();
        let path = folder.path().to_str().unwrap();
        let empty = refused(settings(path), &setup);
        assert_eq!(empty.setting.as_deref(), Some("path"));
        assert!(empty.message.contains(path), "{empty}");
        let still = refused(ImagesSettings { rate_hz: -1.0, ..settings(path) }, &setup);
        assert_eq!(still.setting.as_deref(), Some("rate_hz"));
        setup.camera = None;
        assert!(refused(settings(path), &setup).message.contains("each"));
    }

    #[test]
    fn real_recording_is_read_without_a_gap() {
        let test = "capture.images on a real recording";
        let Some(folder) = foveate_testkit::data_dir_or_skip(test, "s01_arctic_laser_4cam/arctic1") else { return };
        let pattern = folder.join("*.jpg");
        let mut node = Images::new(settings(pattern.to_str().unwrap()), &setup_with_camera([640, 480])).unwrap();
        assert_eq!(node.sequence.listing.length(), 500);
        let mut image = Image::default();
        for _ in 0..3 {
            let next = node.sequence.read_next(&mut image);
            assert!(matches!(next, Next::Picture), "{next:?}");
        }
    }
}
