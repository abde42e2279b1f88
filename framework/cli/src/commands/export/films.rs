//! Pictures of a session as a film for each camera.
//!
//! Films have one rate and begin together: a picture is shown from its capture time to the next one, so that films of cameras that lost pictures stay in step.
//! The table beside each film says which picture each frame is.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use foveate_capture::encoder::{Encoder, FilmForm};
use foveate_messages::{Image, Time};
use foveate_scene::selection::matches;
use foveate_session::source::camera_of;
use foveate_session::{Session, picture};

use crate::progress::Waiting;
use crate::results::write_whole;

/// A film.
struct Film {
    name: String,
    schema: String,
    /// Time from one frame to the next [s].
    period_s: f64,
    encoder: Option<Encoder>,
    /// The picture that is shown until another one comes.
    last: Option<(Time, Image)>,
    n_frames: u64,
    table: String,
}

/// Writes a film for each camera whose name fits one of `cameras` (empty: all), and gives their names.
pub(super) fn write(
    session: &mut Session,
    folder: &Path,
    form: FilmForm,
    cameras: &[String],
    quiet: bool,
) -> Result<Vec<String>, String> {
    let (contents, _) = session.contents();
    let mut films: BTreeMap<u16, Film> = BTreeMap::new();
    for (id, channel) in &session.summary.channels {
        let schema = session.summary.schemas.get(&channel.schema_id).map_or("", |it| it.0.name.as_str());
        let Some(camera) = camera_of(channel).filter(|_| picture::is_picture(schema)) else { continue };
        let its = contents.get(id).map(|it| it.intervals_s()).unwrap_or_default();
        let is_wanted = cameras.is_empty() || cameras.iter().any(|it| matches(it, camera));
        if let Some(&period_s) = its.get(its.len() / 2).filter(|it| **it > 0.0 && is_wanted) {
            let name = channel.topic.trim_start_matches('/').replace('/', ".");
            let table = "frame,time_s,is_repeated\n".to_owned();
            let film =
                Film { name, schema: schema.to_owned(), period_s, encoder: None, last: None, n_frames: 0, table };
            films.insert(*id, film);
        }
    }
    if films.is_empty() {
        let of = if cameras.is_empty() { String::new() } else { format!(" of {}", cameras.join(", ")) };
        return Err(format!("`{}` holds no pictures{of} to make films of", session.path.display()));
    }
    let waiting = Waiting::new("writing films", quiet);
    // The earliest picture is where all films begin.
    let start = first_time(session, &films)?;
    for chunk in 0..session.summary.chunks.len() {
        let mut pictures = Vec::new();
        session.messages(chunk, |channel, _, bytes| {
            if let Some(film) = films.get(&channel) {
                pictures.push((channel, picture::read(&film.schema, bytes)?));
            }
            Ok(())
        })?;
        for (channel, (stamp, image)) in pictures {
            let Some(film) = films.get_mut(&channel) else { continue };
            film.show(folder, form, start, stamp.time, image)?;
        }
    }
    let mut names = Vec::new();
    for film in films.into_values() {
        names.extend(film.finish(folder, form)?);
    }
    drop(waiting);
    Ok(names)
}

/// Capture time of the earliest of the first pictures.
fn first_time(session: &mut Session, films: &BTreeMap<u16, Film>) -> Result<Time, String> {
    let mut first: BTreeMap<u16, Time> = BTreeMap::new();
    for chunk in 0..session.summary.chunks.len() {
        session.messages(chunk, |channel, _, bytes| {
            if let (Some(film), false) = (films.get(&channel), first.contains_key(&channel)) {
                first.insert(channel, picture::read(&film.schema, bytes)?.0.time);
            }
            Ok(())
        })?;
        if first.len() == films.len() {
            break;
        }
    }
    Ok(first.into_values().min().unwrap_or(Time::ZERO))
}

impl Film {
    /// A picture that was captured at `time`; the one before it fills the frames up to there.
    fn show(&mut self, folder: &Path, form: FilmForm, start: Time, time: Time, image: Image) -> Result<(), String> {
        let failed = |what: String| format!("the film `{}` cannot be written: {what}", self.name);
        if self.encoder.is_none() {
            let path = folder.join(format!("{}.{}", self.name, form.ending()));
            self.encoder = Some(Encoder::begin(&path, &image, 1.0 / self.period_s, form).map_err(failed)?);
        }
        let place = ((time - start).as_s() / self.period_s).round().max(0.0) as u64;
        if let Some((_, last)) = &self.last
            && (last.width, last.height, last.format) != (image.width, image.height, image.format)
        {
            let (found, expected) = ([image.width, image.height], [last.width, last.height]);
            return Err(failed(format!("at {time} a picture is {found:?} px, expected {expected:?} px")));
        }
        let n_repeated = place.saturating_sub(self.n_frames);
        let (held_time, held) = self.last.get_or_insert_with(|| (time, image.clone()));
        let encoder = self.encoder.as_mut().ok_or("no film is open")?;
        let mut frame = |time: Time, image: &Image, is_repeated: bool| -> Result<(), String> {
            encoder.add(image).map_err(|what| format!("the film `{}` cannot be written: {what}", self.name))?;
            let _ = writeln!(self.table, "{},{:.6},{}", self.n_frames, time.as_s(), u8::from(is_repeated));
            self.n_frames += 1;
            Ok(())
        };
        for _ in 0..n_repeated {
            frame(*held_time, held, true)?;
        }
        frame(time, &image, false)?;
        self.last = Some((time, image));
        Ok(())
    }

    /// Ends the film; the names of its files.
    fn finish(self, folder: &Path, form: FilmForm) -> Result<Vec<String>, String> {
        let Film { name, encoder, table, .. } = self;
        let Some(encoder) = encoder else { return Ok(Vec::new()) };
        encoder.finish().map_err(|what| format!("the film `{name}` cannot be written: {what}"))?;
        write_whole(&folder.join(format!("{name}.csv")), table.as_bytes())?;
        Ok(vec![format!("{name}.{}", form.ending()), format!("{name}.csv")])
    }
}
