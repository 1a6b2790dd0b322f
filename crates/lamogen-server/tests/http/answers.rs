//! What comes back for valid and invalid requests.

use std::net::{IpAddr, SocketAddr};

use lamogen_server::ServerConfig;

use crate::client::{JSON, ask, connect, generate, get, receive, send};
use crate::service::{Event, RunningServer, wait_until};

#[test]
fn a_motion_comes_in_the_type_that_accept_names() {
    let server = RunningServer::start(ServerConfig::default());
    let answer = generate(server.address, "\"jump\"");
    assert_eq!(answer.status, 200);
    assert_eq!(answer.headers["content-type"], "application/json");
    assert_eq!(answer.json()["type"], "application/json");
    let headers = [JSON, ("Accept", "model/*")];
    let answer = ask(
        server.address,
        "POST /api/v1/generate",
        &headers,
        b"\"jump\"",
    );
    assert_eq!(answer.headers["content-type"], "model/gltf-binary");
    assert_eq!(answer.json()["type"], "model/gltf-binary");
}

#[test]
fn progress_comes_as_events_and_then_the_result() {
    let server = RunningServer::start(ServerConfig::default());
    let mut stream = connect(server.address);
    let headers = [JSON, ("Accept", "text/event-stream")];
    send(&mut stream, "POST /api/v1/generate", &headers, b"\"hold\"");
    assert_eq!(server.event(), Event::Begun("hold".into()));
    std::thread::sleep(std::time::Duration::from_millis(50));
    server.release.send(()).unwrap();
    let answer = receive(&stream);
    assert_eq!(answer.headers["content-type"], "text/event-stream");
    let text = answer.text();
    let events: Vec<&str> = text
        .split("\n\n")
        .filter(|event| !event.is_empty())
        .collect();
    let (last, progress) = events.split_last().unwrap();
    assert!(!progress.is_empty());
    for event in progress {
        let data = event.strip_prefix("event: progress\ndata: ").expect(event);
        let data: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(
            (&data["total"], &data["stage"]),
            (&1000.into(), &"held".into())
        );
    }
    let result = last.strip_prefix("event: result\ndata: ").expect(last);
    assert_eq!(
        serde_json::from_str::<serde_json::Value>(result).unwrap()["request"],
        "hold"
    );

    let answer = ask(
        server.address,
        "POST /api/v1/generate",
        &headers,
        b"\"fail\"",
    );
    assert!(
        answer.text().contains("event: problem\ndata: {"),
        "{}",
        answer.text()
    );
}

#[test]
fn what_is_not_understood_is_said_with_what_was_expected_found_and_where() {
    let server = RunningServer::start(ServerConfig::default());
    let address = server.address;
    let problem = generate(address, "{}").problem(400, "invalid-request");
    assert_eq!(
        (&problem["expected"], &problem["found"]),
        (&"a text".into(), &"{}".into())
    );
    let problem = get(address, "/api/v2/generate").problem(404, "not-found");
    assert_eq!(problem["found"], "/api/v2/generate");
    let answer = get(address, "/api/v1/generate");
    answer.problem(405, "method-not-allowed");
    assert_eq!(answer.headers["allow"], "POST");
    let headers = [JSON, ("Accept", "application/xml")];
    let problem =
        ask(address, "POST /api/v1/generate", &headers, b"\"a\"").problem(406, "not-acceptable");
    assert!(
        problem["expected"]
            .as_str()
            .unwrap()
            .contains("model/gltf-binary")
    );
    assert_eq!(problem["where"], "Accept");
    for content_type in [
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data",
    ] {
        let headers = [("Content-Type", content_type)];
        let problem = ask(address, "POST /api/v1/generate", &headers, b"\"a\"");
        assert_eq!(
            problem.problem(415, "unsupported-media-type")["found"],
            content_type
        );
    }
    ask(address, "POST /api/v1/generate", &[], b"\"a\"").problem(415, "unsupported-media-type");
    let problem =
        ask(address, "POST /api/v1/generate", &[JSON], b"\"\xff\"").problem(400, "invalid-request");
    assert_eq!(problem["where"], "body");
    // The parser of HTTP answers requests that are none.
    assert_eq!(ask(address, "GARBAGE", &[], b"").status, 400);
    // Nothing outside the paths there are can be named.
    for path in [
        "/../../etc/passwd",
        "/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/studio.js/../../x",
    ] {
        get(address, path).problem(404, "not-found");
    }
}

#[test]
fn a_work_that_fails_or_panics_is_a_problem_and_the_next_one_runs() {
    let server = RunningServer::start(ServerConfig::default());
    generate(server.address, "\"fail\"").problem(422, "generation-failed");
    generate(server.address, "\"panic\"").problem(500, "internal");
    assert_eq!(generate(server.address, "\"jump\"").status, 200);
}

#[test]
fn pages_of_other_sites_are_refused() {
    let listed = ServerConfig {
        allowed_origins: vec!["https://example.org".into()],
        ..ServerConfig::default()
    };
    let server = RunningServer::start(listed);
    let from = |origin: &str| {
        let headers = [JSON, ("Origin", origin)];
        ask(server.address, "POST /api/v1/generate", &headers, b"\"a\"")
    };
    assert_eq!(from("http://localhost").status, 200);
    let answer = from("https://example.org");
    assert_eq!(
        answer.headers["access-control-allow-origin"],
        "https://example.org"
    );
    for origin in ["https://evil.example", "null", "http://localhost:3000"] {
        let answer = from(origin);
        assert_eq!(answer.problem(403, "forbidden")["where"], "Origin");
        assert!(!answer.headers.contains_key("access-control-allow-origin"));
    }
    let rebound = [("Host", "evil.example:8765")];
    let answer = ask(server.address, "GET /api/v1/model", &rebound, b"");
    assert_eq!(answer.problem(403, "forbidden")["where"], "Host");
    // A browser asks for leave before a request of another page.
    let asks = [
        ("Origin", "https://example.org"),
        ("Access-Control-Request-Method", "POST"),
        (
            "Access-Control-Request-Headers",
            "content-type,authorization",
        ),
    ];
    let answer = ask(server.address, "OPTIONS /api/v1/generate", &asks, b"");
    assert_eq!(answer.status, 200);
    assert!(answer.headers["access-control-allow-headers"].contains("authorization"));
    // Without a list nobody else gets leave.
    let closed = RunningServer::start(ServerConfig::default());
    let answer = ask(closed.address, "OPTIONS /api/v1/generate", &asks, b"");
    assert_eq!(answer.status, 403);
}

#[test]
fn with_a_token_only_pages_and_health_are_open() {
    let config = ServerConfig {
        token: Some("0123456789abcdef".into()),
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let address = server.address;
    assert_eq!(get(address, "/health").status, 200);
    assert_eq!(get(address, "/").status, 200);
    for path in ["/api/v1/model", "/api/v1/openapi.json", "/metrics"] {
        let answer = get(address, path);
        answer.problem(401, "unauthorized");
        assert_eq!(answer.headers["www-authenticate"], "Bearer");
    }
    generate(address, "\"a\"").problem(401, "unauthorized");
    let with = |token: &str| {
        let value = format!("Bearer {token}");
        let headers = [JSON, ("Authorization", value.as_str())];
        ask(address, "POST /api/v1/generate", &headers, b"\"a\"")
    };
    with("0123456789abcdeX").problem(401, "unauthorized");
    assert_eq!(with("0123456789abcdef").status, 200);
}

#[test]
fn other_addresses_take_any_host_since_they_have_a_token() {
    let config = ServerConfig {
        address: SocketAddr::new(IpAddr::from([0, 0, 0, 0]), 0),
        token: Some("0123456789abcdef".into()),
        ..ServerConfig::default()
    };
    let server = RunningServer::start(config);
    let address = SocketAddr::from(([127, 0, 0, 1], server.address.port()));
    let headers = [
        ("Host", "motion.example"),
        ("Authorization", "Bearer 0123456789abcdef"),
    ];
    assert_eq!(ask(address, "GET /api/v1/model", &headers, b"").status, 200);
}

#[test]
fn answers_have_the_headers_that_browsers_obey() {
    let server = RunningServer::start(ServerConfig::default());
    for path in ["/", "/health", "/nowhere"] {
        let answer = get(server.address, path);
        let policy = &answer.headers["content-security-policy"];
        assert!(
            policy.contains("script-src 'self';") && !policy.contains("unsafe"),
            "{policy}"
        );
        assert_eq!(answer.headers["x-content-type-options"], "nosniff");
        assert_eq!(answer.headers["referrer-policy"], "no-referrer");
        assert_eq!(answer.headers["x-frame-options"], "DENY");
    }
}

#[test]
fn the_document_of_the_interface_names_its_paths() {
    let server = RunningServer::start(ServerConfig::default());
    let document = get(server.address, "/api/v1/openapi.json").json();
    assert_eq!(document["info"]["version"], env!("CARGO_PKG_VERSION"));
    let paths = document["paths"].as_object().unwrap();
    assert_eq!(paths.len(), 7);
    for (path, methods) in paths {
        let method = methods
            .as_object()
            .unwrap()
            .keys()
            .next()
            .unwrap()
            .to_uppercase();
        let answer = ask(
            server.address,
            &format!("{method} {path}"),
            &[JSON],
            b"\"a\"",
        );
        assert_eq!(answer.status, 200, "{method} {path}: {}", answer.text());
        let documented = &methods[&method.to_lowercase()]["responses"]["200"]["content"];
        let found = answer.headers["content-type"].split(';').next().unwrap();
        assert!(
            documented.get(found).is_some(),
            "{path}: {found} is not in the document"
        );
    }
}

#[test]
fn counters_follow_what_happens() {
    let server = RunningServer::start(ServerConfig::default());
    generate(server.address, "\"jump\"");
    generate(server.address, "\"fail\"");
    get(server.address, "/a/path/of/a/client");
    let count = |line: &str| {
        let text = get(server.address, "/metrics").text();
        text.lines().any(|found| found == line)
    };
    for line in [
        "lamogen_answers_total{path=\"/api/v1/generate\",status=\"200\"} 1",
        "lamogen_answers_total{path=\"/api/v1/generate\",status=\"422\"} 1",
        "lamogen_answers_total{path=\"other\",status=\"404\"} 1",
        "lamogen_jobs_total{outcome=\"done\"} 1",
        "lamogen_jobs_total{outcome=\"failed\"} 1",
        "lamogen_jobs_waiting 0",
        "lamogen_jobs_running 0",
    ] {
        wait_until(line, || count(line));
    }
}

#[test]
fn a_file_comes_with_its_options() {
    let server = RunningServer::start(ServerConfig::default());
    let answer = ask(
        server.address,
        "POST /api/v1/laban?name=a%20b.bvh&up=z",
        &[],
        b"HIERARCHY",
    );
    let json = answer.json();
    assert_eq!(json["options"]["name"], "a b.bvh");
    assert_eq!(
        (&json["options"]["up"], &json["bytes"]),
        (&"z".into(), &9.into())
    );
    let answer = ask(
        server.address,
        "POST /api/v1/character?name=hero.glb",
        &[],
        b"glTF",
    );
    let json = answer.json();
    assert_eq!(
        (&json["onto"], &json["options"]["name"]),
        (&"4".into(), &"hero.glb".into())
    );
}
