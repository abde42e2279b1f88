//! Coherence check of measured marks: a surface deforms, but none of its marks jumps among its neighbours.
//!
//! A label assigned to another dot in two cameras makes a mark at another depth that no camera contradicts; and where pictures that share few marks are registered wrongly, marks with their
//! right labels form a shape that the surface never had. Predictions from each mark's neighbours contradict both.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use super::track_store::carry;

/// Largest distance of a mark from its prediction by its neighbours [m]: less than the spacing of marks.
pub(super) const MOST_OFF: f64 = 0.009;
/// Where a larger share of the marks is farther off, the whole measurement is wrong.
const MOST_STRAYS: f64 = 0.3;
/// Fewest marks for the check.
const LEAST: usize = 6;
/// Consecutive incoherent moments after which the stored surface is considered wrong: half a second at 30 Hz.
const PATIENCE: u32 = 15;

/// Result of the check for one moment.
#[derive(Debug, PartialEq)]
pub(super) enum Verdict {
    /// These marks are elsewhere; the others are coherent.
    Strays(BTreeSet<u32>),
    /// So many marks are elsewhere that the whole moment is rejected.
    Incoherent,
}

/// Checks the marks of each moment against those before.
#[derive(Default)]
pub(super) struct Coherence {
    /// Consecutive rejected moments.
    incoherent: u32,
}

impl Coherence {
    /// Checks `measured` against the stored positions of marks, by label [m].
    pub fn judge(&mut self, known: &BTreeMap<u32, Point3<f64>>, measured: &BTreeMap<u32, Point3<f64>>) -> Verdict {
        let common: Vec<(u32, Point3<f64>)> =
            known.iter().filter(|it| measured.contains_key(it.0)).map(|it| (*it.0, *it.1)).collect();
        if common.len() < LEAST {
            return Verdict::Strays(BTreeSet::new());
        }
        let is_stray = |&(label, place): &(u32, Point3<f64>)| {
            let others: Vec<(u32, Point3<f64>)> = common.iter().filter(|it| it.0 != label).copied().collect();
            let carried = carry(&others, measured, &place).map(|it| it * place);
            carried.is_some_and(|it| (it - measured[&label]).norm() > MOST_OFF)
        };
        let strays: BTreeSet<u32> = common.iter().filter(|it| is_stray(it)).map(|it| it.0).collect();
        if strays.len() as f64 <= MOST_STRAYS * common.len() as f64 {
            self.incoherent = 0;
            return Verdict::Strays(strays);
        }
        self.incoherent += 1;
        if self.incoherent > PATIENCE {
            self.incoherent = 0;
            return Verdict::Strays(BTreeSet::new());
        }
        Verdict::Incoherent
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::integrator::tests::marks_on_a_face;

    /// Marks of a face, and where they are after it moved and some of them went elsewhere.
    fn scene(elsewhere: impl Fn(u32) -> Vector3<f64>) -> [BTreeMap<u32, Point3<f64>>; 2] {
        let known: BTreeMap<u32, Point3<f64>> = (0..).zip(marks_on_a_face()).collect();
        let motion = Isometry3::new(Vector3::new(0.05, 0.1, -0.02), Vector3::new(0.1, -0.2, 0.15));
        let measured = known.iter().map(|(label, it)| (*label, motion * (it + elsewhere(*label)))).collect();
        [known, measured]
    }

    #[test]
    fn a_mark_that_jumped_among_its_neighbours_is_a_stray() {
        let [known, measured] = scene(|it| if it == 12 || it == 40 { Vector3::y() * 0.015 } else { Vector3::zeros() });
        assert_eq!(Coherence::default().judge(&known, &measured), Verdict::Strays([12, 40].into()));
        let [known, measured] = scene(|it| Vector3::z() * if it % 5 == 0 { 0.006 } else { 0.0 });
        assert_eq!(Coherence::default().judge(&known, &measured), Verdict::Strays([].into()), "an expression");
    }

    #[test]
    fn a_shape_that_the_surface_never_had_is_not_believed_for_half_a_second() {
        let [known, measured] = scene(|it| Vector3::y() * if it % 2 == 0 { 0.04 } else { -0.04 });
        let mut coherence = Coherence::default();
        for _ in 0..PATIENCE {
            assert_eq!(coherence.judge(&known, &measured), Verdict::Incoherent);
        }
        assert_eq!(coherence.judge(&known, &measured), Verdict::Strays([].into()), "then what is known is wrong");
        let few: BTreeMap<u32, Point3<f64>> = measured.into_iter().take(LEAST - 1).collect();
        assert_eq!(coherence.judge(&known, &few), Verdict::Strays([].into()));
    }
}
