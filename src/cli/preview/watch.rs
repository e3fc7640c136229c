//! `gelsim preview --watch`: renders a job's samples whenever its files change, for a page in a browser.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::Preview;
use super::server::{Answer, Server};
use crate::terminal::print_as_is;
use crate::{Failure, Log, print_result, terminal, threads_failure};
use gelsim_files::diagnostic::{DisplayOptions, user_error};
use gelsim_files::spelling::quote_for_shell;
use gelsim_files::watch;
use gelsim_job::plan::Plan;
use gelsim_job::probe::preview_job;
use gelsim_lab::preview::live::{LiveSample, LiveSheet};

/// Time between two looks at the files.
const LOOK: Duration = Duration::from_millis(300);
/// Time from a change that is seen until the job is read.
const SETTLING: Duration = Duration::from_millis(50);
/// Most time that a page waits for news, before it asks again.
const NEWS: Duration = Duration::from_secs(20);

/// The parts of the page that stay: name, media type, content.
const PARTS: [(&str, &str, &str); 4] = [
    ("", "text/html; charset=utf-8", include_str!("page/page.html")),
    ("style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("script.js", "text/javascript; charset=utf-8", include_str!("page/script.js")),
    ("icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// Serves the page and renders until a signal ends the process.
pub(super) fn watch_job(preview: &Preview) -> Result<(), Failure> {
    if preview.source.is_dir() {
        let message = format!("--watch follows a job while it is edited, and {} is a folder", preview.source.display());
        let (job, folder) = (quote_for_shell(&preview.source.join("job.toml")), quote_for_shell(&preview.source));
        let help = format!(
            "gelsim preview {folder} --out sheet.png draws a dataset; gelsim preview {job} --watch follows its job"
        );
        return Err(user_error(message, help).into());
    }
    end_on_signals()?;
    watch::restart();
    // What is wrong from the start is no edit.
    let mut loaded = Ok(load_job(preview)?);
    let server = Server::bind(preview.port).map_err(|error| {
        let help = "another program may have the port: name another one with --port, or leave it out";
        Failure::runtime_with_help(format!("cannot serve the page on 127.0.0.1: {error}"), help)
    })?;
    let address = server.address();
    let sheet = Arc::new(LiveSheet::new(preview.source.display().to_string()));
    let shown = Arc::clone(&sheet);
    server.start(move |path, query| answer_request(&shown, path, query)).map_err(|error| threads_failure(&error))?;
    print_result(&format!("{address}\n"))?;
    let note = format!("open this address: it shows {} whenever it changes; Ctrl-C ends it", preview.source.display());
    Log::plain_text(false).print_note(&note);

    // The job that the sheet shows, complete.
    let mut complete = None;
    loop {
        match loaded {
            Ok(job) if complete.as_ref() == Some(&job.content) => sheet.mend(),
            Ok(job) => complete = render_sheet(preview, &job, &sheet).then_some(job.content),
            Err(failure) => show_failure(&sheet, &failure),
        }
        while !watch::has_changed() {
            thread::sleep(LOOK);
        }
        // Most editors are done then.
        thread::sleep(SETTLING);
        watch::restart();
        loaded = load_job(preview);
    }
}

/// A job that was read.
struct LoadedJob {
    plan: Plan,
    indices: Vec<u64>,
    /// All that decides what is shown: the job with the contents of its files.
    content: (String, String),
}

fn load_job(preview: &Preview) -> Result<LoadedJob, Failure> {
    let plan = preview.read_plan()?;
    if preview.overrides.strict {
        preview.overrides.refuse_notes(&preview_job(&plan).notes)?;
    }
    let indices = preview.choose_job_samples(&plan)?;
    let text = plan.to_toml().map_err(|error| Failure::from_path(&preview.source, &error))?;
    Ok(LoadedJob { content: (plan.fingerprint.clone(), text), indices, plan })
}

/// Renders all samples of a job. Returns false if it was left for a job that has changed meanwhile, or if it failed.
fn render_sheet(preview: &Preview, job: &LoadedJob, sheet: &LiveSheet) -> bool {
    let (start, wanted) = (Instant::now(), preview.layer_selection());
    sheet.begin(&job.indices);
    let is_old = AtomicBool::new(false);
    job.indices.par_iter().for_each(|&index| {
        if is_old.load(Ordering::Relaxed) || watch::has_changed() {
            is_old.store(true, Ordering::Relaxed);
        } else {
            sheet.put(index, LiveSample::render(&job.plan, index, &wanted));
        }
    });
    if is_old.into_inner() {
        return false;
    }
    if let Err(failure) = Failure::check_meshes(&job.plan) {
        show_failure(sheet, &failure);
        return false;
    }
    let seconds = start.elapsed().as_secs_f64();
    let notes = preview.find_notes(&job.plan);
    let notes = if preview.overrides.verbose { notes } else { notes.worth_showing() };
    sheet.finish(seconds, notes.render(DisplayOptions::PLAIN));
    true
}

/// Shows a failure on the page and on standard error.
fn show_failure(sheet: &LiveSheet, failure: &Failure) {
    sheet.refuse(failure.to_text(DisplayOptions::PLAIN).unwrap_or_default());
    if let Some(text) = failure.to_text(terminal::stderr_display()) {
        print_as_is(&text);
    }
}

/// Ends the process with the status of the first signal: there is nothing to finish.
fn end_on_signals() -> Result<(), Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM])
        .map_err(|error| Failure::runtime(format!("cannot watch for signals: {error}")))?;
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            std::process::exit(128 + signal);
        }
    };
    thread::Builder::new().spawn(wait).map_err(|error| threads_failure(&error))?;
    Ok(())
}

/// Answers what the page asks: its parts, news of the sheet, pictures and labels.
fn answer_request(sheet: &LiveSheet, path: &str, query: &str) -> Option<Answer> {
    if let Some((_, content_type, text)) = PARTS.iter().find(|(name, ..)| *name == path) {
        return Some(Answer { content_type, body: Cow::Borrowed(text.as_bytes()) });
    }
    let number = |name: &str| {
        let mut values = query.split('&').filter_map(|pair| pair.strip_prefix(name)?.strip_prefix('='));
        values.next()?.parse::<u32>().ok()
    };
    let json = |text: String| Answer { content_type: "application/json", body: Cow::Owned(text.into_bytes()) };
    let mut parts = path.split('/');
    match parts.next()? {
        "sheet" if parts.next().is_none() => {
            Some(json(sheet.describe_after(u64::from(number("after").unwrap_or(0)), NEWS)))
        }
        "label" => {
            let index = parts.next()?.parse().ok()?;
            Some(json(sheet.describe_label(index)?)).filter(|_| parts.next().is_none())
        }
        when @ ("picture" | "before") => {
            let index = parts.next()?.parse().ok()?;
            let place = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
            let width = number("width").unwrap_or(u32::MAX).max(1);
            let png = sheet.encode_picture(index, place, width, when == "before")?;
            Some(Answer { content_type: "image/png", body: Cow::Owned(png) }).filter(|_| parts.next().is_none())
        }
        _ => None,
    }
}
