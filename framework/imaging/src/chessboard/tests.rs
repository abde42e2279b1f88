//! Rendered boards: where corners are found, in which order, and what is no board.

use foveate_estimation::random::Random;
use nalgebra::Matrix3;

use super::*;

const SIZE: [usize; 2] = [320, 240];

/// A board of squares of side 1, corner 0 at the origin, in a white frame on a gray floor, as a homography shows it.
struct Scene {
    image_from_board: Matrix3<f64>,
    columns: usize,
    rows: usize,
    /// Dark squares are smaller by this on each side, in squares: white that outshines them.
    bloom: f64,
    is_inverted: bool,
}

impl Scene {
    /// 7 × 4 corners, of which one end alone is dark; pixels from one to the next in a row and in a column, and how much farther off each is.
    fn new(origin: [f64; 2], along: [f64; 2], down: [f64; 2], farther: [f64; 2]) -> Scene {
        let image_from_board =
            Matrix3::new(along[0], down[0], origin[0], along[1], down[1], origin[1], farther[0], farther[1], 1.0);
        Scene { image_from_board, columns: 7, rows: 4, bloom: 0.0, is_inverted: false }
    }

    fn corner(&self, at: usize) -> Point2<f64> {
        let seen =
            self.image_from_board * nalgebra::Vector3::new((at % self.columns) as f64, (at / self.columns) as f64, 1.0);
        Point2::from(seen.xy() / seen.z)
    }

    fn level(&self, x: f64, y: f64) -> f64 {
        let (right, bottom) = (self.columns as f64, self.rows as f64);
        if !(-1.6..right + 0.6).contains(&x) || !(-1.6..bottom + 0.6).contains(&y) {
            return 110.0;
        }
        let is_inside = (-1.0..right).contains(&x) && (-1.0..bottom).contains(&y);
        let (u, v) = (x - x.floor(), y - y.floor());
        let is_whole = u.min(v).min(1.0 - u).min(1.0 - v) >= self.bloom;
        // The square before corner 0 is dark.
        let is_dark = is_inside && is_whole && (x.floor() + y.floor()).rem_euclid(2.0) == 0.0;
        if is_dark != self.is_inverted { 40.0 } else { 220.0 }
    }

    fn render(&self) -> Vec<u8> {
        let back = self.image_from_board.try_inverse().unwrap();
        let mut random = Random::new(7);
        let mut pixels = Vec::new();
        for index in 0..SIZE[0] * SIZE[1] {
            let mut sum = 0.0;
            // The lens blurs over a pixel and a half.
            for part in 0..64 {
                let off = |it: i32| (f64::from(it) - 3.5) * 1.5 / 8.0;
                let (x, y) = ((index % SIZE[0]) as f64 + off(part % 8), (index / SIZE[0]) as f64 + off(part / 8));
                let place = back * nalgebra::Vector3::new(x, y, 1.0);
                sum += self.level(place.x / place.z, place.y / place.z);
            }
            pixels.push((sum / 64.0 + 2.0 * random.normal()).round().clamp(0.0, 255.0) as u8);
        }
        pixels
    }

    fn find(&self, columns: usize, rows: usize) -> Option<Vec<Corner>> {
        find_chessboard(&ImageView::new(&self.render(), SIZE[0], SIZE[1]).unwrap(), columns, rows)
    }

    /// Root mean square error of a coordinate, and the same in units of what is stated; each corner under its number.
    #[track_caller]
    fn error(&self) -> (f64, f64) {
        let found = self.find(self.columns, self.rows).expect("the board is found");
        assert_eq!(found.len(), self.columns * self.rows);
        let (mut squares, mut stated) = (0.0, 0.0);
        for (at, corner) in found.iter().enumerate() {
            let off = corner.centre - self.corner(at);
            assert!(off.norm() < 1.5, "corner {at} is {off} px off");
            squares += off.norm_squared();
            stated += off.dot(&(corner.covariance.try_inverse().unwrap() * off));
        }
        let n = 2.0 * found.len() as f64;
        ((squares / n).sqrt(), (stated / n).sqrt())
    }
}

/// Straight on, large.
fn plain() -> Scene {
    Scene::new([60.0, 50.0], [28.0, 1.0], [-1.0, 28.0], [0.0, 0.0])
}

#[test]
fn corners_are_found_within_a_few_hundredths_of_a_pixel_however_the_board_is_turned() {
    let scenes = [
        ("straight on", plain()),
        ("upside down", Scene::new([250.0, 190.0], [-27.0, 0.0], [0.0, -26.0], [0.0, 0.0])),
        ("on its side", Scene::new([230.0, 40.0], [0.0, 24.0], [-24.0, 0.0], [0.0, 0.0])),
        ("on its corner", Scene::new([120.0, 30.0], [14.0, 14.0], [-14.0, 14.0], [0.0, 0.0])),
        ("slanted", Scene::new([70.0, 60.0], [30.0, 8.0], [-6.0, 20.0], [0.03, 0.02])),
        ("small squares", Scene::new([150.0, 120.0], [6.0, 0.4], [-0.4, 6.0], [0.0, 0.0])),
    ];
    for (name, scene) in scenes {
        let (error, stated) = scene.error();
        assert!(error < 0.06 && stated < 3.0, "{name}: {error:.3} px, {stated:.2} times what is stated");
    }
}

#[test]
fn a_board_far_off_on_the_floor_is_found_where_white_outshines_black() {
    let mut scene = Scene::new([100.0, 120.0], [9.5, -3.0], [9.5, 3.2], [0.0, 0.0]);
    assert!(scene.error().0 < 0.2, "{:?}", scene.error());
    scene.bloom = 0.12;
    assert!(scene.error().0 < 0.4, "{:?}", scene.error());
}

#[test]
fn a_board_with_two_dark_ends_begins_at_the_upper_left() {
    // Of 7 × 5 corners all outer squares in the corners are dark: turned by half, it is the same board.
    let upright = Scene::new([60.0, 50.0], [26.0, 0.0], [0.0, 26.0], [0.0, 0.0]);
    let turned = Scene::new([216.0, 154.0], [-26.0, 0.0], [0.0, -26.0], [0.0, 0.0]);
    for mut scene in [upright, turned] {
        scene.rows = 5;
        let found = scene.find(7, 5).unwrap();
        assert!((found[0].centre - Point2::new(60.0, 50.0)).norm() < 0.2, "{}", found[0].centre);
    }
}

#[test]
fn another_board_part_of_one_and_none_are_not_found() {
    let whole = plain();
    for (columns, rows) in [(7, 5), (8, 4), (6, 4), (7, 3), (4, 4), (3, 3)] {
        assert!(whole.find(columns, rows).is_none(), "{columns} x {rows}");
    }
    let pixels = whole.render();
    assert_eq!(largest_grid(&ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap()), Some([7, 4]));
    // The other way round it is the same board, but for the order of its corners.
    assert!(whole.find(4, 7).is_some());
    let cut = Scene::new([160.0, 50.0], [28.0, 1.0], [-1.0, 28.0], [0.0, 0.0]);
    assert!(cut.find(7, 4).is_none());
    for (columns, rows) in [(0, 0), (2, 5), (7, 2), (usize::MAX, 5)] {
        assert!(whole.find(columns, rows).is_none());
    }
    let nothing = |width, height, level| {
        let pixels = vec![level; width * height];
        find_chessboard(&ImageView::new(&pixels, width, height).unwrap(), 7, 5)
    };
    for (width, height) in [(0, 0), (1, 1), (5, 300), (17, 17), (320, 240)] {
        assert!(nothing(width, height, 128).is_none());
    }
}

#[test]
fn a_hidden_corner_is_supplied_by_its_neighbours_or_the_board_is_left() {
    let scene = plain();
    let mut pixels = scene.render();
    let hidden = scene.corner(17);
    for (index, pixel) in pixels.iter_mut().enumerate() {
        let place = Point2::new((index % SIZE[0]) as f64, (index / SIZE[0]) as f64);
        if (place - hidden).norm() < 5.0 {
            *pixel = 130;
        }
    }
    let found = find_chessboard(&ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap(), 7, 4).unwrap();
    assert!((found[17].centre - hidden).norm() < 2.0);
    assert!((found[20].centre - scene.corner(20)).norm() < 0.2);
}
