//! Whole-job throughput: samples per CPU-second, scaling over threads, peak memory, and time until the plan is ready.
//!
//! `cargo bench --bench throughput` prints a table. CPU seconds are the process' own (user + system), so that a busy
//! machine does not count. Encoding and writing to disk are included.

/// As the command has it.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[path = "../physics/plan.rs"]
mod plan;

use std::path::{Path, PathBuf};
use std::time::Instant;

use gelsim::dataset::generate::{Request, Watch, generate};
use gelsim::job::plan::Plan;

/// A job with one object in many poses at one rung.
fn job(rung: &str, object: &str, resolution: [u32; 2], samples: u64) -> String {
    format!(
        "fidelity = \"{rung}\"\n[dataset]\nname = \"bench\"\nsamples = {samples}\nseed = 1\nsamples_per_shard = 50\n\
         [sensor]\nresolution_px = [{}, {}]\n\
         [[object]]\npath = \"objects/{object}.obj\"\n\
         [pose]\nyaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 3.0]\nx_mm = [-2.0, 2.0]\ny_mm = [-2.0, 2.0]\n\
         [indentation]\ndepth_mm = [0.4, 1.0]\n",
        resolution[0], resolution[1]
    )
}

/// User and system seconds of this process so far, from /proc.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let field = |n: usize| after_name.split_whitespace().nth(n).and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
    // Fields 14 and 15 of the whole line, in clock ticks of 10 ms.
    (field(11) + field(12)) / 100.0
}

fn peak_memory_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}

struct Measured {
    per_cpu_second: f64,
    per_second: f64,
}

fn measure(plan: &Plan, threads: usize, root: &Path) -> Measured {
    let _ = std::fs::remove_dir_all(root);
    let request = Request { root: root.to_owned(), shards: None, threads: Some(threads), overwrite: false };
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    let done = match generate(plan, &request, &Watch::default()) {
        Ok(done) => done,
        Err(stopped) => panic!("{stopped:?}"),
    };
    let (cpu, wall) = (cpu_seconds() - cpu, wall.elapsed().as_secs_f64());
    let _ = std::fs::remove_dir_all(root);
    Measured { per_cpu_second: done.samples as f64 / cpu, per_second: done.samples as f64 / wall }
}

fn main() {
    // `cargo test --benches` and `cargo bench` both run this; only the latter passes --bench.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("throughput: run with cargo bench");
        return;
    }
    let root: PathBuf = std::env::temp_dir().join(format!("gelsim-throughput-{}", std::process::id()));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    println!(
        "{:<10} {:<10} {:>9} {:>8} {:>14} {:>12} {:>8}",
        "rung", "object", "px", "threads", "per CPU-second", "per second", "scaling"
    );
    for (rung, object, resolution) in [
        ("paper", "dots", [640, 480]),
        ("paper", "dots", [320, 240]),
        ("standard", "dots", [640, 480]),
        ("standard", "dots", [320, 240]),
        ("standard", "sphere", [640, 480]),
        ("standard", "flat_face", [640, 480]),
    ] {
        let start = Instant::now();
        let samples = if resolution[0] == 640 { 300 } else { 1200 };
        let plan = plan::plan(&job(rung, object, resolution, samples));
        let ready = start.elapsed().as_secs_f64();
        let mut single = 0.0;
        let mut threads = 1;
        while threads <= cores {
            let measured = measure(&plan, threads, &root);
            if threads == 1 {
                single = measured.per_second;
            }
            println!(
                "{rung:<10} {object:<10} {:>9} {threads:>8} {:>14.1} {:>12.1} {:>8.2}",
                format!("{}x{}", resolution[0], resolution[1]),
                measured.per_cpu_second,
                measured.per_second,
                measured.per_second / single,
            );
            threads *= 2;
        }
        println!(
            "{rung:<10} {object:<10} plan ready after {:.0} ms; peak memory so far {:.0} MB",
            ready * 1e3,
            peak_memory_mb()
        );
    }
}
