//! Seeded random numbers: the same seed gives the same numbers on every run.
//!
//! The generator is xoshiro256++ (D. Blackman and S. Vigna, "Scrambled linear pseudorandom number generators",
//! ACM TOMS 47(4), 2021), its state filled from the seed by SplitMix64. Not for secrets.

/// A stream of seeded random numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Random {
    seed: u64,
    state: [u64; 4],
    spare_normal: Option<f64>,
}

impl Random {
    /// The stream of `seed`; all seeds are equally good.
    #[inline]
    pub fn new(seed: u64) -> Random {
        let mut counter = seed;
        Random { seed, state: [(); 4].map(|()| split_mix(&mut counter)), spare_normal: None }
    }

    /// A separate stream for `name`. It depends on the seed of `self` and on `name`, not on what was drawn from
    /// `self`: a node that draws more does not change the numbers of its neighbours.
    pub fn fork(&self, name: &str) -> Random {
        // FNV-1a, 64 bits
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        let mut mixed = self.seed;
        let mut counter = split_mix(&mut mixed) ^ hash;
        Random::new(split_mix(&mut counter))
    }

    /// 64 random bits.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        let [mut a, mut b, mut c, mut d] = self.state;
        let bits = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let b_moved = b << 17;
        c ^= a;
        d ^= b;
        b ^= c;
        a ^= d;
        c ^= b_moved;
        self.state = [a, b, c, d.rotate_left(45)];
        bits
    }

    /// Uniform in 0 ≤ x < 1, a multiple of 2⁻⁵³.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform between `low` and `high`; `high` itself occurs at most by rounding.
    #[inline]
    pub fn uniform_in(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform among 0, 1, …, n − 1, without bias; 0 when `n` is 0.
    ///
    /// Source: D. Lemire, "Fast random integer generation in an interval", ACM TOMACS 29(1), 2019.
    #[inline]
    pub fn below(&mut self, n: u32) -> u32 {
        let mut product = (self.next_u64() >> 32) * u64::from(n);
        if (product as u32) < n {
            let too_few = n.wrapping_neg() % n;
            while (product as u32) < too_few {
                product = (self.next_u64() >> 32) * u64::from(n);
            }
        }
        (product >> 32) as u32
    }

    /// Normal with mean 0 and standard deviation 1, by Marsaglia's polar method.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare_normal.take() {
            return spare;
        }
        loop {
            let (x, y) = (self.uniform_in(-1.0, 1.0), self.uniform_in(-1.0, 1.0));
            let s = x * x + y * y;
            if s > 0.0 && s < 1.0 {
                let stretch = (-2.0 * s.ln() / s).sqrt();
                self.spare_normal = Some(y * stretch);
                return x * stretch;
            }
        }
    }
}

/// Steps `counter` and gives 64 well-mixed bits of it (SplitMix64).
fn split_mix(counter: &mut u64) -> u64 {
    *counter = counter.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mixed = (*counter ^ (*counter >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_the_published_generators() {
        let mut counter = 1_234_567;
        assert_eq!(
            [(); 3].map(|()| split_mix(&mut counter)),
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
        let mut random = Random { seed: 0, state: [1, 2, 3, 4], spare_normal: None };
        assert_eq!(
            [(); 5].map(|()| random.next_u64()),
            [41_943_041, 58_720_359, 3_588_806_011_781_223, 3_591_011_842_654_386, 9_228_616_714_210_784_205]
        );
    }

    /// The hash of a name is FNV-1a: of "foobar" 85944171f73967e8 (Fowler, Noll, Vo, test vectors of the 64-bit function).
    #[test]
    fn the_stream_of_a_name_stays_the_same() {
        let mut mixed = 5;
        let mut counter = split_mix(&mut mixed) ^ 0x8594_4171_f739_67e8;
        assert_eq!(Random::new(5).fork("foobar"), Random::new(split_mix(&mut counter)));
        assert_ne!(Random::new(5).fork("foobar"), Random::new(5).fork("foobas"));
    }

    /// The first four raw moments of `n` draws.
    fn moments(n: usize, mut draw: impl FnMut() -> f64) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for _ in 0..n {
            let x = draw();
            (1..=4).for_each(|power| sums[power as usize - 1] += x.powi(power));
        }
        sums.map(|it| it / n as f64)
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        // Four standard errors at n = 10⁶.
        let mut random = Random::new(5);
        let [mean, second, third, fourth] = moments(1_000_000, || random.normal());
        assert!(mean.abs() < 0.004 && (second - 1.0).abs() < 0.0057, "{mean} {second}");
        assert!(third.abs() < 0.0155 && (fourth - 3.0).abs() < 0.04, "{third} {fourth}");
        let [mean, second, ..] = moments(1_000_000, || random.uniform_in(-1.0, 3.0));
        assert!((mean - 1.0).abs() < 0.0047 && (second - 7.0 / 3.0).abs() < 0.0105, "{mean} {second}");
    }

    #[test]
    fn every_number_below_n_comes_equally_often() {
        let mut random = Random::new(6);
        // At 3 · 2³⁰ the bias of a plain multiplication is largest: of 2³² inputs, each third output would get two, the
        // others one. (A plain remainder would favour the lower third.)
        let n = 3 << 30;
        let draws: Vec<u32> = (0..100_000).map(|_| random.below(n)).collect();
        let shares = [
            draws.iter().filter(|it| **it < n / 3).count(),
            draws.iter().filter(|it| **it % 3 == 0).count(),
            draws.iter().filter(|it| **it % 3 == 1).count(),
        ];
        // Four standard errors.
        assert!(shares.iter().all(|it| (*it as f64 - 33_333.0).abs() < 4.0 * 149.0), "{shares:?}");
        let mut counts = [0; 7];
        (0..70_000).for_each(|_| counts[random.below(7) as usize] += 1);
        assert!(counts.iter().all(|it| (9_600..10_400).contains(it)), "{counts:?}");
        assert_eq!([random.below(0), random.below(1)], [0, 0]);
    }

    #[test]
    fn uniform_stays_below_one() {
        let mut random = Random::new(7);
        assert!((0..100_000).all(|_| (0.0..1.0).contains(&random.uniform())));
    }

    #[test]
    fn a_fork_depends_on_seed_and_name_only() {
        let mut root = Random::new(8);
        let before = root.fork("wide-1");
        root.normal();
        assert_eq!(before, root.fork("wide-1"));
        let bits = |mut random: Random| random.next_u64();
        let mut seen = vec![bits(Random::new(8)), bits(Random::new(9)), bits(Random::new(9).fork("wide-1"))];
        for name in ["wide-1", "wide-2", "wide-12", ""] {
            seen.push(bits(root.fork(name)));
            seen.push(bits(root.fork(name).fork("noise")));
        }
        let count = seen.len();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), count);
    }

    #[test]
    fn streams_of_forks_are_uncorrelated() {
        let root = Random::new(10);
        let (mut a, mut b) = (root.fork("a"), root.fork("b"));
        let correlation = (0..100_000).map(|_| a.normal() * b.normal()).sum::<f64>() / 1e5;
        assert!(correlation.abs() < 4.0 / 1e5_f64.sqrt(), "{correlation}");
    }
}
