//! The options of a server.

use std::net::SocketAddr;
use std::time::Duration;

/// The options of a [`Server`](crate::Server).
#[derive(Clone, Debug)]
pub struct ServerConfig {
    /// The address to listen on; port 0 is any free port. An address other than a loopback one needs a token.
    /// The default is port 8765 of 127.0.0.1.
    pub address: SocketAddr,
    /// The token that requests must have in the header `Authorization: Bearer …`. Pages and `/health` need none.
    /// The default is `None`: no request needs one.
    pub token: Option<String>,
    /// The origins of other pages that may use the interface (CORS), such as `https://example.org`. The default is none.
    pub allowed_origins: Vec<String>,
    /// The number of requests that may wait for their turn; further ones are answered with status 429. The default is 64.
    pub queue: usize,
    /// The number of works that run at the same time, each on its share of the processors, while further ones wait. A work that
    /// is alone has all processors. The default is 1: works run one after another, each on all processors.
    pub workers: usize,
    /// The longest time of a work. The default is one minute.
    pub work_time: Duration,
    /// The size in bytes of the largest request for a motion. The default is 1 MB.
    pub max_request: usize,
    /// The size in bytes of the largest motion file. The default is 32 MB.
    pub max_upload: usize,
    /// The number of bytes of motion files that the server holds at once; further files are answered with status 429.
    /// The default is 64 MB.
    pub max_upload_total: usize,
    /// The longest time until the head of a request has arrived, also of one that follows on a connection. The default is 15 s.
    pub head_time: Duration,
    /// The longest time until the body of a request has arrived. The default is 30 s.
    pub body_time: Duration,
    /// The longest time for which a client may read nothing of its answer; its connection is closed then, and its work stopped.
    /// The default is 30 s.
    pub write_time: Duration,
    /// The number of open connections. Where a further one comes, the one that has been idle for the longest time is closed; if none
    /// is idle, the further one waits. The default is 512.
    pub max_connections: usize,
    /// The longest time that works may go on after the server was told to end. The default is 5 s.
    pub grace: Duration,
    /// The pages and their parts. The default is none.
    pub pages: Vec<PageFile>,
}

/// A file that is answered as it is, such as a page or its script.
#[derive(Clone, Debug)]
pub struct PageFile {
    /// The path, such as `/studio.js`.
    pub path: &'static str,
    /// The media type, such as `text/javascript; charset=utf-8`.
    pub media_type: &'static str,
    /// The content.
    pub content: String,
}

impl Default for ServerConfig {
    fn default() -> Self {
        ServerConfig {
            address: SocketAddr::from(([127, 0, 0, 1], 8765)),
            token: None,
            allowed_origins: Vec::new(),
            queue: 64,
            workers: 1,
            work_time: Duration::from_secs(60),
            max_request: 1_000_000,
            max_upload: 32_000_000,
            max_upload_total: 64_000_000,
            head_time: Duration::from_secs(15),
            body_time: Duration::from_secs(30),
            write_time: Duration::from_secs(30),
            max_connections: 512,
            grace: Duration::from_secs(5),
            pages: Vec::new(),
        }
    }
}

/// Why a server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// An address that other machines can reach has no token.
    #[error("{address}: expected a token for an address that other machines can reach, found none")]
    #[allow(missing_docs)]
    NoToken { address: SocketAddr },
    /// The token is shorter than a guess takes.
    #[error("expected a token of at least {shortest} characters without spaces, found {found}")]
    #[allow(missing_docs)]
    Token { shortest: usize, found: String },
    /// An allowed origin is none.
    #[error("expected an origin such as https://example.org, found {found:?}")]
    #[allow(missing_docs)]
    Origin { found: String },
    /// The address cannot be listened on.
    #[error("{address}: {reason}")]
    #[allow(missing_docs)]
    Bind {
        address: SocketAddr,
        reason: std::io::Error,
    },
    /// The threads of the server cannot be started.
    #[error("threads cannot be started: {reason}")]
    #[allow(missing_docs)]
    Threads { reason: std::io::Error },
}

/// The number of characters of the shortest token.
pub(crate) const SHORTEST_TOKEN: usize = 16;

impl ServerConfig {
    /// Checks the options that do not need the network.
    pub(crate) fn check(&self) -> Result<(), ServerError> {
        let address = self.address;
        match &self.token {
            None if !address.ip().is_loopback() => return Err(ServerError::NoToken { address }),
            Some(token) => {
                let is_visible = token.bytes().all(|byte| byte.is_ascii_graphic());
                if token.len() < SHORTEST_TOKEN || !is_visible {
                    let found = match is_visible {
                        true => format!("{}", token.len()),
                        false => "spaces or characters beyond ASCII".into(),
                    };
                    let shortest = SHORTEST_TOKEN;
                    return Err(ServerError::Token { shortest, found });
                }
            }
            None => {}
        }
        for origin in &self.allowed_origins {
            let rest = origin
                .strip_prefix("https://")
                .or(origin.strip_prefix("http://"));
            let is_origin = rest.is_some_and(|host| {
                !host.is_empty()
                    && host.bytes().all(|byte| byte.is_ascii_graphic())
                    && !host.contains(['/', '?', '#', '@', '*'])
            });
            if !is_origin {
                let found = origin.clone();
                return Err(ServerError::Origin { found });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(config: ServerConfig) -> String {
        config.check().unwrap_err().to_string()
    }

    #[test]
    fn other_machines_need_a_token_that_cannot_be_guessed() {
        assert!(ServerConfig::default().check().is_ok());
        let open = || ServerConfig {
            address: SocketAddr::from(([0, 0, 0, 0], 0)),
            ..ServerConfig::default()
        };
        assert!(error(open()).contains("expected a token"));
        let with = |token: &str| ServerConfig {
            token: Some(token.into()),
            ..open()
        };
        assert!(error(with("short")).contains("at least 16 characters without spaces, found 5"));
        assert!(error(with("sixteen letters and spaces")).contains("found spaces"));
        assert!(with("0123456789abcdef").check().is_ok());
    }

    #[test]
    fn origins_have_a_scheme_a_host_and_no_more() {
        let with = |origin: &str| ServerConfig {
            allowed_origins: vec![origin.into()],
            ..ServerConfig::default()
        };
        for origin in ["https://example.org", "http://localhost:5173"] {
            assert!(with(origin).check().is_ok(), "{origin}");
        }
        for origin in [
            "*",
            "example.org",
            "https://",
            "https://a.org/",
            "null",
            "https://*.org",
        ] {
            assert!(
                error(with(origin)).contains("expected an origin"),
                "{origin}"
            );
        }
    }
}
