//! Figures: charts with axes and legends as SVG, marks on pictures as PNG.
//!
//! Pure functions: values in, text out, the same bytes each time; NaN and infinities never reach a file. Mostly a
//! [`Figure`] of [`Chart`]s is all that is needed; anything else is drawn mark by mark with an [`svg::Svg`] and an
//! [`axes::Panel`], whose `place` maps values to the figure's pixels.
//!
//! ```
//! use foveate_plot::{Axis, Chart, Figure, Series, COLOURS};
//!
//! let curve = (-20..=20).map(|it| f64::from(it) / 20.0).map(|x| [x, x * x]).collect();
//! let chart = Chart::new("", [310.0, 210.0], Axis::new("x [m]"), Axis::new("y [m²]"))
//!     .with(Series::line("measured", COLOURS[0], curve));
//! let figure = Figure { title: "A parabola".to_owned(), n_columns: 1, charts: vec![chart] };
//! assert!(figure.svg().starts_with("<svg"));
//! ```
//!
//! | module | what it gives |
//! |---|---|
//! | [`chart`] | charts in a grid, with a legend |
//! | [`svg`] | lines, areas, dots and texts as SVG |
//! | [`axes`] | ranges and frames with axes |
//! | [`ticks`] | round numbers along axes |
//! | [`legend`] | legends |
//! | [`names`] | names beside points, placed without overlap |
//! | [`view`] | parallel projection of space |
//! | [`thin`] | thinning of lines and dots to what can be seen |
//! | [`colours`] | colours distinguishable for most eyes, colour maps, themes |
//! | [`text`] | escaped texts, formatted numbers |
//! | `canvas` | marks on pictures, PNG (feature `png`) |

pub mod axes;
#[cfg(feature = "png")]
pub mod canvas;
pub mod chart;
pub mod colours;
pub mod legend;
pub mod names;
pub mod svg;
pub mod text;
pub mod thin;
pub mod ticks;
pub mod view;

pub use chart::{Axis, Chart, Figure, Marks, Series, nothing};
pub use colours::COLOURS;
