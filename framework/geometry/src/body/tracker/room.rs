//! How much room an arm has: hulls of few views make a sheet of an arm, in which it may lie anywhere.

use nalgebra::Vector3;

use super::super::field::VoxelField;
use super::super::parts::Limb;
use super::BodyTracker;

/// Around an axis it is looked so far, in radii of the part, beside a voxel [–].
const REACH: f64 = 2.5;
/// Places along the axis, away from it, and about it.
const PLACES: [usize; 3] = [8, 6, 8];
/// What lies this near to the skin of another part is that part's [m].
const OTHERS: f64 = 0.01;

impl BodyTracker {
    /// Measures the room of both arms.
    pub(super) fn look_around(&mut self, field: &VoxelField) {
        self.room = [Limb::LeftArm, Limb::RightArm].map(|limb| self.room_of(field, limb));
    }

    /// What the voxels around the lower part of a limb hold that is no other part's, over that part's volume [–].
    fn room_of(&self, field: &VoxelField, limb: Limb) -> f64 {
        let [_, lower] = limb.parts();
        if !self.filter.layout().has(lower) {
            return 1.0;
        }
        let body = &self.filter.body;
        let others = self.skins().without(&limb.parts());
        let sizes = body.size(lower);
        let radius = (sizes.x + sizes.y) / 2.0;
        let reach = REACH * radius + field.size();
        let [along, away, about] = PLACES;
        let (centre, turn) = (body.centres()[lower.index()], body.turn(lower));
        let mut held = 0.0;
        for ring in 0..away {
            let distance = reach * (ring as f64 + 0.5) / away as f64;
            // Of the ring's area, what each place stands for.
            let area = std::f64::consts::TAU * distance * reach / (away * about * along) as f64;
            for (step, spoke) in (0..along).flat_map(|step| (0..about).map(move |spoke| (step, spoke))) {
                let angle = std::f64::consts::TAU * spoke as f64 / about as f64;
                let height = sizes.z * ((2 * step + 1) as f64 / along as f64 - 1.0);
                let place = centre + turn * Vector3::new(distance * angle.cos(), distance * angle.sin(), height);
                let is_held = field.cell(&place).is_some_and(|it| field.holds(it));
                if is_held && others.distance(&place) > OTHERS {
                    held += area;
                }
            }
        }
        held / (std::f64::consts::PI * radius.powi(2))
    }
}
