//! Whether the marks that were measured lie as they should: a surface bends, but none of its marks jumps among its neighbours.
//!
//! A name that went to another dot in two cameras makes a mark that no camera contradicts, at another depth; and where pictures that share few marks are brought together wrongly, marks that have their
//! right names come out in a shape that the surface never had. What is known of the surface, carried along by the neighbours of each mark, contradicts both.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use super::track_store::carry;

/// A mark is at most this far from where its neighbours carry it [m]: less than marks are apart.
pub(super) const MOST_OFF: f64 = 0.009;
/// Where more than this share of the marks are farther off, it is the whole that was measured wrongly.
const MOST_STRAYS: f64 = 0.3;
/// Fewer marks than this tell nothing of one another.
const LEAST: usize = 6;
/// After so many moments in a row at which the whole was wrong, what is known of the surface is: half a second at 30 Hz.
const PATIENCE: u32 = 15;

/// What is to be thought of the marks of one moment.
#[derive(Debug, PartialEq)]
pub(super) enum Verdict {
    /// These marks are elsewhere; the others lie as they should.
    Strays(BTreeSet<u32>),
    /// So many are elsewhere that nothing of that moment is to be believed.
    Incoherent,
}

/// Judges the marks of each moment by where they were before.
#[derive(Default)]
pub(super) struct Coherence {
    /// Moments in a row of which nothing was believed.
    incoherent: u32,
}

impl Coherence {
    /// Of `measured`, in the light of where the marks are known to have been, by label [m].
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
