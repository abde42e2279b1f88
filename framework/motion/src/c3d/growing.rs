//! A C3D file that grows during recording: a header of constant length, and frames behind it.
//!
//! After each batch of frames the header is rewritten with their number; then the file is complete. Frames are 32-bit floats in Intel's order.

use super::read::sample;
use super::write::{MOST_FRAMES, Room, floats, head, integers};
use super::{BLOCK, ByteOrder, C3dError, Recording, Sample, fault};

/// Bytes of a point in a frame.
pub const POINT_BYTES: usize = 16;

/// Writes a C3D file frame by frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Growing {
    about: Recording,
    residual_step: f32,
    label_bytes: usize,
}

impl Growing {
    /// A file of the points that `about` names (its samples are ignored). Labels of up to `label_bytes` bytes can be
    /// changed later. Residuals are written in steps of `residual_step`, at most 255 of them.
    ///
    /// # Errors
    /// As [`write`](super::write): too many points, too long labels, analog channels, a step that is not above 0.
    pub fn new(about: Recording, residual_step: f32, label_bytes: usize) -> Result<Self, C3dError> {
        if !about.analog.labels.is_empty() {
            return fault(0, "analog channels", "points alone");
        }
        if about.labels.len() > usize::from(u16::MAX) {
            return fault(0, format_args!("{} points", about.labels.len()), "at most 65535");
        }
        if !(residual_step.is_finite() && residual_step > 0.0) {
            return fault(0, format_args!("a step of {residual_step}"), "a number above 0");
        }
        let this = Self { about: Recording { samples: Vec::new(), ..about }, residual_step, label_bytes };
        this.head(0)?;
        Ok(this)
    }

    /// Header and parameters for `n_frames` frames; of the same length for any number of frames.
    ///
    /// # Errors
    /// More than 16,777,216 frames.
    pub fn head(&self, n_frames: usize) -> Result<Vec<u8>, C3dError> {
        if n_frames > MOST_FRAMES {
            return fault(0, format_args!("{n_frames} frames"), "at most 16777216: they are counted by a 32-bit float");
        }
        let room = Room { long_frames: true, label_bytes: self.label_bytes };
        head(&self.about, n_frames, -self.residual_step, ByteOrder::Intel, room)
    }

    /// Appends one or several frames, one sample for each point, to `out`.
    pub fn put(&self, samples: &[Sample], out: &mut Vec<u8>) {
        floats(out, samples, self.residual_step, f32::to_le_bytes);
    }

    /// Decodes 16 bytes that [`Self::put`] wrote; the residual is in whole steps.
    pub fn sample(&self, bytes: [u8; POINT_BYTES]) -> Sample {
        let value = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        sample([value(0), value(4), value(8)], value(12) as i16, self.residual_step)
    }

    /// Header and parameters of the same file with 16-bit integers in steps of `step`, for frames of [`Self::put_integers`].
    ///
    /// # Errors
    /// As [`Self::head`].
    pub fn integer_head(&self, n_frames: usize, step: f32) -> Result<Vec<u8>, C3dError> {
        let room = Room { long_frames: n_frames > usize::from(u16::MAX), label_bytes: 0 };
        head(&self.about, n_frames, step, ByteOrder::Intel, room)
    }

    /// The step for coordinates up to `farthest`: a little larger than the least, so that the farthest is not rounded beyond the last number.
    pub fn integer_step(farthest: f32) -> f32 {
        let largest = farthest / f32::from(i16::MAX);
        if largest > 0.0 && largest.is_finite() { largest * 1.000_001 } else { 1.0 }
    }

    /// Appends samples as integers to `out`.
    pub fn put_integers(samples: &[Sample], step: f32, out: &mut Vec<u8>) {
        integers(out, samples, step, ByteOrder::Intel);
    }

    /// Padding for the last block of a file of `n_bytes` bytes with `n_frames` frames [bytes]. 0 where the header
    /// cannot count the frames: readers that then go to the end of the file would take padding for points.
    pub fn padding(n_bytes: u64, n_frames: usize) -> usize {
        if n_frames > usize::from(u16::MAX) { 0 } else { (n_bytes.next_multiple_of(BLOCK as u64) - n_bytes) as usize }
    }
}

#[cfg(test)]
mod tests {
    use super::super::read;
    use super::*;

    fn about(n_points: usize) -> Recording {
        let labels = (0..n_points).map(|it| format!("mark-{it}")).collect();
        Recording {
            rate_hz: 240.0,
            units: "mm".to_owned(),
            first_frame: 1,
            labels,
            start_s: Some(0.5),
            ..Recording::default()
        }
    }

    #[test]
    fn file_is_whole_after_each_lot_of_frames() {
        for n_points in [1, 5, 300] {
            let growing = Growing::new(about(n_points), 0.015625, 24).unwrap();
            let start = growing.head(0).unwrap().len();
            let mut frames = Vec::new();
            let mut samples = Vec::new();
            for n_frames in 1..=40_usize {
                let place = |it: usize| [(n_frames * it) as f32, 1.5, -2.25];
                let of_frame: Vec<Sample> = (0..n_points)
                    .map(|it| match (it + n_frames) % 5 {
                        0 => Sample::MISSING,
                        _ => Sample { position: place(it), residual: 0.03125, cameras: 5 },
                    })
                    .collect();
                growing.put(&of_frame, &mut frames);
                samples.extend(of_frame);
                let head = growing.head(n_frames).unwrap();
                assert_eq!(head.len(), start);
                let found = read(&[&head[..], &frames].concat()).unwrap();
                assert_eq!(found, Recording { samples: samples.clone(), ..about(n_points) });
            }
        }
    }

    #[test]
    fn integers_are_made_of_the_floats() {
        let growing = Growing::new(about(2), 0.015625, 0).unwrap();
        let samples = [Sample { position: [100.0, -300.0, 7.0], residual: 0.5, cameras: 3 }, Sample::MISSING];
        let mut floats = Vec::new();
        growing.put(&samples, &mut floats);
        let back: Vec<Sample> = floats.as_chunks::<POINT_BYTES>().0.iter().map(|it| growing.sample(*it)).collect();
        assert_eq!(back, samples);
        let step = Growing::integer_step(300.0);
        let mut file = growing.integer_head(1, step).unwrap();
        Growing::put_integers(&back, step, &mut file);
        let found = read(&file).unwrap();
        assert!((0..3).all(|it| (found.samples[0].position[it] - samples[0].position[it]).abs() < 0.5001 * step));
        assert_eq!((found.samples[1], found.labels), (Sample::MISSING, growing.about.labels));
    }

    #[test]
    fn what_no_file_can_tell_is_refused() {
        assert!(Growing::new(about(1), 0.0, 0).unwrap_err().expected.contains("above 0"));
        let long = Recording { labels: vec!["x".repeat(121)], ..about(0) };
        assert!(Growing::new(long, 0.02, 0).unwrap_err().found.contains("xxx"));
        let growing = Growing::new(about(1), 0.02, 0).unwrap();
        assert!(growing.head(1 << 24).is_ok() && growing.head((1 << 24) + 1).is_err());
    }
}
