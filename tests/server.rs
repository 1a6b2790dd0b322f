//! `lamogen serve` as programs and people use it.

mod running;

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use running::{fails, lamogen, succeeds};
use serde_json::{Value, json};

/// A server that runs while a test does.
struct RunningServer {
    child: Child,
    /// `127.0.0.1` and the port.
    address: String,
}

impl RunningServer {
    fn start(arguments: &[&str]) -> RunningServer {
        let all = [&["serve", "--port", "0", "--json"], arguments].concat();
        let mut child = lamogen(Path::new("."), &all)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let stdout = child.stdout.as_mut().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        let started: Value = serde_json::from_str(&line).expect(&line);
        let address = started["address"].as_str().unwrap();
        let address = address.trim_start_matches("http://").trim_end_matches('/');
        RunningServer {
            address: address.to_owned(),
            child,
        }
    }

    /// Sends a request and returns the answer.
    fn ask(&self, start: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(120)))
            .unwrap();
        let mut head = format!(
            "{start} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Length: {}\r\n",
            self.address,
            body.len()
        );
        for (name, value) in headers {
            head += &format!("{name}: {value}\r\n");
        }
        stream.write_all(format!("{head}\r\n").as_bytes()).unwrap();
        // The server may answer before it has read a body that is too large.
        let _ = stream.write_all(body);
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        Answer::parse(&bytes)
    }

    fn generate(&self, accept: &str, request: &Value) -> Answer {
        let headers = [("Content-Type", "application/json"), ("Accept", accept)];
        self.ask(
            "POST /api/v1/generate",
            &headers,
            request.to_string().as_bytes(),
        )
    }

    /// Asks with a request that is wrong, and checks what the problem says.
    fn refuses(&self, request: &str, status: u16, place: &str, part: &str) {
        let headers = [("Content-Type", "application/json")];
        let answer = self.ask("POST /api/v1/generate", &headers, request.as_bytes());
        let problem = answer.json();
        assert_eq!(answer.status, status, "{request}: {problem}");
        assert_eq!(problem["where"], place, "{request}: {problem}");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(part), "{request}: {detail}");
    }

    fn laban(&self, query: &str, bytes: &[u8]) -> Answer {
        self.ask(&format!("POST /api/v1/laban?{query}"), &[], bytes)
    }
}

impl Drop for RunningServer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An answer of the server.
struct Answer {
    status: u16,
    headers: HashMap<String, String>,
    body: Vec<u8>,
}

impl Answer {
    fn parse(bytes: &[u8]) -> Answer {
        let end = bytes
            .windows(4)
            .position(|four| four == b"\r\n\r\n")
            .unwrap();
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let mut lines = head.lines();
        let status = lines.next().unwrap().split(' ').nth(1).unwrap();
        let headers = lines.filter_map(|line| line.split_once(": "));
        Answer {
            status: status.parse().unwrap(),
            headers: headers
                .map(|(name, value)| (name.to_lowercase(), value.to_owned()))
                .collect(),
            body: bytes[end + 4..].to_vec(),
        }
    }

    fn json(&self) -> Value {
        let text = String::from_utf8_lossy(&self.body);
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
    }
}

const JUMP: [&str; 9] = [
    "generate",
    "a person jumps",
    "--steps",
    "3",
    "--seed",
    "7",
    "--seconds",
    "2",
    "--quiet",
];

fn jump() -> Value {
    json!({ "prompt": "a person jumps", "steps": 3, "seed": 7, "seconds": 2, "weight": "strong", "part": ["arms:sudden"] })
}

#[test]
fn answers_are_the_bytes_that_the_command_writes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let server = RunningServer::start(&[]);
    let types = [
        ("json", "application/json"),
        ("glb", "model/gltf-binary"),
        ("bvh", "text/plain"),
        ("vrma", "application/x-vrma"),
        ("npy", "application/x-npy"),
        ("csv", "text/csv"),
        ("gif", "image/gif"),
        ("png", "image/png"),
        ("svg", "image/svg+xml"),
        ("html", "text/html"),
    ];
    let names: Vec<String> = types
        .iter()
        .map(|(ending, _)| format!("a.{ending}"))
        .collect();
    let mut arguments = [&JUMP[..], &["--weight", "strong", "--part", "arms:sudden"]].concat();
    for name in &names {
        arguments.extend(["--out", name]);
    }
    succeeds(folder, &arguments);
    for ((_, media_type), name) in types.iter().zip(&names) {
        let answer = server.generate(media_type, &jump());
        assert_eq!(answer.status, 200, "{name}");
        assert_eq!(&answer.headers["content-type"], media_type);
        let written = std::fs::read(folder.join(name)).unwrap();
        assert!(
            answer.body == written,
            "{name}: {} and {} bytes",
            answer.body.len(),
            written.len()
        );
    }
}

/// While others wait, motions are made side by side on fewer threads, and each is the one of the command.
#[test]
fn answers_are_the_same_bytes_when_many_ask_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let server = RunningServer::start(&["--parallel", "3"]);
    let motions = ["strong", "light", "", "strong"].iter().enumerate();
    let motions: Vec<(u64, &str)> = motions
        .map(|(seed, word)| (seed as u64 % 3, *word))
        .collect();
    std::thread::scope(|scope| {
        let answers: Vec<_> = { motions.iter() }
            .map(|&(seed, word)| {
                let mut request =
                    json!({ "prompt": "a person jumps", "steps": 3, "seed": seed, "seconds": 2 });
                if !word.is_empty() {
                    request["weight"] = word.into();
                }
                let server = &server;
                scope.spawn(move || server.generate("text/plain", &request))
            })
            .collect();
        for ((seed, word), answer) in motions.iter().zip(answers) {
            let name = format!("{seed}{word}.bvh");
            let seed = seed.to_string();
            let mut arguments = vec!["generate", "a person jumps", "--steps", "3"];
            arguments.extend(["--seed", &seed, "--seconds", "2", "--quiet", "--out", &name]);
            if !word.is_empty() {
                arguments.extend(["--weight", word]);
            }
            succeeds(folder, &arguments);
            let answer = answer.join().unwrap();
            assert_eq!(answer.status, 200);
            assert!(
                answer.body == std::fs::read(folder.join(&name)).unwrap(),
                "{name}"
            );
        }
    });
}

#[test]
fn a_report_on_a_file_is_the_command_s_and_its_series_can_be_a_goal() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    succeeds(
        folder,
        &[&JUMP[..], &["--shape", "far", "--out", "far.bvh"]].concat(),
    );
    let (printed, _) = succeeds(folder, &["laban", "far.bvh", "--json"]);
    let printed: Value = serde_json::from_str(&printed).unwrap();
    let server = RunningServer::start(&[]);
    let bytes = std::fs::read(folder.join("far.bvh")).unwrap();
    let report = server.laban("name=..%2F..%2Ffar.bvh", &bytes).json();
    assert_eq!(report["motions"], printed["motions"]);
    assert_eq!(report["title"], "far.bvh");
    assert!(report["motions"][0].get("joints").is_none());
    // Without a name the first bytes say the format.
    let with_joints = server.laban("joints=true", &bytes).json();
    assert_eq!(
        with_joints["motions"][0]["joints"]
            .as_array()
            .unwrap()
            .len(),
        40
    );
    assert_eq!(
        with_joints["motions"][0]["series"],
        report["motions"][0]["series"]
    );

    let mut request = json!({ "prompt": "a person jumps", "steps": 3, "seed": 3, "seconds": 2 });
    request["like"] = report["motions"][0]["series"].clone();
    let liked = server.generate("application/json", &request);
    assert_eq!(liked.status, 200, "{}", liked.json());
    succeeds(
        folder,
        &[
            "generate",
            "a person jumps",
            "--steps",
            "3",
            "--seed",
            "3",
            "--seconds",
            "2",
            "--like",
            "far.bvh",
            "--out",
            "liked.json",
            "--quiet",
        ],
    );
    assert_eq!(
        liked.body,
        std::fs::read(folder.join("liked.json")).unwrap()
    );
}

#[test]
fn motions_are_put_on_characters_that_were_sent() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A file of lamogen is a character, too: it has a skin.
    succeeds(folder, &[&JUMP[..], &["--out", "hero.glb"]].concat());
    let guided = [&JUMP[..], &["--weight", "strong", "--part", "arms:sudden"]].concat();
    succeeds(
        folder,
        &[&guided[..], &["--onto", "hero.glb", "--out", "jump.glb"]].concat(),
    );
    let hero = std::fs::read(folder.join("hero.glb")).unwrap();
    let server = RunningServer::start(&[]);
    let send = |name: &str, bytes: &[u8]| {
        let start = format!("POST /api/v1/character?name={name}");
        server.ask(
            &start,
            &[("Content-Type", "application/octet-stream")],
            bytes,
        )
    };
    let answer = send("..%2F..%2Fhero.glb", &hero);
    let character = answer.json();
    assert_eq!(answer.status, 200, "{character}");
    assert_eq!(character["name"], "hero.glb");
    let bones = character["mesh"]["bones"].as_array().unwrap().len();
    assert_eq!(bones, 22);
    let again = send("other.glb", &hero).json();
    assert_eq!(again["onto"], character["onto"]);

    let mut request = jump();
    request["onto"] = character["onto"].clone();
    let written = server.generate("model/gltf-binary", &request);
    assert_eq!(written.status, 200);
    assert!(written.body == std::fs::read(folder.join("jump.glb")).unwrap());
    let scene = server.generate("application/json", &request).json();
    assert_eq!(scene["onto"], character["onto"]);
    for motion in scene["motions"].as_array().unwrap() {
        let poses = &motion["character"];
        assert_eq!(
            (&poses["frames"], &poses["frames_per_second"]),
            (&json!(40), &json!(20.0))
        );
        let bytes = 40 * bones * 7 * 4;
        assert_eq!(
            poses["poses"].as_str().unwrap().len(),
            bytes.div_ceil(3) * 4
        );
    }
    // Everything else is as without a character.
    let plain = server.generate("application/json", &jump()).json();
    assert_eq!(plain["motions"][1]["joints"], scene["motions"][1]["joints"]);
    assert!(
        server.generate("text/plain", &request).body == server.generate("text/plain", &jump()).body
    );

    let known = request.to_string();
    request["onto"] = "0123456789abcdef".into();
    server.refuses(&request.to_string(), 400, "onto", "is still kept");
    request["onto"] = "../hero.glb".into();
    server.refuses(&request.to_string(), 400, "onto", "is still kept");
    request["onto"] = 3.into();
    server.refuses(&request.to_string(), 400, "onto", "found 3");
    for (name, bytes) in [
        ("a.glb", &hero[..40]),
        ("a.vrm", b"glTF and no more"),
        ("a.bvh", b"HIERARCHY"),
    ] {
        let answer = send(name, bytes);
        assert_eq!(
            (answer.status, &answer.json()["where"]),
            (422, &json!(name)),
            "{name}"
        );
    }
    // Four are kept, the last ones.
    for length in 1..=4 {
        let longer = [&hero[..], &vec![0; length]].concat();
        assert_eq!(send("longer.glb", &longer).status, 200);
    }
    server.refuses(&known, 400, "onto", "is still kept");
}

#[test]
fn wrong_requests_say_what_was_expected_and_where() {
    let server = RunningServer::start(&["--max-upload", "1"]);
    let deep = format!(
        "{{\"prompt\": {}1{}}}",
        "[".repeat(10_000),
        "]".repeat(10_000)
    );
    for (request, place, part) in [
        ("{\"prompt\": \"\"}", "prompt", "expected a sentence"),
        ("{\"prompt\": 3}", "prompt", "invalid type"),
        ("{}", "prompt", "missing field"),
        (
            "{\"prompt\": \"a person walks\", \"seconds\": 1}",
            "seconds",
            "2.0 to 3600.0 s",
        ),
        (
            "{\"prompt\": \"a person walks\", \"seconds\": 1e39}",
            "seconds",
            "at most 60 s",
        ),
        (
            "{\"prompt\": \"a person walks\", \"seconds\": 58, \"then\": [{\"prompt\": \"a person jumps\"}]}",
            "seconds",
            "at most 60 s, all sentences together, found 61 s",
        ),
        (
            "{\"prompt\": \"a person walks\", \"steps\": 0}",
            "steps",
            "1 to 1000",
        ),
        (
            "{\"prompt\": \"a person walks\", \"steps\": 100000}",
            "steps",
            "1 to 1000",
        ),
        (
            "{\"prompt\": \"a person walks\", \"weight\": \"sudden\"}",
            "weight",
            "speaks of Time",
        ),
        (
            "{\"prompt\": \"a person walks\", \"weight\": -1}",
            "weight",
            "at least 0",
        ),
        (
            "{\"prompt\": \"a person walks\", \"part\": [\"wings:strong\"]}",
            "part",
            "expected one of arms",
        ),
        (
            "{\"prompt\": \"a person walks\", \"like\": \"/etc/passwd\"}",
            "like",
            "a server opens no files",
        ),
        (
            "{\"prompt\": \"a person walks\", \"after\": \"/etc/passwd\"}",
            "after",
            "a server opens no files",
        ),
        (
            "{\"prompt\": \"a person walks\", \"before\": \"/etc/passwd\"}",
            "before",
            "a server opens no files",
        ),
        (
            "{\"prompt\": \"a person walks\", \"then\": [{\"prompt\": \"a person jumps\", \"like\": \"/etc/passwd\"}]}",
            "then",
            "a server opens no files",
        ),
        (
            "{\"prompt\": \"a person walks\", \"like\": {\"weight\": [1]}}",
            "like",
            "time: an array of 1 to",
        ),
        (
            "{\"prompt\": \"a person walks\", \"like\": {\"weight\": [1], \"time\": [1, 2], \"flow\": [1], \"shape\": [1]}}",
            "like",
            "time: 1 numbers",
        ),
        (
            "{\"prompt\": \"a person walks\", \"like\": {\"weight\": [null], \"time\": [1], \"flow\": [1], \"shape\": [1]}}",
            "like",
            "found null at frame 0",
        ),
        (
            "{\"prompt\": \"a person walks\", \"like\": {\"strength\": [1]}}",
            "like",
            "strength",
        ),
        (
            "{\"prompt\": \"a person walks\", \"wieght\": 1}",
            "wieght",
            "unknown field",
        ),
        ("[1]", "body", "expected a JSON object"),
        ("", "body", "found nothing"),
        (" \n\t", "body", "found nothing"),
        ("not json", "body", "expected a JSON object"),
        ("{\"prompt\": \"a", "body", "at column"),
        (&deep, "body", "invalid type: sequence"),
    ] {
        server.refuses(request, 400, place, part);
    }
    // Each is nearly as large as a request may be.
    let many = |item: &str| vec![item; 900_000 / (item.len() + 1)].join(",");
    let with = |fields: &str| format!("{{\"prompt\": \"a person walks\", {fields}}}");
    let sentence = "{\"prompt\":\"a person jumps\",\"seconds\":2}";
    for (fields, part) in [
        (
            format!("\"part\": [{}]", many("\"arms:strong\"")),
            "in common",
        ),
        (
            format!("\"reach\": [{}]", many("\"right-hand@1.5=0.3,1.6,0.5\"")),
            "at a moment",
        ),
        (
            format!(
                "\"then\": [{},{{\"prompt\":\"a\",\"seconds\":-99999}}]",
                many(sentence)
            ),
            "all sentences together",
        ),
        (many("\"x\":1"), "unknown field"),
        (format!("\"seed\": {}", "9".repeat(900_000)), "out of range"),
    ] {
        let headers = [("Content-Type", "application/json")];
        let request = with(&fields);
        let answer = server.ask("POST /api/v1/generate", &headers, request.as_bytes());
        assert_eq!(answer.status, 400, "{}", answer.json());
        let detail = answer.json()["detail"].to_string();
        assert!(detail.contains(part), "{part}: {detail}");
        assert!(
            answer.body.len() < 2000,
            "{part}: {} bytes",
            answer.body.len()
        );
    }
    let long = json!({ "prompt": "a ".repeat(1500) }).to_string();
    server.refuses(&long, 400, "prompt", "at most 2000");
    let huge = json!({ "prompt": "a".repeat(2_000_000) }).to_string();
    server.refuses(&huge, 413, "body", "at most 1000000 bytes");

    let broken = |query: &str, bytes: &[u8]| {
        let answer = server.laban(query, bytes);
        let problem = answer.json();
        (
            answer.status,
            problem["where"].clone(),
            problem["detail"].to_string(),
        )
    };
    for (query, bytes, status, place, part) in [
        ("", &b"nothing known"[..], 422, "body", "BVH, GLB"),
        ("", b"", 422, "body", "BVH, GLB"),
        ("name=a.bvh", b"HIERARCHY\nROOT", 422, "a.bvh", "a.bvh"),
        ("name=a.fbx", b"x", 422, "a.fbx", ".bvh"),
        (
            "name=a.glb",
            b"glTF\x02\0\0\0\xff\xff\xff\xff",
            422,
            "a.glb",
            "a.glb",
        ),
        (
            "name=a.npy",
            b"\x93NUMPY\x01\0\xff\xff{",
            422,
            "a.npy",
            "a.npy",
        ),
        (
            "name=a.gltf",
            br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"/etc/passwd","byteLength":4}]}"#,
            422,
            "a.gltf",
            "a.gltf",
        ),
        ("unit=miles", b"x", 400, "unit", "miles"),
        ("up=w", b"x", 400, "up", "w"),
        ("fps=fast", b"x", 400, "fps", "a number"),
        ("path=/etc/passwd", b"x", 400, "query", "one of name"),
        (
            "name=a.bvh",
            &vec![b' '; 1_000_001],
            413,
            "body",
            "at most 1000000 bytes",
        ),
    ] {
        let found = broken(query, bytes);
        assert_eq!(
            (found.0, &found.1),
            (status, &Value::from(place)),
            "{query}: {}",
            found.2
        );
        assert!(found.2.contains(part), "{query}: {}", found.2);
    }
    // None of this has hurt it.
    assert_eq!(server.generate("application/json", &jump()).status, 200);
}

#[test]
fn the_model_describes_itself_and_the_page_loads_its_own_files_alone() {
    let server = RunningServer::start(&[]);
    let model = server.ask("GET /api/v1/model", &[], b"").json();
    assert_eq!(
        (&model["model"], &model["frames"]),
        (&"embedded".into(), &json!([40, 196]))
    );
    assert_eq!(
        model["components"][0]["words"][1],
        json!({ "word": "strong", "factor": 1.5 })
    );
    let document = server.ask("GET /api/v1/openapi.json", &[], b"").json();
    let formats = &document["paths"]["/api/v1/generate"]["post"]["responses"]["200"]["content"];
    for format in model["formats"].as_array().unwrap() {
        assert!(formats.get(format.as_str().unwrap()).is_some(), "{format}");
    }
    for (path, media_type) in [
        ("/", "text/html"),
        ("/studio.js", "text/javascript"),
        ("/studio.css", "text/css"),
    ] {
        let answer = server.ask(&format!("GET {path}"), &[], b"");
        assert_eq!(answer.status, 200);
        assert!(answer.headers["content-type"].starts_with(media_type));
    }
}

#[test]
fn options_that_would_open_the_machine_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fails(
        folder,
        &["serve", "--bind", "0.0.0.0", "--port", "0"],
        2,
        &["expected a token", "--token-file"],
    );
    fails(
        folder,
        &["serve", "--token", "short", "--port", "0"],
        2,
        &["at least 16 characters", "found 5"],
    );
    fails(
        folder,
        &["serve", "--token-file", "none", "--port", "0"],
        3,
        &["none"],
    );
    fails(
        folder,
        &["serve", "--allow-origin", "*", "--port", "0"],
        2,
        &["expected an origin"],
    );
    fails(
        folder,
        &["studio", "--no-open", "--time-limit", "0"],
        2,
        &["--time-limit"],
    );
    let server = RunningServer::start(&[]);
    let port = server.address.rsplit(':').next().unwrap();
    fails(
        folder,
        &["serve", "--port", port],
        2,
        &["--port takes another one"],
    );
}

#[cfg(unix)]
#[test]
fn a_signal_ends_the_server_after_what_runs() {
    let mut server = RunningServer::start(&["--quiet"]);
    let mut stream = TcpStream::connect(&server.address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let body = jump().to_string();
    let head = format!(
        "POST /api/v1/generate HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {}\r\nAccept: text/event-stream\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(head.as_bytes()).unwrap();
    // The head of the answer comes when the work has been taken.
    let mut answer = vec![0; 12];
    stream.read_exact(&mut answer).unwrap();
    let pid = server.child.id().to_string();
    let told = std::process::Command::new("kill")
        .args(["-TERM", &pid])
        .status();
    assert!(told.unwrap().success());
    stream.read_to_end(&mut answer).unwrap();
    let text = String::from_utf8_lossy(&answer);
    assert!(
        text.contains("event: result") || text.contains("shutting-down"),
        "{text}"
    );
    let end = Instant::now() + Duration::from_secs(30);
    let status = loop {
        match server.child.try_wait().unwrap() {
            Some(status) => break status,
            None if Instant::now() > end => panic!("the server goes on"),
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    assert_eq!(status.code(), Some(0));
}
