//! A service whose works say when they begin, and end when they are told to.

use std::net::SocketAddr;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use lamogen_server::{
    MotionService, PageFile, Problem, ProblemKind, ProcessorShare, Server, ServerConfig,
    ServerHandle, UploadedFile, WorkError, WorkObserver, WorkProgress,
};
use serde_json::{Value, json};

/// What happens to works.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    Begun(String),
    Stopped(String),
}

/// The number of bytes of a large result: more than the buffers of a connection hold.
pub const LARGE: usize = 64_000_000;

/// Requests are texts. The work of one that begins with `hold` goes on until the test releases it; `panic` panics;
/// `fail` fails; `large` has a result of [`LARGE`] bytes. `ponder` is parsed when the test releases it. The result is the request and the media type.
pub struct HeldService {
    events: Sender<Event>,
    release: Mutex<Receiver<()>>,
}

impl MotionService for HeldService {
    type Request = String;

    fn media_types(&self) -> &'static [&'static str] {
        &["application/json", "model/gltf-binary"]
    }

    fn model(&self) -> Value {
        json!({ "model": "held" })
    }

    fn parse(&self, json: &str) -> Result<String, Problem> {
        match serde_json::from_str(json) {
            Ok(Value::String(text)) if text == "ponder" => {
                let released = self.release.lock().unwrap();
                let _ = released.recv_timeout(Duration::from_secs(10));
                Ok(text)
            }
            Ok(Value::String(text)) => Ok(text),
            _ => Err(Problem::mismatch(ProblemKind::InvalidRequest, "a text", json).at("body")),
        }
    }

    fn generate(
        &self,
        request: &String,
        media_type: &str,
        _: ProcessorShare,
        observer: WorkObserver<'_>,
    ) -> Result<Vec<u8>, WorkError> {
        // The receiver may have been dropped by a test that does not look.
        let _ = self.events.send(Event::Begun(request.clone()));
        match request.as_str() {
            "panic" => panic!("as the test wants"),
            "fail" => {
                let problem = Problem::new(ProblemKind::GenerationFailed, "as the test wants");
                return Err(WorkError::Failed(problem));
            }
            _ => {}
        }
        if request == "large" {
            return Ok(vec![b' '; LARGE]);
        }
        for done in 1.. {
            let progress = WorkProgress {
                done,
                total: 1000,
                stage: "held",
            };
            if observer(progress).is_break() {
                let _ = self.events.send(Event::Stopped(request.clone()));
                return Err(WorkError::Stopped);
            }
            if !request.starts_with("hold") {
                break;
            }
            let released = self.release.lock().unwrap();
            match released.recv_timeout(Duration::from_millis(5)) {
                Ok(()) | Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        Ok(json!({ "request": request, "type": media_type })
            .to_string()
            .into_bytes())
    }

    fn measure(&self, file: &UploadedFile) -> Result<Value, Problem> {
        Ok(json!({ "options": file.options, "bytes": file.bytes.len() }))
    }

    fn add_character(&self, file: &UploadedFile) -> Result<Value, Problem> {
        Ok(json!({ "onto": file.bytes.len().to_string(), "options": file.options }))
    }
}

/// A server that runs while a test does.
pub struct RunningServer {
    pub address: SocketAddr,
    pub handle: ServerHandle,
    pub events: Receiver<Event>,
    pub release: Sender<()>,
    thread: Option<JoinHandle<()>>,
}

impl RunningServer {
    /// Starts a server on a free port.
    pub fn start(config: ServerConfig) -> RunningServer {
        let (send_event, events) = channel();
        let (release, released) = channel();
        let service = HeldService {
            events: send_event,
            release: Mutex::new(released),
        };
        let config = ServerConfig {
            address: SocketAddr::new(config.address.ip(), 0),
            pages: vec![PageFile {
                path: "/",
                media_type: "text/html; charset=utf-8",
                content: "<!doctype html><title>page</title>".into(),
            }],
            ..config
        };
        let server = Server::bind(config, service).unwrap();
        let (address, handle) = (server.address(), server.handle());
        let thread = std::thread::spawn(move || server.run().unwrap());
        RunningServer {
            address,
            handle,
            events,
            release,
            thread: Some(thread),
        }
    }

    /// Waits for the next event.
    pub fn event(&self) -> Event {
        self.events
            .recv_timeout(Duration::from_secs(10))
            .expect("an event within ten seconds")
    }

    /// Waits for the end of the server.
    pub fn join(mut self) {
        let thread = self.thread.take();
        thread
            .map(JoinHandle::join)
            .transpose()
            .expect("the server ends without a panic");
    }
}

impl Drop for RunningServer {
    fn drop(&mut self) {
        self.handle.stop();
    }
}

/// Waits until a condition holds, at most ten seconds.
pub fn wait_until(claim: &str, condition: impl Fn() -> bool) {
    let end = std::time::Instant::now() + Duration::from_secs(10);
    while !condition() {
        assert!(std::time::Instant::now() < end, "{claim}");
        std::thread::sleep(Duration::from_millis(10));
    }
}
