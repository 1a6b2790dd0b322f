//! What there may be too much of: requests, bytes, time.

use std::io::{Read, Write};
use std::time::Duration;

use lamogen_server::ServerConfig;

use crate::client::{JSON, ask, connect, generate, get, receive, send};
use crate::service::{Event, LARGE, RunningServer, wait_until};

/// Sends a request for a motion and does not wait for the answer.
fn begin(server: &RunningServer, request: &str) -> std::net::TcpStream {
    let mut stream = connect(server.address);
    let body = format!("\"{request}\"");
    send(
        &mut stream,
        "POST /api/v1/generate",
        &[JSON],
        body.as_bytes(),
    );
    stream
}

fn waiting(server: &RunningServer) -> u64 {
    get(server.address, "/health").json()["waiting"]
        .as_u64()
        .unwrap()
}

#[test]
fn a_full_queue_is_429_with_a_time_and_what_waits_is_done_in_turn() {
    let config = ServerConfig {
        queue: 2,
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let first = begin(&server, "hold 1");
    assert_eq!(server.event(), Event::Begun("hold 1".into()));
    let second = begin(&server, "2");
    wait_until("the second waits", || waiting(&server) == 1);
    let third = begin(&server, "3");
    wait_until("the third waits", || waiting(&server) == 2);
    let answer = generate(server.address, "\"4\"");
    answer.problem(429, "busy");
    assert!(answer.headers["retry-after"].parse::<u32>().unwrap() >= 1);
    server.release.send(()).unwrap();
    for (stream, request) in [(first, "hold 1"), (second, "2"), (third, "3")] {
        assert_eq!(receive(&stream).json()["request"], request);
    }
    assert_eq!(server.event(), Event::Begun("2".into()));
    assert_eq!(server.event(), Event::Begun("3".into()));
}

#[test]
fn a_client_that_goes_away_stops_its_work_and_leaves_the_queue() {
    let server = RunningServer::start(ServerConfig::default());
    let running = begin(&server, "hold running");
    assert_eq!(server.event(), Event::Begun("hold running".into()));
    let waiting_one = begin(&server, "hold waiting");
    wait_until("it waits", || waiting(&server) == 1);
    drop(waiting_one);
    wait_until("it has left the queue", || waiting(&server) == 0);
    drop(running);
    assert_eq!(server.event(), Event::Stopped("hold running".into()));
    // The server goes on.
    assert_eq!(generate(server.address, "\"next\"").status, 200);
    assert_eq!(server.event(), Event::Begun("next".into()));
}

#[test]
fn a_client_of_events_that_goes_away_stops_its_work() {
    let server = RunningServer::start(ServerConfig::default());
    let mut stream = connect(server.address);
    let headers = [JSON, ("Accept", "text/event-stream")];
    send(&mut stream, "POST /api/v1/generate", &headers, b"\"hold\"");
    assert_eq!(server.event(), Event::Begun("hold".into()));
    stream.read_exact(&mut [0; 16]).unwrap();
    drop(stream);
    assert_eq!(server.event(), Event::Stopped("hold".into()));
}

#[test]
fn a_work_that_takes_too_long_is_stopped() {
    let config = ServerConfig {
        work_time: Duration::from_millis(50),
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let problem = generate(server.address, "\"hold\"").problem(503, "time-limit");
    assert_eq!(problem["expected"], "a work of at most 0.05 s");
    assert_eq!(server.event(), Event::Begun("hold".into()));
    assert_eq!(server.event(), Event::Stopped("hold".into()));
}

#[test]
fn large_bodies_are_refused_before_and_while_they_come() {
    let config = ServerConfig {
        max_request: 100,
        max_upload: 100_000,
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let long = format!("\"{}\"", "a".repeat(200));
    let problem = generate(server.address, &long).problem(413, "too-large");
    assert_eq!(
        (&problem["expected"], &problem["found"]),
        (&"at most 100 bytes".into(), &"202 bytes".into())
    );
    // A body without a stated length.
    let chunked = [JSON, ("Transfer-Encoding", "chunked")];
    let mut stream = connect(server.address);
    send(&mut stream, "POST /api/v1/generate", &chunked, b"");
    stream
        .write_all(format!("c8\r\n{}\r\n0\r\n\r\n", "a".repeat(200)).as_bytes())
        .unwrap();
    receive(&stream).problem(413, "too-large");
    // A stated length that is never sent.
    let stated = [("Content-Length", "999999999999")];
    ask(server.address, "POST /api/v1/laban", &stated, b"a").problem(413, "too-large");
    ask(server.address, "POST /api/v1/laban", &[], &vec![0; 100_001]).problem(413, "too-large");
    assert_eq!(
        ask(server.address, "POST /api/v1/laban", &[], &[0; 100_000]).status,
        200
    );
}

#[test]
fn files_take_no_more_memory_than_allowed() {
    let config = ServerConfig {
        max_upload: 1 << 20,
        max_upload_total: 1 << 20,
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    // Half a file occupies the room of a whole one.
    let mut half = connect(server.address);
    let stated = [("Content-Length", "1048576"), ("Expect", "100-continue")];
    send(&mut half, "POST /api/v1/laban", &stated, b"");
    // The server asks for the body once it has reserved its room.
    let mut go_on = [0; 25];
    half.read_exact(&mut go_on).unwrap();
    assert_eq!(&go_on, b"HTTP/1.1 100 Continue\r\n\r\n");
    let answer = ask(server.address, "POST /api/v1/laban", &[], b"HIERARCHY");
    answer.problem(429, "busy");
    assert_eq!(answer.headers["retry-after"], "1");
    drop(half);
    wait_until("the room is free again", || {
        ask(server.address, "POST /api/v1/laban", &[], b"HIERARCHY").status == 200
    });
}

#[test]
fn slow_heads_and_bodies_and_idle_connections_end() {
    let config = ServerConfig {
        head_time: Duration::from_millis(100),
        body_time: Duration::from_millis(100),
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let mut slow = connect(server.address);
    send(
        &mut slow,
        "POST /api/v1/generate",
        &[JSON, ("Content-Length", "10")],
        b"\"a",
    );
    receive(&slow).problem(408, "slow-request");
    let mut head = connect(server.address);
    head.write_all(b"GET /health HTTP/1.1\r\nHost: loc")
        .unwrap();
    let mut rest = Vec::new();
    head.read_to_end(&mut rest).unwrap();
    // So does one that is idle.
    connect(server.address).read_to_end(&mut rest).unwrap();
}

/// A client that reads nothing of a large answer loses its connection, and others are served meanwhile.
#[test]
fn clients_that_do_not_read_their_answer_are_left() {
    let config = ServerConfig {
        write_time: Duration::from_millis(200),
        max_connections: 1,
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let mut slow = begin(&server, "large");
    assert_eq!(server.event(), Event::Begun("large".into()));
    // Its place is the only one.
    assert_eq!(get(server.address, "/health").status, 200);
    let mut rest = Vec::new();
    // Either the connection ends early, or it is reset.
    let _ = slow.read_to_end(&mut rest);
    assert!(rest.len() < LARGE, "{} bytes came", rest.len());
    // A client that reads has it all. It has more time, since it may be kept from reading for a moment.
    let server = RunningServer::start(ServerConfig::default());
    let whole = generate(server.address, "\"large\"");
    assert_eq!((whole.status, whole.body.len()), (200, LARGE));
}

#[test]
fn works_that_wait_run_side_by_side_and_each_has_its_own_end() {
    let config = ServerConfig {
        workers: 2,
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let first = begin(&server, "hold 1");
    assert_eq!(server.event(), Event::Begun("hold 1".into()));
    let others = ["hold 2", "hold 3"].map(|request| begin(&server, request));
    wait_until("both wait for the first, which is alone", || {
        waiting(&server) == 2
    });
    server.release.send(()).unwrap();
    assert_eq!(receive(&first).status, 200);
    let mut begun = [server.event(), server.event()].map(|event| format!("{event:?}"));
    begun.sort();
    assert_eq!(begun, ["Begun(\"hold 2\")", "Begun(\"hold 3\")"]);
    // Each has its own end.
    let [second, third] = others;
    drop(second);
    assert_eq!(server.event(), Event::Stopped("hold 2".into()));
    server.release.send(()).unwrap();
    assert_eq!(receive(&third).json()["request"], "hold 3");
}

#[test]
fn the_end_finishes_what_runs_refuses_what_waits_and_closes_the_door() {
    let server = RunningServer::start(ServerConfig::default());
    let running = begin(&server, "hold running");
    assert_eq!(server.event(), Event::Begun("hold running".into()));
    let waiting_one = begin(&server, "waiting");
    wait_until("it waits", || waiting(&server) == 1);
    server.handle.stop();
    receive(&waiting_one).problem(503, "shutting-down");
    let address = server.address;
    wait_until("the door is closed", || {
        std::net::TcpStream::connect(address).is_err()
    });
    server.release.send(()).unwrap();
    let answer = receive(&running);
    assert_eq!(
        (answer.status, answer.json()["request"].as_str()),
        (200, Some("hold running"))
    );
    server.join();
}

#[test]
fn what_runs_longer_than_the_grace_is_stopped_with_a_whole_answer() {
    let config = ServerConfig {
        grace: Duration::from_millis(100),
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let running = begin(&server, "hold");
    assert_eq!(server.event(), Event::Begun("hold".into()));
    server.handle.stop();
    receive(&running).problem(503, "shutting-down");
    assert_eq!(server.event(), Event::Stopped("hold".into()));
    server.join();
}
