//! What comes back for requests that mean ill. The table in `docs/server.md` lists them.

use std::io::{Read, Write};
use std::time::Duration;

use lamogen_server::ServerConfig;

use crate::client::{JSON, ask, connect, get, receive, send};
use crate::service::{Event, RunningServer};

/// Sends bytes as they are. Returns the status of the answer, if one comes before the connection is closed.
fn send_raw(server: &RunningServer, bytes: &[u8]) -> Option<u16> {
    let mut stream = connect(server.address);
    // The server may close before it has read all.
    let _ = stream.write_all(bytes);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let text = String::from_utf8_lossy(&answer);
    text.split(' ').nth(1)?.parse().ok()
}

#[test]
fn heads_that_are_no_heads_or_too_large_are_refused() {
    let server = RunningServer::start(ServerConfig {
        head_time: Duration::from_millis(200),
        ..ServerConfig::default()
    });
    let head = |headers: &str| format!("GET /health HTTP/1.1\r\n{headers}\r\n").into_bytes();
    let many = "X: y\r\n".repeat(100);
    let large = format!("X: {}\r\n", "y".repeat(1_000_000));
    let long_path = format!(
        "GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "a".repeat(100_000)
    );
    for (attack, bytes, statuses) in [
        (
            "no HTTP",
            b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n".to_vec(),
            &[400][..],
        ),
        ("no host", head(""), &[400]),
        (
            "many headers",
            head(&format!("Host: localhost\r\n{many}")),
            &[431],
        ),
        (
            "a large header",
            head(&format!("Host: localhost\r\n{large}")),
            &[431],
        ),
        ("a long path", long_path.into_bytes(), &[404, 414]),
        (
            "a header with a line break",
            head("Host: localhost\r\n evil: 1\r\n"),
            &[400],
        ),
        ("a null byte", head("Host: local\0host\r\n"), &[400]),
        (
            "two lengths",
            head("Host: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n"),
            &[400],
        ),
        (
            "a negative length",
            head("Host: localhost\r\nContent-Length: -1\r\n"),
            &[400],
        ),
    ] {
        let found = send_raw(&server, &bytes);
        assert!(
            found.is_some_and(|status| statuses.contains(&status)),
            "{attack}: expected {statuses:?}, found {found:?}"
        );
    }
    assert_eq!(get(server.address, "/health").status, 200);
}

/// What one program takes for the body of a request another one must not take for a request of its own.
#[test]
fn a_body_is_never_taken_for_the_next_request() {
    let server = RunningServer::start(ServerConfig::default());
    let hidden = "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let body = format!("0\r\n\r\n{hidden}");
    let mut stream = connect(server.address);
    let both = [JSON, ("Transfer-Encoding", "chunked")];
    let length = body.len().to_string();
    let headers = [&both[..], &[("Content-Length", &length)]].concat();
    send(
        &mut stream,
        "POST /api/v1/generate",
        &headers,
        body.as_bytes(),
    );
    let first = receive(&stream);
    assert_eq!(first.status, 400, "{}", first.text());
    let mut rest = Vec::new();
    stream
        .set_read_timeout(Some(Duration::from_secs(2)))
        .unwrap();
    let _ = stream.read_to_end(&mut rest);
    let rest = String::from_utf8_lossy(&rest);
    assert!(!rest.contains("lamogen_jobs"), "{rest}");
}

#[test]
fn a_head_that_comes_letter_by_letter_is_left() {
    let server = RunningServer::start(ServerConfig {
        head_time: Duration::from_millis(200),
        ..ServerConfig::default()
    });
    let mut stream = connect(server.address);
    let head = b"GET /health HTTP/1.1\r\nHost: localhost\r\nX: aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\r\n\r\n";
    for letter in head {
        if stream.write_all(&[*letter]).is_err() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let text = String::from_utf8_lossy(&answer);
    assert!(!text.contains("200 OK"), "{text}");
}

#[test]
fn idle_connections_by_the_hundred_make_room_for_others() {
    // None of them would end by itself while this waits.
    let server = RunningServer::start(ServerConfig {
        head_time: Duration::from_secs(600),
        max_connections: 64,
        ..ServerConfig::default()
    });
    let mut busy = connect(server.address);
    send(&mut busy, "POST /api/v1/generate", &[JSON], b"\"hold\"");
    assert_eq!(server.event(), Event::Begun("hold".into()));
    let idle: Vec<_> = (0..400).map(|_| connect(server.address)).collect();
    assert_eq!(get(server.address, "/health").status, 200);
    // A connection whose request is being answered stays, as old as it is.
    server.release.send(()).unwrap();
    assert_eq!(receive(&busy).status, 200);
    drop(idle);
}

#[test]
fn a_request_that_is_long_in_reading_keeps_nobody_waiting() {
    let server = RunningServer::start(ServerConfig::default());
    let mut slow = connect(server.address);
    send(&mut slow, "POST /api/v1/generate", &[JSON], b"\"ponder\"");
    let again = ask(
        server.address,
        "POST /api/v1/generate",
        &[JSON],
        b"\"jump\"",
    );
    assert_eq!(again.status, 200);
    server.release.send(()).unwrap();
    assert_eq!(receive(&slow).json()["request"], "ponder");
}
