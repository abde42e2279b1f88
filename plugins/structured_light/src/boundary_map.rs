//! The map of one picture that boundaries make: which repetition of the code each is, and the pixels beside it.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate::imaging::stripes::boundary::Line;
use foveate::prelude::*;

use crate::foresight::Field;

/// Of a boundary's slope where one of its neighbours is missing, and of that across a stripe [–].
const SLOPE_SIGMA: f32 = 0.1;

/// Stripes count as no wider than so many that face the camera: beyond, their slope changes too much [–].
const WIDEST: f32 = 2.0;

/// The projector column of a boundary, in the one repetition of the code that fits; `None` where none or several do.
pub(crate) fn period_of(line: &Line, y: usize, stripe: f32, period: f32, lit_from: &Field) -> Option<f32> {
    let [a, b] = lit_from.at(line.x, y as f32);
    let (least, most) = (a.min(b), a.max(b));
    let first = f32::from(line.number) * stripe - 0.5;
    let times = ((least - first) / period).ceil();
    let column = first + times * period;
    (column <= most && column + period > most && times >= 0.0).then_some(column)
}

/// The brightest of each pixel over some pictures.
pub(crate) fn brightest(pictures: &VecDeque<Arc<Image>>) -> Vec<u8> {
    let mut pictures = pictures.iter();
    let mut all = pictures.next().map(|it| it.pixels.clone()).unwrap_or_default();
    for picture in pictures {
        all.iter_mut().zip(&picture.pixels).for_each(|(a, b)| *a = (*a).max(*b));
    }
    all
}

/// A map in the making.
pub(crate) struct Map {
    map: ProjectorMap,
    axis: usize,
    /// How far the boundary is whose column a pixel has [px].
    away: Vec<f32>,
}

impl Map {
    pub(crate) fn new(image: &Image, projector_size: [u32; 2], axis: usize) -> Map {
        let (width, height) = (image.width, image.height);
        let n = width as usize * height as usize;
        let nothing: Vec<u8> = [f32::NAN; 4].iter().flat_map(|it| it.to_le_bytes()).collect();
        let map = ProjectorMap {
            camera: image.camera,
            projector_size,
            width,
            height,
            samples: nothing.repeat(n),
            ..ProjectorMap::default()
        };
        Map { map, axis, away: vec![f32::INFINITY; n] }
    }

    /// Gives the pixels beside a boundary their columns of the projector.
    pub(crate) fn draw(&mut self, y: usize, line: &Line, column: f32, stripe: f32, pitch: f32, beside: f32) {
        // Without a neighbour the slope is that of a surface that faces the camera, about. Where stripes are wide, as far beside as elsewhere in the projector's picture.
        let (slope, unsure, beside) = match line.slope.is_finite() {
            true if line.is_last => (line.slope, SLOPE_SIGMA, beside),
            true => (line.slope, SLOPE_SIGMA, beside * (1.0 / (line.slope * pitch)).clamp(1.0, WIDEST)),
            false => (1.0 / pitch, 0.5, 0.5),
        };
        let width = self.map.width as usize;
        let first = (line.x - beside).ceil().max(0.0) as usize;
        let last = ((line.x + beside).floor() as usize).min(width - 1);
        for x in first..=last {
            let off = x as f32 - line.x;
            let at = y * width + x;
            if off.abs() >= self.away[at] {
                continue;
            }
            self.map.n_known += u32::from(self.away[at].is_infinite());
            self.away[at] = off.abs();
            let value = column + off * slope * stripe;
            let sigma = slope * stripe * line.sigma.hypot(unsure * off);
            for (place, number) in [(self.axis, value), (2 + self.axis, sigma)] {
                self.map.samples[16 * at + 4 * place..][..4].copy_from_slice(&number.to_le_bytes());
            }
        }
    }

    pub(crate) fn finish(mut self, name: String) -> ProjectorMap {
        self.map.name = name;
        self.map
    }
}
