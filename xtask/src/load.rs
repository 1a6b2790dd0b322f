//! Many clients at once on `lamogen serve`, beside `lamogen batch` on the same requests.

use std::error::Error;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::bench::peak_memory_of;
use crate::judges::build_command;
use crate::running_server::RunningServer;

/// The options of a load.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Clients that ask at the same time, each for one motion after another.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub clients: u64,
    /// Seconds after which no client asks again.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: u64,
    /// Batch sizes of lamogen batch to compare with.
    #[arg(long, value_name = "SIZE", value_delimiter = ',', default_values_t = [1, 8])]
    pub batch_sizes: Vec<u32>,
    /// Further options of lamogen serve, such as --parallel 1.
    #[arg(last = true)]
    pub server: Vec<String>,
}

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Measures a load, and returns a table in Markdown.
///
/// # Errors
///
/// If the command cannot be built or run, or if an answer is an error other than 429.
pub fn run(options: &Options, observer: &mut dyn FnMut(&str)) -> Result<String> {
    let command = build_command()?;
    let server = RunningServer::start(&command, &options.server)?;
    let clients = Clients {
        address: server.address(),
    };
    observer("one request at a time");
    let ratio = clients.second_beside_alone()?;
    observer("many clients");
    let (answers, seconds) = clients.load(options);
    let peak = peak_memory_of(server.process());
    drop(server);

    let count = |is_counted: fn(u16) -> bool| {
        let counted = answers.iter().filter(|answer| is_counted(answer.status));
        counted.count().to_string()
    };
    let done: Vec<&AnsweredRequest> = { answers.iter() }
        .filter(|answer| answer.status == 200)
        .collect();
    if done.is_empty() {
        return Err("expected answers with a motion, found none".into());
    }
    let mut latencies: Vec<f64> = done.iter().map(|answer| answer.seconds).collect();
    latencies.sort_by(f64::total_cmp);
    let quantile = |share: f64| {
        let place = (share * (latencies.len() - 1) as f64).round() as usize;
        format!("{:.1} s", latencies[place])
    };
    let throughput = done.len() as f64 / seconds;
    let mut rows = vec![
        ("motions".to_owned(), done.len().to_string()),
        ("answers 429".into(), count(|status| status == 429)),
        (
            "other errors".into(),
            count(|status| ![200, 429].contains(&status)),
        ),
        ("latency, median".into(), quantile(0.5)),
        ("latency, 99 %".into(), quantile(0.99)),
        (
            "one request behind another, beside one alone".into(),
            format!("{ratio:.1}×"),
        ),
        (
            "peak memory".into(),
            peak.map_or("unknown".into(), |mib| format!("{mib:.0} MiB")),
        ),
        ("motions a second".into(), format!("{throughput:.2}")),
    ];
    for size in &options.batch_sizes {
        observer(&format!("lamogen batch --batch-size {size}"));
        let batch = batch_throughput(&command, &done, *size)?;
        let share = throughput / batch;
        rows.push((
            format!("the same by `lamogen batch --batch-size {size}`"),
            format!("{batch:.2}; the server has {share:.2}× of it"),
        ));
    }
    let mut table = String::from("| | |\n|---|---|\n");
    for (name, value) in rows {
        writeln!(table, "| {name} | {value} |")?;
    }
    let error = { answers.iter() }.find(|answer| ![200, 429].contains(&answer.status));
    match error {
        None => Ok(table),
        Some(error) => Err(format!(
            "{table}\nexpected 200 or 429, found {} for {}",
            error.status,
            request(error.number)
        )
        .into()),
    }
}

/// Returns the request of a number: sentences, lengths and goals in turn, each with a seed of its own.
fn request(number: u64) -> Value {
    const PROMPTS: [&str; 7] = [
        "a person jumps",
        "a person walks forward",
        "a person waves with both hands",
        "a man kicks with the right leg",
        "a person dances",
        "a person sits down and stands up",
        "someone picks something up",
    ];
    const SECONDS: [f64; 5] = [2.0, 4.0, 6.5, 9.8, 3.0];
    const GOALS: [&[(&str, &str)]; 4] = [
        &[("weight", "strong")],
        &[("time", "sudden")],
        &[],
        &[("flow", "bound"), ("shape", "near")],
    ];
    let place = number as usize;
    let mut request = json!({
        "prompt": PROMPTS[place % PROMPTS.len()],
        "seconds": SECONDS[place % SECONDS.len()],
        "seed": number,
    });
    for (component, word) in GOALS[place % GOALS.len()] {
        request[*component] = (*word).into();
    }
    request
}

/// What came back for a request.
struct AnsweredRequest {
    number: u64,
    /// The status; 0 if the connection broke.
    status: u16,
    seconds: f64,
    retry_after: u64,
}

/// The clients of a server.
struct Clients<'s> {
    /// `127.0.0.1` and the port.
    address: &'s str,
}

impl Clients<'_> {
    /// Sends a request and reads the whole answer.
    fn ask(&self, number: u64) -> AnsweredRequest {
        let start = Instant::now();
        let (status, retry_after) = self.exchange(number).unwrap_or((0, 0));
        AnsweredRequest {
            number,
            status,
            seconds: start.elapsed().as_secs_f64(),
            retry_after,
        }
    }

    /// Returns the status of the answer, and the seconds of its header `Retry-After`.
    fn exchange(&self, number: u64) -> Result<(u16, u64)> {
        let body = request(number).to_string();
        let mut stream = TcpStream::connect(self.address)?;
        write!(
            stream,
            "POST /api/v1/generate HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\
             Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            self.address,
            body.len()
        )?;
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer)?;
        let text = String::from_utf8_lossy(&answer);
        let (head, content) = text.split_once("\r\n\r\n").ok_or("no answer")?;
        let status: u16 = head.split(' ').nth(1).ok_or("no status")?.parse()?;
        if status == 200 {
            let motion: Value = serde_json::from_str(content)?;
            motion["motions"][0]["joints"]
                .as_array()
                .ok_or("no joints")?;
        }
        let retry_after = head
            .lines()
            .find_map(|line| line.strip_prefix("retry-after: "));
        let retry_after = retry_after.map_or(Ok(0), str::parse)?;
        Ok((status, retry_after))
    }

    /// Returns how much longer a request takes that comes just after another one than one that comes alone. All are as long.
    fn second_beside_alone(&self) -> Result<f64> {
        // Requests of the same sentence, length and goals; a seed of its own for each, so that nothing is kept.
        let same = 7 * 5 * 4;
        let seconds = |number: u64| {
            let answer = self.ask(number * same);
            match answer.status {
                200 => Ok(answer.seconds),
                status => Err(format!("expected 200, found {status}")),
            }
        };
        let mut ratios = Vec::new();
        for trial in 0..5 {
            let alone = seconds(3 * trial + 1)?;
            let both = thread::scope(|scope| {
                let first = scope.spawn(|| seconds(3 * trial + 2));
                thread::sleep(Duration::from_millis(20));
                let second = seconds(3 * trial + 3);
                first
                    .join()
                    .unwrap_or(Err("a client panicked".into()))
                    .and(second)
            })?;
            ratios.push(both / alone);
        }
        ratios.sort_by(f64::total_cmp);
        Ok(ratios[ratios.len() / 2])
    }

    /// Lets all clients ask until the time is over. Returns what came back, and the seconds until all was there.
    fn load(&self, options: &Options) -> (Vec<AnsweredRequest>, f64) {
        let next = AtomicU64::new(1_000_000);
        let answers = Mutex::new(Vec::new());
        let start = Instant::now();
        let end = start + Duration::from_secs(options.seconds);
        thread::scope(|scope| {
            for _ in 0..options.clients {
                scope.spawn(|| {
                    while Instant::now() < end {
                        let answer = self.ask(next.fetch_add(1, Ordering::Relaxed));
                        let wait = Duration::from_secs(answer.retry_after);
                        let left = end.saturating_duration_since(Instant::now());
                        if let Ok(mut answers) = answers.lock() {
                            answers.push(answer);
                        }
                        thread::sleep(wait.min(left));
                    }
                });
            }
        });
        let seconds = start.elapsed().as_secs_f64();
        (answers.into_inner().unwrap_or_default(), seconds)
    }
}

/// Returns how many motions a second `lamogen batch` makes of the requests that were done.
fn batch_throughput(command: &Path, done: &[&AnsweredRequest], size: u32) -> Result<f64> {
    let folder = tempfile::tempdir()?;
    let requests = folder.path().join("requests.jsonl");
    let lines: String = { done.iter() }
        .map(|answer| format!("{}\n", request(answer.number)))
        .collect();
    std::fs::write(&requests, lines)?;
    let output = Command::new(command)
        .arg("batch")
        .arg(&requests)
        .arg("--out")
        .arg(folder.path().join("motions"))
        .args(["--quiet", "--json", "--batch-size", &size.to_string()])
        .stderr(Stdio::inherit())
        .output()?;
    let summary: Value = serde_json::from_slice(&output.stdout)?;
    let number = |key: &str| {
        let number = summary[key].as_f64();
        number.ok_or_else(|| format!("expected {key} in {summary}"))
    };
    Ok(number("made")? / number("seconds")?)
}
