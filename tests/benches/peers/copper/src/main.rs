//! What a message costs in copper-rs through chains of 4 and 32 pass-through tasks, in one thread; prints the slope.
//!
//! Three graphs: 64 bytes, a pooled megabyte, and 64 bytes with copper's own log of every message on.

use std::time::Instant;

use cu29::prelude::*;

/// Messages a round.
const COUNT: u32 = 20_000;
/// Rounds; the fastest counts, as for every program of this comparison.
const ROUNDS: u32 = 9;

/// Source, pass-through task and sink for one payload; `$make` gives the payload out of `$pool`.
macro_rules! tasks {
    ($name:ident, $payload:ty, $pool_type:ty, $new_pool:expr, |$pool:ident| $make:expr) => {
        mod $name {
            use cu29::prelude::*;

            pub type Payload = $payload;

            #[derive(Reflect)]
            #[reflect(from_reflect = false)]
            pub struct Source {
                #[reflect(ignore)]
                pool: $pool_type,
            }

            impl Freezable for Source {}

            impl CuSrcTask for Source {
                type Resources<'r> = ();
                type Output<'m> = output_msg!(Payload);

                fn new(_config: Option<&ComponentConfig>, _resources: ()) -> CuResult<Self> {
                    Ok(Self { pool: $new_pool })
                }

                fn process(&mut self, context: &CuContext, output: &mut Self::Output<'_>) -> CuResult<()> {
                    let $pool = &self.pool;
                    output.tov = Tov::Time(context.now());
                    output.set_payload($make);
                    Ok(())
                }
            }

            #[derive(Reflect)]
            pub struct Pass;

            impl Freezable for Pass {}

            impl CuTask for Pass {
                type Resources<'r> = ();
                type Input<'m> = input_msg!(Payload);
                type Output<'m> = output_msg!(Payload);

                fn new(_config: Option<&ComponentConfig>, _resources: ()) -> CuResult<Self> {
                    Ok(Self)
                }

                fn process(
                    &mut self,
                    _context: &CuContext,
                    input: &Self::Input<'_>,
                    output: &mut Self::Output<'_>,
                ) -> CuResult<()> {
                    if let Some(payload) = input.payload() {
                        output.set_payload(payload.clone());
                    }
                    output.tov = input.tov;
                    Ok(())
                }
            }

            #[derive(Reflect)]
            pub struct Sink;

            impl Freezable for Sink {}

            impl CuSinkTask for Sink {
                type Resources<'r> = ();
                type Input<'m> = input_msg!(Payload);

                fn new(_config: Option<&ComponentConfig>, _resources: ()) -> CuResult<Self> {
                    Ok(Self)
                }

                fn process(&mut self, _context: &CuContext, input: &Self::Input<'_>) -> CuResult<()> {
                    assert!(std::hint::black_box(input.payload()).is_some(), "a message is missing");
                    Ok(())
                }
            }
        }
    };
}

tasks!(small, [u64; 8], (), (), |_pool| [7; 8]);
tasks!(
    large,
    CuHandle<Vec<u8>>,
    std::sync::Arc<CuHostMemoryPool<Vec<u8>>>,
    CuHostMemoryPool::new("frames", 64, || vec![7; 1 << 20])?,
    |pool| pool.acquire().ok_or("the pool is empty")?
);

/// An application over one graph, and what a message costs in it [ns].
macro_rules! application {
    ($name:ident, $graph:literal) => {
        mod $name {
            use super::*;

            #[copper_runtime(config = $graph)]
            struct Chain {}

            pub fn message_ns() -> CuResult<f64> {
                let log = std::env::temp_dir().join(format!("foveate-peer-copper-{}", std::process::id()));
                std::fs::create_dir_all(&log)
                    .map_err(|error| CuError::new_with_cause("no folder for the log", error))?;
                let path = log.join("log.copper");
                let mut app = Chain::builder().with_log_path(&path, Some(256 << 20))?.build()?.start()?;
                let mut best = f64::INFINITY;
                for _ in 0..ROUNDS {
                    let start = Instant::now();
                    for _ in 0..COUNT {
                        app.run_one_iteration()?;
                    }
                    best = best.min(start.elapsed().as_nanos() as f64 / f64::from(COUNT));
                }
                drop(app.stop()?);
                // The log has done its part; what stays of it is no result.
                let _ = std::fs::remove_dir_all(&log);
                Ok(best)
            }
        }
    };
}

application!(small4, "graphs/small4.ron");
application!(small32, "graphs/small32.ron");
application!(large4, "graphs/large4.ron");
application!(large32, "graphs/large32.ron");
application!(logged4, "graphs/logged4.ron");
application!(logged32, "graphs/logged32.ron");

fn main() -> CuResult<()> {
    // One application a process: copper's logger is a global.
    let which = std::env::args().nth(1).unwrap_or_default();
    let ns = match which.as_str() {
        "small4" => small4::message_ns()?,
        "small32" => small32::message_ns()?,
        "large4" => large4::message_ns()?,
        "large32" => large32::message_ns()?,
        "logged4" => logged4::message_ns()?,
        "logged32" => logged32::message_ns()?,
        _ => return Err(CuError::from("expected small4, small32, large4, large32, logged4 or logged32")),
    };
    println!("{ns}");
    Ok(())
}
