//! `lamogen generate`.

use std::ops::ControlFlow;

use lamogen::{Generation, Request};
use serde_json::{Map, Value, json};

use crate::arguments::{BodyName, Generate, PassArguments, PresetName};
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::output::{Format, Output};
use crate::report;
use crate::scene::Scene;
use crate::source::Source;

pub fn run(options: &Generate, console: &Console) -> Result<(), Failure> {
    let seeds = seeds(options)?;
    let outputs = outputs(options, &seeds)?;
    let formats: Vec<Format> = options.out.iter().map(|output| output.format).collect();
    for unused in options.writing.unused(&formats) {
        console.notice(unused);
    }
    let source = Source::open(&options.source, console)?;
    let goals = options.goals.asked().goals(&source.device())?;
    if options.pass.emphasis.is_some() && goals.is_none() {
        console.notice("--emphasis changes nothing here: it is for motions with goals, such as --weight strong");
    }
    let requests: Vec<Request> = seeds
        .iter()
        .map(|&seed| {
            let request = Request::new(&options.prompt)
                .seconds(options.seconds)
                .seed(seed);
            let request = options.pass.apply(request, source.model.preset());
            match goals.clone() {
                Some(goals) => request.scale(goals),
                None => request,
            }
        })
        .collect();
    let bar = console.bar("steps");
    // Written as they come: what is done is kept.
    let parts = requests.len().div_ceil(TOGETHER);
    let samples = seeds.chunks(TOGETHER).zip(outputs.chunks(TOGETHER));
    for (part, (requests, (seeds, outputs))) in requests.chunks(TOGETHER).zip(samples).enumerate() {
        let generations = source.model.generate_all_with(requests, &mut |progress| {
            bar.set_length((parts * progress.total) as u64);
            bar.set_message(progress.step.pass.to_string());
            bar.set_position((part * progress.total + progress.done) as u64);
            ControlFlow::Continue(())
        })?;
        for ((generation, &seed), outputs) in generations.into_iter().zip(seeds).zip(outputs) {
            let sample = Sample { seed, outputs };
            bar.suspend(|| sample.write(generation, options, &source, console))?;
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// Motions that run together.
const TOGETHER: usize = 8;

/// One of the motions, and its files.
struct Sample<'a> {
    seed: u64,
    outputs: &'a [Output],
}

impl Sample<'_> {
    fn write(
        &self,
        generation: Generation,
        options: &Generate,
        source: &Source,
        console: &Console,
    ) -> Result<(), Failure> {
        if generation.cut_tokens > 0 {
            console.notice(format!(
                "The prompt is too long: its last {} tokens were left out.",
                generation.cut_tokens
            ));
        }
        if let Some(notice) = unseen(&generation) {
            console.notice(notice);
        }
        let facts = facts(
            &options.prompt,
            self.seed,
            &generation,
            &options.pass,
            source,
        );
        let licence = source.model.licence();
        let scene = Scene::generated(&options.prompt, generation, facts, licence);
        for output in self.outputs {
            output.write(&scene, &options.writing, console)?;
        }
        console.say(result(&scene, self.outputs, console.json))
    }
}

/// The files of every sample, checked.
fn outputs(options: &Generate, seeds: &[u64]) -> Result<Vec<Vec<Output>>, Failure> {
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
    Ok(seeds.iter().map(of).collect())
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
    generation: &Generation,
    pass: &PassArguments,
    source: &Source,
) -> Map<String, Value> {
    let preset = { pass.preset }.map_or(source.model.preset(), PresetName::preset);
    let licence = source.model.licence().map(ToString::to_string);
    let facts = json!({
        "prompt": prompt,
        "seed": seed,
        "seconds": generation.guided.seconds(),
        "goals": generation.goals.to_string(),
        "model": source.name,
        "licence": licence,
        "preset": preset.name(),
        "steps": pass.steps.unwrap_or(preset.steps()),
        "emphasis": pass.emphasis,
        "body": pass.body.unwrap_or(BodyName::of(preset.guidance().body)).name(),
        "temporal_smoothing": source.temporal_smoothing_frames(),
        "text_scale": source.model.text_scale(),
        "cut_tokens": generation.cut_tokens,
        "unseen_words": generation.unseen_words,
        "stand_in": generation.stand_in,
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
        ([baseline, guided], Some(target)) => report::guided(scene, baseline, guided, target),
        _ => report::text(scene.main()),
    };
    format!("{}\n{table}{}", scene.heading(), files.join("\n"))
}

/// Which words the model has not met, if there are any.
fn unseen(generation: &Generation) -> Option<String> {
    if let Some(sentence) = &generation.stand_in {
        return Some(format!(
            "The model has met no word of the prompt: the motion is that of \"{sentence}\"."
        ));
    }
    let words = &generation.unseen_words;
    let named = words.join(", ");
    Some(match words.len() {
        0 => return None,
        1 => format!(
            "The model was trained on no caption with the word {named}: the motion goes by the others."
        ),
        count => format!(
            "The model was trained on no caption with {count} of the words ({named}): the motion goes by the others."
        ),
    })
}
