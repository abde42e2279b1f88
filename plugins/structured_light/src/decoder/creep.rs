//! A set whose camera drifted so far that its pictures look like those of a scene that changed.

use foveate::imaging::ImageView;
use foveate::imaging::stripes::code::StripeCode;
use foveate::imaging::stripes::drift::{Drift, drift};
use foveate::imaging::stripes::steady::Steadied;
use foveate::imaging::stripes::{Examination, SetFault, examine};

/// Whether pictures of a set are of another scene.
pub(super) fn has_moved(found: &Examination) -> bool {
    found.faults.iter().any(|it| matches!(it, SetFault::Moved { .. }))
}

/// How a set with all its pictures crept, and the set without that; `None` where it did not, or is of more than one scene for all that.
pub(super) fn crept(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> Option<(Drift, Steadied)> {
    let drift =
        drift(code, pictures, min_contrast).filter(|it| it.creeps() && pictures.len() == code.pictures().len())?;
    let steadied = Steadied::of(code, pictures, &drift, min_contrast)?;
    let (width, height) = pictures.first()?.size();
    let views = steadied.pictures.iter().map(|it| ImageView::new(it, width, height));
    let views: Vec<ImageView<'_>> = views.collect::<Result<_, _>>().ok()?;
    (!has_moved(&examine(code, &views, &[], min_contrast))).then_some((drift, steadied))
}
