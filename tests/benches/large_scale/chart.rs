//! Where the figures of measured series go.

use std::path::Path;

use foveate::plot::{Chart, Figure};

/// Draws `charts` in so many columns as `name`.svg into the folder asked for, if any.
pub fn save(out: Option<&Path>, name: &str, title: &str, n_columns: usize, charts: Vec<Chart<'_>>) {
    let Some(folder) = out else { return };
    let svg = Figure { title: title.to_owned(), n_columns, charts }.svg();
    let path = folder.join(format!("{name}.svg"));
    match std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&path, svg)) {
        Ok(()) => println!("plot: {}", path.display()),
        Err(error) => eprintln!("{}: the plot could not be saved ({error})", path.display()),
    }
}
