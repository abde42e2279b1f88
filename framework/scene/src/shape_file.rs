//! Models of shapes that deform, as files: `face.model.toml`. Lengths in metres, numbers such that reading gives what was written.
//!
//! ```toml
//! [shape_model]
//! kind = "components"              # or "faces"
//! length_unit = "m"
//! usual_misfit = 1.4
//! usual_strain = 1.1
//!
//! [mark.7]                         # by label
//! mean = [0.03, -0.01, 0.08]
//! spread = 0.002
//! unexplained = 4e-8               # m²
//! hidden = [1e-7, 0, 0, 1e-7, 0, 1e-7]   # xx, xy, xz, yy, yz, zz, m²
//!
//! [[base]]
//! variance = 2.4e-3                # of a component, m²; left out: not known
//! shape = [0.1, 0.0, -0.02]        # three numbers for each mark, ascending by label
//! ```
//!
//! A model of faces has `lowest_weight` and `highest_weight` in its head; left out, there is no such bound.

use std::fmt::Write;
use std::ops::Range;
use std::path::Path;

use foveate_geometry::shape_model::{Bases, ShapeModel, Usual};
use nalgebra::{DMatrix, Matrix3, Point3};
use toml::de::DeTable;

use crate::error::{CalibrationDiagnostic, CalibrationError};
use crate::toml_reader::{Reader, read};

const SECTIONS: [&str; 3] = ["shape_model", "mark", "base"];
const HEADER_KEYS: [&str; 6] =
    ["kind", "length_unit", "usual_misfit", "usual_strain", "lowest_weight", "highest_weight"];
const MARK_KEYS: [&str; 4] = ["mean", "spread", "unexplained", "hidden"];
const BASE_KEYS: [&str; 2] = ["variance", "shape"];

/// Reads `text`; `path` is for the messages.
///
/// # Errors
/// Everything that is wrong with it, each with its line, what was found and what is expected.
pub fn parse_shape_model(text: &str, path: &Path) -> Result<ShapeModel, CalibrationError> {
    let model = read(text, path, |reader, root, whole| reader.shape_model(root, whole))?;
    let fault = |found: String| CalibrationDiagnostic::of_file(path, found, "a model whose parts go together");
    let model = model.ok_or_else(|| fault("an incomplete model".to_owned()))?;
    match model.fault() {
        Some(found) => Err(fault(found).into()),
        None => Ok(model),
    }
}

/// Reads the file at `path`.
///
/// # Errors
/// As [`parse_shape_model`]; a file that cannot be read.
pub fn load_shape_model(path: &Path) -> Result<ShapeModel, CalibrationError> {
    let text = foveate_diagnostics::file::read_text(path).map_err(|error| {
        CalibrationDiagnostic::of_file(path, format!("no text ({error})"), "a model of a shape in TOML")
    })?;
    parse_shape_model(&text, path)
}

/// The file's text.
pub fn shape_model_to_toml(model: &ShapeModel) -> String {
    let mut text = String::from(
        "# A shape that deforms: places of marks and the modes in which they move together.\n[shape_model]\n",
    );
    let kind = match model.bases {
        Bases::Faces { .. } => "faces",
        Bases::Components { .. } => "components",
    };
    let _ = writeln!(text, "kind = \"{kind}\"\nlength_unit = \"m\"");
    let _ = writeln!(text, "usual_misfit = {:?}\nusual_strain = {:?}", model.usual.misfit, model.usual.strain);
    if let Bases::Faces { lowest, highest } = model.bases {
        for (key, bound) in [("lowest_weight", lowest), ("highest_weight", highest)] {
            if bound.is_finite() {
                let _ = writeln!(text, "{key} = {bound:?}");
            }
        }
    }
    for (mark, label) in model.labels.iter().enumerate() {
        let hidden = &model.hidden[mark];
        let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|it| hidden[it]);
        let _ = writeln!(
            text,
            "\n[mark.{label}]\nmean = {}\nspread = {:?}\nunexplained = {:?}\nhidden = {}",
            list(model.mean[mark].iter()),
            model.spreads[mark],
            model.unexplained[mark],
            list(upper.iter()),
        );
    }
    for (base, shape) in model.shapes.column_iter().enumerate() {
        text.push_str("\n[[base]]\n");
        if let Bases::Components { variances } = &model.bases
            && variances[base].is_finite()
        {
            let _ = writeln!(text, "variance = {:?}", variances[base]);
        }
        let _ = writeln!(text, "shape = {}", list(shape.iter()));
    }
    text
}

/// Numbers with as many digits as it takes to read the same ones again.
fn list<'a>(numbers: impl Iterator<Item = &'a f64>) -> String {
    let numbers: Vec<String> = numbers.map(|it| format!("{it:?}")).collect();
    format!("[{}]", numbers.join(", "))
}

struct MarkOfFile {
    label: u32,
    mean: Point3<f64>,
    spread: f64,
    unexplained: f64,
    hidden: Matrix3<f64>,
}

impl Reader<'_> {
    fn shape_model(&mut self, root: &DeTable<'_>, whole: Range<usize>) -> Option<ShapeModel> {
        self.refuse_unknown(root, "section", &SECTIONS);
        let (head, at) = self.required_table(root, "shape_model", whole.start..whole.start)?;
        self.refuse_unknown(head, "key", &HEADER_KEYS);
        let unit = self.required(head, "length_unit", "\"m\"", at.clone())?;
        self.expect(unit.get_ref().as_str().filter(|it| *it == "m"), unit, "length_unit", "\"m\"");
        let kind = self.required(head, "kind", "\"faces\" or \"components\"", at.clone())?;
        let faces = match kind.get_ref().as_str() {
            Some("faces") => Some(true),
            Some("components") => Some(false),
            _ => None,
        };
        let faces = self.expect(faces, kind, "kind", "\"faces\" or \"components\"");
        let [misfit, strain] = ["usual_misfit", "usual_strain"].map(|key| self.one_number(head, key, at.clone()));
        let mut bound = |key: &str, none: f64| match head.get(key) {
            Some(value) => self.number(value, key),
            None => Some(none),
        };
        let bounds = (bound("lowest_weight", f64::NEG_INFINITY), bound("highest_weight", f64::INFINITY));
        let marks = self.marks(root, whole)?;
        let (shapes, variances) = self.bases(root, marks.len())?;
        let bases = match faces? {
            true => Bases::Faces { lowest: bounds.0?, highest: bounds.1? },
            false => Bases::Components { variances },
        };
        Some(ShapeModel {
            labels: marks.iter().map(|it| it.label).collect(),
            mean: marks.iter().map(|it| it.mean).collect(),
            spreads: marks.iter().map(|it| it.spread).collect(),
            unexplained: marks.iter().map(|it| it.unexplained).collect(),
            hidden: marks.iter().map(|it| it.hidden).collect(),
            shapes,
            bases,
            usual: Usual { misfit: misfit?, strain: strain? },
        })
    }

    fn one_number(&mut self, table: &DeTable<'_>, key: &str, at: Range<usize>) -> Option<f64> {
        let value = self.required(table, key, "a number", at)?;
        self.number(value, key)
    }

    fn marks(&mut self, root: &DeTable<'_>, whole: Range<usize>) -> Option<Vec<MarkOfFile>> {
        let (tables, _) = self.required_table(root, "mark", whole)?;
        let mut marks = Vec::new();
        let mut complete = true;
        for (key, value) in tables {
            let label = key.get_ref().parse::<u32>().ok();
            if label.is_none() {
                let found = format!("a mark called {:?}", key.get_ref());
                self.report(key.span(), found, "its label, a whole number from 0 on".to_owned());
            }
            let table = self.expect(value.get_ref().as_table(), value, "mark", "a table");
            match label.zip(table).and_then(|(label, table)| self.mark(label, table, key.span())) {
                Some(mark) => marks.push(mark),
                None => complete = false,
            }
        }
        marks.sort_by_key(|it| it.label);
        complete.then_some(marks)
    }

    fn mark(&mut self, label: u32, table: &DeTable<'_>, at: Range<usize>) -> Option<MarkOfFile> {
        self.refuse_unknown(table, "key", &MARK_KEYS);
        let mean = self.numbers::<3>(table, "mean", at.clone());
        let spread = self.one_number(table, "spread", at.clone());
        let unexplained = self.one_number(table, "unexplained", at.clone());
        let [xx, xy, xz, yy, yz, zz] = self.numbers::<6>(table, "hidden", at)?;
        let hidden = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Some(MarkOfFile { label, mean: Point3::from(mean?), spread: spread?, unexplained: unexplained?, hidden })
    }

    /// A column for each base, and their variances.
    fn bases(&mut self, root: &DeTable<'_>, n_marks: usize) -> Option<(DMatrix<f64>, Vec<f64>)> {
        let Some(value) = root.get("base") else {
            return Some((DMatrix::zeros(3 * n_marks, 0), Vec::new()));
        };
        let tables = self.expect(value.get_ref().as_array(), value, "base", "tables, each headed [[base]]")?;
        let (mut numbers, mut variances) = (Vec::new(), Vec::new());
        let expected = format!("{} numbers, three for each mark", 3 * n_marks);
        let mut complete = true;
        for value in tables {
            let table = self.expect(value.get_ref().as_table(), value, "base", "a table")?;
            self.refuse_unknown(table, "key", &BASE_KEYS);
            let variance = match table.get("variance") {
                Some(value) => self.number(value, "variance"),
                None => Some(f64::INFINITY),
            };
            let shape = self.required(table, "shape", &expected, value.span());
            let list = shape.and_then(|shape| {
                let list = shape.get_ref().as_array().filter(|it| it.len() == 3 * n_marks);
                self.expect(list, shape, "shape", &expected)
            });
            let before = numbers.len();
            for (place, item) in list.into_iter().flatten().enumerate() {
                numbers.extend(self.number(item, &format!("shape[{place}]")));
            }
            complete &= variance.is_some() && numbers.len() == before + 3 * n_marks;
            variances.extend(variance);
        }
        complete.then(|| (DMatrix::from_vec(3 * n_marks, variances.len(), numbers), variances))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(bases: Bases) -> ShapeModel {
        let n = 4;
        let number = |it: usize| (it as f64 * 0.37).sin() / 3.0;
        ShapeModel {
            labels: vec![2, 3, 17, 40],
            mean: (0..n).map(|it| Point3::new(number(it), number(it + 9), number(it + 20))).collect(),
            spreads: (0..n).map(|it| number(it).abs()).collect(),
            shapes: DMatrix::from_fn(3 * n, 2, |row, column| number(row + 50 * column)),
            bases,
            unexplained: vec![1e-8, 3e-8, 1.0 / 3.0 * 1e-9, 0.0],
            hidden: (0..n).map(|it| Matrix3::from_diagonal_element(1e-7 * (it + 1) as f64)).collect(),
            usual: Usual { misfit: 1.3, strain: 0.9 },
        }
    }

    fn parse(text: &str) -> Result<ShapeModel, CalibrationError> {
        parse_shape_model(text, Path::new("face.model.toml"))
    }

    #[test]
    fn what_is_written_is_read_again_to_the_last_digit() {
        for bases in [
            Bases::Components { variances: vec![2e-4, 1.0 / 7.0] },
            Bases::Components { variances: vec![2e-4, f64::INFINITY] },
            Bases::Faces { lowest: 0.0, highest: 1.0 },
            Bases::Faces { lowest: f64::NEG_INFINITY, highest: 2.5 },
        ] {
            let model = model(bases);
            assert_eq!(parse(&shape_model_to_toml(&model)).unwrap(), model);
        }
        let rigid = ShapeModel {
            shapes: DMatrix::zeros(12, 0),
            bases: Bases::Components { variances: vec![] },
            ..model(Bases::Faces { lowest: 0.0, highest: 1.0 })
        };
        assert_eq!(parse(&shape_model_to_toml(&rigid)).unwrap(), rigid);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let good = shape_model_to_toml(&model(Bases::Components { variances: vec![2e-4, 1e-4] }));
        #[track_caller]
        fn check(text: &str, line: usize, expected: &str) {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(&format!("face.model.toml:{line}:")) && error.contains(expected), "{error}");
        }
        check(&good.replacen("components", "splines", 1), 3, "\"faces\" or \"components\"");
        check(&good.replacen("\"m\"", "\"mm\"", 1), 4, "\"m\"");
        check(&good.replacen("usual_misfit", "usual_misfits", 1), 5, "usual_misfit (did you mean that?)");
        check(&good.replacen("[mark.17]", "[mark.nose]", 1), 20, "a whole number");
        check(&good.replacen("spread = ", "spread = nan #", 1), 10, "a finite number");
        let cut = good.rfind(", ").unwrap();
        let last = good.lines().count();
        check(&format!("{}]\n", &good[..cut]), last, "12 numbers, three for each mark");
        check("kind = 1", 1, "shape_model");
        let error = |text: &str| parse(text).unwrap_err().to_string();
        assert!(error(&good.replacen("variance = 0.0002", "variance = 0.0", 1)).contains("not above 0"));
        let two: Vec<&str> = good.split("\n[mark.17]").collect();
        assert!(error(&format!("{}\n", two[0])).contains("2 marks; expected 3 or more"));
        assert!(load_shape_model(Path::new("no/such.toml")).unwrap_err().to_string().contains("no text"));
        // Any part of the file alone is refused, not crashed on.
        (0..good.len()).step_by(97).for_each(|it| assert!(parse(&good[..it]).is_err() || it > cut));
    }
}
