//! Which cameras see the light together: the view graph as a matrix.

use std::fmt::Write as _;

use super::ReportInput;
use super::figures::Figures;
use super::page::{Page, count, escaped, fixed};
use super::summary::name_of;
use super::svg::{shade, short};
use crate::solved::{ObservationRole, Solved};

/// Up to so many cameras have numbers in the cells.
const NUMBERED: usize = 18;
/// Up to so many cameras have all names written.
const NAMED: usize = 70;

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    let solved = report.solved;
    let n = solved.cameras.len();
    if n < 2 || figures.n_frames == 0 {
        return;
    }
    page.section(
        "graph",
        "Who sees the light together",
        "Frames that two cameras saw together. A calibration hangs together by these: a camera whose row is pale is held by few others. \
         Framed cells are pairs that were oriented with each other; crossed ones contradict the rest.",
    );
    let common = common_frames(solved);
    let most = common.iter().copied().max().unwrap_or(0).max(1);
    let cell = (640.0 / n as f64).clamp(4.0, 34.0);
    let left = 110.0;
    let mut paths = vec![String::new(); 6];
    let mut words = String::new();
    for row in 1..n {
        for column in 0..row {
            let (x, y) = (left + column as f64 * cell, (row - 1) as f64 * cell);
            let number = common[row * n + column];
            let level = shade(f64::from(number) / f64::from(most));
            let side = short(cell - 1.0);
            // writing to a String cannot fail
            let _ = write!(paths[level], "M{} {}h{side}v{side}h-{side}z", short(x), short(y));
            if n <= NUMBERED {
                let class = if level > 3 { "num on" } else { "num" };
                let (x, y) = (short(x + 0.5 * cell - 0.5), short(y + 0.5 * cell + 3.0));
                let _ = write!(words, "<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{number}</text>");
            }
        }
    }
    let mut svg: String = paths
        .iter()
        .enumerate()
        .filter(|it| !it.1.is_empty())
        .map(|(level, path)| format!("<path class=\"h{level}\" d=\"{path}\"/>"))
        .collect();
    let (mut framed, mut crossed) = (String::new(), String::new());
    for link in solved.links.iter().filter(|it| it.a.max(it.b) < n && it.a != it.b) {
        let (row, column) = (link.a.max(link.b), link.a.min(link.b));
        let (x, y) = (short(left + column as f64 * cell), short((row - 1) as f64 * cell));
        let side = short(cell - 1.0);
        let _ = write!(framed, "M{x} {y}h{side}v{side}h-{side}z");
        if !link.consistent {
            let _ = write!(crossed, "M{x} {y}l{side} {side}m0 -{side}l-{side} {side}");
        }
    }
    let _ = write!(svg, "<path class=\"framed\" d=\"{framed}\"/><path class=\"crossed\" d=\"{crossed}\"/>{words}");
    let every = n.div_ceil(NAMED);
    let below = (n - 1) as f64 * cell;
    for camera in (0..n).step_by(every) {
        let name: String = name_of(solved, camera).chars().take(16).collect();
        let name = escaped(&name);
        if camera > 0 {
            let y = short((camera - 1) as f64 * cell + 0.5 * cell + 3.0);
            let _ = write!(svg, "<text class=\"tick e\" x=\"{}\" y=\"{y}\">{name}</text>", short(left - 5.0));
        }
        if camera + 1 < n {
            let x = short(left + (camera as f64 + 0.5) * cell + 3.0);
            let _ = write!(
                svg,
                "<text class=\"tick e\" transform=\"translate({x} {}) rotate(-90)\">{name}</text>",
                short(below + 5.0)
            );
        }
    }
    let longest = solved.cameras.iter().map(|it| it.name.chars().count().min(16)).max().unwrap_or(0);
    let size = [left + (n - 1) as f64 * cell + 10.0, below + 14.0 + 7.0 * longest as f64].map(short);
    page.raw(&format!(
        "<div class=\"wide\"><svg class=\"matrix\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" role=\"img\" \
         aria-label=\"Frames seen together by each pair of cameras\">{svg}</svg></div>",
        size[0], size[1]
    ));
    let keys: String = (0..6)
        .map(|level| {
            let to = fixed(f64::from(most) * f64::from(level) / 5.0, 0);
            let words = if level == 0 { "0".to_owned() } else { format!("to {to}") };
            format!("<span class=\"key h{level}\">{words}</span>")
        })
        .collect();
    let every_words = if every > 1 { format!(" One camera in {every} is named.") } else { String::new() };
    let oriented = solved.links.len();
    page.raw(&format!(
        "<p class=\"note\">Frames seen together: {keys}. {} pairs were oriented.{every_words}</p>",
        count(oriented)
    ));
}

/// Frames that two cameras saw together, in a square matrix; observations that contradict the rest do not count.
fn common_frames(solved: &Solved) -> Vec<u32> {
    let n = solved.cameras.len();
    let mut seen: Vec<(usize, usize)> = solved
        .observations
        .iter()
        .filter(|it| it.camera < n && it.role != ObservationRole::Rejected)
        .map(|it| (it.frame, it.camera))
        .collect();
    seen.sort_unstable();
    seen.dedup();
    let mut common = vec![0; n * n];
    for frame in seen.chunk_by(|a, b| a.0 == b.0) {
        for (index, (_, a)) in frame.iter().enumerate() {
            for (_, b) in &frame[index + 1..] {
                common[a * n + b] += 1;
                common[b * n + a] += 1;
            }
        }
    }
    common
}
