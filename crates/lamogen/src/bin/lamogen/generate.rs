//! `lamogen generate`.

use std::ops::ControlFlow;

use lamogen::Request;
use serde_json::{Map, Value, json};

use crate::arguments::{Generate, PassArguments, PresetName};
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::output::Output;
use crate::report;
use crate::scene::Scene;
use crate::source::Source;

pub fn run(options: &Generate, console: &Console) -> Result<(), Failure> {
    let outputs = outputs(options)?;
    let source = Source::open(&options.source, console)?;
    let seeds = seeds(options)?;
    let requests: Vec<Request> = seeds
        .iter()
        .map(|&seed| {
            let request = Request::new(&options.prompt)
                .seconds(options.seconds)
                .seed(seed);
            let request = options.pass.apply(request, source.preset);
            match options.factors.curve() {
                Some(curve) => request.scale(curve),
                None => request,
            }
        })
        .collect();
    let bar = console.bar("steps");
    let generations = source.model.generate_all_with(&requests, &mut |progress| {
        bar.set_length(progress.total as u64);
        bar.set_message(progress.step.pass.to_string());
        bar.set_position(progress.done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    for ((seed, generation), outputs) in seeds.into_iter().zip(generations?).zip(outputs) {
        if generation.cut_tokens > 0 {
            let cut = generation.cut_tokens;
            console.notice(format!(
                "The prompt is too long: its last {cut} tokens were left out."
            ));
        }
        let facts = facts(&options.prompt, seed, &generation, &options.pass, &source);
        let licence = source.model.licence();
        let scene = Scene::generated(&options.prompt, generation, facts, licence);
        for output in &outputs {
            output.write(&scene, &options.writing, console)?;
        }
        console.say(result(&scene, &outputs, console.json))?;
    }
    Ok(())
}

/// The files of every sample, checked.
fn outputs(options: &Generate) -> Result<Vec<Vec<Output>>, Failure> {
    for output in &options.out {
        output.check()?;
    }
    for (place, output) in options.out.iter().enumerate() {
        if options.out[..place].contains(output) {
            let message = format!("--out {output} is given twice");
            return Err(Failure::new(Code::Usage, message));
        }
    }
    let of = |seed: &u64| match options.samples {
        1 => options.out.clone(),
        _ => options
            .out
            .iter()
            .map(|output| output.numbered(*seed))
            .collect(),
    };
    Ok(seeds(options)?.iter().map(of).collect())
}

fn seeds(options: &Generate) -> Result<Vec<u64>, Failure> {
    let last = options.seed.checked_add(u64::from(options.samples) - 1);
    let message = format!("the last of {} seeds is too large", options.samples);
    let last = last.ok_or_else(|| Failure::new(Code::Usage, message))?;
    Ok((options.seed..=last).collect())
}

/// What the files say of how a motion was made.
pub fn facts(
    prompt: &str,
    seed: u64,
    generation: &lamogen::Generation,
    pass: &PassArguments,
    source: &Source,
) -> Map<String, Value> {
    let preset = pass.preset.unwrap_or(PresetName::of(source.preset));
    let licence = source.model.licence().map(ToString::to_string);
    let facts = json!({
        "prompt": prompt,
        "seed": seed,
        "seconds": generation.guided.seconds(),
        "scale": generation.scale.to_string(),
        "model": source.name,
        "licence": licence,
        "preset": preset.name(),
        "steps": pass.steps.unwrap_or(preset.preset().steps()),
        "emphasis": pass.emphasis,
        "cut_tokens": generation.cut_tokens,
        "loss": generation.loss,
    });
    facts.as_object().cloned().unwrap_or_default()
}

/// What is printed at the end.
fn result(scene: &Scene, outputs: &[Output], json: bool) -> String {
    let files: Vec<String> = outputs.iter().map(Output::to_string).collect();
    if json {
        let mut summary = report::summary(scene);
        summary.remove("loss");
        summary.insert("files".into(), files.into());
        return Value::from(summary).to_string();
    }
    let table = match (&scene.motions[..], &scene.target) {
        ([baseline, guided], Some(target)) => report::comparison(
            ["baseline", "guided"],
            &baseline.laban,
            &guided.laban,
            Some(target),
        ),
        _ => report::text(scene.main()),
    };
    format!("{}\n{table}{}", scene.heading(), files.join("\n"))
}
