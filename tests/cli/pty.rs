//! A command run in a pseudo-terminal, and what its user would see there.

use std::fs::File;
use std::io::Read;
use std::process::{Command, Stdio};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::support::Folder;

/// Rows of the terminal: more than anything that is printed here, so that nothing scrolls away.
const ROWS: u16 = 600;

/// A terminal with a width and what its user's environment says of colours.
#[derive(Clone, Copy)]
pub struct Terminal {
    pub columns: u16,
    pub env: &'static [(&'static str, &'static str)],
}

/// What a command left on a terminal.
pub struct Shown {
    pub status: i32,
    /// Every byte that came.
    pub raw: String,
    /// The rows of the screen after them, without spaces at their ends.
    pub rows: Vec<String>,
    /// The rows that the terminal broke off because they were too long for it.
    pub broken: Vec<String>,
}

impl Terminal {
    pub const fn of(columns: u16) -> Self {
        Self { columns, env: &[] }
    }

    pub const fn with(columns: u16, env: &'static [(&'static str, &'static str)]) -> Self {
        Self { columns, env }
    }

    /// Runs `gelsim` with arguments that are separated by single spaces, all three of its streams in this terminal.
    pub fn run(self, folder: &Folder, arguments: &str) -> Shown {
        self.run_each(folder, &arguments.split(' ').collect::<Vec<_>>())
    }

    pub fn run_each(self, folder: &Folder, arguments: &[&str]) -> Shown {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
        grantpt(&master).expect("a pseudo-terminal");
        unlockpt(&master).expect("a pseudo-terminal");
        let size = Winsize { ws_row: ROWS, ws_col: self.columns, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&master, size).expect("a size");
        let name = ptsname(&master, Vec::new()).expect("a name").into_string().expect("UTF-8");
        let end = || Stdio::from(File::options().read(true).write(true).open(&name).expect("its other end"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.args(arguments).current_dir(folder.path("")).stdin(end()).stdout(end()).stderr(end());
        for name in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "COLUMNS", "LINES", "CI"] {
            command.env_remove(name);
        }
        command.env("TERM", "xterm-256color").envs(self.env.iter().copied());
        let mut child = command.spawn().expect("the command starts");
        // Its ends of the terminal go with it.
        drop(command);
        let mut raw = Vec::new();
        let mut reader = File::from(master);
        let mut block = [0; 1 << 14];
        // An error is how a terminal says that nobody holds its other end.
        while let Ok(length @ 1..) = reader.read(&mut block) {
            raw.extend_from_slice(&block[..length]);
        }
        let status = child.wait().expect("it ends").code().unwrap_or(-1);
        let mut screen = vt100::Parser::new(ROWS, self.columns, 0);
        screen.process(&raw);
        let screen = screen.screen();
        let rows: Vec<String> = screen.rows(0, self.columns).map(|row| row.trim_end().to_owned()).collect();
        let last = rows.iter().rposition(|row| !row.is_empty()).map_or(0, |at| at + 1);
        let broken =
            (0..ROWS).filter(|row| screen.row_wrapped(*row)).map(|row| rows[usize::from(row)].clone()).collect();
        Shown { status, raw: String::from_utf8_lossy(&raw).into_owned(), rows: rows[..last].to_vec(), broken }
    }
}

impl Shown {
    /// The screen as one text.
    pub fn text(&self) -> String {
        self.rows.join("\n")
    }

    /// The same with what stands in several rows in one: words are where they were.
    pub fn flat(&self) -> String {
        self.text().split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// True if colours or other styles were asked for.
    pub fn is_styled(&self) -> bool {
        self.raw.contains("\u{1b}[1m") || self.raw.contains("\u{1b}[0m")
    }

    /// Fails unless every row fits the terminal. A word that is longer than the terminal is wide need not.
    #[track_caller]
    pub fn assert_unbroken(&self, columns: u16) -> &Self {
        for row in &self.broken {
            let is_one_word = !row.trim().contains(' ') && row.len() >= usize::from(columns) / 2;
            assert!(is_one_word, "{columns} columns break {row:?} in\n{}", self.text());
        }
        assert!(!self.raw.contains("\\u001b"), "escapes are shown in\n{}", self.text());
        self
    }
}
