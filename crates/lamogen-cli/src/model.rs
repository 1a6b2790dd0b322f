//! `lamogen model`: prints information about models, and converts checkpoints.

use std::collections::HashMap;
use std::path::Path;

use lamogen::model::{Checkpoint, CheckpointError, Denoiser, Precision};
use serde_json::json;

use crate::arguments::{ModelArguments, ModelCommand};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::source::ModelSource;

/// Runs a subcommand of `lamogen model`.
pub fn run(command: &ModelCommand, console: &Console) -> Result<(), Failure> {
    match command {
        ModelCommand::Info { folder } => info(folder.as_deref(), console),
        ModelCommand::Convert {
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

/// Prints the sizes, the licence and the defaults of a model.
fn info(folder: Option<&Path>, console: &Console) -> Result<(), Failure> {
    let arguments = ModelArguments {
        model: folder.map(Path::to_owned),
        temporal_smoothing: None,
        text_scale: None,
        text_scale_until: None,
        sampler: None,
        device: None,
    };
    let source = ModelSource::open(&arguments, console)?;
    let (network, licence) = (source.model.network(), source.model.licence());
    let config = source.model.config();
    let steps = source.model.default_steps(source.model.preset());
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
            "text_scale": source.model.text_scale().scale,
            "text_scale_until": source.model.text_scale().until,
            "sampler": source.model.sampling_method().name(),
            "licence": licence,
        });
        return console.print(info.to_string());
    }
    let rate = lamogen::FRAMES_PER_SECOND;
    let [shortest, longest] = [network.min_frames(), network.max_frames()];
    let seconds = [shortest, longest].map(|frames| frames as f32 / rate);
    let licence = licence.map_or("not stated in the files".into(), ToString::to_string);
    let config = serde_json::to_string_pretty(&config)
        .map_err(|error| Failure::new(FailureCode::Run, error))?;
    console.print(format!(
        "{}\nlicence   {licence}\nlength    {:.1} to {:.1} s ({shortest} to {longest} frames)\nsteps     {steps} by default\nsampler   {}\nconfig    {config}",
        source.name,
        seconds[0],
        seconds[1],
        source.model.sampling_method().name()
    ))
}

/// Converts a checkpoint to safetensors. `metadata` are texts that are added to the file, such as the licence.
fn convert(
    (from, to): (&Path, &Path),
    precision: Precision,
    metadata: HashMap<String, String>,
    force: bool,
    console: &Console,
) -> Result<(), Failure> {
    // A file with any other name would be read as a PyTorch file.
    if to.extension().is_none_or(|ending| ending != "safetensors") {
        let found = to.display();
        let message = format!("expected a name that ends in .safetensors, found {found}");
        return Err(Failure::new(FailureCode::Usage, message));
    }
    let same = std::fs::canonicalize(from)
        .ok()
        .zip(std::fs::canonicalize(to).ok());
    if same.is_some_and(|(from, to)| from == to) {
        let message = format!(
            "{}: expected another file to write than to read",
            to.display()
        );
        return Err(Failure::new(FailureCode::Usage, message));
    }
    let checkpoint =
        Checkpoint::open(from).map_err(|error| Failure::new(FailureCode::Input, error))?;
    // A conversion must not replace the licence of the weights by accident.
    for (name, text) in &metadata {
        let stated = checkpoint.metadata(name).filter(|stated| stated != text);
        if let (Some(stated), false) = (stated, force) {
            let message = format!("--{name}: {} states {stated:?} already", from.display());
            let hint = "--force replaces it, for whoever owns the weights";
            return Err(Failure::new(FailureCode::Usage, message).hint(hint));
        }
    }
    let bar = console.progress_bar("tensors");
    let converted = checkpoint.convert(to, precision, metadata, &mut |converted| {
        bar.set_length(converted.all as u64);
        bar.set_position(converted.done as u64);
    });
    bar.finish_and_clear();
    // Some damage of the input is found only when a tensor is read.
    converted.map_err(|error| {
        let code = match &error {
            CheckpointError::Io { path, .. } if path == to => FailureCode::Output,
            _ => FailureCode::Input,
        };
        Failure::new(code, error)
    })?;
    let bytes = std::fs::metadata(to)
        .map_err(|error| Failure::output(to, error))?
        .len();
    match console.json {
        true => console.print(json!({ "file": to.to_string_lossy(), "bytes": bytes }).to_string()),
        false => console.print(format!("{}: {:.1} MB", to.display(), bytes as f64 / 1e6)),
    }
}
