//! Each model against dense textbook filters, and against one another on a path that turns.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, Vector2, Vector3, Vector6};
use proptest::prelude::*;

use super::*;
use crate::kalman::{ConstantVelocity, Innovation};
use crate::random::Random;

fn quiet(acceleration_density: f64) -> Mode {
    Mode::ConstantVelocity { acceleration_density }
}

fn jerky(jerk_density: f64, acceleration_sigma: f64) -> Mode {
    Mode::ConstantAcceleration { jerk_density, acceleration_sigma }
}

/// Changes between all modes, none twice the same.
fn rates() -> Matrix3<f64> {
    Matrix3::new(0.0, 1.3, 0.4, 2.0, 0.0, 0.7, 0.3, 0.9, 0.0)
}

fn all_models() -> Vec<Model> {
    let chains: [&[Mode]; 4] = [
        &[quiet(0.1), quiet(5.0)],
        &[quiet(0.1), jerky(50.0, 4.0)],
        &[jerky(1.0, 2.0), jerky(80.0, 6.0)],
        &[quiet(0.1), quiet(5.0), jerky(50.0, 4.0)],
    ];
    let mut models = vec![quiet(2.0).into(), jerky(40.0, 5.0).into()];
    models.extend(chains.map(|it| Model::Interacting(Interacting::with_rates(it, &rates()).unwrap())));
    models
}

/// Jacobian of one of three cameras with 500 px of focal length, 2 m away, along one of the axes.
fn camera_jacobian(which: usize) -> Matrix2x3<f64> {
    let mut jacobian = Matrix2x3::zeros();
    jacobian[(0, (which + 1) % 3)] = 250.0;
    jacobian[(1, (which + 2) % 3)] = 250.0;
    jacobian
}

/// A dense filter of nine numbers in one mode, as the textbooks have it; one without acceleration keeps it at zero.
#[derive(Clone)]
struct Textbook {
    mode: Mode,
    state: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Textbook {
    fn new(mode: Mode, position: Point3<f64>, spread: &Matrix3<f64>, velocity: Vector3<f64>, sigma: f64) -> Textbook {
        let (mut state, mut covariance) = (DVector::zeros(9), DMatrix::zeros(9, 9));
        state.rows_mut(0, 3).copy_from(&position.coords);
        state.rows_mut(3, 3).copy_from(&velocity);
        covariance.view_mut((0, 0), (3, 3)).copy_from(spread);
        covariance.view_mut((3, 3), (3, 3)).fill_diagonal(sigma * sigma);
        let mut made = Textbook { mode, state, covariance };
        made.fill(made.variance());
        made
    }

    /// The variance of acceleration that the mode states; zero without.
    fn variance(&self) -> f64 {
        match self.mode {
            Mode::ConstantVelocity { .. } => 0.0,
            Mode::ConstantAcceleration { acceleration_sigma, .. } => acceleration_sigma.powi(2),
        }
    }

    /// Forgets the acceleration.
    fn fill(&mut self, variance: f64) {
        self.state.rows_mut(6, 3).fill(0.0);
        self.covariance.rows_mut(6, 3).fill(0.0);
        self.covariance.columns_mut(6, 3).fill(0.0);
        self.covariance.view_mut((6, 6), (3, 3)).fill_diagonal(variance);
    }

    fn predict(&mut self, t: f64) {
        let step = |s: f64| {
            let one = Matrix3::new(1.0, s, s * s / 2.0, 0.0, 1.0, s, 0.0, 0.0, 1.0);
            DMatrix::from_fn(9, 9, |i, j| if i % 3 == j % 3 { one[(i / 3, j / 3)] } else { 0.0 })
        };
        let (density, enters) = match self.mode {
            Mode::ConstantVelocity { acceleration_density } => (acceleration_density, 3),
            Mode::ConstantAcceleration { jerk_density, .. } => (jerk_density, 6),
        };
        // Q = ∫ F(s) G q Gᵀ F(s)ᵀ ds by Gauss's rule of three points, exact for these polynomials.
        let mut noise = DMatrix::zeros(9, 9);
        for (place, weight) in [(-(0.6f64.sqrt()), 5.0), (0.0, 8.0), (0.6f64.sqrt(), 5.0)] {
            let shape = step(0.5 * t * (1.0 + place)).columns(enters, 3).into_owned();
            noise += &shape * shape.transpose() * (density * weight / 18.0 * t);
        }
        let forward = step(t);
        self.state = &forward * &self.state;
        self.covariance = &forward * &self.covariance * forward.transpose() + noise;
    }

    /// The log-likelihood of a measurement, which is taken in.
    fn update(&mut self, innovation: &DVector<f64>, by_state: &DMatrix<f64>, noise: &DMatrix<f64>) -> f64 {
        let expected = by_state * &self.covariance * by_state.transpose() + noise;
        let inverse = expected.clone().try_inverse().unwrap();
        let gain = &self.covariance * by_state.transpose() * &inverse;
        self.state += &gain * innovation;
        let keep = DMatrix::identity(9, 9) - &gain * by_state;
        self.covariance = &keep * &self.covariance * keep.transpose() + &gain * noise * gain.transpose();
        let squared = (innovation.transpose() * inverse * innovation)[0];
        -0.5 * (squared + (expected * (2.0 * std::f64::consts::PI)).determinant().ln())
    }
}

/// The interacting filter of the book, each step as it stands there.
struct TextbookModes {
    rates: DMatrix<f64>,
    each: Vec<Textbook>,
    probabilities: DVector<f64>,
}

fn combined(each: &[Textbook], shares: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
    let mean: DVector<f64> = each.iter().zip(shares).map(|(it, share)| &it.state * *share).sum();
    let mut covariance = DMatrix::zeros(9, 9);
    for (it, share) in each.iter().zip(shares) {
        let apart = &it.state - &mean;
        covariance += (&it.covariance + &apart * apart.transpose()) * *share;
    }
    (mean, covariance)
}

impl TextbookModes {
    fn predict(&mut self, t: f64) {
        let transition = (&self.rates * t).exp();
        let expected = transition.transpose() * &self.probabilities;
        let before = self.each.clone();
        for (j, own) in self.each.iter_mut().enumerate() {
            let mut sources = before.clone();
            for source in sources.iter_mut().filter(|it| it.variance() == 0.0) {
                source.fill(own.variance());
            }
            let shares: Vec<f64> =
                (0..before.len()).map(|i| transition[(i, j)] * self.probabilities[i] / expected[j]).collect();
            (own.state, own.covariance) = combined(&sources, &shares);
            if own.variance() == 0.0 {
                own.fill(0.0);
            }
            own.predict(t);
        }
        self.probabilities = expected;
    }

    fn update(&mut self, innovation: &DVector<f64>, by_state: &DMatrix<f64>, noise: &DMatrix<f64>) -> f64 {
        let mean = self.moments().0;
        let mut likelihoods = DVector::zeros(self.each.len());
        for (j, own) in self.each.iter_mut().enumerate() {
            let own_innovation = innovation + by_state * (&mean - &own.state);
            likelihoods[j] = own.update(&own_innovation, by_state, noise).exp();
        }
        let joint = self.probabilities.component_mul(&likelihoods);
        self.probabilities = &joint / joint.sum();
        joint.sum().ln()
    }

    fn moments(&self) -> (DVector<f64>, DMatrix<f64>) {
        combined(&self.each, self.probabilities.as_slice())
    }
}

fn dense_model(model: &Model) -> (Vec<Mode>, DMatrix<f64>, Vec<f64>) {
    match *model {
        Model::ConstantVelocity { acceleration_density } => {
            (vec![quiet(acceleration_density)], DMatrix::zeros(1, 1), vec![1.0])
        }
        Model::ConstantAcceleration { jerk_density, acceleration_sigma } => {
            (vec![jerky(jerk_density, acceleration_sigma)], DMatrix::zeros(1, 1), vec![1.0])
        }
        Model::Interacting(it) => {
            let n = it.modes().len();
            let mut all = DMatrix::from_fn(n, n, |i, j| rates()[(i, j)]);
            all.set_diagonal(&DVector::from_fn(n, |i, _| -all.row(i).sum()));
            (it.modes().to_vec(), all, it.start().to_vec())
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn every_model_is_that_of_the_textbook(seed: u64, which in 0..6_usize) {
        let mut random = Random::new(seed);
        let model = all_models()[which];
        let (modes, rates, start) = dense_model(&model);
        let position = Point3::from(Vector3::from_fn(|_, _| random.normal()));
        let velocity = Vector3::from_fn(|_, _| random.normal());
        let spread = Matrix3::new(0.04, 0.01, 0.0, 0.01, 0.05, -0.01, 0.0, -0.01, 0.02);
        let mut filter = Filter::new(&model, position, spread, velocity, 1.5);
        let mut book = TextbookModes {
            rates,
            each: modes.iter().map(|mode| Textbook::new(*mode, position, &spread, velocity, 1.5)).collect(),
            probabilities: DVector::from_vec(start),
        };
        for step in 0..12 {
            let dt_s = if step == 5 { 0.0 } else { random.uniform_in(0.001, 0.3) };
            let expected_place = filter.position_after(0.0);
            prop_assert!((expected_place - filter.position()).norm() < 1e-12);
            prop_assert!(filter.predict(dt_s));
            book.predict(dt_s);
            let found = if step % 4 == 3 {
                let measured = filter.position() + Vector3::from_fn(|_, _| 0.1 * random.normal());
                let innovation = DVector::from_column_slice((measured - filter.position()).as_slice());
                let noise = Matrix3::identity() * 0.01;
                let ours = filter.update_position(&measured, &noise).log_likelihood;
                (ours, book.update(&innovation, &DMatrix::identity(3, 9), &(DMatrix::identity(3, 3) * 0.01)))
            } else {
                let jacobian = Matrix2x3::from_fn(|_, _| 100.0 * random.normal());
                let noise = Matrix2::new(0.3, 0.1, 0.1, 0.4);
                let expected = filter.innovation_covariance(&jacobian, &noise);
                let dense = jacobian * book.moments().1.fixed_view::<3, 3>(0, 0) * jacobian.transpose() + noise;
                prop_assert!((expected - dense).norm() < 1e-7 * dense.norm());
                // A few sigmas of what is expected: the modes are to disagree, and not to underflow.
                let innovation = expected.cholesky().unwrap().l() * Vector2::new(random.normal(), random.normal()) * 2.0;
                let mut by_state = DMatrix::zeros(2, 9);
                by_state.columns_mut(0, 3).copy_from(&jacobian);
                let ours = filter.update_pixel(innovation, &jacobian, &noise);
                let squared = (innovation.transpose() * expected.try_inverse().unwrap() * innovation)[0];
                prop_assert!((ours.normalised_squared - squared).abs() < 1e-7 * (1.0 + squared));
                let dense_noise = DMatrix::from_column_slice(2, 2, noise.as_slice());
                (ours.log_likelihood, book.update(&DVector::from_column_slice(innovation.as_slice()), &by_state, &dense_noise))
            };
            prop_assert!((found.0 - found.1).abs() < 1e-6 * (1.0 + found.1.abs()), "{} {}", found.0, found.1);
            let (mean, covariance) = book.moments();
            let mut state = DVector::zeros(9);
            state.rows_mut(0, 3).copy_from(&filter.position().coords);
            state.rows_mut(3, 3).copy_from(&filter.velocity());
            state.rows_mut(6, 3).copy_from(&filter.acceleration());
            prop_assert!((&state - &mean).norm() < 1e-7 * (1.0 + mean.norm()), "step {step}: {state} {mean}");
            let ours = filter.covariance();
            prop_assert!((ours - covariance.fixed_view::<6, 6>(0, 0)).norm() < 1e-7 * (1.0 + ours.norm()));
            prop_assert_eq!(ours, ours.transpose());
            let corner = ours.fixed_view::<3, 3>(0, 0).into_owned();
            prop_assert_eq!(corner, filter.position_covariance());
            if !filter.mode_probabilities().is_empty() {
                let ours = DVector::from_column_slice(filter.mode_probabilities());
                prop_assert!((&ours - &book.probabilities).norm() < 1e-7, "{ours} {}", book.probabilities);
            }
        }
    }

    #[test]
    fn changes_have_the_probabilities_of_the_chain(
        off in proptest::array::uniform6(0.0..20.0_f64), dt_s in 0.0..10.0_f64, n in 2..4_usize,
    ) {
        let [a, b, c, d, e, f] = off;
        let given = Matrix3::new(9.0, a, b, c, 9.0, d, e, f, 9.0);
        let modes = [quiet(1.0), quiet(2.0), quiet(3.0)];
        let chain = Interacting::with_rates(&modes[..n], &given).unwrap();
        let mut dense = DMatrix::from_fn(n, n, |i, j| given[(i, j)]);
        (0..n).for_each(|i| dense[(i, i)] = 0.0);
        dense.set_diagonal(&DVector::from_fn(n, |i, _| -dense.row(i).sum()));
        let expected = (&dense * dt_s).exp();
        let ours = chain.transition(dt_s);
        for i in 0..n {
            for j in 0..n {
                prop_assert!((ours[(i, j)] - expected[(i, j)]).abs() < 1e-9, "{ours} {expected}");
            }
            prop_assert!((ours.row(i).sum() - 1.0).abs() < 1e-12 && ours.iter().all(|it| *it >= 0.0));
        }
        // The start is where the chain settles: one more step changes nothing.
        let start = DVector::from_column_slice(chain.start());
        prop_assert!((expected.transpose() * &start - &start).norm() < 1e-6, "{start}");
    }
}

#[test]
fn a_filter_of_constant_velocity_is_the_plain_one_to_the_bit() {
    let mut random = Random::new(2);
    let mut plain = ConstantVelocity::new(Point3::origin(), Matrix3::identity(), 2.0);
    let mut filter = Filter::new(&quiet(3.0).into(), Point3::origin(), Matrix3::identity(), Vector3::zeros(), 2.0);
    for step in 0..100 {
        plain.predict(0.01, 3.0);
        filter.predict(0.01);
        let (innovation, noise) = (Vector2::new(random.normal(), random.normal()), Matrix2::identity() * 0.3);
        let jacobian = camera_jacobian(step);
        assert_eq!(
            plain.update_pixel(innovation, &jacobian, &noise),
            filter.update_pixel(innovation, &jacobian, &noise)
        );
    }
    assert_eq!(
        (plain.position, plain.velocity, plain.covariance),
        (filter.position(), filter.velocity(), filter.covariance())
    );
    assert_eq!(filter.acceleration(), Vector3::zeros());
}

#[test]
fn modes_that_do_not_differ_are_one() {
    // Two equal modes: whatever the chain, the mixture is the plain filter.
    let twice = Interacting::new(&[(quiet(3.0), 0.5), (quiet(3.0), 0.1)]).unwrap();
    assert!((twice.start()[0] - 5.0 / 6.0).abs() < 1e-12, "a point is where it stays");
    let make = |model| Filter::new(&model, Point3::origin(), Matrix3::identity(), Vector3::zeros(), 2.0);
    let (mut one, mut two) = (make(quiet(3.0).into()), make(Model::Interacting(twice)));
    let mut random = Random::new(3);
    for step in 0..200 {
        one.predict(0.01);
        two.predict(0.01);
        let (innovation, noise) = (Vector2::new(random.normal(), random.normal()), Matrix2::identity() * 0.3);
        let (a, b) = (
            one.update_pixel(innovation, &camera_jacobian(step), &noise),
            two.update_pixel(innovation, &camera_jacobian(step), &noise),
        );
        assert!((a.log_likelihood - b.log_likelihood).abs() < 1e-9);
    }
    assert!((one.position() - two.position()).norm() < 1e-12 && (one.covariance() - two.covariance()).norm() < 1e-12);
}

/// A point whose true motion is given; what three cameras see of it, one after another.
fn run(model: &Model, seed: u64, steps: usize, dt_s: f64, mut truth: impl FnMut(usize) -> Vector6<f64>) -> Run {
    let (mut random, sigma) = (Random::new(seed), 0.5);
    let first = truth(0);
    let position: Vector3<f64> = first.fixed_rows::<3>(0) + Vector3::from_fn(|_, _| 0.1 * random.normal());
    let velocity: Vector3<f64> = first.fixed_rows::<3>(3) + Vector3::from_fn(|_, _| random.normal());
    let mut filter = Filter::new(model, position.into(), Matrix3::identity() * 0.01, velocity, 1.0);
    let mut done = Run::default();
    for step in 1..=steps {
        let state = truth(step);
        let place = state.fixed_rows::<3>(0);
        assert!(filter.predict(dt_s));
        let jacobian = camera_jacobian(step % 3);
        let noise = Vector2::new(random.normal(), random.normal()) * sigma;
        let innovation = jacobian * (place - filter.position().coords) + noise;
        let found = filter.update_pixel(innovation, &jacobian, &(Matrix2::identity() * sigma * sigma));
        done.innovations += found.normalised_squared;
        done.squared_errors += (place - filter.position().coords).norm_squared();
        let mut error = state;
        error.fixed_rows_mut::<3>(0).copy_from(&(place - filter.position().coords));
        error.fixed_rows_mut::<3>(3).copy_from(&(state.fixed_rows::<3>(3) - filter.velocity()));
        done.last_error = error.dot(&(filter.covariance().try_inverse().unwrap() * error));
        done.steps += 1;
    }
    done
}

#[derive(Default)]
struct Run {
    innovations: f64,
    squared_errors: f64,
    last_error: f64,
    steps: usize,
}

#[test]
fn errors_under_constant_acceleration_are_as_large_as_the_covariance_says() {
    let (dt_s, density, acceleration_sigma) = (0.01_f64, 60.0_f64, 4.0);
    let (runs, steps) = (200, 100);
    let (mut state_error, mut innovations) = (0.0, 0.0);
    for seed in 0..runs {
        let mut random = Random::new(seed).fork("truth");
        let mut state = Vector6::from_fn(|i, _| if i < 3 { 0.0 } else { random.normal() });
        let mut acceleration: Vector3<f64> = Vector3::from_fn(|_, _| acceleration_sigma * random.normal());
        let done = run(&jerky(density, acceleration_sigma).into(), seed, steps, dt_s, |step| {
            if step > 0 {
                let substeps = 20;
                let h = dt_s / f64::from(substeps);
                for _ in 0..substeps {
                    for axis in 0..3 {
                        state[axis] += h * state[axis + 3];
                        state[axis + 3] += h * acceleration[axis];
                        acceleration[axis] += (density * h).sqrt() * random.normal();
                    }
                }
            }
            state
        });
        state_error += done.last_error;
        innovations += done.innovations;
    }
    // χ²: means 6 and 2, variances twice that; four standard errors.
    let (mean_state, mean) = (state_error / runs as f64, innovations / (runs as usize * steps) as f64);
    assert!((mean_state - 6.0).abs() < 4.0 * (12.0 / runs as f64).sqrt(), "{mean_state}");
    assert!((mean - 2.0).abs() < 4.0 * (4.0 / (runs as usize * steps) as f64).sqrt(), "{mean}");
}

/// Walks straight at 1.2 m/s, and every two seconds turns at 12 m/s² for 0.4 s.
fn manoeuvres(dt_s: f64) -> impl FnMut(usize) -> Vector6<f64> {
    let mut state = Vector6::new(0.0, 0.0, 1.0, 1.2, 0.0, 0.0);
    move |step| {
        if step > 0 {
            let time_s = step as f64 * dt_s;
            let turning = time_s % 2.0 > 1.6;
            let side = if time_s % 4.0 > 2.0 { 1.0 } else { -1.0 };
            let heading: Vector3<f64> = state.fixed_rows::<3>(3).normalize();
            let across = Vector3::new(-heading.y, heading.x, 0.0) * if turning { 12.0 * side } else { 0.0 };
            let moved = state.fixed_rows::<3>(3) * dt_s + across * (dt_s * dt_s / 2.0);
            let mut place = state.fixed_rows_mut::<3>(0);
            place += moved;
            let mut velocity = state.fixed_rows_mut::<3>(3);
            velocity += across * dt_s;
        }
        state
    }
}

#[test]
fn interacting_modes_beat_each_of_them_on_a_path_with_turns() {
    let (dt_s, steps) = (1.0 / 180.0, 3600);
    let (calm, agile, turning) = (quiet(0.02), quiet(10.0), jerky(200.0, 8.0));
    let rms_mm = |model: &Model| {
        let sum: f64 = (0..10).map(|seed| run(model, seed, steps, dt_s, manoeuvres(dt_s)).squared_errors).sum();
        1e3 * (sum / (10 * steps) as f64).sqrt()
    };
    let [calm_alone, agile_alone, turning_alone] = [calm, agile, turning].map(|it| rms_mm(&it.into()));
    let two = rms_mm(&Model::Interacting(Interacting::new(&[(calm, 1.6), (agile, 0.4)]).unwrap()));
    let curved = rms_mm(&Model::Interacting(Interacting::new(&[(calm, 1.6), (turning, 0.4)]).unwrap()));
    let three = rms_mm(&Model::Interacting(Interacting::new(&[(calm, 1.6), (agile, 0.3), (turning, 0.4)]).unwrap()));
    let figures = format!(
        "quiet {calm_alone:.2}, agile {agile_alone:.2}, accelerating {turning_alone:.2}; \
         quiet + agile {two:.2}, quiet + accelerating {curved:.2}, all three {three:.2} mm"
    );
    println!("{figures}");
    let best_alone = calm_alone.min(agile_alone).min(turning_alone);
    assert!(two < 0.9 * calm_alone.min(agile_alone), "{figures}");
    assert!(curved < 0.9 * best_alone && three < 0.9 * best_alone, "{figures}");
}

#[test]
fn noise_grows_fast_where_it_is_too_low_and_shrinks_slowly_where_it_is_too_high() {
    let scale_after = |stated: f64, seconds: f64| {
        let (dt_s, true_density) = (1.0 / 180.0_f64, 2.0_f64);
        let mut random = Random::new(7);
        let model = quiet(stated).into();
        let mut filter = Filter::new(&model, Point3::origin(), Matrix3::identity() * 1e-4, Vector3::zeros(), 0.1);
        let mut adapted = AdaptiveNoise::new(0.25);
        let (mut position, mut velocity) = (Vector3::zeros(), Vector3::zeros());
        for step in 0..(seconds / dt_s) as usize {
            for axis in 0..3 {
                velocity[axis] += (true_density * dt_s).sqrt() * random.normal();
            }
            position += velocity * dt_s;
            assert!(filter.predict_scaled(dt_s, adapted.scale()));
            let jacobian = camera_jacobian(step % 3) * 10.0; // what the cameras add is small: the motion is to be seen
            let noise = Vector2::new(random.normal(), random.normal()) * 0.5;
            let innovation = jacobian * (position - filter.position().coords) + noise;
            let found = filter.update_pixel(innovation, &jacobian, &(Matrix2::identity() * 0.25));
            adapted.observe(found.normalised_squared, 2, dt_s);
        }
        adapted.scale()
    };
    let (risen, fallen_soon, fallen) = (scale_after(0.1, 1.0), scale_after(20.0, 0.5), scale_after(20.0, 20.0));
    assert!((8.0..=64.0).contains(&risen), "20 times too low: {risen}");
    assert!(fallen_soon > 0.5 && fallen < 0.3, "10 times too high: {fallen_soon}, later {fallen}");
    let right = scale_after(2.0, 20.0);
    assert!((0.4..2.5).contains(&right), "{right}");
}

/// d ln s / dt = k/τ · ln r after one observation of the largest square: r = (16 · 2 + 4) / (2 + 4) over 1 + √(2/6), k = 4.
#[test]
fn the_rate_of_adapted_noise_goes_with_time_over_the_time_constant() {
    let log_rate = 4.0 * (6.0 / (1.0 + (1.0_f64 / 3.0).sqrt())).ln();
    for (time_constant_s, dt_s, step) in [(0.25, 0.05, 0.2), (2.5, 0.5, 0.2), (0.25, 0.01, 0.04), (0.1, 0.17, 1.0)] {
        let mut adapted = AdaptiveNoise::bounded(time_constant_s, 1.0, 1e6);
        adapted.observe(1e9, 2, dt_s);
        let found = adapted.scale().ln();
        assert!((found - step * log_rate).abs() < 1e-9, "{dt_s} s of {time_constant_s} s: {found}");
    }
}

#[test]
fn adapted_noise_stays_within_its_bounds_whatever_comes() {
    let mut adapted = AdaptiveNoise::bounded(0.1, 0.5, 8.0);
    for nonsense in [(f64::NAN, 0.1), (f64::INFINITY, 0.1), (-1.0, 0.1), (1.0, f64::NAN), (1.0, -1.0)] {
        adapted.observe(nonsense.0, 2, nonsense.1);
    }
    adapted.observe(1e9, 0, 0.1);
    assert_eq!(adapted.scale(), 1.0);
    adapted.observe(1e12, 2, 0.01);
    assert!(adapted.scale() < 2.0, "one observation is no manoeuvre: {}", adapted.scale());
    (0..1000).for_each(|_| adapted.observe(1e12, 2, 1e9));
    (0..1000).for_each(|_| adapted.observe(1e12, 2, 0.01));
    assert!((adapted.scale() - 8.0).abs() < 1e-9);
    (0..10_000).for_each(|_| adapted.observe(0.0, 2, 0.01));
    assert!((adapted.scale() - 0.5).abs() < 1e-9);
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    for model in all_models() {
        let mut filter =
            Filter::new(&model, Point3::new(1.0, 2.0, 3.0), Matrix3::identity(), Vector3::new(1.0, 0.0, 0.0), 1.0);
        assert!(filter.predict(0.1));
        let before = filter.clone();
        assert!(filter.predict(0.0));
        assert_eq!(filter, before, "no time, no change: {model:?}");
        for (dt_s, scale) in [(-1e-9, 1.0), (f64::NAN, 1.0), (f64::INFINITY, 1.0), (1.0, -1.0), (1.0, f64::NAN)] {
            assert!(!filter.predict_scaled(dt_s, scale), "{model:?} {dt_s} {scale}");
        }
        let (jacobian, fine) = (camera_jacobian(0), Matrix2::identity());
        for (innovation, jacobian, noise) in [
            (Vector2::new(f64::NAN, 0.0), jacobian, fine),
            (Vector2::new(f64::INFINITY, 0.0), jacobian, fine),
            (Vector2::zeros(), jacobian.map(|_| f64::NAN), fine),
            (Vector2::zeros(), jacobian, fine * f64::NAN),
            (Vector2::zeros(), jacobian, fine * -1e9),
            (Vector2::zeros(), Matrix2x3::zeros(), Matrix2::zeros()),
        ] {
            assert_eq!(filter.update_pixel(innovation, &jacobian, &noise), Innovation::IMPOSSIBLE, "{model:?}");
        }
        let nowhere = Point3::new(0.0, f64::NAN, 0.0);
        assert_eq!(filter.update_position(&nowhere, &Matrix3::identity()), Innovation::IMPOSSIBLE);
        assert_eq!(filter, before, "{model:?}");
        if !matches!(model, Model::ConstantVelocity { .. }) {
            assert!(!filter.predict(1e200), "overflows: {model:?}");
            assert_eq!(filter, before);
        }
        // So far off that every mode's likelihood underflows: still a measurement.
        assert!(filter.update_pixel(Vector2::new(1e6, 0.0), &jacobian, &fine).log_likelihood.is_finite());
        let total: f64 = filter.mode_probabilities().iter().sum();
        assert!(filter.mode_probabilities().is_empty() || (total - 1.0).abs() < 1e-12, "{model:?}");
    }
}

#[test]
fn covariances_stay_positive_definite() {
    for model in all_models() {
        let mut random = Random::new(3);
        let mut filter = Filter::new(&model, Point3::origin(), Matrix3::identity() * 1e4, Vector3::zeros(), 1e2);
        for step in 0..20_000 {
            assert!(filter.predict(if step % 1000 == 999 { 10.0 } else { 1e-3 * random.uniform() }));
            let sigma = if step % 7 == 0 { 1e-2 } else { 1.0 };
            let innovation = Vector2::new(random.normal(), random.normal()) * sigma;
            let found = filter.update_pixel(
                innovation,
                &camera_jacobian(step / 500 % 3),
                &(Matrix2::identity() * (sigma * sigma)),
            );
            assert!(found.normalised_squared.is_finite(), "step {step}");
            assert!(filter.covariance().cholesky().is_some(), "step {step}: {}", filter.covariance());
        }
    }
}

#[test]
fn models_that_make_no_sense_are_refused() {
    let fine = quiet(1.0);
    assert_eq!(Interacting::new(&[]), Err(BadModel::Count(0)));
    assert_eq!(Interacting::new(&[(fine, 1.0)]), Err(BadModel::Count(1)));
    assert_eq!(Interacting::new(&[(fine, 1.0); 4]), Err(BadModel::Count(4)));
    assert_eq!(Interacting::new(&[(fine, 1.0), (quiet(-1.0), 1.0)]), Err(BadModel::Noise { mode: 1, value: -1.0 }));
    assert!(matches!(
        Interacting::new(&[(jerky(1.0, f64::NAN), 1.0), (fine, 1.0)]),
        Err(BadModel::Noise { mode: 0, .. })
    ));
    for stay_s in [0.0, -1.0, f64::NAN] {
        assert!(matches!(Interacting::new(&[(fine, 1.0), (fine, stay_s)]), Err(BadModel::Rate { mode: 1, .. })));
    }
    // A mode that nothing leaves holds everything in the end, and is no trouble.
    let held = Interacting::new(&[(fine, f64::INFINITY), (quiet(2.0), 1.0)]).unwrap();
    assert!((held.start()[0] - 1.0).abs() < 1e-9);
    let mut filter =
        Filter::new(&Model::Interacting(held), Point3::origin(), Matrix3::identity(), Vector3::zeros(), 1.0);
    assert!(filter.predict(1e3));
    assert!(filter.covariance().iter().all(|it| it.is_finite()) && filter.covariance() != Matrix6::zeros());
}
