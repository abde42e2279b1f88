//! Stored shapes of the surface: a knee that was lost bent and comes back stretched is recognised from an earlier stretched shape.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::constellation::recognise;
use super::track_store::TrackStore;

/// Most shapes that are kept; the oldest is dropped.
const KEPT: usize = 12;
/// Smallest root mean square difference of distances between marks of two shapes [m]: less than the tolerance of recognition.
const APART: f64 = 0.002;
/// Share of the marks that must be measured for reliable predictions of the rest.
const MEASURED: f64 = 0.6;
/// Marks of a shape, at least.
const LEAST: usize = 8;

/// Positions of the marks at one moment, by label, in the world [m].
type Shape = BTreeMap<u32, Point3<f64>>;

/// Different shapes, the newest last.
#[derive(Default)]
pub(super) struct Shapes(Vec<Shape>);

impl Shapes {
    /// Stores the present shape, if enough of it is measured.
    pub fn remember(&mut self, store: &TrackStore) {
        let believed = || store.marks.iter().filter(|it| it.1.is_believed);
        let (n, n_seen) = (believed().count(), believed().filter(|it| it.1.is_seen).count());
        if n_seen < LEAST || (n_seen as f64) < MEASURED * n as f64 {
            return;
        }
        let now: Shape = believed().map(|(label, mark)| (*label, mark.position)).collect();
        if let Some(like) = self.0.iter_mut().find(|it| difference(it, &now) < APART) {
            // Marks that were found since then.
            if like.len() < now.len() {
                *like = now;
            }
            return;
        }
        if self.0.len() == KEPT {
            self.0.remove(0);
        }
        self.0.push(now);
    }

    /// Labels of `points`, and their shape; the predicted present shape `now` is tried first. `None` where no stored shape fits.
    pub fn recognise(&self, points: &[Point3<f64>], now: Shape) -> Option<(BTreeMap<u32, Point3<f64>>, Shape)> {
        std::iter::once(&now).chain(self.0.iter().rev()).find_map(|shape| {
            let (labels, marks): (Vec<u32>, Vec<Point3<f64>>) = shape.iter().map(|it| (*it.0, *it.1)).unzip();
            let pairs = recognise(points, &marks)?;
            let measured = pairs.iter().map(|(mark, point)| (labels[*mark], points[*point])).collect();
            // What was forgotten since then stays so.
            let known = shape.iter().filter(|it| now.contains_key(it.0)).map(|it| (*it.0, *it.1)).collect();
            Some((measured, known))
        })
    }
}

/// Root mean square difference of distances between the marks of two shapes [m]; infinite for too few marks in common.
fn difference(one: &Shape, other: &Shape) -> f64 {
    let common: Vec<[&Point3<f64>; 2]> = one.iter().filter_map(|(label, a)| Some([a, other.get(label)?])).collect();
    if common.len() < LEAST {
        return f64::INFINITY;
    }
    let (mut sum, mut n) = (0.0, 0);
    for (i, a) in common.iter().enumerate() {
        for b in &common[..i] {
            let [one, other] = [0, 1].map(|it| (a[it] - b[it]).norm());
            sum += (one - other).powi(2);
            n += 1;
        }
    }
    (sum / f64::from(n)).sqrt()
}

#[cfg(test)]
mod tests {
    use foveate::estimation::Random;
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    /// A sheet of marks, bent around an axis across it by so much of a turn a metre [rad/m].
    fn sheet(bend: f64) -> Vec<Point3<f64>> {
        let mut hand = Random::new(5);
        let mut uneven = || hand.uniform_in(-0.004, 0.004);
        let flat = (0..45).map(|it| [f64::from(it % 5) * 0.02 + uneven(), f64::from(it / 5) * 0.02 + uneven()]);
        flat.collect::<Vec<_>>()
            .into_iter()
            .map(|[x, y]| {
                let turn = bend * y;
                let along = |of: f64| if bend == 0.0 { y } else { of / bend };
                let sunk = if bend == 0.0 { 0.0 } else { (1.0 - turn.cos()) / bend };
                Point3::new(x, along(turn.sin()), sunk)
            })
            .collect()
    }

    fn store(marks: &[Point3<f64>]) -> TrackStore {
        let mut store = TrackStore::default();
        marks.iter().zip(0..).for_each(|(it, label)| store.named(label, *it));
        store
    }

    #[test]
    fn what_was_lost_bent_is_recognised_stretched() {
        let (bent, stretched) = (sheet(8.0), sheet(0.0));
        let motion = Isometry3::new(Vector3::new(0.3, -0.1, 0.05), Vector3::new(0.2, 0.7, -0.3));
        // Eight of them are hidden.
        let points: Vec<Point3<f64>> = stretched.iter().skip(8).map(|it| motion * it).collect();
        let now: Shape = (0..).zip(bent.iter().copied()).collect();
        let mut shapes = Shapes::default();
        shapes.remember(&store(&bent));
        assert!(shapes.recognise(&points, now.clone()).is_none(), "it was never seen like that");
        shapes.remember(&store(&stretched));
        shapes.remember(&store(&sheet(0.05)));
        assert_eq!(shapes.0.len(), 2, "what is hardly bent is no other shape");
        let (measured, known) = shapes.recognise(&points, now).unwrap();
        assert!(measured.len() > 30 && measured.iter().all(|(label, it)| *it == points[*label as usize - 8]));
        assert_eq!(known[&3], stretched[3]);
    }
}
