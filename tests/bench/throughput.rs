//! Whole-job throughput: samples per CPU-second, scaling over threads, peak memory, and time until the plan is ready.
//!
//! `cargo bench --bench throughput` prints a table. CPU seconds are the process' own (user + system), so that a busy
//! machine does not count. Encoding and writing to disk are included.
//!
//! `cargo bench --bench throughput -- --beside OTHER` runs the program OTHER and the one beside this bench in turns on the
//! same jobs, and prints what each takes and the ratio.

#[path = "../../src/memory.rs"]
mod memory;
#[path = "../physics/plan.rs"]
mod plan;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use gelsim_dataset::generate::{GenerateRequest, RunMonitor, generate};
use gelsim_job::plan::Plan;

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

/// User and system seconds so far, from /proc: of this process, and of those that it has started.
fn cpu_seconds() -> [f64; 2] {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let field = |n: usize| after_name.split_whitespace().nth(n).and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
    // Fields 14 to 17 of the whole line, in clock ticks of 10 ms.
    [field(11) + field(12), field(13) + field(14)].map(|ticks| ticks / 100.0)
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
    let request = GenerateRequest { root: root.to_owned(), shards: None, threads: Some(threads), overwrite: false };
    let (cpu, wall) = (cpu_seconds()[0], Instant::now());
    let done = match generate(plan, &request, &RunMonitor::default()) {
        Ok(done) => done,
        Err(stopped) => panic!("{stopped:?}"),
    };
    let (cpu, wall) = (cpu_seconds()[0] - cpu, wall.elapsed().as_secs_f64());
    let _ = std::fs::remove_dir_all(root);
    Measured { per_cpu_second: done.samples as f64 / cpu, per_second: done.samples as f64 / wall }
}

/// Jobs on which two programs are compared: level, object, resolution, samples.
const COMPARED: [(&str, &str, [u32; 2], u64); 6] = [
    ("paper", "dots", [640, 480], 200),
    ("standard", "dots", [640, 480], 80),
    ("standard", "sphere", [640, 480], 120),
    ("standard", "gear", [640, 480], 80),
    ("high", "dots", [640, 480], 40),
    ("standard", "dots", [320, 240], 300),
];
/// How often each program runs a job.
const TURNS: usize = 5;

/// Runs `other` and the program of this build in turns, on one thread each, and prints CPU time a sample (the median of the
/// turns), and their ratio (the
/// median of those of each turn, with the least and the largest).
fn beside(other: &Path, root: &Path) {
    let own = std::env::current_exe().expect("a path").with_file_name("../gelsim");
    assert!(own.is_file() && other.is_file(), "build the program first (cargo build --release), and name another one");
    std::fs::create_dir_all(root).expect("a folder");
    println!("{:<10} {:<8} {:>9} {:>9} {:>9} {:>22}", "level", "object", "px", "other ms", "own ms", "own / other");
    for (level, object, resolution, samples) in COMPARED {
        let file = root.join("job.toml");
        let objects = plan::repository().join("objects").display().to_string();
        let text = job(level, object, resolution, samples).replace("path = \"objects", &format!("path = \"{objects}"));
        std::fs::write(&file, text).expect("a job");
        let run = |program: &Path| {
            let before = cpu_seconds()[1];
            let out = root.join("out");
            let mut command = Command::new(program);
            command.arg("generate").arg(&file).args(["--quiet", "--threads", "1", "--overwrite", "--out"]).arg(&out);
            assert!(command.status().expect("it starts").success(), "{}", program.display());
            1e3 * (cpu_seconds()[1] - before) / samples as f64
        };
        let mut turns: Vec<[f64; 2]> = (0..TURNS).map(|_| [run(other), run(&own)]).collect();
        let mut ratios: Vec<f64> = turns.iter().map(|[other, own]| own / other).collect();
        ratios.sort_by(f64::total_cmp);
        let mut median = |k: usize| {
            turns.sort_by(|a, b| a[k].total_cmp(&b[k]));
            turns[TURNS / 2][k]
        };
        let size = format!("{}x{}", resolution[0], resolution[1]);
        println!(
            "{level:<10} {object:<8} {size:>9} {:>9.2} {:>9.2} {:>9.2} ({:.2} to {:.2})",
            median(0),
            median(1),
            ratios[TURNS / 2],
            ratios[0],
            ratios[TURNS - 1],
        );
    }
    let _ = std::fs::remove_dir_all(root);
}

fn main() {
    memory::keep_freed();
    // `cargo test --benches` and `cargo bench` both run this; only the latter passes --bench.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("throughput: run with cargo bench");
        return;
    }
    let root: PathBuf = std::env::temp_dir().join(format!("gelsim-throughput-{}", std::process::id()));
    let other = std::env::args().skip_while(|argument| argument != "--beside").nth(1);
    if let Some(other) = other {
        return beside(Path::new(&other), &root);
    }
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
