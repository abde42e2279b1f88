//! The section on what fell short: broken promises, failures, gaps, losses; then suspensions and notes.

use crate::events::{Event, events};
use crate::folder::{Folder, Row, Rows};
use crate::page::{Html, Page, Table};
use crate::rig::is_interrupted;
use crate::words::{number, so_many};

/// Rows of the ledger shown at most; the rest is in the file.
const EDGES_SHOWN: usize = 40;
/// Events of one sort shown at most.
const EVENTS_SHOWN: usize = 60;
/// What the columns of losses mean.
const MEANINGS: [(&str, &str); 4] = [
    ("gaps", "messages that their source declared missing, such as pictures that were lost or could not be used"),
    ("dropped", "messages that were made, and thrown away because their consumer did not keep up"),
    ("late", "messages that were captured before one that was delivered earlier; they were delivered all the same"),
    ("lost", "gaps and dropped, over all messages that should have been delivered"),
];

/// Writes the section.
pub(crate) fn write(page: &mut Page, folder: &Folder) {
    page.section("shortfalls", "What fell short");
    let cameras = folder.cameras();
    let all = folder.events.as_ref().map(|it| events(it, &cameras));
    let lossy = folder.ledger.as_ref().map(lossy);
    verdict(page, folder, all.as_deref().ok(), lossy.as_ref().map_or(0, Vec::len));
    match &all {
        Err(sentence) => page.missing(sentence),
        Ok(all) => {
            list(page, all, "unmet", "Requirements not met", "edge");
            list(page, all, "fault", "Failures of nodes", "node");
            list(page, all, "gap", "Gaps: data that was missing", "node");
        }
    }
    match &lossy {
        Err(sentence) => page.missing(sentence),
        Ok(lossy) => losses(page, lossy),
    }
    if let Ok(all) = &all {
        suspensions(page, all);
        let notes: Vec<Html> =
            all.iter().filter(|it| it.what == "note").map(|it| Html::prose(&with_others(it))).collect();
        if !notes.is_empty() {
            page.heading("Notes of the nodes");
            page.list(&notes);
        }
    }
}

/// Sorts of events that are shortfalls: the figure that counts them, and words for one and for several.
const SORTS: [(&str, &str, &str, &str); 3] = [
    ("unmet", "requirements_unmet", "requirement not met", "requirements not met"),
    ("fault", "faults", "failure of a node", "failures of nodes"),
    ("gap", "gaps", "missing message", "missing messages"),
];

/// One sentence for who reads nothing else.
fn verdict(page: &mut Page, folder: &Folder, all: Option<&[Event]>, n_lossy: usize) {
    let mut short = Vec::new();
    if is_interrupted(folder) {
        short.push("the run was stopped before its end".to_owned());
    }
    for (what, figure, one, several) in SORTS {
        let events = all.into_iter().flatten().filter(|it| it.what == what);
        // A broken promise has no count: each row is one. Those that are alike were taken together.
        let listed: f64 = events.map(|it| it.count.max(1.0 + it.others as f64)).sum();
        // Where one of the two files is missing, the other is enough.
        let n = listed.max(folder.figure(figure).unwrap_or(0.0));
        if n > 0.0 {
            short.push(format!("{} {}", number(n), if n == 1.0 { one } else { several }));
        }
    }
    if n_lossy > 0 {
        short.push(format!("{} with gaps, drops or late messages", so_many(n_lossy, "edge")));
    }
    if !short.is_empty() {
        page.verdict(false, &format!("Short of what was asked or expected: {}.", short.join("; ")));
    } else if folder.events.is_ok() && folder.ledger.is_ok() {
        page.verdict(true, "Nothing fell short: no requirement was missed, no node failed, and no message was missing, dropped or late.");
    } else {
        page.paragraph("Nothing is known to have fallen short, and not all files that would say so can be read.");
    }
}

fn with_others(event: &Event) -> String {
    let Event { message, others, .. } = event;
    if *others == 0 { message.clone() } else { format!("{message} (and {others} more like it)") }
}

/// A table of the events of one sort.
fn list(page: &mut Page, all: &[Event], what: &str, title: &str, place: &'static str) {
    let found: Vec<&Event> = all.iter().filter(|it| it.what == what).collect();
    let columns: &[_] = match what {
        "unmet" => &[(place, false), ("what", false), ("must", false)],
        "fault" => &[(place, false), ("what", false), ("then", false), ("first at [s]", true), ("times", true)],
        _ => &[(place, false), ("what", false), ("first at [s]", true), ("times", true)],
    };
    let mut table = Table::new(title, columns);
    for it in found.iter().take(EVENTS_SHOWN) {
        let mut cells = vec![Html::name(&it.place), Html::prose(&with_others(it))];
        if what != "gap" {
            cells.push(Html::text(&it.action));
        }
        if what != "unmet" {
            let time = it.first_time_s.map_or("–".to_owned(), number);
            cells.extend([time, number(it.count)].map(|it| Html::text(&it)));
        }
        table.row(&cells);
    }
    page.table(&table);
    if found.len() > EVENTS_SHOWN {
        page.note(&format!("{} more are in `events.csv`.", found.len() - EVENTS_SHOWN));
    }
}

/// Edges that lost or delayed something, worst first.
fn lossy(ledger: &Rows) -> Vec<Row<'_>> {
    let harm = |row: &Row<'_>| (row.count("loss"), row.count("gaps") + row.count("dropped"), row.count("late"));
    let mut rows: Vec<Row<'_>> = ledger.iter().filter(|it| harm(it) > (0.0, 0.0, 0.0)).collect();
    rows.sort_by(|a, b| harm(b).partial_cmp(&harm(a)).unwrap_or(std::cmp::Ordering::Equal));
    rows
}

fn losses(page: &mut Page, lossy: &[Row<'_>]) {
    if lossy.is_empty() {
        return;
    }
    let mut table = Table::new(
        "Edges with gaps, drops or late messages, worst first",
        &[("edge", false), ("delivered", true), ("gaps", true), ("dropped", true), ("late", true), ("lost", true)],
    );
    for row in lossy.iter().take(EDGES_SHOWN) {
        let [delivered, gaps, dropped, late] =
            ["delivered", "gaps", "dropped", "late"].map(|it| Html::text(&number(row.count(it))));
        let lost = Html::text(&format!("{} %", foveate_plot::text::rounded(1e2 * row.count("loss"))));
        table.row(&[Html::name(row.text("edge")), delivered, gaps, dropped, late, lost]);
    }
    page.table(&table);
    if lossy.len() > EDGES_SHOWN {
        page.note(&format!("{} more edges are in `ledger.csv`.", lossy.len() - EDGES_SHOWN));
    }
    let meanings: Vec<Html> =
        MEANINGS.iter().map(|(word, meaning)| Html::markup(format!("<b>{word}</b>: {meaning}"))).collect();
    page.list(&meanings);
}

/// When scales waited for their targets.
fn suspensions(page: &mut Page, all: &[Event]) {
    let found: Vec<&Event> = all.iter().filter(|it| matches!(it.what.as_str(), "suspended" | "resumed")).collect();
    if found.is_empty() {
        return;
    }
    let mut table = Table::new(
        "Suspensions: scales that waited for their target",
        &[("scale", false), ("event", false), ("first at [s]", true), ("times", true), ("why", false)],
    );
    for it in found.iter().take(EVENTS_SHOWN) {
        let time = it.first_time_s.map_or("–".to_owned(), number);
        let [what, time, count] = [&it.what, &time, &number(it.count)].map(|it| Html::text(it));
        table.row(&[Html::name(&it.place), what, time, count, Html::prose(&it.message)]);
    }
    page.table(&table);
    if found.len() > EVENTS_SHOWN {
        page.note(&format!("{} more are in `events.csv`.", found.len() - EVENTS_SHOWN));
    }
    page.note(
        "A scale whose target is lost is suspended: its nodes keep what they know and get no messages. At the start of a session this is normal.",
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_that_lost_most_come_first_and_sound_ones_not_at_all() {
        let text = "edge,delivered,gaps,dropped,late,loss\nsound,9,0,0,0,0\nlate,9,0,0,4,0\nworse,5,3,2,0,0.5\nbad,9,1,0,0,0.1\n";
        let rows = Rows::parse(text, "edge").unwrap();
        let found: Vec<String> = lossy(&rows).iter().map(|it| it.text("edge").to_owned()).collect();
        assert_eq!(found, ["worse", "bad", "late"]);
    }
}
