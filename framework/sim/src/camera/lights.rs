//! The LEDs in a picture: over the whole exposure, row by row where these are exposed one after the other, as spots with what lens and sensor make of them.

use foveate_messages::{Interval, TargetId, Time};
use nalgebra::Point2;

use super::sensor::{Sensor, rolled};
use super::spot::Spot;
use super::{HALO_WIDTH, Renderer};
use crate::head::HeadMotion;
use crate::truth::TrueCamera;
use crate::world::{Light, Mirror, REFERENCE_DISTANCE_M, World};

impl Renderer {
    /// Draws the LEDs over all of the exposure, by rows where these are exposed one after the other; before them the lamps' pulse, which they do not share.
    pub(super) fn draw_lights(&mut self, world: &World, capture: Time, on_head: Option<(&HeadMotion, &TrueCamera)>) {
        if let Some(sensor) = &self.sensor {
            sensor.flicker(capture, self.settings.exposure_ms, &mut self.canvas);
        }
        let readout_ms = self.sensor.as_ref().and_then(Sensor::readout_ms);
        for (share, moment) in self.moments(capture, self.settings.blur_samples.max(1)) {
            let stand = |it: &mut Self, moment: Time| {
                if let Some((motion, at_rest)) = on_head {
                    it.stand(motion.camera_at(at_rest, moment));
                }
            };
            let Some(readout_ms) = readout_ms else {
                stand(self, moment);
                self.draw_leds(world, moment, share, None);
                continue;
            };
            let half = Interval::from_ms(0.5 * readout_ms);
            let late = moment + half;
            stand(self, late);
            let there = self.lights_at(world, late, share);
            stand(self, moment - half);
            self.draw_leds(world, moment - half, share, Some(&there));
        }
    }

    /// Image positions of the LEDs at `moment` [px], without those that a person hides.
    fn lights_at(&mut self, world: &World, moment: Time, share: f64) -> Vec<(TargetId, Point2<f64>)> {
        let led_peak = world.settings().led_peak * self.settings.gain * share;
        world.at(moment, &mut self.moment);
        let lights = self.moment.lights_towards(&self.centre, led_peak);
        lights
            .filter(|it| !self.moment.occluded(&self.centre, &it.position))
            .filter_map(|it| Some((it.id, self.camera.project(&it.position)?)))
            .collect()
    }

    /// Draws the LEDs as they are at `moment`, with this share of their light; with a rolling shutter `moment` is that of the first row, and `later` says where they are
    /// seen at the last row's.
    fn draw_leds(&mut self, world: &World, moment: Time, share: f64, later: Option<&[(TargetId, Point2<f64>)]>) {
        let led_peak = world.settings().led_peak * self.settings.gain * share;
        world.at(moment, &mut self.moment);
        for light in self.moment.lights_towards(&self.centre, led_peak) {
            if let Some(pixel) = self.camera.project(&light.position)
                && !self.moment.occluded(&self.centre, &light.position)
                && let Some(pixel) = self.met(&light, pixel, later)
            {
                self.glow(&light, pixel).for_each(|spot| spot.add_to(&mut self.canvas, self.camera.image_size));
            }
        }
        let reflectance = world.settings().reflections;
        if reflectance > 0.0 {
            for mirror in [Mirror::FLOOR, Mirror::DISPLAY] {
                for light in self.moment.reflections_seen_from(&self.centre, &mirror, led_peak, reflectance) {
                    if let Some(pixel) = self.camera.project(&light.position) {
                        self.glow(&light, pixel).for_each(|it| it.add_to(&mut self.canvas, self.camera.image_size));
                    }
                }
            }
        }
    }

    /// Where the row that is just then exposed meets a light.
    fn met(&self, light: &Light, pixel: Point2<f64>, later: Option<&[(TargetId, Point2<f64>)]>) -> Option<Point2<f64>> {
        let Some(later) = later else { return Some(pixel) };
        let (_, last) = later.iter().find(|it| it.0 == light.id)?;
        rolled(&pixel, last, self.camera.image_size[1])
    }

    /// A light's spot, and its halo if the lens makes one.
    fn glow(&self, light: &Light, pixel: Point2<f64>) -> impl Iterator<Item = Spot> + use<> {
        let distance = (light.position - self.centre).norm();
        let peak = light.brightness * (REFERENCE_DISTANCE_M / distance).powi(2);
        let (centre, sigma) = ([pixel.x, pixel.y], self.sigmas());
        let halo = Spot { centre, sigma: sigma.map(|it| it * HALO_WIDTH), peak: peak * self.settings.bloom };
        let spot = Spot { centre, sigma, peak };
        let [first, second] = match &self.sensor {
            Some(sensor) => sensor.spots(spot),
            None => [Some(spot), None],
        };
        [first, second, (self.settings.bloom > 0.0).then_some(halo)].into_iter().flatten()
    }
}
