//! `structured_light.collector`: collects the pictures of a pattern set from a camera's pictures and the projector's reports.
//!
//! 1. To each pattern belongs the picture whose capture time is nearest to the middle of the time in which it was shown, all of the exposure lying in that time.
//! 2. A set of which a picture is missing is not passed on; the pictures are named.
//! 3. The code is static: nothing may move meanwhile. Whatever a bit shows, it and its inverse together are as bright as white and black together, and so is twice the
//!    mean of a phase shift's steps; where they are not, something has moved between these pictures. Blocks of the picture where it has are made black, so that nothing
//!    is decoded there; a set with many of them is not passed on.
//!
//! Motion is detected in means of 4 × 4 px, which hide the noise of single pixels, root mean square over blocks of 16 × 16 px. What noise is left in these is known from
//! the pictures themselves ([`foveate::imaging::stripes::noise`]) and no motion.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::imaging::ImageView;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::moved::Blocks;
use crate::pattern::PatternSettings;

ports! {
    IMAGE: In<Image> = each("image");
    SHOWN: In<PatternShown> = each("shown");
    POSE: In<HeadPose> = each("pose").optional();
    PICTURES: Out<PatternPictures> = "pictures";
}

figures! {
    "collector.sets.*": count, high, "Sets of pictures of the camera that were passed on";
    "collector.sets_moved.*": count, low, "Sets of the camera in which too much moved, not passed on";
    "collector.sets_incomplete.*": count, low, "Sets of the camera of which pictures were missing, not passed on";
    "collector.moved_share.*": share, low, "Blocks of 16 x 16 px in which something moved, over those that the projector lit, over all sets with all pictures";
}

/// Pictures that wait for the pattern that they show.
const HELD: usize = 32;
/// From one pattern to the next at most, where the projector waits for pictures of the camera.
const LONGEST_WAIT: Interval = Interval(5_000_000_000);

/// Settings of [`Collector`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CollectorSettings {
    /// Latency of the projector, from the command to show a pattern to its light [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub latency_ms: f64,
    /// The camera's exposure: all of it must lie in the time in which the pattern is shown [ms]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub exposure_ms: f64,
    /// Something has moved in a block where bit + inverse − white − black is larger, root mean square of the means of 4 × 4 px, beyond what the noise of the pictures makes of it [gray level]
    #[schemars(range(min = 0.1, max = 255.0))]
    pub max_change: f64,
    /// Part of the lit blocks in which something may have moved; with more, the set is not passed on [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub max_moved: f64,
    /// With `pose` connected: how far the picture may move from the first to the last one of a set [px]
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub max_turn_px: f64,
}

impl Default for CollectorSettings {
    fn default() -> Self {
        Self { latency_ms: 30.0, exposure_ms: 4.0, max_change: 4.0, max_moved: 0.03, max_turn_px: 1.0 }
    }
}

/// A set that is being shown.
struct Set {
    first: Arc<PatternShown>,
    /// By place: what was shown, its middle, and the best picture so far with its distance from that.
    slots: Vec<Option<Slot>>,
}

struct Slot {
    name: String,
    middle: Time,
    lasts: Interval,
    picture: Option<(Stamp, Arc<Image>)>,
}

/// Pictures and patterns in, whole sets of pictures out.
pub struct Collector {
    settings: CollectorSettings,
    camera_name: String,
    focal_px: f64,
    sets: BTreeMap<u64, Set>,
    held: VecDeque<(Stamp, Arc<Image>)>,
    angles: VecDeque<(Time, [f64; 2])>,
    passed: u64,
    moved: u64,
    incomplete: u64,
    blocks: [u64; 2],
    remarks: Vec<String>,
}

impl Node for Collector {
    const TYPE: &'static str = "structured_light.collector";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Collects the pictures of a pattern set, and refuses sets in which something moved";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CollectorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CollectorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("exposure_ms", settings.exposure_ms, 0.0..=100.0)?;
        ConfigError::unless_in("max_change", settings.max_change, 0.1..=255.0)?;
        ConfigError::unless_in("max_moved", settings.max_moved, 0.0..=1.0)?;
        ConfigError::unless_in("max_turn_px", settings.max_turn_px, 0.01..=1000.0)?;
        Ok(Self {
            settings,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            focal_px: setup.camera_model().map_or(0.0, |it| it.intrinsics.focal[0]),
            sets: BTreeMap::new(),
            held: VecDeque::new(),
            angles: VecDeque::new(),
            passed: 0,
            moved: 0,
            incomplete: 0,
            blocks: [0; 2],
            remarks: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(pose) = io.take(&POSE) {
            self.angles.push_back((pose.value.time, pose.value.angles));
            if self.angles.len() > 1024 {
                self.angles.pop_front();
            }
        }
        while let Some(shown) = io.take(&SHOWN) {
            self.expect(&shown.value);
        }
        while let Some(image) = io.take(&IMAGE) {
            let time = image.time();
            if self.held.len() == HELD {
                self.held.pop_front();
            }
            self.held.push_back((image.stamp, Arc::clone(&image.value)));
            self.sort_in(image.stamp, &image.value);
            // A picture of a later time ends what should have come before it.
            while let Some((&number, _)) = self.sets.iter().next().filter(|it| it.1.is_over(time, self.sets.len() > 1))
            {
                let Some(set) = self.sets.remove(&number) else { break };
                self.conclude(io, number, set);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("collector.sets.{name}"), self.passed as f64);
        report.figure(format!("collector.sets_moved.{name}"), self.moved as f64);
        report.figure(format!("collector.sets_incomplete.{name}"), self.incomplete as f64);
        let [moved, lit] = self.blocks.map(|it| it as f64);
        report.figure(format!("collector.moved_share.{name}"), moved / lit);
        self.remarks.iter().for_each(|it| report.remark(it));
        Ok(())
    }
}

impl Set {
    /// Whether a picture of `time` comes after all of its patterns, or all have theirs; `has_next`: the set after it has begun.
    fn is_over(&self, time: Time, has_next: bool) -> bool {
        let is_told = self.slots.iter().all(Option::is_some);
        let mut slots = self.slots.iter().flatten();
        let is_past = |it: &Slot| time > it.middle + Interval(it.lasts.0 / 2);
        let last = self.first.from + Interval(self.first.lasts.0 * i64::from(self.first.count + 1));
        // Patterns that were never told of end with the time that they would have taken, and as long again, but a projector may also wait for the camera.
        let newest = self.slots.iter().flatten().map(|it| it.middle).max().unwrap_or(last);
        let patience = (last + Interval(self.first.lasts.0 * i64::from(self.first.count))).max(newest + LONGEST_WAIT);
        slots.all(is_past) && (is_told || has_next || time > patience)
    }
}

impl Collector {
    fn expect(&mut self, shown: &Arc<PatternShown>) {
        let set = self
            .sets
            .entry(shown.set)
            .or_insert_with(|| Set { first: Arc::clone(shown), slots: (0..shown.count).map(|_| None).collect() });
        let middle = shown.from + Interval::from_ms(self.settings.latency_ms) + Interval(shown.lasts.0 / 2);
        if let Some(slot) = set.slots.get_mut(shown.index as usize) {
            *slot = Some(Slot { name: shown.name.clone(), middle, lasts: shown.lasts, picture: None });
        }
        for (stamp, image) in self.held.clone() {
            self.sort_in(stamp, &image);
        }
    }

    fn sort_in(&mut self, stamp: Stamp, image: &Arc<Image>) {
        let exposure = Interval::from_ms(self.settings.exposure_ms);
        for slot in self.sets.values_mut().flat_map(|it| it.slots.iter_mut().flatten()) {
            let off = |time: Time| (time - slot.middle).0.abs();
            let fits = 2 * off(stamp.time) <= slot.lasts.0 - exposure.0;
            if fits && slot.picture.as_ref().is_none_or(|it| off(stamp.time) < off(it.0.time)) {
                slot.picture = Some((stamp, Arc::clone(image)));
            }
        }
    }

    fn conclude(&mut self, io: &mut Io<'_>, number: u64, set: Set) {
        let name = format!("set {number}");
        let missing = |(at, slot): (usize, &Option<Slot>)| match slot {
            None => Some(format!("picture {at} (the projector never reported it)")),
            Some(slot) => slot.picture.is_none().then(|| format!("`{}`", slot.name)),
        };
        let missing: Vec<String> = set.slots.iter().enumerate().filter_map(missing).collect();
        let time = set.first.from;
        if !missing.is_empty() {
            self.incomplete += 1;
            let n = missing.len();
            let listed =
                if n > 3 { format!("{} and {} more", missing[..3].join(", "), n - 3) } else { missing.join(", ") };
            let all = set.slots.len();
            let fault = format!("{name}: found no picture of {listed}, expected one of each of the {all} patterns");
            self.refuse(io, time, fault);
            return;
        }
        let (names, pictures): (Vec<String>, Vec<(Stamp, Arc<Image>)>) =
            set.slots.into_iter().flatten().filter_map(|it| Some((it.name, it.picture?))).unzip();
        let [first, last] = [0, pictures.len() - 1].map(|it| pictures[it].0.time);
        if let Some(turn_px) = self.turn_px(first, last).filter(|it| *it > self.settings.max_turn_px) {
            self.moved += 1;
            let most = self.settings.max_turn_px;
            let fault = format!(
                "{name}: the camera's head turned by {turn_px:.1} px during the set, expected at most {most} px"
            );
            self.refuse(io, time, fault);
            return;
        }
        let image = &pictures[0].1;
        let (width, height) = (image.width, image.height);
        if pictures.iter().any(|(_, it)| [it.width, it.height] != [width, height] || it.format != PixelFormat::Gray8) {
            let fault = format!(
                "{name}: found pictures of several sizes or in colour, expected gray ones of {width} x {height} px"
            );
            self.refuse(io, time, fault);
            return;
        }
        let mut pixels: Vec<u8> = Vec::with_capacity(pictures.len() * image.pixels.len());
        pictures.iter().for_each(|it| pixels.extend(&it.1.pixels));
        let mut all = PatternPictures {
            camera: image.camera,
            name: name.clone(),
            width,
            height,
            names,
            unreadable: Vec::new(),
            manifest: set.first.manifest.clone(),
            pixels,
        };
        let code =
            PatternSettings::read(&all.manifest).and_then(|it| it.stripe_code(None).map_err(|fault| fault.message));
        let code = match code {
            Ok(code) if code.frames > 0 => {
                let expected = "expected a static one: `structured_light.boundaries` takes the pictures one by one";
                self.refuse(io, time, format!("{name}: found a boundary code, {expected}"));
                return;
            }
            Ok(code) if code.pictures().len() == all.names.len() => code,
            Ok(code) => {
                let (found, expected) = (all.names.len(), code.pictures().len());
                self.refuse(io, time, format!("{name}: found {found} pictures, expected the {expected} of its code"));
                return;
            }
            Err(fault) => {
                self.refuse(io, time, format!("{name}: {fault}"));
                return;
            }
        };
        let (columns, rows) = (width as usize, height as usize);
        let views: Result<Vec<ImageView<'_>>, _> =
            (0..all.names.len()).map(|it| ImageView::new(all.picture(it).unwrap_or_default(), columns, rows)).collect();
        let blocks = match views {
            Ok(views) => Blocks::of(&code, &views, [self.settings.max_change as f32, 0.0]),
            Err(fault) => {
                self.refuse(io, time, format!("{name}: {fault}"));
                return;
            }
        };
        self.blocks[0] += blocks.moved.len() as u64;
        self.blocks[1] += blocks.n_lit as u64;
        let share = blocks.share();
        if share > self.settings.max_moved {
            self.moved += 1;
            let (found, most) = (100.0 * share, 100.0 * self.settings.max_moved);
            let fault = format!(
                "{name}: something moved in {found:.0} % of what the projector lights, expected at most {most:.0} % during a static code"
            );
            self.refuse(io, time, fault);
            return;
        }
        for picture in all.pixels.chunks_exact_mut(columns * rows) {
            blocks.each_row([columns, rows], |row, from, to| picture[row * columns..][from..to].fill(0));
        }
        self.passed += 1;
        let middle = pictures[pictures.len() / 2].0;
        io.emit(&PICTURES, middle, all);
    }

    fn refuse(&mut self, io: &mut Io<'_>, time: Time, fault: String) {
        io.gap(&PICTURES, time, fault.as_str());
        self.remarks.push(fault);
    }

    /// How far the head turned the picture between two times; `None` without poses of that time.
    fn turn_px(&self, first: Time, last: Time) -> Option<f64> {
        let there: Vec<[f64; 2]> =
            self.angles.iter().filter(|it| (first..=last).contains(&it.0)).map(|it| it.1).collect();
        let span = |axis: usize| {
            let of = there.iter().map(|it| it[axis]);
            of.clone().fold(f64::NEG_INFINITY, f64::max) - of.fold(f64::INFINITY, f64::min)
        };
        (!there.is_empty()).then(|| span(0).hypot(span(1)) * self.focal_px)
    }
}

#[cfg(test)]
mod tests {
    use foveate::imaging::stripes::code::{Shown, StripeCode};
    use foveate::imaging::stripes::pattern::picture;
    use foveate_testkit::check_node;

    use super::*;

    const SIZE: [u32; 2] = [128, 96];
    const MANIFEST: &str =
        "projector_px = [128, 96]\ncode = \"phase\"\norder = \"white black columns\"\nperiod_px = 16\n";

    fn code() -> StripeCode {
        PatternSettings::read(MANIFEST).unwrap().stripe_code(None).unwrap()
    }

    /// Surfaces of many shades, of which those for which `moves` holds have come `off` px to the right, with noise of `sigma` gray levels.
    fn seen(
        sigma: f64,
        shown: Shown,
        off: f64,
        moves: impl Fn(usize, usize) -> bool,
        random: &mut foveate::estimation::random::Random,
    ) -> Image {
        let light = picture(&code(), shown, 1.0);
        let pixels = (0..SIZE[1] as usize).flat_map(|y| (0..SIZE[0] as usize).map(move |x| (x, y))).map(|(x, y)| {
            let at = x as f64 - if moves(x, y) { off } else { 0.0 };
            let albedo = 0.55 + 0.25 * (at * 0.21 + y as f64 * 0.13).sin();
            let gray = 14.0 + albedo * f64::from(light[y * SIZE[0] as usize + x]) * 0.7 + sigma * random.normal();
            gray.round().clamp(0.0, 255.0) as u8
        });
        Image { width: SIZE[0], height: SIZE[1], pixels: pixels.collect(), ..Image::default() }
    }

    struct Outcome {
        sets: Vec<Arc<PatternPictures>>,
        gaps: Vec<String>,
        report: Report,
    }

    /// One set, and a picture after it. `speed` is in pixels a picture; picture `lost` never comes; captures are `late_ms` after the middle of their pattern.
    fn collect(speed: f64, moves: impl Fn(usize, usize) -> bool + Copy, lost: Option<usize>, late_ms: f64) -> Outcome {
        collect_noisy(1.0, speed, moves, lost, late_ms)
    }

    fn collect_noisy(
        sigma: f64,
        speed: f64,
        moves: impl Fn(usize, usize) -> bool + Copy,
        lost: Option<usize>,
        late_ms: f64,
    ) -> Outcome {
        let mut bench = NodeBench::<Collector>::new(CollectorSettings::default()).unwrap();
        let mut random = foveate::estimation::random::Random::new(3);
        let pictures = code().pictures();
        for (index, shown) in pictures.iter().enumerate() {
            let from = Time::from_s(1.0 + 0.02 * index as f64);
            let told = PatternShown {
                index: index as u32,
                count: pictures.len() as u32,
                name: shown.to_string(),
                from,
                lasts: Interval::from_ms(20.0),
                manifest: MANIFEST.to_owned(),
                ..PatternShown::default()
            };
            bench.feed(&SHOWN, from, told).unwrap();
        }
        for (index, shown) in pictures.iter().chain([&Shown::Black]).enumerate() {
            let capture = Time::from_s(1.0 + 0.02 * index as f64) + Interval::from_ms(40.0 + late_ms);
            let image = seen(sigma, *shown, speed * index as f64, moves, &mut random);
            if lost != Some(index) {
                bench.feed(&IMAGE, capture, image).unwrap();
            }
        }
        let gaps = bench.gaps(&PICTURES).into_iter().map(|it| it.reason).collect();
        let sets = bench.outputs(&PICTURES).into_iter().map(|it| it.value).collect();
        Outcome { sets, gaps, report: bench.finish().unwrap() }
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<Collector>("");
        check_node::<Collector>("latency_ms = 16\nmax_moved = 0.1");
    }

    #[test]
    fn a_set_at_rest_is_passed_on_whole_and_in_order() {
        for late_ms in [-7.0, 0.0, 7.0] {
            let found = collect(0.0, |_, _| true, None, late_ms);
            let names: Vec<String> = code().pictures().iter().map(ToString::to_string).collect();
            assert!(found.sets.len() == 1 && found.gaps.is_empty(), "{:?}", found.gaps);
            let set = &found.sets[0];
            assert!(set.names == names && set.manifest == MANIFEST && set.pixels.len() == 128 * 96 * names.len());
            let mean =
                |index: usize| set.picture(index).unwrap().iter().map(|it| u64::from(*it)).sum::<u64>() / (128 * 96);
            assert!(mean(0) > 90 && mean(1) < 20, "white, then black: {} {}", mean(0), mean(1));
            assert_eq!(found.report.figures["collector.moved_share.test.node"], 0.0);
        }
    }

    #[test]
    fn pictures_that_no_exposure_fits_are_missing_and_named() {
        let found = collect(0.0, |_, _| true, Some(4), 0.0);
        assert!(found.sets.is_empty());
        assert!(
            found.gaps[0].contains("found no picture of `bit 1 of the columns`, expected one of each"),
            "{:?}",
            found.gaps
        );
        // An exposure that reaches into the next pattern shows a mixture.
        let late = collect(0.0, |_, _| true, None, 9.0);
        assert!(late.sets.is_empty() && late.gaps[0].contains("and 1"), "{:?}", late.gaps);
    }

    #[test]
    fn what_moves_is_refused_and_a_part_that_moves_is_left_out() {
        let found = collect(1.0, |_, _| true, None, 0.0);
        assert!(found.sets.is_empty() && found.gaps[0].contains("something moved in"), "{:?}", found.gaps);
        assert_eq!(found.report.figures["collector.sets_moved.test.node"], 1.0);
        // Two pixels from the first to the last picture.
        let slow = collect(0.1, |_, _| true, None, 0.0);
        assert!(slow.sets.is_empty() && slow.gaps[0].contains("something moved in"), "{:?}", slow.gaps);
        // One block of 48.
        let part = collect(1.0, |x, y| (32..48).contains(&x) && (16..32).contains(&y), None, 0.0);
        assert_eq!(part.sets.len(), 1, "{:?}", part.gaps);
        let white = part.sets[0].picture(0).unwrap();
        let is_black = |x: usize, y: usize| white[y * 128 + x] == 0;
        assert!(is_black(32, 16) && is_black(47, 31) && !is_black(31, 16) && !is_black(48, 20) && !is_black(40, 32));
    }

    #[test]
    fn noise_is_no_motion_and_motion_is_seen_under_noise() {
        for sigma in [4.0, 8.0, 12.0] {
            let rest = collect_noisy(sigma, 0.0, |_, _| true, None, 0.0);
            assert_eq!(rest.sets.len(), 1, "{sigma}: {:?}", rest.gaps);
            assert_eq!(rest.report.figures["collector.moved_share.test.node"], 0.0, "{sigma}");
            let moved = collect_noisy(sigma, 1.0, |_, _| true, None, 0.0);
            assert!(moved.sets.is_empty(), "{sigma}");
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let settings = CollectorSettings { max_moved: 1.5, ..CollectorSettings::default() };
        let refused = Collector::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting);
        assert_eq!(refused.as_deref(), Some("max_moved"));
    }
}
