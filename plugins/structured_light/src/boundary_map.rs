//! The map of one picture that boundaries make: which repetition of the code each is, and the pixels beside it.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate::imaging::stripes::boundary::Line;
use foveate::prelude::*;

use crate::foresight::Field;

/// Of a boundary's slope, where one of its neighbours is missing and across a stripe: what a place is off for each pixel beside the boundary [–].
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

/// On the side where no next boundary is known the surface may end, or step: points go no farther than this part of a stripe. On rims, where stripes are 2 to 4 px wide in the camera's picture, two pixels are on what is behind [–].
const BEYOND: f32 = 0.25;

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
        let (slope, wide) = (line.slope, line.slope.recip());
        // Where stripes are wide, as far beside as elsewhere in the projector's picture.
        let beside = beside * (wide / pitch).clamp(1.0, WIDEST);
        let reach = line.is_last.map(|is_last| if is_last { beside.min(BEYOND * wide) } else { beside });
        let width = self.map.width as usize;
        let first = (line.x - reach[0]).ceil().max(0.0) as usize;
        let last = ((line.x + reach[1]).floor() as usize).min(width - 1);
        for x in first..=last {
            let off = x as f32 - line.x;
            let at = y * width + x;
            if off.abs() >= self.away[at] {
                continue;
            }
            self.map.n_known += u32::from(self.away[at].is_infinite());
            self.away[at] = off.abs();
            let value = column + off * slope * stripe;
            let sigma = slope * stripe * line.sigma.hypot(SLOPE_SIGMA * off);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of a row of the picture that a boundary at column 20 gives points, whose stripes are `wide` [px].
    fn drawn(wide: f32, is_last: [bool; 2]) -> Vec<usize> {
        let image = Image { width: 40, height: 1, ..Image::default() };
        let line = Line {
            number: 5,
            x: 20.0,
            sigma: 0.1,
            slope: wide.recip(),
            confidence: 1.0,
            is_last,
            is_lit: [true; 2],
            is_ghost: false,
        };
        let mut map = Map::new(&image, [100, 100], 0);
        map.draw(0, &line, 19.5, 4.0, 8.0, 2.0);
        let map = map.finish(String::new());
        (0..40).filter(|x| map.get(*x, 0).coordinate[0].is_finite()).collect()
    }

    #[test]
    fn points_beside_a_boundary_end_where_the_surface_may() {
        assert_eq!(drawn(8.0, [false; 2]), [18, 19, 20, 21, 22]);
        assert_eq!(drawn(16.0, [false; 2]), [16, 17, 18, 19, 20, 21, 22, 23, 24], "as far in the projector's picture");
        assert_eq!(drawn(3.0, [false; 2]), [18, 19, 20, 21, 22]);
        assert_eq!(drawn(3.0, [false, true]), [18, 19, 20], "beyond the last one there may be nothing");
        assert_eq!(drawn(5.0, [true, false]), [19, 20, 21, 22]);
    }
}
