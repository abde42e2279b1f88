//! The view graph: which cameras see the light together.

use super::network::Room;
use super::{Judgement, Level};

/// The graph of cameras that share enough frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Links {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Linked pairs `(a, b, shared frames)`, a < b.
    pub pairs: Vec<(usize, usize, usize)>,
    /// By camera: with how many others it is linked.
    pub degree: Vec<usize>,
    /// Cameras without which the rest falls apart: a cut vertex of the graph.
    pub cuts: Vec<usize>,
    /// Cameras linked with a single other one, and that one.
    pub hanging: Vec<(usize, usize)>,
    /// Groups that share no link with each other; one when all is well.
    pub groups: Vec<Vec<usize>>,
}

pub(super) fn links(network: &Room<'_>) -> Links {
    let n = network.solved.cameras.len();
    let mut common = vec![0_usize; n * n];
    let mut seeing = Vec::new();
    for observations in &network.of_point {
        seeing.clear();
        seeing.extend(observations.iter().map(|it| network.solved.observations[*it].camera));
        seeing.sort_unstable();
        seeing.dedup();
        for (place, a) in seeing.iter().enumerate() {
            seeing[place + 1..].iter().for_each(|b| common[a * n + b] += 1);
        }
    }
    let every_pair = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    let pairs: Vec<(usize, usize, usize)> =
        every_pair.map(|(a, b)| (a, b, common[a * n + b])).filter(|it| it.2 >= network.options.min_common).collect();
    let mut neighbours = vec![Vec::new(); n];
    for &(a, b, _) in &pairs {
        neighbours[a].push(b);
        neighbours[b].push(a);
    }
    let nodes: Vec<usize> = network.calibrated().collect();
    let groups = groups(&neighbours, &nodes, None);
    let is_cut = |it: &usize| self::groups(&neighbours, &nodes, Some(*it)).len() > groups.len();
    let cuts: Vec<usize> = nodes.iter().copied().filter(is_cut).collect();
    let hanging: Vec<(usize, usize)> = match nodes.len() {
        0..=2 => Vec::new(), // two cameras cannot have more
        _ => nodes.iter().filter(|it| neighbours[**it].len() == 1).map(|it| (*it, neighbours[*it][0])).collect(),
    };
    let judgement = judge(network, &groups, &cuts, &hanging);
    Links { judgement, pairs, degree: neighbours.iter().map(Vec::len).collect(), cuts, hanging, groups }
}

fn judge(network: &Room<'_>, groups: &[Vec<usize>], cuts: &[usize], hanging: &[(usize, usize)]) -> Judgement {
    let min = network.options.min_common;
    if groups.len() > 1 {
        let smallest = groups.iter().min_by_key(|it| it.len()).map_or(&[][..], Vec::as_slice);
        let names: Vec<&str> = smallest.iter().take(4).map(|it| network.name(*it)).collect();
        let sentence = format!(
            "{} share fewer than {min} frames with the other cameras: wave where they and others both see.",
            names.join(", ")
        );
        Judgement::new(Level::Redo, sentence)
    } else if let Some(&(camera, other)) = hanging.first() {
        let (name, other) = (network.name(camera), network.name(other));
        let sentence =
            format!("Camera {name} is linked only with {other}: wave where {name} and a third camera both see.");
        Judgement::new(Level::Usable, sentence)
    } else if let Some(&cut) = cuts.first() {
        let name = network.name(cut);
        let sentence = format!(
            "Two parts of the camera network are linked only through camera {name}: wave where cameras of both see."
        );
        Judgement::new(Level::Usable, sentence)
    } else {
        Judgement::new(
            Level::Good,
            format!("Every camera is linked to at least two others, with {min} common frames or more."),
        )
    }
}

/// Connected parts of the graph of `nodes`, without the camera `left_out`.
fn groups(neighbours: &[Vec<usize>], nodes: &[usize], left_out: Option<usize>) -> Vec<Vec<usize>> {
    let mut open: Vec<bool> = vec![false; neighbours.len()];
    nodes.iter().filter(|it| Some(**it) != left_out).for_each(|it| open[*it] = true);
    let mut groups = Vec::new();
    for &start in nodes {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let (mut group, mut next) = (vec![start], 0);
        while let Some(&camera) = group.get(next) {
            next += 1;
            for &other in &neighbours[camera] {
                if std::mem::take(&mut open[other]) {
                    group.push(other);
                }
            }
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_fall_apart_where_their_only_link_is_taken_out() {
        let neighbours = [vec![1, 2], vec![0, 2], vec![0, 1, 3], vec![2, 4], vec![3], vec![]];
        let nodes = [0, 1, 2, 3, 4];
        assert_eq!(groups(&neighbours, &nodes, None), [vec![0, 1, 2, 3, 4]]);
        assert_eq!(groups(&neighbours, &nodes, Some(2)), [vec![0, 1], vec![3, 4]]);
        assert_eq!(groups(&neighbours, &nodes, Some(0)).len(), 1);
        assert_eq!(groups(&neighbours, &[0, 1, 5], None).len(), 2);
    }
}
