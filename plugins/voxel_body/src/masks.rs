//! `voxel_body.masks`: silhouettes of another program, read as pictures.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    IMAGE: In<Image> = each("image");
    SILHOUETTE: Out<Silhouette> = "silhouette";
}

figures! {
    "silhouette.seen.*": count, high, "Silhouettes of the camera with a body";
        "silhouette.empty.*": count, neither, "Silhouettes without a body";
    "silhouette.full.*": count, low, "Silhouettes that fill the picture";
    "silhouette.body_share.*": share, neither, "Mean part of the camera's picture that is body, over silhouettes with one";
    "silhouette.specks.*": share, low, "Part of the camera's pixels that were removed as specks: all neighbours but at most one are of the other kind";
        "silhouette.refused.*": count, low, "Pictures whose number of bytes does not match their size";
}

/// Settings of [`Masks`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MasksSettings {
    /// Smallest value of a body pixel's brightest channel; gray levels between 0 and 255 give the confidence [gray level]
    #[schemars(range(min = 1, max = 255))]
    pub threshold: u8,
    /// Whether the body is dark on bright ground [–]
    pub inverted: bool,
    /// A silhouette with a larger part body is `full` [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub full_fraction: f64,
    /// Whether specks are removed: pixels whose eight neighbours, or all but one, are of the other kind; keyed pictures have such specks, and no limb is as thin [–]
    pub despeckle: bool,
}

impl Default for MasksSettings {
    /// Half-way, bright on dark, full from 95 % on, without specks.
    fn default() -> Self {
        Self { threshold: 128, inverted: false, full_fraction: 0.95, despeckle: true }
    }
}

/// Pictures of masks in, such as those that `capture.images` or `capture.video` reads; silhouettes out.
pub struct Masks {
    settings: MasksSettings,
    camera_name: String,
    camera: Option<CameraId>,
    /// By gray level: the confidence.
    table: [u8; 256],
    pool: Pool<Silhouette>,
    counts: [u64; 3],
    body_share: f64,
    refused: u64,
    /// Gray level of the pixel that was most like body, of masks without one.
    nearest: Option<u8>,
    /// Masks whose background is body, most likely.
    inside_out: u64,
    specks: Specks,
}

impl Node for Masks {
    const TYPE: &'static str = "voxel_body.masks";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Reads mask pictures of another program as silhouettes";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = MasksSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: MasksSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("threshold", settings.threshold, 1..=255)?;
        ConfigError::unless_in("full_fraction", settings.full_fraction, 0.0..=1.0)?;
        let threshold = u32::from(settings.threshold);
        // Linear below and above, so that the threshold becomes the least level of a body.
        let confidence = |level: u32| match level.checked_sub(threshold) {
            None => level * 127 / (threshold - 1).max(1),
            Some(_) if threshold == 255 => 255,
            Some(above) => 128 + above * 127 / (255 - threshold),
        };
        let table = std::array::from_fn(|it| {
            let level = if settings.inverted { 255 - it } else { it };
            confidence(level as u32) as u8
        });
        Ok(Self {
            settings,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            camera: setup.camera,
            table,
            pool: Pool::default(),
            counts: [0; 3],
            body_share: 0.0,
            refused: 0,
            nearest: None,
            inside_out: 0,
            specks: Specks::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let mask = &image.value;
        let (channels, n) = (mask.format.channels(), mask.width as usize * mask.height as usize);
        if mask.pixels.len() != n * channels {
            self.refused += 1;
            let (found, expected) = (mask.pixels.len(), n * channels);
            io.gap(&SILHOUETTE, image.time(), format_args!("the mask has {found} bytes, expected {expected}"));
            return Ok(());
        }
        let mut silhouette = self.pool.take(Silhouette::default);
        silhouette.camera = self.camera.unwrap_or(mask.camera);
        (silhouette.width, silhouette.height, silhouette.window) = (mask.width, mask.height, mask.window);
        silhouette.confidence.clear();
        let level = |pixel: &[u8]| self.table[usize::from(pixel.iter().copied().max().unwrap_or(0))];
        silhouette.confidence.extend(mask.pixels.chunks_exact(channels).map(level));
        if self.settings.despeckle {
            self.specks.remove(&mut silhouette);
        }
        silhouette.n_body = silhouette.confidence.iter().filter(|it| **it >= Silhouette::BODY).count() as u32;
        let share = f64::from(silhouette.n_body) / n.max(1) as f64;
        silhouette.status = match silhouette.n_body {
            0 => SilhouetteStatus::Empty,
            _ if share > self.settings.full_fraction => SilhouetteStatus::Full,
            _ => SilhouetteStatus::Seen,
        };
        self.counts[silhouette.status as usize] += 1;
        self.inside_out += u64::from(share > 0.5 && is_rim_body(&silhouette));
        if silhouette.n_body == 0 {
            let inverted = self.settings.inverted;
            let levels = mask.pixels.chunks_exact(channels).filter_map(|it| it.iter().copied().max());
            let nearest = if inverted { levels.min() } else { levels.max() };
            let nearer = |a: u8, b: u8| if inverted { a.min(b) } else { a.max(b) };
            self.nearest = [self.nearest, nearest].into_iter().flatten().reduce(nearer);
        }
        if silhouette.status == SilhouetteStatus::Seen {
            self.body_share += share;
        }
        io.emit(&SILHOUETTE, image.stamp, self.pool.share(silhouette));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let (name, [seen, empty, full]) = (&self.camera_name, self.counts);
        report.figure(format!("silhouette.seen.{name}"), seen as f64);
        if seen > 0 {
            report.figure(format!("silhouette.body_share.{name}"), self.body_share / seen as f64);
        }
        for (what, n) in [("empty", empty), ("full", full), ("refused", self.refused)] {
            if n > 0 {
                report.figure(format!("silhouette.{what}.{name}"), n as f64);
            }
        }
        let specks = self.specks.n as f64 / self.specks.n_pixels.max(1) as f64;
        if self.specks.n > 0 {
            report.figure(format!("silhouette.specks.{name}"), specks);
        }
        if specks > MANY_SPECKS {
            report.remark(format!(
                "{name}: {:.1} % of the pixels of its masks were specks of one or two pixels and were removed: are masks noisy, or saved as JPEG? (`despeckle`)",
                100.0 * specks
            ));
        }
        if let Some(level) = self.nearest.filter(|_| seen + full == 0) {
            let (nearest, expected) = if self.settings.inverted {
                ("darkest", format!("{} or less", 255 - self.settings.threshold))
            } else {
                ("brightest", format!("{} or more", self.settings.threshold))
            };
            report.remark(format!(
                "{name}: none of {empty} masks has a body: their {nearest} pixel is {level}, expected {expected} (`threshold`, `inverted`; `format = \"rgb\"` where pictures are read, if masks have colours: as gray pure red is 76, blue 29)"
            ));
        }
        if 2 * self.inside_out > seen + empty + full {
            report.remark(format!(
                "{name}: {} of {} masks have body all around their edge, and more of it than of background: is background body (`inverted = {}`)?",
                self.inside_out,
                seen + empty + full,
                !self.settings.inverted
            ));
        }
        Ok(())
    }
}

/// More specks than this are said in words [–].
const MANY_SPECKS: f64 = 0.002;

/// Takes specks off masks, and counts them.
#[derive(Default)]
struct Specks {
    n: u64,
    n_pixels: u64,
    /// By pixel: 1 where body is; and how many of three in its row are.
    is_body: Vec<u8>,
    of_row: Vec<u8>,
}

impl Specks {
    /// Pixels on the picture's edge stay as they are.
    fn remove(&mut self, silhouette: &mut Silhouette) {
        let (width, height) = (silhouette.width as usize, silhouette.height as usize);
        self.n_pixels += (width * height) as u64;
        if width < 3 || height < 3 {
            return;
        }
        let Self { is_body, of_row, n, .. } = self;
        is_body.clear();
        is_body.extend(silhouette.confidence.iter().map(|it| u8::from(*it >= Silhouette::BODY)));
        of_row.clear();
        of_row.resize(is_body.len(), 0);
        for (sum, three) in of_row[1..].iter_mut().zip(is_body.windows(3)) {
            *sum = three[0] + three[1] + three[2];
        }
        for row in 1..height - 1 {
            for at in row * width + 1..(row + 1) * width - 1 {
                let own = is_body[at];
                let others = of_row[at - width] + of_row[at] + of_row[at + width] - own;
                // Of eight.
                if own == 1 && others <= 1 {
                    silhouette.confidence[at] = Silhouette::BODY - 1;
                    *n += 1;
                } else if own == 0 && others >= 7 {
                    silhouette.confidence[at] = Silhouette::BODY;
                    *n += 1;
                }
            }
        }
    }
}

/// Of the pixels on the picture's edge more are not body where a person is in it, as near as may be [–].
const RIM: f64 = 0.9;

fn is_rim_body(silhouette: &Silhouette) -> bool {
    let (width, height) = (silhouette.width as usize, silhouette.height as usize);
    let is_rim = |at: &usize| {
        let (x, y) = (at % width, at / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let (mut n, mut n_body) = (0, 0);
    for at in (0..width * height).filter(is_rim) {
        n += 1;
        n_body += usize::from(silhouette.confidence[at] >= Silhouette::BODY);
    }
    n_body as f64 > RIM * f64::from(n)
}

#[cfg(test)]
mod tests {
    use foveate::estimation::random::Random;
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn masks_of_zeros_and_ones_are_told() {
        for (inverted, pixels, expected) in [
            (false, [0, 1, 0, 1], "brightest pixel is 1, expected 128 or more"),
            (true, [255, 254, 255, 254], "darkest pixel is 254, expected 127 or less"),
        ] {
            let mut bench = NodeBench::<Masks>::new(MasksSettings { inverted, ..MasksSettings::default() }).unwrap();
            let image = Image { width: 4, height: 1, pixels: pixels.to_vec(), ..Image::default() };
            bench.feed(&IMAGE, Time::ZERO, image).unwrap();
            let remarks = bench.finish().unwrap().remarks;
            assert!(remarks.iter().any(|it| it.contains(expected)), "{remarks:?}");
        }
    }

    #[test]
    fn masks_whose_background_is_body_are_told_and_people_who_stand_near_are_not() {
        let disc = |radius: f64, inside: u8| -> Vec<u8> {
            let pixel = |at: i32| (f64::from(at % 20 - 10).hypot(f64::from(at / 20 - 10)) < radius) == (inside == 255);
            (0..400).map(|at| if pixel(at) { 255 } else { 0 }).collect()
        };
        let remarks = |pixels: &[u8], inverted: bool| {
            let mut bench = NodeBench::<Masks>::new(MasksSettings { inverted, ..MasksSettings::default() }).unwrap();
            let image = Image { width: 20, height: 20, pixels: pixels.to_vec(), ..Image::default() };
            bench.feed(&IMAGE, Time::ZERO, image).unwrap();
            bench.finish().unwrap().remarks.join(" ")
        };
        assert!(remarks(&disc(6.0, 0), false).contains("`inverted = true`"));
        assert!(remarks(&disc(6.0, 255), true).contains("`inverted = false`"));
        // Somebody so near that most of the picture and much of its edge is body.
        assert_eq!(remarks(&disc(11.5, 255), false), "");
        assert_eq!(remarks(&disc(6.0, 255), false), "");
    }

    #[test]
    fn specks_are_taken_off_and_told_and_thin_limbs_stay() {
        let mut random = Random::new(5);
        let (width, height) = (80, 60);
        // A body, an arm two pixels thin, and 3 % of all pixels turned over.
        let is_body = |at: usize| {
            let (x, y) = (at % width, at / width);
            (20..40).contains(&x) && (10..50).contains(&y) || (40..70).contains(&x) && (20..22).contains(&y)
        };
        let clean: Vec<u8> = (0..width * height).map(|at| if is_body(at) { 255 } else { 0 }).collect();
        let noisy: Vec<u8> = clean.iter().map(|it| if random.uniform() < 0.03 { 255 - it } else { *it }).collect();
        let read = |pixels: &[u8], despeckle: bool| {
            let settings = MasksSettings { despeckle, ..MasksSettings::default() };
            let mut bench = NodeBench::<Masks>::new(settings).unwrap();
            let image =
                Image { width: width as u32, height: height as u32, pixels: pixels.to_vec(), ..Image::default() };
            bench.feed(&IMAGE, Time::ZERO, image).unwrap();
            let silhouette = bench.outputs(&SILHOUETTE)[0].value.clone();
            let wrong = (0..width * height).filter(|&at| silhouette.is_body(at % width, at / width) != is_body(at));
            (wrong.count(), bench.finish().unwrap().remarks.join(" "))
        };
        assert_eq!(read(&clean, true), (0, String::new()));
        let (wrong, remarks) = read(&noisy, true);
        let (before, no_remarks) = read(&noisy, false);
        assert!(before > 120 && wrong < before / 4, "{wrong} of {before} are left");
        assert!(remarks.contains("were specks") && no_remarks.is_empty(), "{remarks} {no_remarks}");
    }

    fn one(settings: MasksSettings, pixels: &[u8], format: PixelFormat) -> Silhouette {
        let mut bench = NodeBench::<Masks>::new(settings).unwrap();
        let width = (pixels.len() / format.channels()) as u32;
        let image = Image { width, height: 1, format, pixels: pixels.to_vec(), ..Image::default() };
        bench.feed(&IMAGE, Time::ZERO, image).unwrap();
        Silhouette::clone(&bench.outputs(&SILHOUETTE)[0].value)
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Masks>("");
        check_node::<Masks>("threshold = 10\ninverted = true");
    }

    #[test]
    fn bright_is_body_or_dark_where_told_so() {
        let it = one(MasksSettings::default(), &[0, 127, 128, 255], PixelFormat::Gray8);
        assert_eq!((it.confidence, it.n_body, it.status), (vec![0, 127, 128, 255], 2, SilhouetteStatus::Seen));
        let low = MasksSettings { threshold: 1, ..MasksSettings::default() };
        assert_eq!(one(low, &[0, 1, 255, 0], PixelFormat::Gray8).confidence, [0, 128, 255, 0]);
        let inverted = MasksSettings { inverted: true, ..MasksSettings::default() };
        assert_eq!(one(inverted, &[0, 255], PixelFormat::Gray8).n_body, 1);
        assert_eq!(one(MasksSettings::default(), &[0, 0, 0, 0, 200, 0], PixelFormat::Rgb8).n_body, 1);
    }

    #[test]
    fn empty_full_and_broken_masks_are_told_apart() {
        assert_eq!(one(MasksSettings::default(), &[0; 4], PixelFormat::Gray8).status, SilhouetteStatus::Empty);
        assert_eq!(one(MasksSettings::default(), &[255; 4], PixelFormat::Gray8).status, SilhouetteStatus::Full);
        let mut bench = NodeBench::<Masks>::new(MasksSettings::default()).unwrap();
        let broken = Image { width: 2, height: 2, pixels: vec![0; 3], ..Image::default() };
        bench.feed(&IMAGE, Time::ZERO, broken).unwrap();
        assert_eq!(bench.gaps(&SILHOUETTE)[0].reason, "the mask has 3 bytes, expected 4");
        assert_eq!(bench.finish().unwrap().figures["silhouette.refused.test.node"], 1.0);
    }
}
