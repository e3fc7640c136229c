//! `preview --watch`: a page for a browser on this machine, which follows a job while it is edited.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{Folder, JOB, edited};

/// A command that watches `job.toml`; killed with this.
struct Watch {
    child: Child,
    port: u16,
    token: String,
}

/// Status, headers and body of an answer.
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Watch {
    fn start(folder: &Folder, flags: &str) -> Self {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.current_dir(folder.path("")).args(["preview", "job.toml", "--watch"]).args(flags.split_whitespace());
        command.env("GELSIM_CACHE_DIR", folder.path("cache")).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the command starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
        let parts = line.strip_prefix("http://127.0.0.1:").and_then(|rest| rest.trim_end().strip_suffix('/'));
        let (port, token) = parts.and_then(|rest| rest.split_once('/')).unwrap_or_else(|| panic!("{line:?}"));
        assert!(token.len() == 32 && token.bytes().all(|byte| byte.is_ascii_hexdigit()), "{token}");
        Self { port: port.parse().expect("a port"), token: token.to_owned(), child }
    }

    /// Sends bytes, and reads all that comes back.
    fn send(&self, bytes: &[u8]) -> Vec<u8> {
        let mut stream = self.connect();
        // It may answer, and close, before it has read all.
        let _ = stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write));
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        answer
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a limit");
        stream
    }

    fn request(&self, line: &str) -> Answer {
        let answer = self.send(format!("{line} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", self.port).as_bytes());
        let end = answer.windows(4).position(|part| part == b"\r\n\r\n").unwrap_or_else(|| panic!("{line}: no head"));
        let head = String::from_utf8_lossy(&answer[..end]).into_owned();
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_else(|| panic!("{head}"));
        Answer { status, head, body: answer[end + 4..].to_vec() }
    }

    fn get(&self, path: &str) -> Answer {
        self.request(&format!("GET /{}/{path}", self.token))
    }

    fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}");
        serde_json::from_slice(&answer.body).expect("JSON")
    }

    fn picture(&self, path: &str) -> image::RgbImage {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}");
        image::load_from_memory(&answer.body).expect("a PNG").into_rgb8()
    }

    /// Follows the sheet until it is as wanted.
    fn wait_for(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        let (mut revision, start) = (0, Instant::now());
        loop {
            let sheet = self.json(&format!("sheet?after={revision}"));
            if wanted(&sheet) {
                return sheet;
            }
            assert!(start.elapsed() < Duration::from_secs(120), "never: {sheet}");
            revision = sheet["revision"].as_u64().expect("a number");
        }
    }

    /// Follows the sheet until a job that is newer than `before` is rendered.
    fn wait_rendered(&self, before: &Value) -> Value {
        let before = before["revision"].as_u64().unwrap_or(0);
        self.wait_for(|sheet| {
            let samples = sheet["samples"].as_array().expect("a list");
            let fresh = |sample: &Value| sample["is_current"] == true && sample["revision"].as_u64() > Some(before);
            sheet["is_busy"] == false && sheet["problem"] == "" && !samples.is_empty() && samples.iter().all(fresh)
        })
    }

    /// Ends the command by a signal: its status, and what it said on standard error.
    fn end(mut self, signal: &str) -> (Option<i32>, String) {
        let id = self.child.id().to_string();
        assert!(std::process::Command::new("kill").args([signal, &id]).status().expect("kill").success());
        let status = self.child.wait().expect("it ends").code();
        let mut said = String::new();
        self.child.stderr.take().expect("a pipe").read_to_string(&mut said).expect("text");
        (status, said)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill().and_then(|()| self.child.wait());
    }
}

#[test]
fn the_page_and_all_it_shows_are_served_below_the_address() {
    let folder = Folder::with_job(JOB);
    let files = folder.files("");
    let watch = Watch::start(&folder, "--count 3");
    let sheet = watch.wait_rendered(&Value::Null);
    let kinds =
        [("", "text/html"), ("style.css", "text/css"), ("script.js", "text/javascript"), ("icon.svg", "image/")];
    for (name, kind) in kinds {
        let answer = watch.get(name);
        assert_eq!(answer.status, 200, "{name}");
        for header in [
            &format!("Content-Type: {kind}"),
            "Content-Security-Policy: default-src 'self'",
            "Referrer-Policy: no-referrer",
            "X-Content-Type-Options: nosniff",
            "Cache-Control: no-store",
        ] {
            assert!(answer.head.contains(header), "{name}: {header}\n{}", answer.head);
        }
        assert!(answer.head.contains(&format!("Content-Length: {}\r\n", answer.body.len())));
    }
    assert_eq!(sheet["samples"].as_array().map(Vec::len), Some(3));
    let panels = &sheet["samples"][0]["rows"][0]["panels"];
    let headings: Vec<&str> =
        panels.as_array().expect("a list").iter().filter_map(|it| it["heading"].as_str()).collect();
    assert!(headings.len() == 3 && headings[0] == "tactile" && headings[1].starts_with("depth "), "{headings:?}");
    // As `preview` draws it.
    folder.succeed("preview job.toml --key 0 --out sample.png");
    let drawn = image::open(folder.path("sample.png")).expect("a PNG").into_rgb8();
    let tactile = watch.picture("picture/0/0/0?v=1");
    assert_eq!(tactile.dimensions(), (48, 36));
    for (x, y, pixel) in tactile.enumerate_pixels() {
        assert_eq!(drawn.get_pixel(6 + x, 21 + y), pixel, "{x} {y}");
    }
    assert_eq!(watch.picture("picture/2/0/1?width=24").dimensions(), (24, 18));
    let label = watch.json("label/1");
    assert_eq!(label["json"]["index"], 1);
    let facts = label["facts"].as_array().expect("a list");
    let fact = |name: &str| facts.iter().find(|fact| fact["name"] == name).map(|fact| fact["value"].clone());
    assert_eq!(fact("class"), Some(label["json"]["object"]["class"].clone()));
    assert!(["depth", "pose", "contact", "health"].iter().all(|name| fact(name).is_some()), "{facts:?}");
    let effects = label["effects"].as_array().expect("a list");
    assert!(effects.iter().any(|effect| effect["name"] == "noise" && effect["reason"] == "the camera has none"));
    for missing in ["none", "label/3", "label/x", "label/", "picture/0/0/3", "picture/0/1/0", "picture/0/0", "sheet/1"]
    {
        assert_eq!(watch.get(missing).status, 404, "{missing}");
    }
    for path in
        ["..", "../job.toml", "%2e%2e/job.toml", "job.toml", "/etc/passwd", "picture/0/0/0/../../../../job.toml"]
    {
        assert_eq!(watch.get(path).status, 404, "{path}");
    }
    std::fs::remove_file(folder.path("sample.png")).expect("it was drawn");
    assert_eq!(watch.end("-INT").0, Some(130));
    assert!(folder.files("") == files, "nothing is written");
}

#[test]
fn who_does_not_know_the_token_or_the_name_learns_nothing() {
    let folder = Folder::with_job(JOB);
    let watch = Watch::start(&folder, "--count 1");
    let (port, token) = (watch.port, watch.token.clone());
    let get = |path: &str, host: &str| watch.send(format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes());
    let (own, page) = (format!("127.0.0.1:{port}"), format!("/{token}/"));
    assert!(get(&page, &own).starts_with(b"HTTP/1.1 200"));
    assert!(get(&page, &format!("localhost:{port}")).starts_with(b"HTTP/1.1 200"));
    let refused = get("/", &own);
    assert!(refused.starts_with(b"HTTP/1.1 403 Forbidden\r\n"));
    let other: String = token.bytes().map(|byte| if byte == b'0' { '1' } else { '0' }).collect();
    let last = format!("{}{}", &token[..31], if token.ends_with('0') { '1' } else { '0' });
    for path in
        [format!("/{other}/"), format!("/{last}/"), format!("/{token}"), format!("/{token}0/"), "/favicon.ico".into()]
    {
        assert!(get(&path, &own) == refused, "{path}");
    }
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1", "", &format!("{own}.evil.example")] {
        assert!(get(&page, host) == refused, "{host}");
    }
    for method in ["POST", "HEAD", "PUT", "OPTIONS", "DELETE"] {
        let answer = watch.request(&format!("{method} {page}"));
        assert!(answer.status == 405 && answer.head.contains("Allow: GET"), "{method}");
        assert_eq!(watch.request(&format!("{method} /")).status, 403, "{method}");
    }
}

#[test]
fn odd_huge_and_slow_requests_neither_end_it_nor_keep_others_waiting() {
    let folder = Folder::with_job(JOB);
    let watch = Watch::start(&folder, "--count 1");
    let begin = format!("GET /{}/ HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n", watch.token, watch.port);
    let mut slow: Vec<TcpStream> = (0..50).map(|_| watch.connect()).collect();
    slow.iter_mut().for_each(|stream| stream.write_all(begin.as_bytes()).expect("it reads"));
    let huge = vec![b'a'; 4 << 20];
    let odd: [&[u8]; 8] = [
        b"",
        b"\0\0\0\0",
        b"GET\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        &huge,
        &[b"GET /", &huge[..], b" HTTP/1.1\r\n\r\n"].concat(),
        &[begin.as_bytes(), b"Cookie: ", &huge, b"\r\n\r\n"].concat(),
        &[begin.as_bytes(), &b"a: b\r\n".repeat(10_000), b"\r\n"].concat(),
    ];
    for bytes in odd {
        let answer = watch.send(bytes);
        let refused = answer.is_empty() || answer.starts_with(b"HTTP/1.1 400 ");
        assert!(refused, "{}", String::from_utf8_lossy(&answer[..answer.len().min(200)]));
    }
    // A body is not read.
    let body = [begin.as_bytes(), b"Content-Length: 1000000\r\n\r\n", &huge[..1_000_000]].concat();
    assert!(watch.send(&body).starts_with(b"HTTP/1.1 200 "));
    let addresses = ["picture/99999999999999999999/0/0", "picture/0/18446744073709551616/0", "label/-1", "label/0/0"];
    for path in addresses {
        assert_eq!(watch.get(path).status, 404, "{path}");
    }
    watch.wait_rendered(&Value::Null);
    for path in ["picture/0/0/0?width=0", "picture/0/0/0?width=99999999999", "picture/0/0/0?width=x", "sheet?after=x"] {
        assert_eq!(watch.get(path).status, 200, "{path}");
    }
    // Those that were slow are answered if they go on in time.
    let mut answer = String::new();
    let stream = &mut slow[0];
    if stream.write_all(b"\r\n").is_ok() && stream.read_to_string(&mut answer).is_ok() {
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 200 "), "{answer}");
    }
    assert_eq!(watch.get("").status, 200);
}

/// The poses of the samples on a sheet.
fn poses(watch: &Watch, sheet: &Value) -> Vec<Value> {
    let samples = sheet["samples"].as_array().expect("a list").iter();
    samples.map(|sample| watch.json(&format!("label/{}", sample["index"]))["json"]["pose"].clone()).collect()
}

#[test]
fn an_edit_shows_the_same_samples_anew_and_those_before() {
    let folder = Folder::with_job(JOB);
    let watch = Watch::start(&folder, "--count 4 --set camera.read_noise_levels=0.0");
    let first = watch.wait_rendered(&Value::Null);
    assert!(first["samples"].as_array().expect("a list").iter().all(|sample| sample["has_before"] == false));
    let (before, poses_before) = (watch.picture("picture/0/0/0"), poses(&watch, &first));
    folder.write("job.toml", edited(JOB, &[("[pose]", "[camera]\nexposure = 0.5\n\n[pose]")]));
    let second = watch.wait_rendered(&first);
    let darker = watch.picture("picture/0/0/0");
    let sum = |picture: &image::RgbImage| picture.iter().map(|level| u64::from(*level)).sum::<u64>();
    assert!(sum(&darker) < sum(&before) * 6 / 10, "{} {}", sum(&darker), sum(&before));
    assert_eq!(watch.picture("before/0/0/0"), before);
    assert_eq!(poses(&watch, &second), poses_before, "no other draw");
    // What changes no sample renders nothing.
    let text = folder.read("job.toml") + "\n# a comment\n";
    folder.write("job.toml", &text);
    let third = watch.wait_for(|sheet| sheet["revision"] != second["revision"] && sheet["is_busy"] == false);
    assert_eq!(third["samples"], second["samples"]);
    // More samples keep those that were there, and fewer lose the others.
    folder.write("job.toml", edited(&text, &[("samples = 8", "samples = 2")]));
    let fourth = watch.wait_rendered(&third);
    assert_eq!(fourth["samples"].as_array().map(Vec::len), Some(2));
    assert_eq!(poses(&watch, &fourth), poses_before[..2]);
}

#[test]
fn a_broken_job_shows_its_error_over_the_last_sheet_until_it_is_mended() {
    let folder = Folder::with_job(JOB);
    let watch = Watch::start(&folder, "--count 2");
    let first = watch.wait_rendered(&Value::Null);
    for broken in [edited(JOB, &[("[pose]", "[pose")]), edited(JOB, &[("seed = 7", "sed = 7")]), String::new()] {
        folder.write("job.toml", &broken);
        let said = folder.fail("preview job.toml --out sheet.png", 2);
        let shown = watch.wait_for(|sheet| sheet["problem"] == said.trim_end());
        assert_eq!(shown["samples"], first["samples"]);
        assert!(said.contains("job.toml:") || broken.is_empty(), "{said}");
        assert_eq!(watch.get("picture/0/0/0").status, 200);
    }
    fs::remove_file(folder.path("job.toml")).expect("it was there");
    watch.wait_for(|sheet| sheet["problem"].as_str().is_some_and(|text| text.contains("cannot read the job")));
    // As an editor does.
    folder.write("job.toml~", JOB);
    fs::rename(folder.path("job.toml~"), folder.path("job.toml")).expect("renamed");
    let mended = watch.wait_for(|sheet| sheet["problem"] == "");
    assert_eq!(mended["samples"], first["samples"], "nothing is rendered again");
    assert!(watch.end("-TERM").1.contains("unknown key `sed`"), "the terminal tells it, too");
}

#[test]
fn files_that_a_job_names_are_watched_also_those_that_are_not_there() {
    let folder =
        Folder::with_job(&edited(JOB, &[("[sensor]", "[sensor]\nfile = \"own.toml\""), ("cube.obj", "p*.obj")]));
    folder.write("own.toml", "gelpad_thickness_mm = 2.0\nbackground = \"own.png\"\n");
    fs::copy(folder.path("cube.obj"), folder.path("part.obj")).expect("a mesh");
    let picture = |level: u8| {
        image::RgbImage::from_pixel(48, 36, image::Rgb([level; 3])).save(folder.path("own.png")).expect("a picture");
    };
    picture(90);
    let watch = Watch::start(&folder, "--count 6");
    let first = watch.wait_rendered(&Value::Null);
    picture(120);
    let second = watch.wait_rendered(&first);
    folder.write("own.toml", "gelpad_thickness_mm = 2.5\nbackground = \"own.png\"\n");
    let third = watch.wait_rendered(&second);
    assert_eq!(watch.json("label/0")["json"]["sensor"]["gelpad_thickness_mm"], 2.5);
    fs::copy(folder.path("cone.obj"), folder.path("new.obj")).expect("a mesh");
    fs::rename(folder.path("new.obj"), folder.path("part.obj")).expect("renamed");
    let fourth = watch.wait_rendered(&third);
    // Another file that the pattern finds.
    fs::copy(folder.path("cube.obj"), folder.path("plate.obj")).expect("a mesh");
    watch.wait_rendered(&fourth);
    fs::remove_file(folder.path("own.png")).expect("it was there");
    watch.wait_for(|sheet| sheet["problem"].as_str().is_some_and(|text| text.contains("own.toml:2:")));
    picture(120);
    watch.wait_for(|sheet| sheet["problem"] == "");
}

#[test]
fn sequences_grips_single_samples_and_overrides_are_followed() {
    let sequence = "\n[sequence]\nframe_rate_hz = 10.0\n\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.4\ndepth_mm = 0.5\n";
    let depth = "[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n";
    let job = edited(JOB, &[(depth, "")]);
    let folder = Folder::with_job(&format!("{job}{sequence}"));
    let watch = Watch::start(&folder, "--key 2 --seed 11 --fidelity draft --layers contact");
    let sheet = watch.wait_rendered(&Value::Null);
    let rows = sheet["samples"][0]["rows"].as_array().expect("a list");
    let labels: Vec<&str> = rows.iter().filter_map(|row| row["label"].as_str()).collect();
    assert_eq!((labels, sheet["samples"][0]["index"].clone()), (vec!["tactile", "contact"], 2.into()));
    assert!(rows[0]["panels"].as_array().expect("a list").len() >= 4, "{rows:?}");
    let label = watch.json("label/2");
    assert_eq!((&label["json"]["seed"], &label["json"]["fidelity"]), (&11.into(), &"draft".into()));
    assert!(label["facts"].as_array().expect("a list").iter().any(|fact| fact["name"] == "slip"), "{label}");
    // The same address shows what the job has become.
    folder.write("job.toml", edited(&job, &[("[pose]", "[gripper]\nsqueeze_mm = 0.8\n\n[pose]")]));
    let sheet = watch.wait_for(|sheet| sheet["problem"] != "" || sheet["samples"][0]["rows"][0]["label"] == "left");
    assert_eq!(sheet["problem"], "");
    watch.wait_for(|sheet| sheet["is_busy"] == false);
    let label = watch.json("label/2");
    let names: Vec<&str> =
        label["facts"].as_array().expect("a list").iter().filter_map(|it| it["name"].as_str()).collect();
    assert!(names.contains(&"gripper") && names.contains(&"right finger"), "{names:?}");
    // A sample that the job no longer has.
    folder.write("job.toml", edited(JOB, &[("samples = 8", "samples = 2")]));
    watch.wait_for(|sheet| sheet["problem"].as_str().is_some_and(|text| text.contains("there is no sample 2")));
}

#[test]
fn what_cannot_be_watched_is_refused_before_anything_is_served() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let said = folder.fail("preview out --watch", 2);
    assert!(said.contains("--watch follows a job") && said.contains("gelsim preview out/job.toml --watch"), "{said}");
    assert!(folder.fail("preview job.toml --watch --out sheet.png", 2).contains("cannot be used with"));
    assert!(folder.fail("preview job.toml --watch --port 0", 2).contains("--port"));
    assert!(folder.fail("preview job.toml --out sheet.png --port 5000", 2).contains("cannot be used with"));
    assert!(folder.fail("preview job.toml", 2).contains("--out"));
    folder.write("broken.toml", "[dataset");
    assert!(folder.fail("preview broken.toml --watch", 2).contains("broken.toml:1:"));
    let said = folder.fail("preview job.toml --watch --strict --set sensor.resolution_px=[36,48]", 2);
    assert!(said.contains("--strict treats notes"), "{said}");
    let watch = Watch::start(&folder, "");
    let said = folder.fail(&format!("preview job.toml --watch --port {}", watch.port), 1);
    assert!(said.contains("cannot serve the page") && said.contains("--port"), "{said}");
    assert_eq!(watch.end("-TERM").0, Some(143));
}
