//! `capture.video`: a video file of one camera, decoded by an `ffmpeg` child process.
//!
//! The first frame has the time `start_s`, the others follow at the file's own time stamps, also for a phone that varied
//! its rate; or, with `rate_hz`, at a regular distance. Where the time stamps leave out frames, each of them is a gap. The
//! child is started at the node's first activation, and is killed when the node is dropped.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use foveate::node::pool::Fresh;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::decode::SIDE_LIMIT;
use crate::ffmpeg::{Decoder, Dialect, Ending, Header, Programs};
use crate::ffmpeg_words::Announced;
use crate::settings::{Field, Format, Reasons, camera_of, frame_time, where_others_have};

ports! {
    IMAGE: Out<Image> = "image";
}

/// A step of the time stamps longer than this many average frames counts as missing frames.
const LONG_STEP: f64 = 1.75;
/// Missing frames in one place that are each counted as a gap; a longer pause counts as this many.
const GAPS_A_STEP: u64 = 1000;

/// Settings of [`Video`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VideoSettings {
    /// The file; `{camera}` is the camera's name, `${NAME}` an environment variable [–]
    pub path: String,
    /// What the frames are decoded to [–]
    #[serde(default)]
    pub format: Format,
    /// Session time of the first frame, for cameras that started later than others [s]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub start_s: f64,
    /// Frame rate of the capture, for slow motion and files with bad time stamps; 0: the file's own times [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Delay between capture and delivery of a frame, as of a real camera [ms]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub latency_ms: f64,
    /// A chain of ffmpeg's filters for the frames, such as `transpose=1` or `pad=1088:1920`, which must give the size that the
    /// calibration states; empty: none [–]
    #[serde(default)]
    pub filter: String,
    /// Lines of interlaced frames that are kept, `odd` or `even`, before any filter: the pictures then have half the height, and the calibration must be of such pictures [–]
    #[serde(default)]
    pub field: Field,
    /// Decoder threads; 0: chosen by `ffmpeg`. With many cameras 1 is best [–]
    #[serde(default = "default_threads")]
    #[schemars(range(min = 0, max = 64))]
    pub threads: u32,
}

impl VideoSettings {
    /// The whole chain of filters.
    fn filters(&self) -> String {
        let parts = [self.field.filter(), &self.filter];
        parts.into_iter().filter(|it| !it.is_empty()).collect::<Vec<_>>().join(",")
    }
}

fn default_threads() -> u32 {
    1
}

/// Frames out, at their own times.
pub struct Video {
    film: Film,
    pool: Pool<Image>,
    latency: Interval,
    instance: String,
    turns: VecDeque<Turn>,
    runs: bool,
}

/// One turn of the node, prepared.
struct Turn {
    time: Time,
    what: What,
}

enum What {
    Picture(Fresh<Image>),
    Gap(String),
    /// Ends the node.
    Fault(String),
}

/// A file that is being decoded.
struct Film {
    settings: VideoSettings,
    camera: CameraId,
    path: PathBuf,
    programs: Programs,
    header: Header,
    state: State,
    /// Columns, rows that every frame must have [px]; unknown until the first where there is no calibration.
    size: Option<[u32; 2]>,
    /// Own time of the first and of the last frame.
    span: Option<(Interval, Interval)>,
    /// Session time of the last frame or gap.
    last: Time,
    /// Frames, left out ones included.
    index: u64,
    n_pictures: u64,
    left_out: u64,
    wrong: Reasons,
    /// The end of the decoder, where it was not bad enough to be a gap.
    ending: Option<Ending>,
}

enum State {
    Unopened,
    Open(Box<Decoder>),
    Over,
}

impl Film {
    /// Prepares the next turns; none when the film is over.
    fn advance(&mut self, pool: &mut Pool<Image>, turns: &mut VecDeque<Turn>) {
        if let Err(fault) = self.try_advance(pool, turns) {
            self.state = State::Over;
            turns.push_back(Turn { time: self.last, what: What::Fault(format!("`{}` {fault}", self.path.display())) });
        }
    }

    fn try_advance(&mut self, pool: &mut Pool<Image>, turns: &mut VecDeque<Turn>) -> Result<(), String> {
        if let State::Unopened = self.state {
            self.last = Time::from_s(self.settings.start_s);
            self.header = self.programs.header(&self.path).map_err(|fault| format!("cannot be read: {fault}"))?;
            self.open(Dialect::Current)?;
        }
        let State::Open(decoder) = &mut self.state else { return Ok(()) };
        let Some(frame) = decoder.next() else { return self.end(pool, turns) };
        let [width, height] = frame.size;
        let expected = *self.size.get_or_insert(frame.size);
        // Before any memory is asked for: a header may claim any size.
        if expected != frame.size && self.n_pictures == 0 {
            return Err(self.wrong_size(&frame, expected));
        }
        if width.max(height) > SIDE_LIMIT {
            return Err(format!(
                "states a size of {width} x {height} px{}, expected at most {SIDE_LIMIT} px each way",
                self.filtered()
            ));
        }
        let State::Open(decoder) = &mut self.state else { return Ok(()) };
        let mut image = pool.take(Image::default);
        let format = self.settings.format.pixel_format();
        image.pixels.resize(width as usize * height as usize * format.channels(), 0);
        if !decoder.read(&mut image.pixels) {
            return self.end(pool, turns);
        }
        (image.camera, image.width, image.height, image.format) = (self.camera, width, height, format);
        let time = self.time_of(&frame, turns);
        if expected == frame.size {
            self.n_pictures += 1;
            turns.push_back(Turn { time, what: What::Picture(image) });
            return Ok(());
        }
        let fault = self.wrong_size(&frame, expected);
        drop(pool.share(image));
        self.wrong.add(format!("frame {} {fault}", self.index - 1));
        turns.push_back(Turn {
            time,
            what: What::Gap(format!("frame {} of `{}` {fault}", self.index - 1, self.path.display())),
        });
        Ok(())
    }

    fn open(&mut self, dialect: Dialect) -> Result<(), String> {
        let VideoSettings { format, threads, .. } = self.settings;
        let decoder = self.programs.decode(&self.path, format, &self.settings.filters(), threads, dialect);
        self.state = State::Open(Box::new(decoder.map_err(|fault| format!("cannot be read: {fault}"))?));
        Ok(())
    }

    fn wrong_size(&self, frame: &Announced, [columns, rows]: [u32; 2]) -> String {
        let [width, height] = frame.size;
        format!("is {width} x {height} px{}, expected {columns} x {rows} px", self.filtered())
    }

    /// For messages about what leaves the filter; empty without one.
    fn filtered(&self) -> String {
        let filter = self.settings.filters();
        if filter.is_empty() { String::new() } else { format!(" after filter = \"{filter}\"") }
    }

    /// Session time of a frame; missing frames before it become gaps.
    fn time_of(&mut self, frame: &Announced, turns: &mut VecDeque<Turn>) -> Time {
        let nominal_s = 1.0 / self.header.rate_hz.unwrap_or(25.0);
        let (first, previous) = self.span.unwrap_or_default();
        // A file without time stamps runs at its average rate.
        let own = match (frame.time, self.span) {
            (Some(time), _) => time,
            (None, Some(_)) => Interval(previous.0 + Interval::from_s(nominal_s).0),
            (None, None) => Interval(0),
        };
        if self.span.is_none() {
            self.span = Some((own, own));
            self.index = 1;
            return self.last;
        }
        self.span = Some((first, own));
        let steps = Interval(own.0 - previous.0).as_s() / nominal_s;
        let is_long = self.header.rate_hz.is_some() && steps > LONG_STEP;
        let n_missing = if is_long { (steps.round() as u64).saturating_sub(1).min(GAPS_A_STEP) } else { 0 };
        let before = self.last;
        let time = if self.settings.rate_hz > 0.0 {
            frame_time(self.settings.start_s, self.settings.rate_hz, self.index + n_missing)
        } else {
            Time::from_s(self.settings.start_s) + Interval(own.0 - first.0)
        };
        for missing in 1..=n_missing {
            let part = (time - before).0 as f64 * missing as f64 / (n_missing + 1) as f64;
            // The same words for all of them, so that a log can count them.
            let reason = format!("`{}` has no time stamp for this frame", self.path.display());
            turns.push_back(Turn { time: before + Interval(part.round() as i64), what: What::Gap(reason) });
        }
        self.left_out += n_missing;
        self.index += n_missing + 1;
        self.last = time;
        time
    }

    /// After the last frame: what `ffmpeg` had to say.
    fn end(&mut self, pool: &mut Pool<Image>, turns: &mut VecDeque<Turn>) -> Result<(), String> {
        let State::Open(decoder) = std::mem::replace(&mut self.state, State::Over) else { return Ok(()) };
        let ending = decoder.end();
        let words = ending.complaints.as_ref().map_or("nothing".to_owned(), |it| format!("`{it}`"));
        if self.index == 0 && ending.spoke_older {
            self.open(Dialect::Older)?;
            return self.try_advance(pool, turns);
        }
        if self.index == 0 {
            return Err(match self.settings.filter.as_str() {
                "" => format!("is no video that ffmpeg can decode; it says {words}"),
                filter => format!("gives no frame with filter = \"{filter}\"; ffmpeg says {words}"),
            });
        }
        let announced = self.header.n_frames.filter(|&it| it > self.index);
        if !ending.success || (announced.is_some() && ending.complaints.is_some()) {
            let of = announced.map_or(String::new(), |it| format!(" of {it}"));
            let reason = format!("`{}` ends after {}{of} frames; ffmpeg says {words}", self.path.display(), self.index);
            turns.push_back(Turn { time: self.last, what: What::Gap(reason) });
        } else {
            self.ending = Some(ending);
        }
        Ok(())
    }

    fn remarks(&self, instance: &str, report: &mut Report) {
        let path = self.path.display();
        report.remarks.extend(
            self.wrong.sentence(&format!("{instance} could not use {} frames of `{path}`", self.wrong.count())),
        );
        if self.left_out > 0 {
            report.remark(format!("{instance}: the time stamps of `{path}` lack {} frames", self.left_out));
        }
        let Some(ending) = &self.ending else { return };
        let announced = self.header.n_frames.filter(|&it| it > self.index);
        if let Some(announced) = announced {
            report.remark(format!(
                "{instance}: `{path}` delivered {} of the {announced} frames in its header",
                self.index
            ));
        }
        if let Some(words) = &ending.complaints {
            let times = ending.n_complaints;
            report.remark(format!("{instance}: ffmpeg complained {times} times of `{path}`: {words}"));
        }
    }
}

impl Node for Video {
    const TYPE: &'static str = "capture.video";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads a video file of one camera through ffmpeg";
    type Settings = VideoSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: VideoSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        ConfigError::unless_in("rate_hz", settings.rate_hz, 0.0..=100_000.0)?;
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("threads", settings.threads, 0..=64)?;
        let camera = camera_of(setup, Self::TYPE)?;
        let path = setup.path("path", &settings.path)?;
        let refused = |fault: String| ConfigError::at("path", format_args!("`{}` {fault}", path.display()));
        let file = std::fs::metadata(&path).map_err(|error| {
            refused(format!("cannot be read: {error}{}", where_others_have(setup, &settings.path, Path::is_file)))
        })?;
        if !file.is_file() {
            return Err(refused(
                "is no file, expected a video; for a folder of pictures use `capture.images`".to_owned(),
            ));
        }
        if file.len() == 0 {
            return Err(refused("is empty (0 bytes)".to_owned()));
        }
        Programs::default()
            .missing(std::env::var_os("PATH").as_deref())
            .map_or(Ok(()), |it| Err(ConfigError::node(it)))?;
        let latency = Interval::from_ms(settings.latency_ms);
        let film = Film {
            settings,
            camera,
            path,
            programs: Programs::default(),
            header: Header::default(),
            state: State::Unopened,
            size: setup.camera_model().map(|it| it.image_size),
            span: None,
            last: Time::ZERO,
            index: 0,
            n_pictures: 0,
            left_out: 0,
            wrong: Reasons::default(),
            ending: None,
        };
        let runs = setup.purpose == Purpose::Run;
        Ok(Self {
            film,
            pool: Pool::default(),
            latency,
            instance: setup.instance.clone(),
            turns: VecDeque::new(),
            runs,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(turn) = self.turns.pop_front() else { return Ok(()) };
        match turn.what {
            What::Picture(image) => io.emit_at(&IMAGE, turn.time, self.pool.share(image)),
            What::Gap(reason) => io.gap(&IMAGE, turn.time, reason),
            What::Fault(fault) => return Err(NodeError::input(fault)),
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.turns.is_empty() && self.runs {
            self.film.advance(&mut self.pool, &mut self.turns);
        }
        self.turns.front().map_or(Due::Never, |it| Due::At(it.time + self.latency))
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.film.remarks(&self.instance, report);
        Ok(())
    }

    fn plan(settings: &VideoSettings) -> Plan {
        let rate_hz = (settings.rate_hz > 0.0).then_some(settings.rate_hz);
        Plan { rate_hz, latency_s: settings.latency_ms * 1e-3, ..Plan::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ffmpeg::tests::make;
    use crate::settings::tests::setup_with_camera;

    const SOURCE: &str = "-f lavfi -i testsrc=size=64x48:rate=30:duration=1";

    fn settings(path: &Path) -> VideoSettings {
        VideoSettings {
            path: path.to_str().unwrap().to_owned(),
            format: Format::Gray,
            start_s: 0.0,
            rate_hz: 0.0,
            latency_ms: 0.0,
            filter: String::new(),
            field: Field::Whole,
            threads: 1,
        }
    }

    fn node(settings: VideoSettings) -> Video {
        Video::new(settings, &setup_with_camera([64, 48])).unwrap()
    }

    /// All turns of a node: times and what happened.
    fn play(node: &mut Video) -> Vec<(f64, String)> {
        let mut turns = Vec::new();
        while let Due::At(due) = node.due() {
            let turn = node.turns.pop_front().unwrap();
            assert_eq!(due, turn.time + node.latency);
            turns.push((
                turn.time.as_s(),
                match turn.what {
                    What::Picture(image) => format!("{} x {} {}", image.width, image.height, image.pixels.len()),
                    What::Gap(reason) => format!("gap: {reason}"),
                    What::Fault(fault) => format!("fault: {fault}"),
                },
            ));
        }
        turns
    }

    fn remarks(node: &mut Video) -> String {
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        report.remarks.join("\n")
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Video>("path = \"a.mp4\"\nrate_hz = 240.0");
    }

    #[test]
    fn whole_video_gives_every_frame_at_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        if !make("a whole video", &format!("{SOURCE} -bf 2 {}", path.display())) {
            return;
        }
        let mut own = node(VideoSettings { start_s: 2.0, ..settings(&path) });
        let turns = play(&mut own);
        assert_eq!(turns.len(), 30);
        for (index, (time, what)) in turns.iter().enumerate() {
            assert!((time - 2.0 - index as f64 / 30.0).abs() < 1e-4, "frame {index} at {time}");
            assert_eq!(what, "64 x 48 3072");
        }
        assert_eq!(remarks(&mut own), "");
        let slow = play(&mut node(VideoSettings { rate_hz: 240.0, format: Format::Rgb, ..settings(&path) }));
        assert_eq!(slow[24], (0.1, "64 x 48 9216".to_owned()));
    }

    #[test]
    fn pixels_are_those_of_the_video() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dot.mkv");
        // A white square that is 8 px further right in each frame.
        let dot = "-f lavfi -i color=black:size=64x48:rate=10:duration=0.6,format=gray,geq=lum='255*between(X,8*N+1,8*N+4)*between(Y,20,23)'";
        if !make("the pixels of a video", &format!("{dot} -c:v ffv1 {}", path.display())) {
            return;
        }
        let mut node = node(settings(&path));
        for index in 0..6 {
            assert!(matches!(node.due(), Due::At(_)));
            let Some(Turn { what: What::Picture(image), .. }) = node.turns.pop_front() else { panic!("frame {index}") };
            let sum: f64 = image.pixels.iter().map(|&it| f64::from(it)).sum();
            let moment: f64 = image.pixels.iter().enumerate().map(|(at, &it)| (at % 64) as f64 * f64::from(it)).sum();
            assert!((moment / sum - (8.0 * index as f64 + 2.5)).abs() < 1e-9, "frame {index}: {}", moment / sum);
        }
    }

    #[test]
    fn frames_pass_the_filter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        if !make("a filtered video", &format!("{SOURCE} {}", path.display())) {
            return;
        }
        let filter = |chain: &str| play(&mut node(VideoSettings { filter: chain.into(), ..settings(&path) }));
        let turns = filter("transpose=1,pad=64:64,crop=64:48");
        assert_eq!((turns.len(), turns[0].1.as_str()), (30, "64 x 48 3072"));
        assert!(filter("transpose=1")[0].1.contains("48 x 64 px after filter = \"transpose=1\", expected 64 x 48 px"));
        let turns = filter("no_such_filter=3");
        let said = &turns[0].1;
        assert!(said.starts_with("fault") && said.contains("filter = \"no_such_filter=3\"; ffmpeg says"), "{said}");
        assert!(said.contains("No such filter: 'no_such_filter'"), "{said}");
    }

    #[test]
    fn uneven_time_stamps_are_kept_and_left_out_frames_are_gaps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("uneven.mkv");
        // Frames 10, 11 and 12 of 30 are missing, their times are not closed up.
        let cut = "-vf select='not(between(n,10,12))' -fps_mode passthrough -c:v ffv1";
        if !make("a video with a hole", &format!("{SOURCE} {cut} {}", path.display())) {
            return;
        }
        let mut node = node(settings(&path));
        let turns = play(&mut node);
        let gaps: Vec<f64> = turns.iter().filter(|it| it.1.starts_with("gap")).map(|it| it.0).collect();
        assert_eq!(gaps.len(), 3, "{turns:?}");
        for (gap, expected) in gaps.iter().zip([10.0, 11.0, 12.0]) {
            assert!((gap - expected / 30.0).abs() < 1.5e-3, "{gap}");
        }
        assert!((turns[13].0 - 13.0 / 30.0).abs() < 1e-3);
        assert!(remarks(&mut node).contains("3 frames"));
    }

    #[test]
    fn truncated_video_gives_what_there_is_and_ffmpegs_words() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.avi");
        if !make("a truncated video", &format!("{SOURCE} -c:v mjpeg {}", path.display())) {
            return;
        }
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let mut node = node(settings(&path));
        let turns = play(&mut node);
        assert!((5..29).contains(&turns.len()), "{} turns", turns.len());
        let (_, last) = &turns[turns.len() - 1];
        assert!(last.starts_with("gap") && last.contains("of 30 frames") && last.contains("corrupt"), "{last}");
        assert_eq!(remarks(&mut node), "", "the gap has said it");
    }

    #[test]
    fn what_is_no_video_is_said_in_ffmpegs_words() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no.mp4");
        std::fs::write(&path, "no video at all").unwrap();
        if !make("a file that is no video", &format!("{SOURCE} {}", folder.path().join("a.mp4").display())) {
            return;
        }
        let turns = play(&mut node(settings(&path)));
        assert_eq!(turns.len(), 1);
        assert!(turns[0].1.starts_with("fault") && turns[0].1.contains("Invalid data"), "{turns:?}");
    }

    #[test]
    fn wrong_size_says_both_sizes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        if !make("a video of another size", &format!("{SOURCE} {}", path.display())) {
            return;
        }
        let turns = play(&mut Video::new(settings(&path), &setup_with_camera([640, 480])).unwrap());
        assert_eq!(turns.len(), 1);
        assert!(turns[0].1.contains("64 x 48 px, expected 640 x 480 px"), "{turns:?}");
    }

    #[test]
    fn missing_ffmpeg_says_how_to_get_it() {
        // What is looked for first is there.
        if !make("a missing ffmpeg", "-version") {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, "x").unwrap();
        for program in ["ffmpeg", "ffprobe"] {
            let mut node = node(settings(&path));
            match program {
                "ffmpeg" => node.film.programs.ffmpeg = "no-such-ffmpeg".into(),
                _ => node.film.programs.ffprobe = "no-such-ffprobe".into(),
            }
            let turns = play(&mut node);
            assert!(turns[0].1.contains("apt install ffmpeg"), "{turns:?}");
        }
    }

    #[test]
    fn nothing_is_started_to_check() {
        // What is looked for first is there.
        if !make("the check of a video", "-version") {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, "x").unwrap();
        let setup = Setup { purpose: Purpose::Check, ..setup_with_camera([64, 48]) };
        let mut node = Video::new(settings(&path), &setup).unwrap();
        assert_eq!(node.due(), Due::Never);
        assert!(matches!(node.film.state, State::Unopened));
        let refused = |path: &Path| Video::new(settings(path), &setup).map(|_| ()).unwrap_err();
        assert!(refused(folder.path()).message.contains("capture.images"));
        assert!(refused(Path::new("/no/such.mp4")).message.contains("/no/such.mp4"));
        std::fs::write(&path, "").unwrap();
        assert!(refused(&path).message.contains("empty"));
    }
}
