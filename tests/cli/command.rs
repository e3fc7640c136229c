//! A command that is run to its end, and what must be true of that.

use std::ffi::OsStr;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// A program with arguments, input, and the time that it may take.
pub struct Command {
    inner: std::process::Command,
    input: Vec<u8>,
    most: Option<Duration>,
}

impl Command {
    pub fn new(program: impl AsRef<OsStr>) -> Self {
        Self { inner: std::process::Command::new(program), input: Vec::new(), most: None }
    }

    pub fn arg(&mut self, argument: impl AsRef<OsStr>) -> &mut Self {
        self.inner.arg(argument);
        self
    }

    pub fn args(&mut self, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> &mut Self {
        self.inner.args(arguments);
        self
    }

    pub fn env(&mut self, name: impl AsRef<OsStr>, value: impl AsRef<OsStr>) -> &mut Self {
        self.inner.env(name, value);
        self
    }

    pub fn current_dir(&mut self, folder: impl AsRef<Path>) -> &mut Self {
        self.inner.current_dir(folder);
        self
    }

    pub fn write_stdin(&mut self, input: impl Into<Vec<u8>>) -> &mut Self {
        self.input = input.into();
        self
    }

    /// It is killed after that.
    pub fn timeout(&mut self, most: Duration) -> &mut Self {
        self.most = Some(most);
        self
    }

    pub fn output(&mut self) -> std::io::Result<Output> {
        let mut run = self.inner.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        let mut input = run.stdin.take().expect("a pipe");
        let (mut out, mut err) = (run.stdout.take().expect("a pipe"), run.stderr.take().expect("a pipe"));
        thread::scope(|scope| {
            // A program need not read to the end.
            scope.spawn(|| drop((input.write_all(&self.input), input)));
            let stdout = scope.spawn(move || read(&mut out));
            let stderr = scope.spawn(move || read(&mut err));
            if let Some(most) = self.most {
                let start = Instant::now();
                while run.try_wait()?.is_none() {
                    if start.elapsed() > most {
                        run.kill()?;
                        break;
                    }
                    thread::sleep(Duration::from_millis(2));
                }
            }
            let [stdout, stderr] = [stdout, stderr].map(|reader| reader.join().expect("no panic"));
            Ok(Output { status: run.wait()?, stdout, stderr })
        })
    }

    pub fn assert(&mut self) -> Assert {
        Assert { output: self.output().expect("the command starts"), what: format!("{:?}", self.inner) }
    }
}

fn read(pipe: &mut impl Read) -> Vec<u8> {
    let mut bytes = Vec::new();
    pipe.read_to_end(&mut bytes).expect("a pipe");
    bytes
}

/// What a command did.
pub struct Assert {
    output: Output,
    what: String,
}

impl Assert {
    #[track_caller]
    pub fn success(self) -> Self {
        self.code(0)
    }

    #[track_caller]
    pub fn code(self, status: i32) -> Self {
        let Output { status: found, stdout, stderr } = &self.output;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert_eq!(found.code(), Some(status), "{}: {found}\n{}\n{}", self.what, text(stdout), text(stderr));
        self
    }

    #[track_caller]
    pub fn stdout(self, text: &str) -> Self {
        assert_eq!(String::from_utf8_lossy(&self.output.stdout), text, "{}", self.what);
        self
    }

    #[track_caller]
    pub fn stderr(self, text: &str) -> Self {
        assert_eq!(String::from_utf8_lossy(&self.output.stderr), text, "{}", self.what);
        self
    }

    pub fn get_output(&self) -> &Output {
        &self.output
    }
}
