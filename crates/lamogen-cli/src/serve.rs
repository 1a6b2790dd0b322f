//! `lamogen serve` and `lamogen studio`: motions over HTTP, and the page to play with them.
//!
//! ```text
//! service.rs     what the server is asked for: motions, reports, the model
//! characters.rs  characters that clients have sent
//! request.rs     the JSON of a request
//! format.rs      which media type is which format
//! problem.rs     errors as the server answers them
//! ```

mod characters;
mod format;
mod problem;
mod request;
mod service;

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lamogen_server::{PageFile, Server, ServerConfig, ServerError, ServerHandle};
use serde_json::json;

use crate::arguments::{ServeArguments, StudioArguments};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::signals::clean_up_and_exit;
use crate::source::ModelSource;
use service::CommandService;

/// The environment variable that may hold the token.
const TOKEN_VARIABLE: &str = "LAMOGEN_TOKEN";

/// Runs `lamogen serve`.
pub fn run(options: &ServeArguments, console: &Console) -> Result<(), Failure> {
    serve(options, console, |_| ())
}

/// Runs `lamogen studio`.
pub fn run_studio(options: &StudioArguments, console: &Console) -> Result<(), Failure> {
    serve(&options.serve, console, |address| {
        if !options.no_open
            && let Err(error) = open::that_detached(address)
        {
            console.notice(format!(
                "No browser could be started ({error}); open the address by hand."
            ));
        }
    })
}

/// Answers requests until a signal ends the command. `start` is called with the address of the page.
fn serve(
    options: &ServeArguments,
    console: &Console,
    start: impl FnOnce(&str),
) -> Result<(), Failure> {
    let token = token(options)?;
    let source = ModelSource::open(&options.source, console)?;
    let config = ServerConfig {
        address: SocketAddr::new(options.bind, options.port),
        token: token.clone(),
        allowed_origins: options.allow_origin.clone(),
        queue: options.queue as usize,
        workers: parallel_works(options, &source),
        work_time: Duration::from_secs(options.time_limit.into()),
        max_upload: options.max_upload as usize * 1_000_000,
        max_upload_total: 2 * options.max_upload as usize * 1_000_000,
        pages: pages(),
        ..ServerConfig::default()
    };
    let service = CommandService::new(source, console.without_notices(), options.max_seconds);
    service.warm_up();
    let server = Server::bind(config, service)?;
    end_on_signals(server.handle());
    let address = format!("http://{}/", server.address());
    // The token stays in the browser: fragments are not sent.
    let page = match &token {
        Some(token) => format!("{address}#token={token}"),
        None => address.clone(),
    };
    match console.json {
        true => console.print(json!({ "address": address }).to_string())?,
        false => console.print(&address)?,
    }
    start(&page);
    Ok(server.run()?)
}

/// The largest number of motions that are made at the same time unless an option says another: each takes memory of its own.
const MAX_DEFAULT_PARALLEL: usize = 4;

/// Returns how many motions are made at the same time while requests wait.
fn parallel_works(options: &ServeArguments, source: &ModelSource) -> usize {
    match options.parallel {
        Some(motions) => motions as usize,
        // A graphics processor is not shared out by threads.
        None if source.model.batch_size() > 1 => 1,
        None => rayon::current_num_threads().min(MAX_DEFAULT_PARALLEL),
    }
}

/// Returns the last part of a name that a client gave to a file: the name without any folders.
fn file_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or_default()
}

/// Returns the files of the studio's page.
fn pages() -> Vec<PageFile> {
    let studio = lamogen_view::studio();
    let files = [
        ("/", "text/html; charset=utf-8", studio.page),
        (
            "/studio.js",
            "text/javascript; charset=utf-8",
            studio.script,
        ),
        ("/studio.css", "text/css; charset=utf-8", studio.style),
    ];
    let file = |(path, media_type, content)| PageFile {
        path,
        media_type,
        content,
    };
    files.map(file).into()
}

/// Returns the token: that of the arguments, of the file, or of the environment.
fn token(options: &ServeArguments) -> Result<Option<String>, Failure> {
    let text = match (&options.token, &options.token_file) {
        (Some(token), _) => Some(token.clone()),
        (None, Some(path)) => Some(std::fs::read_to_string(path).map_err(|error| {
            Failure::new(FailureCode::Input, format!("{}: {error}", path.display()))
        })?),
        (None, None) => std::env::var(TOKEN_VARIABLE).ok(),
    };
    Ok(text.map(|text| text.trim().to_owned()))
}

/// Ends the server on the first signal, and the command at once on the second.
fn end_on_signals(handle: ServerHandle) {
    let is_ending = AtomicBool::new(false);
    // If no handler can be installed, a signal ends the command at once.
    let _ = ctrlc::set_handler(move || match is_ending.swap(true, Ordering::Relaxed) {
        false => handle.stop(),
        true => clean_up_and_exit(),
    });
}

impl From<ServerError> for Failure {
    fn from(error: ServerError) -> Self {
        let hint = match &error {
            ServerError::NoToken { .. } | ServerError::Token { .. } => {
                Some("openssl rand -hex 16 > token; lamogen serve --token-file token …")
            }
            ServerError::Bind { reason, .. } if reason.kind() == std::io::ErrorKind::AddrInUse => {
                Some("--port takes another one, and 0 any free one")
            }
            _ => None,
        };
        let failure = Failure::new(FailureCode::Usage, error);
        match hint {
            Some(hint) => failure.hint(hint),
            None => failure,
        }
    }
}
