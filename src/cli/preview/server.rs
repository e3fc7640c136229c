//! Answers a browser on this machine: GET requests of HTTP/1.1, one a connection, below an address that nobody guesses.
//!
//! Other programs and users of the machine can reach the port, and so can pages of the web through a browser. Whoever
//! does not know the token, or calls the server by another name than its own, learns nothing: the answer is always the
//! same. A connection has a limited time and size, and a thread of its own.

use std::borrow::Cow;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use rand::TryRng;
use rand::rngs::SysRng;

/// Most bytes of a request.
const MAX_REQUEST: usize = 16 << 10;
/// Most headers of a request.
const MAX_HEADERS: usize = 100;
/// Most connections at a time. Whoever comes beyond them is sent away.
const MAX_CONNECTIONS: usize = 200;
/// Most time for a request to arrive, and for each part of an answer to leave.
const MAX_TIME: Duration = Duration::from_secs(5);

/// What a browser may do with an answer: all that a page loads comes from here, no text of it becomes a program, and
/// nothing is kept.
const HEADERS: &str = "\
Content-Security-Policy: default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; \
require-trusted-types-for 'script'; trusted-types 'none'\r\n\
Cross-Origin-Resource-Policy: same-origin\r\n\
Referrer-Policy: no-referrer\r\n\
X-Content-Type-Options: nosniff\r\n\
Cache-Control: no-store\r\n\
Connection: close\r\n";

/// An answer to a request that is allowed.
pub struct Answer {
    /// Media type of the body.
    pub content_type: &'static str,
    /// The body.
    pub body: Cow<'static, [u8]>,
}

/// A server on the loopback that is not started yet.
pub struct Server {
    listener: TcpListener,
    port: u16,
    token: String,
}

impl Server {
    /// Takes a port of 127.0.0.1, or any free one, and draws a token of 128 bits.
    pub fn bind(port: Option<u16>) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)))?;
        let mut token = [0; 16];
        SysRng.try_fill_bytes(&mut token).map_err(io::Error::other)?;
        let token = token.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { port: listener.local_addr()?.port(), listener, token })
    }

    /// Returns the address of the page.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// Answers requests on a thread of its own until the process ends. `answer` gets what stands behind the token: path
    /// and query.
    pub fn start(self, answer: impl Fn(&str, &str) -> Option<Answer> + Send + Sync + 'static) -> io::Result<()> {
        let shared = Arc::new((self.port, self.token, answer));
        thread::Builder::new().name(String::from("server")).spawn(move || {
            for stream in self.listener.incoming() {
                let Ok(stream) = stream else {
                    // For want of open files, mostly.
                    thread::sleep(Duration::from_millis(50));
                    continue;
                };
                let shared = Arc::clone(&shared);
                if Arc::strong_count(&shared) <= MAX_CONNECTIONS {
                    // Without a thread the connection is closed.
                    let _ = thread::Builder::new().spawn(move || {
                        let (port, token, answer) = &*shared;
                        // Whoever leaves early gets no answer.
                        let _ = serve_connection(stream, |request| respond(request, *port, token, answer));
                    });
                }
            }
        })?;
        Ok(())
    }
}

/// Reads a request and writes the answer of `respond`.
fn serve_connection(mut stream: TcpStream, respond: impl FnOnce(&[u8]) -> Vec<u8>) -> io::Result<()> {
    stream.set_write_timeout(Some(MAX_TIME))?;
    let request = read_until(&mut stream, MAX_REQUEST, is_complete)?;
    stream.write_all(&respond(&request))?;
    // A connection that is closed with something unread can lose its answer.
    stream.shutdown(Shutdown::Write)?;
    read_until(&mut stream, 1 << 20, |_| false).map(|_| ())
}

/// Reads until `is_enough`, the other side's end, or `most` bytes.
fn read_until(stream: &mut TcpStream, most: usize, is_enough: impl Fn(&[u8]) -> bool) -> io::Result<Vec<u8>> {
    let end = Instant::now() + MAX_TIME;
    let mut read = Vec::new();
    let mut part = [0; 4096];
    while read.len() < most && !is_enough(&read) {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut part)? {
            0 => break,
            count => read.extend_from_slice(&part[..count]),
        }
    }
    Ok(read)
}

/// Returns true if all headers are there, or if what is there cannot begin a request.
fn is_complete(read: &[u8]) -> bool {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    !matches!(httparse::Request::new(&mut headers).parse(read), Ok(httparse::Status::Partial))
}

/// Answers a request.
fn respond(read: &[u8], port: u16, token: &str, answer: impl Fn(&str, &str) -> Option<Answer>) -> Vec<u8> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    if !matches!(request.parse(read), Ok(httparse::Status::Complete(_))) {
        return write_answer("400 Bad Request", None);
    }
    let (method, path) = (request.method.unwrap_or_default(), request.path.unwrap_or_default());
    let mut hosts = request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case("host"));
    // A page of the web whose name was made to lead here calls the server by that name.
    let names = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let is_host = |header: &httparse::Header| names.iter().any(|name| name.as_bytes() == header.value);
    let is_called_right = hosts.next().is_some_and(is_host) && hosts.next().is_none();
    let Some(rest) = strip_token(path, token).filter(|_| is_called_right) else {
        return write_answer("403 Forbidden", None);
    };
    if method != "GET" {
        return write_answer("405 Method Not Allowed\r\nAllow: GET", None);
    }
    let (path, query) = rest.split_once('?').unwrap_or((rest, ""));
    match answer(path, query) {
        Some(answer) => write_answer("200 OK", Some(answer)),
        None => write_answer("404 Not Found", None),
    }
}

/// Returns what stands behind the token in a path. How long that takes says nothing of the token.
fn strip_token<'a>(path: &'a str, token: &str) -> Option<&'a str> {
    let (given, rest) = path.strip_prefix('/')?.split_once('/')?;
    let differs = given.bytes().zip(token.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b));
    (given.len() == token.len() && differs == 0).then_some(rest)
}

/// Writes an answer; without a body it is the status in words.
fn write_answer(status: &str, answer: Option<Answer>) -> Vec<u8> {
    let words = || status.lines().next().unwrap_or_default().as_bytes().to_vec();
    let answer =
        answer.unwrap_or_else(|| Answer { content_type: "text/plain; charset=utf-8", body: Cow::Owned(words()) });
    let (kind, length) = (answer.content_type, answer.body.len());
    let head = format!("HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{HEADERS}\r\n");
    [head.as_bytes(), &answer.body].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status_of(request: &str) -> String {
        let answer = |path: &str, query: &str| {
            let body = format!("{path} {query}").into_bytes();
            (path != "none").then_some(Answer { content_type: "text/plain", body: Cow::Owned(body) })
        };
        let written = respond(request.as_bytes(), 80, "secret", answer);
        let text = String::from_utf8(written).expect("text");
        text.lines().next().expect("a line").to_owned()
    }

    #[test]
    fn only_who_knows_token_and_name_is_answered() {
        let get = |path: &str, host: &str| status_of(&format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
        for host in ["127.0.0.1:80", "localhost:80"] {
            assert_eq!(get("/secret/", host), "HTTP/1.1 200 OK");
            assert_eq!(get("/secret/a?b=c", host), "HTTP/1.1 200 OK");
            assert_eq!(get("/secret/none", host), "HTTP/1.1 404 Not Found");
        }
        let paths = ["/", "/secret", "//secret/", "/secreT/", "/secre/", "/secrets/", "/Secret/x", "*", "secret/", ""];
        for path in paths.into_iter().filter(|path| !path.is_empty()) {
            assert_eq!(get(path, "127.0.0.1:80"), "HTTP/1.1 403 Forbidden", "{path}");
        }
        assert_eq!(get("http://127.0.0.1:80/secret/", "127.0.0.1:80"), "HTTP/1.1 403 Forbidden");
        for host in ["127.0.0.1", "127.0.0.1:81", "evil.example:80", "127.0.0.1:80.evil.example", "", "[::1]:80"] {
            assert_eq!(get("/secret/", host), "HTTP/1.1 403 Forbidden", "{host}");
        }
        let without = "GET /secret/ HTTP/1.1\r\n\r\n";
        let twice = "GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:80\r\nHost: evil.example\r\n\r\n";
        for request in [without, twice] {
            assert_eq!(status_of(request), "HTTP/1.1 403 Forbidden");
        }
    }

    #[test]
    fn other_methods_are_refused_and_other_bytes_are_no_request() {
        for method in ["POST", "HEAD", "OPTIONS", "PUT", "DELETE", "TRACE", "get"] {
            let line = format!("{method} /secret/ HTTP/1.1\r\nHost: localhost:80\r\n\r\n");
            assert_eq!(status_of(&line), "HTTP/1.1 405 Method Not Allowed");
        }
        let many = format!("GET /secret/ HTTP/1.1\r\nHost: localhost:80\r\n{}\r\n", "a: b\r\n".repeat(200));
        for bytes in ["", "\0", "GET", "GET /secret/ HTTP/9.9\r\n\r\n", "GET  /\r\n\r\n", "\r\n\r\n", &many] {
            assert_eq!(status_of(bytes), "HTTP/1.1 400 Bad Request", "{bytes:?}");
        }
        assert!(!is_complete(b"GET /secret/ HTTP/1.1\r\nHost: loc"));
        assert!(is_complete(b"GET /secret/ HTTP/1.1\r\n\r\n") && is_complete(b"\x16\x03\x01 TLS"));
    }
}
