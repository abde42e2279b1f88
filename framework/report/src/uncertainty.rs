//! The section on stated uncertainty: what the data said of itself.

use std::collections::BTreeMap;

use crate::events::without_cameras;
use crate::figures;
use crate::folder::{Folder, Rows};
use crate::page::{Html, Page, Table};
use crate::words::number;

/// Whether a figure is of stated uncertainty.
pub(crate) fn is_sigma(figure: &str) -> bool {
    figure.contains("sigma")
}

/// Writes the section.
pub(crate) fn write(page: &mut Page, folder: &Folder) {
    page.section("uncertainty", "Stated uncertainty");
    page.paragraph(
        "σ is one standard deviation, as the data states it of itself. It says how well the observations fix a value. Only a comparison with the truth says whether that is right.",
    );
    match &folder.ledger {
        Err(sentence) => page.missing(sentence),
        Ok(ledger) => {
            let table = of_outputs(ledger);
            page.table(&table);
            if table.is_empty() {
                page.paragraph("No edge of the graph carried data that states a σ.");
            } else {
                page.note(
                    "Each edge has the mean over those of its messages that were sampled: in pixels for what was found in pictures, in metres for what lies in space, with four decimals. \
                     A row takes together the edges that leave one output, of all cameras.",
                );
            }
        }
    }
    match &folder.summary {
        Err(sentence) => page.missing(sentence),
        Ok(summary) => {
            let caption = "Figures of stated uncertainty";
            if !figures::write(page, caption, summary, &folder.context(), is_sigma) {
                page.paragraph("No figure is of stated uncertainty.");
            } else if summary.keys().any(|it| it.contains("error_sigmas")) {
                page.note(
                    "`error_sigmas` is the true error over the stated σ. Near 1 the statement is right; below 1 it is cautious, above 1 it promises too much.",
                );
            }
        }
    }
}

/// One row for each output, over the edges that leave it.
fn of_outputs(ledger: &Rows) -> Table {
    let mut table = Table::new(
        "σ of the data that outputs gave",
        &[("output", false), ("edges", true), ("median σ", true), ("largest σ", true), ("of", false)],
    );
    let mut kinds: BTreeMap<String, Vec<(f64, String)>> = BTreeMap::new();
    for row in ledger.iter() {
        if let Some(sigma) = row.number("sigma") {
            let edge = row.text("edge");
            let output = edge.split_once(" -> ").map_or(edge, |it| it.0);
            kinds.entry(without_cameras(output)).or_default().push((sigma, output.to_owned()));
        }
    }
    for (kind, mut sigmas) in kinds {
        sigmas.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n = sigmas.len();
        let median = (sigmas[(n - 1) / 2].0 + sigmas[n / 2].0) / 2.0;
        let (largest, output) = &sigmas[n - 1];
        let camera = output.split_once('[').and_then(|it| it.1.split_once(']')).map_or("", |it| it.0);
        let cells = [n.to_string(), number(median), number(*largest)].map(|it| Html::text(&it));
        let [n, median, largest] = cells;
        table.row(&[Html::name(&kind), n, median, largest, Html::whole(camera)]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_that_differ_in_the_camera_are_one_row_with_the_largest() {
        let ledger = "edge,sigma\na[c1].x -> b.x,0.1\na[c2].x -> b.x,0.5\na[c3].x -> d.x,0.2\nb.y -> c.y,\n";
        let mut page = Page::new("t", &[]);
        page.section("s", "S");
        page.table(&of_outputs(&Rows::parse(ledger, "edge").unwrap()));
        let page = page.finish();
        let row = "<th scope=\"row\">a.<wbr>x</th><td class=\"n\">3</td><td class=\"n\">0.2</td><td class=\"n\">0.5</td><td><span class=\"u\">c2</span></td>";
        assert!(page.contains(row), "{page}");
        assert!(!page.contains("b.<wbr>y"), "an edge without σ has no row");
    }
}
