//! The arguments of `lamogen studio` and `lamogen serve`.

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;

use clap::Args;

use super::shared::ModelArguments;

/// The text below the options of `lamogen serve` in the help.
pub const AFTER_HELP: &str = "\
A request for a motion is a line of lamogen batch:
  curl --json '{\"prompt\": \"a person jumps\", \"weight\": \"strong\"}' -H 'Accept: model/gltf-binary' http://127.0.0.1:8765/api/v1/generate -o jump.glb
GET /api/v1/openapi.json describes all there is. The studio is at /.

Only programs on this machine reach the server, unless --bind names another address, which then needs a token.
Ctrl-C or SIGTERM ends it: what runs is finished, if it takes no longer than a few seconds.";

/// The text below the options of `lamogen studio` in the help.
pub const STUDIO_AFTER_HELP: &str = "\
The page is on this machine alone and loads nothing from elsewhere. Ctrl-C ends it.
lamogen serve is the same for other programs, without a browser.";

/// The arguments of `lamogen studio`.
#[derive(Args)]
pub struct StudioArguments {
    /// Do not open the browser.
    #[arg(long)]
    pub no_open: bool,
    #[command(flatten)]
    pub serve: ServeArguments,
}

/// The arguments of `lamogen serve`.
#[derive(Args)]
pub struct ServeArguments {
    /// Port to listen on; 0 is any free one.
    #[arg(long, default_value_t = 8765)]
    pub port: u16,
    /// Address to listen on. Others than 127.0.0.1 and ::1 can be reached from other machines and need a token.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub bind: IpAddr,
    /// Token that requests must have, at least 16 characters. Other users of this machine can see arguments: prefer
    /// --token-file, or the environment variable LAMOGEN_TOKEN.
    #[arg(long, value_name = "TOKEN", conflicts_with = "token_file")]
    pub token: Option<String>,
    /// File with the token.
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// Origin of a page of another site that may ask, such as https://example.org. May be given several times.
    #[arg(long, value_name = "ORIGIN")]
    pub allow_origin: Vec<String>,
    /// How many requests may wait; further ones are told to come again later.
    #[arg(long, value_name = "REQUESTS", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub queue: u32,
    /// How many motions are made at the same time while requests wait, each on its share of the processors. A motion does not
    /// depend on it. One a processor without, but at most 4; 1 on a graphics processor.
    #[arg(long, value_name = "MOTIONS", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub parallel: Option<u32>,
    /// Length of the longest motion in seconds. A guided motion takes about 110 MB at 30 s and 120 MB at two minutes.
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=3600))]
    pub max_seconds: u32,
    /// Longest time of a request's work in seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub time_limit: u32,
    /// Size of the largest motion file that may be sent, in megabytes.
    #[arg(long, value_name = "MEGABYTES", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub max_upload: u32,
    #[command(flatten)]
    pub source: ModelArguments,
}
