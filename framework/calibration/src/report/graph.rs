//! Report section: the view graph as a matrix.

use foveate_plot::colours::level;
use foveate_plot::svg::{Anchor, Font, Pen, Rect, SMALL, Svg};
use foveate_plot::text::{count, fitted, fixed, text_width};

use super::ReportInput;
use super::figures::Figures;
use super::page::{LEVELS, Page, THEME};
use super::summary::name_of;
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
        "Which cameras see the light together",
        "Frames that two cameras saw together. These link the calibration: a camera with a pale row depends on few others. \
         Framed cells are pairs that were oriented with each other; crossed ones contradict the rest.",
    );
    let common = common_frames(solved);
    let most = common.iter().copied().max().unwrap_or(0).max(1);
    let cell = (640.0 / n as f64).clamp(4.0, 34.0);
    let names: Vec<String> = (0..n).map(|it| fitted(&name_of(solved, it), SMALL, 116.0)).collect();
    let longest = names.iter().map(|it| text_width(it, SMALL)).fold(0.0, f64::max);
    let (left, below) = (longest + 10.0, (n - 1) as f64 * cell);
    let about = "Frames seen together by each pair of cameras";
    let mut svg = Svg::bare(left + below + 10.0, below + 14.0 + longest, about, THEME);
    let rect_of = |row: usize, column: usize| {
        let (left, top) = (left + column as f64 * cell, (row - 1) as f64 * cell);
        Rect { left, top, width: cell - 1.0, height: cell - 1.0 }
    };
    let level_of = |number: u32| level(f64::from(number) / f64::from(most), LEVELS.len());
    let pairs = || (1..n).flat_map(|row| (0..row).map(move |column| (row, column)));
    let mut cells = vec![Vec::new(); LEVELS.len()];
    pairs().for_each(|(row, column)| cells[level_of(common[row * n + column])].push(rect_of(row, column)));
    cells.iter().zip(LEVELS).for_each(|(cells, colour)| svg.cells(cells, colour));
    let (mut framed, mut crossed) = (Vec::new(), Vec::new());
    for link in solved.links.iter().filter(|it| it.a.max(it.b) < n && it.a != it.b) {
        let rect = rect_of(link.a.max(link.b), link.a.min(link.b));
        let [a, b] = [[rect.left, rect.top], [rect.right(), rect.bottom()]];
        framed.push(vec![a, [b[0], a[1]], b, [a[0], b[1]], a]);
        if !link.consistent {
            crossed.extend([vec![a, b], vec![[a[0], b[1]], [b[0], a[1]]]]);
        }
    }
    svg.lines(&framed, Pen::new(THEME.edge, 1.0));
    svg.lines(&crossed, Pen::new("var(--redo)", 1.5));
    for (row, column) in pairs().filter(|_| n <= NUMBERED) {
        let (number, rect) = (common[row * n + column], rect_of(row, column));
        let font = Font::new((cell / 3.2).min(10.0));
        let font = if level_of(number) > 3 { font.coloured("var(--on)") } else { font };
        svg.text([rect.middle()[0], rect.middle()[1] + 3.5], Anchor::Middle, font, &number.to_string());
    }
    let every = n.div_ceil(NAMED);
    let font = Font::new(SMALL).coloured(THEME.muted);
    for (camera, name) in names.iter().enumerate().step_by(every) {
        if camera > 0 {
            svg.text([left - 5.0, rect_of(camera, 0).middle()[1] + 4.0], Anchor::End, font, name);
        }
        if camera + 1 < n {
            let x = left + (camera as f64 + 0.5) * cell + 3.0;
            svg.text_turned([x, below + 5.0], Anchor::End, font, name);
        }
    }
    page.raw(&format!("<div class=\"wide\">{}</div>", svg.element("matrix")));
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
