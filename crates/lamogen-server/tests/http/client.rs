//! A client that sends exactly what it is told to.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An answer of the server.
pub struct Answer {
    pub status: u16,
    /// The headers, with names in lower case.
    pub headers: HashMap<String, String>,
    pub body: Vec<u8>,
}

impl Answer {
    /// Returns the body as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("{}", self.text()))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// Checks that the answer is a problem of a kind, and returns it.
    pub fn problem(&self, status: u16, kind: &str) -> serde_json::Value {
        assert_eq!(self.status, status, "{}", self.text());
        assert_eq!(self.headers["content-type"], "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["type"], format!("urn:lamogen:problem:{kind}"));
        assert_eq!(problem["status"], status);
        assert!(!problem["detail"].as_str().unwrap().is_empty());
        problem
    }
}

/// A connection whose reads end after ten seconds, so that no test hangs.
pub fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    let longest = Some(Duration::from_secs(10));
    stream.set_read_timeout(longest).unwrap();
    stream.set_write_timeout(longest).unwrap();
    stream
}

/// Sends the head of a request and a body, with `Host` and, where there is a body, its length.
pub fn send(stream: &mut TcpStream, start: &str, headers: &[(&str, &str)], body: &[u8]) {
    let has = |name: &str| {
        headers
            .iter()
            .any(|(other, _)| other.eq_ignore_ascii_case(name))
    };
    let mut head = format!("{start} HTTP/1.1\r\n");
    if !has("Host") {
        head += "Host: localhost\r\n";
    }
    if !body.is_empty() && !has("Content-Length") {
        head += &format!("Content-Length: {}\r\n", body.len());
    }
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    head += "\r\n";
    // The server may answer and close before it has read all.
    let _ = stream
        .write_all(head.as_bytes())
        .and_then(|()| stream.write_all(body));
}

/// Reads an answer, whole.
pub fn receive(stream: &TcpStream) -> Answer {
    let mut reader = BufReader::new(stream);
    let mut line = || {
        let mut line = String::new();
        reader
            .read_line(&mut line)
            .expect("the server answers in time");
        line.trim_end().to_owned()
    };
    let status_line = line();
    let status = status_line
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    let status = status.unwrap_or_else(|| panic!("no answer: {status_line:?}"));
    let mut headers = HashMap::new();
    loop {
        let header = line();
        match header.split_once(':') {
            Some((name, value)) => headers.insert(name.to_lowercase(), value.trim().to_owned()),
            None => break,
        };
    }
    let mut body = Vec::new();
    match headers.get("content-length") {
        Some(length) => {
            body.resize(length.parse().unwrap(), 0);
            reader.read_exact(&mut body).unwrap();
        }
        None if headers
            .get("transfer-encoding")
            .is_some_and(|coding| coding == "chunked") =>
        {
            loop {
                let mut size = String::new();
                reader.read_line(&mut size).unwrap();
                let size = usize::from_str_radix(size.trim(), 16).unwrap();
                let mut chunk = vec![0; size + 2];
                reader.read_exact(&mut chunk).unwrap();
                body.extend(&chunk[..size]);
                if size == 0 {
                    break;
                }
            }
        }
        None => {}
    }
    Answer {
        status,
        headers,
        body,
    }
}

/// Sends a request on a connection of its own and returns the answer.
pub fn ask(address: SocketAddr, start: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
    let mut stream = connect(address);
    send(&mut stream, start, headers, body);
    receive(&stream)
}

pub fn get(address: SocketAddr, path: &str) -> Answer {
    ask(address, &format!("GET {path}"), &[], b"")
}

/// The header of requests for motions.
pub const JSON: (&str, &str) = ("Content-Type", "application/json");

/// Asks for a motion.
pub fn generate(address: SocketAddr, body: &str) -> Answer {
    ask(address, "POST /api/v1/generate", &[JSON], body.as_bytes())
}
