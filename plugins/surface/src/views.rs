//! The cameras that look at a surface, and their pictures of one moment.

use foveate::geometry::Camera;
use foveate::imaging::ImageView;
use foveate::imaging::matching::SearchPyramid;
use foveate::imaging::plane::{self, Channel};
use foveate::prelude::*;

/// One camera.
#[derive(Debug, Clone)]
pub struct View {
    /// Its number in the calibration.
    pub id: CameraId,
    /// Its name there.
    pub name: String,
    /// Its optics and place.
    pub camera: Camera,
}

/// Pictures that were taken at one time, by view.
#[derive(Debug, Default)]
pub struct Moment {
    /// When.
    pub time: Time,
    /// What each view saw; `None`: nothing.
    pub pictures: Vec<Option<SearchPyramid>>,
    gray: Vec<u8>,
}

impl Moment {
    /// Takes a set of pictures. Those of cameras that are no view, or of another size than the calibration says, are named.
    pub fn take(&mut self, views: &[View], images: &[Stamped<std::sync::Arc<Image>>], n_levels: usize) -> Vec<String> {
        let mut faults = Vec::new();
        self.pictures.resize_with(views.len(), || None);
        let mut came = vec![false; views.len()];
        for image in images {
            let Some(at) = views.iter().position(|it| it.id == image.value.camera) else { continue };
            self.time = image.time();
            let found = [image.value.width, image.value.height];
            let expected = views[at].camera.image_size;
            if found != expected || image.value.window != Default::default() {
                let name = &views[at].name;
                faults.push(format!(
                    "`{name}`: found a picture of {} x {} px, expected the whole of {} x {} px as in the calibration",
                    found[0], found[1], expected[0], expected[1]
                ));
                continue;
            }
            let pixels = match image.value.format {
                PixelFormat::Gray8 => &image.value.pixels,
                PixelFormat::Rgb8 => {
                    if let Err(fault) = plane::extract(Channel::Luma, &image.value.pixels, &mut self.gray) {
                        faults.push(fault.to_string());
                        continue;
                    }
                    &self.gray
                }
            };
            match ImageView::new(pixels, found[0] as usize, found[1] as usize) {
                Ok(view) => {
                    self.pictures[at].get_or_insert_with(SearchPyramid::default).build(&view, n_levels);
                    came[at] = true;
                }
                Err(fault) => faults.push(fault.to_string()),
            }
        }
        for (at, came) in came.iter().enumerate() {
            if !came {
                self.pictures[at] = None;
            }
        }
        faults
    }

    /// How many views have a picture.
    pub fn n_pictures(&self) -> usize {
        self.pictures.iter().flatten().count()
    }
}
