//! The truth about a picture of the studio: which person the centre of each pixel sees, and where people block light.

use std::sync::{Arc, OnceLock};

use foveate_messages::Time;
use nalgebra::{Isometry3, Point3, Rotation3, Vector3};

use super::studio::{Projector, THING_BIT};
use crate::sight::{FirstHits, Lines};
use crate::studio::{Lighting, Posed, Studio, place};
use crate::truth::TrueCamera;
use crate::world::World;

/// Light that is less than this share of what it is without people is a shadow [–].
const SHADOW: f32 = 0.9;

/// What a camera sees of people; keeps what it needs from picture to picture.
#[derive(Default)]
pub(crate) struct PeopleView {
    lines: Option<Lines>,
    /// Row by row: 0 no person, otherwise the number of the person plus 1.
    pub seen: Vec<u8>,
    /// The people present, and when.
    things: Vec<(usize, Arc<Posed>)>,
    time: Time,
    /// Computed on first use.
    lighting: OnceLock<Arc<Lighting>>,
    width: usize,
    eye: Point3<f64>,
    turn: Rotation3<f64>,
}

impl PeopleView {
    /// Looks through a camera that stands as `camera` does at `time`.
    pub fn look(&mut self, world: &World, camera: &TrueCamera, time: Time) {
        let [width, height] = camera.image_size.map(|it| it as usize);
        self.seen.clear();
        self.seen.resize(width * height, 0);
        (self.width, self.time) = (width, time);
        self.lighting = OnceLock::new();
        self.things.clear();
        self.eye = camera.centre();
        self.turn = camera.camera_from_world.rotation.inverse().to_rotation_matrix();
        let Some(studio) = world.studio() else { return };
        let projector = Projector::new(camera);
        let things: Vec<(usize, Arc<Posed>)> =
            world.present(time).into_iter().map(|it| (it, world.posed(studio, it, time))).collect();
        let image = |vertices: &[Point3<f64>]| -> Vec<[f32; 3]> {
            vertices.iter().map(|it| projector.image(it).unwrap_or([0.0; 3])).collect()
        };
        let imaged: Vec<Vec<[f32; 3]>> = things.iter().map(|it| image(&it.1.vertices)).collect();
        let of_props = image(&studio.props.vertices);
        let mut hits = FirstHits::default();
        hits.begin(imaged.iter().flatten(), [0.0; 2], camera.image_size);
        for (index, (thing, _)) in things.iter().enumerate() {
            hits.add(&imaged[index], &studio.thing(*thing).triangles, (index as u32) << THING_BIT, [0.0; 2]);
        }
        let n_people = things.len();
        hits.add(&of_props, &studio.props.triangles, (n_people as u32) << THING_BIT, [0.0; 2]);
        let lines = Lines::know(&mut self.lines, &camera.standing(Isometry3::identity()));
        let [columns, rows] = hits.area();
        for (column, row) in rows.flat_map(|row| columns.clone().map(move |it| (it, row))) {
            let hit = hits.triangle(column, row).map(|it| it >> THING_BIT);
            let Some(hit) = hit.filter(|it| *it < n_people) else { continue };
            let [x, y] = lines.at_shifted(column, row, width, [0.0; 2]);
            // Desks stand before people, too.
            let room = place(&self.eye, &(self.turn * Vector3::new(x, y, 1.0)), 1.0);
            if hits.depth(column, row).is_some_and(|it| f64::from(it) < room.depth) {
                self.seen[row * width + column] = things[hit].0 as u8 + 1;
            }
        }
        self.things = things;
    }

    /// Whether people block some of the light on the part of the room that a pixel sees behind them.
    pub fn is_shaded(&self, studio: &Studio, column: usize, row: usize) -> bool {
        let Some(lines) = &self.lines else { return false };
        let lighting = self.lighting.get_or_init(|| studio.lighting(self.time, 0.0, &self.things));
        let [x, y] = lines.at_shifted(column, row, self.width, [0.0; 2]);
        let room = place(&self.eye, &(self.turn * Vector3::new(x, y, 1.0)), 1.0);
        let (mut all, mut left) = (studio.ambient(&room.normal), studio.ambient(&room.normal));
        for (number, lamp) in studio.lamps.iter().enumerate() {
            let light = lamp.colour()[1] * lamp.falls_on(&room.point, &room.normal) * lighting.levels[number];
            all += light;
            left += light * lighting.maps[number].iter().map(|it| it.free(&room.point)).product::<f32>();
        }
        left < SHADOW * all
    }
}
