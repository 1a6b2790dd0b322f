//! `lamogen model`.

use std::collections::HashMap;
use std::path::Path;

use lamogen::model::{Checkpoint, CheckpointError, Denoiser, Precision};
use serde_json::json;

use crate::arguments::{Model, SourceArguments};
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::source::Source;

pub fn run(task: &Model, console: &Console) -> Result<(), Failure> {
    match task {
        Model::Info { folder } => info(folder.as_deref(), console),
        Model::Convert {
            from,
            to,
            bits,
            half,
            license,
            attribution,
            force,
        } => {
            let precision = match half {
                true => Precision::F16,
                false => *bits,
            };
            let texts = [("license", license), ("attribution", attribution)];
            let metadata = texts
                .into_iter()
                .filter_map(|(name, text)| Some((name.to_owned(), text.clone()?)))
                .collect();
            convert((from, to), precision, metadata, *force, console)
        }
    }
}

fn info(folder: Option<&Path>, console: &Console) -> Result<(), Failure> {
    let arguments = SourceArguments {
        model: folder.map(Path::to_owned),
        temporal_smoothing: None,
        text_scale: None,
        device: None,
    };
    let source = Source::open(&arguments, console)?;
    let (network, licence) = (source.model.network(), source.model.licence());
    let config = source.model.config();
    let steps = source.model.preset().steps();
    if console.json {
        let licence = licence.map(|licence| {
            json!({
                "name": licence.name,
                "attribution": licence.attribution,
                "non_commercial": licence.is_non_commercial(),
            })
        });
        let info = json!({
            "model": source.name,
            "config": config,
            "frames": [network.min_frames(), network.max_frames()],
            "steps": steps,
            "temporal_smoothing": source.temporal_smoothing_frames(),
            "text_scale": source.model.text_scale(),
            "licence": licence,
        });
        return console.say(info.to_string());
    }
    let rate = lamogen::FRAMES_PER_SECOND;
    let [shortest, longest] = [network.min_frames(), network.max_frames()];
    let seconds = [shortest, longest].map(|frames| frames as f32 / rate);
    let licence = licence.map_or("not stated in the files".into(), ToString::to_string);
    let config =
        serde_json::to_string_pretty(config).map_err(|error| Failure::new(Code::Run, error))?;
    console.say(format!(
        "{}\nlicence   {licence}\nlength    {:.1} to {:.1} s ({shortest} to {longest} frames)\nsteps     {steps} by default\nconfig    {config}",
        source.name, seconds[0], seconds[1]
    ))
}

fn convert(
    (from, to): (&Path, &Path),
    precision: Precision,
    metadata: HashMap<String, String>,
    force: bool,
    console: &Console,
) -> Result<(), Failure> {
    // Any other name would be taken for a PyTorch file when it is read.
    if to.extension().is_none_or(|ending| ending != "safetensors") {
        let found = to.display();
        let message = format!("expected a name that ends in .safetensors, found {found}");
        return Err(Failure::new(Code::Usage, message));
    }
    let same = std::fs::canonicalize(from)
        .ok()
        .zip(std::fs::canonicalize(to).ok());
    if same.is_some_and(|(from, to)| from == to) {
        let message = format!(
            "{}: expected another file to write than to read",
            to.display()
        );
        return Err(Failure::new(Code::Usage, message));
    }
    let checkpoint = Checkpoint::open(from).map_err(|error| Failure::new(Code::Input, error))?;
    // Terms travel with weights, whatever is done to these.
    for (name, text) in &metadata {
        let stated = checkpoint.metadata(name).filter(|stated| stated != text);
        if let (Some(stated), false) = (stated, force) {
            let message = format!("--{name}: {} states {stated:?} already", from.display());
            let hint = "--force replaces it, for whoever owns the weights";
            return Err(Failure::new(Code::Usage, message).hint(hint));
        }
    }
    let bar = console.bar("tensors");
    let converted = checkpoint.convert(to, precision, metadata, &mut |converted| {
        bar.set_length(converted.all as u64);
        bar.set_position(converted.done as u64);
    });
    bar.finish_and_clear();
    // Damage of the input is often found only when the tensor's turn comes.
    converted.map_err(|error| {
        let code = match &error {
            CheckpointError::Io { path, .. } if path == to => Code::Output,
            _ => Code::Input,
        };
        Failure::new(code, error)
    })?;
    let bytes = std::fs::metadata(to)
        .map_err(|error| Failure::output(to, error))?
        .len();
    match console.json {
        true => console.say(json!({ "file": to.to_string_lossy(), "bytes": bytes }).to_string()),
        false => console.say(format!("{}: {:.1} MB", to.display(), bytes as f64 / 1e6)),
    }
}
