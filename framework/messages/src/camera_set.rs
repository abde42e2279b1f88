//! Cameras by number, and sets of them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

use crate::wire::portable;
use crate::{Message, Quality, Space, Wire};

/// A camera of the rig: its place in the calibration's list, which is sorted by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct CameraId(pub u16);

/// A set of cameras, ascending; up to 16 of them without an allocation.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(from = "Vec<CameraId>", into = "Vec<CameraId>")]
#[schemars(with = "Vec<CameraId>")]
pub struct CameraSet(SmallVec<[CameraId; 16]>);

impl CameraSet {
    /// Adds `camera`; adding twice is the same as once.
    pub fn insert(&mut self, camera: CameraId) {
        if let Err(place) = self.0.binary_search(&camera) {
            self.0.insert(place, camera);
        }
    }

    /// Whether `camera` is in the set.
    pub fn contains(&self, camera: CameraId) -> bool {
        self.0.binary_search(&camera).is_ok()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Leaves the set empty and keeps its memory.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// In ascending order.
    pub fn iter(&self) -> impl Iterator<Item = CameraId> + '_ {
        self.0.iter().copied()
    }
}

impl From<Vec<CameraId>> for CameraSet {
    fn from(cameras: Vec<CameraId>) -> Self {
        cameras.into_iter().collect()
    }
}

impl From<CameraSet> for Vec<CameraId> {
    fn from(set: CameraSet) -> Self {
        set.iter().collect()
    }
}

impl FromIterator<CameraId> for CameraSet {
    fn from_iter<I: IntoIterator<Item = CameraId>>(cameras: I) -> Self {
        let mut set = CameraSet::default();
        cameras.into_iter().for_each(|camera| set.insert(camera));
        set
    }
}

/// The cameras that are worth processing.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct CameraChoice {
    /// These, and no others.
    pub cameras: CameraSet,
}

impl Message for CameraChoice {
    const NAME: &'static str = "camera_choice";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = portable!(CameraChoice);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.cameras.len() as u32), sigma: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_repetition_of_insertion_do_not_matter() {
        let set: CameraSet = [7, 2, 7, 5, 2].map(CameraId).into_iter().collect();
        assert_eq!(set, [2, 5, 7].map(CameraId).into_iter().collect());
        assert_eq!(set.len(), 3);
        assert!(set.contains(CameraId(5)) && !set.contains(CameraId(3)));
    }
}
