//! `lamogen generate`: generates the motions of one sentence.

use lamogen::{Error, FinishedStretches, Generation, NamedMotions, Request};
use serde_json::{Map, Value, json};

use crate::arguments::{BodyName, GenerateArguments, PassArguments, PresetName};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::output::{OutputFile, OutputFormat};
use crate::report;
use crate::scene::{Scene, seconds};
use crate::signals;
use crate::source::ModelSource;
use crate::unfinished::UnfinishedMotion;

/// Runs `lamogen generate`.
pub fn run(options: &GenerateArguments, console: &Console) -> Result<(), Failure> {
    let stop = signals::stop_on_signals();
    let seeds = seeds(options)?;
    let outputs = sample_files(options, &seeds)?;
    let formats: Vec<OutputFormat> = options.out.iter().map(|output| output.format).collect();
    options.writing.check(&formats)?;
    for notice in options.writing.notices(&formats) {
        console.notice(notice);
    }
    let source = ModelSource::open(&options.source, console)?;
    let goals = options.goals.requested_goals().resolve(&source.device())?;
    let sentences = options.sentences.iter();
    let following = { sentences.map(|sentence| sentence.request(&source.device())) }
        .collect::<Result<Vec<Request>, _>>()?;
    let has_goals = goals.is_some()
        || options
            .sentences
            .iter()
            .any(|sentence| sentence.has_goals());
    if options.pass.emphasis.is_some() && !has_goals {
        console.notice("--emphasis changes nothing here: it is for motions with goals, such as --weight strong");
    }
    let (after, before) = (options.after.as_deref(), options.before.as_deref());
    let named_motions = NamedMotions::read(after, before, &options.places.pose)?;
    let places = options.places.places();
    for notice in places.notices() {
        console.notice(notice);
    }
    let requests: Vec<Request> = seeds
        .iter()
        .map(|&seed| {
            let request = Request::new(&options.prompt)
                .seconds(options.seconds)
                .seed(seed)
                .root_motion(options.writing.root_motion())
                .places(places.clone());
            let request = following.iter().cloned().fold(request, Request::then);
            let request = named_motions.apply(request);
            let request = options.pass.apply(request, source.model.preset());
            match goals.clone() {
                Some(goals) => request.scale(goals),
                None => request,
            }
        })
        .collect();
    let bar = console.progress_bar("steps");
    // The files of each batch are written at once, so that a stop later loses none of them.
    let batches = requests.len().div_ceil(BATCH_SIZE);
    let samples = { seeds.chunks(BATCH_SIZE) }.zip(outputs.chunks(BATCH_SIZE));
    let samples = requests.chunks(BATCH_SIZE).zip(samples);
    let writer = SampleWriter {
        options,
        source: &source,
        console,
    };
    let all = seeds.len();
    for (batch, (requests, (seeds, outputs))) in samples.enumerate() {
        stop.heed(true);
        let generations = source.model.generate_all_with(requests, &mut |progress| {
            bar.set_length((batches * progress.total) as u64);
            bar.set_message(progress.step.pass.to_string());
            bar.set_position((batch * progress.total + progress.done) as u64);
            stop.control_flow()
        });
        // A signal while files are written ends the command at once: a picture of a long motion may take long.
        stop.heed(false);
        let sample = |place: usize| Sample {
            seed: seeds[place],
            outputs: &outputs[place],
        };
        let generations = match generations {
            Ok(generations) => generations,
            Err(error) => {
                bar.finish_and_clear();
                let early_end = EarlyEnd {
                    finished: batch * BATCH_SIZE,
                    all,
                };
                return Err(early_end.keep(error, sample, &writer)?);
            }
        };
        for (place, generation) in generations.into_iter().enumerate() {
            bar.suspend(|| writer.write(&sample(place), generation))?;
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// The number of motions that are generated before their files are written.
const BATCH_SIZE: usize = 8;

/// A run that ended before all of its motions were generated.
struct EarlyEnd {
    /// The number of motions that were finished before that batch.
    finished: usize,
    /// The number of all motions.
    all: usize,
}

impl EarlyEnd {
    /// Writes the files of what the batch has finished: of motions, and of the stretches of long ones. Returns how the command
    /// fails. If the user stopped it before anything was finished, the command ends here.
    fn keep<'a>(
        self,
        mut error: Error,
        sample: impl Fn(usize) -> Sample<'a>,
        writer: &SampleWriter<'_>,
    ) -> Result<Failure, Failure> {
        let partial = match &mut error {
            Error::Stopped(stopped) => std::mem::take(&mut stopped.partial),
            Error::Failed(failed) => std::mem::take(&mut failed.partial),
            Error::Request { .. } => return Ok(error.into()),
        };
        let finished = self.finished + partial.finished.len();
        for (place, generation) in partial.finished {
            writer.write(&sample(place), generation)?;
        }
        let mut kept = finished > 0;
        for unfinished in partial.unfinished {
            if let Some(stretches) = unfinished.finished {
                writer.write_stretches(&sample(unfinished.request), stretches)?;
                kept = true;
            }
        }
        if !matches!(error, Error::Stopped(_)) {
            return Ok(error.into());
        }
        if !kept {
            signals::clean_up_and_exit();
        }
        let message = format!("stopped; {finished} of {} motions are finished", self.all);
        Ok(Failure::new(FailureCode::Stopped, message))
    }
}

/// One of the motions, with its seed and its files.
struct Sample<'a> {
    seed: u64,
    outputs: &'a [OutputFile],
}

/// Writes the files of motions.
struct SampleWriter<'a> {
    options: &'a GenerateArguments,
    source: &'a ModelSource,
    console: &'a Console,
}

impl SampleWriter<'_> {
    /// Writes the files of a motion, and prints notices and measurements.
    fn write(&self, sample: &Sample<'_>, generation: Generation) -> Result<(), Failure> {
        let SampleWriter {
            options,
            source,
            console,
        } = *self;
        if generation.cut_tokens > 0 {
            console.notice(format!(
                "The prompt is too long: its last {} tokens were left out.",
                generation.cut_tokens
            ));
        }
        if let Some(notice) = unseen_words_notice(&generation) {
            console.notice(notice);
        }
        let facts = generation_facts(sample.seed, &generation, &options.pass, source);
        let scene = Scene::from_generation(generation, facts);
        for output in sample.outputs {
            output.write(&scene, &options.writing, console)?;
        }
        console.print(format_result(&scene, sample.outputs, console.json))
    }

    /// Writes the files of the finished stretches of a long motion.
    fn write_stretches(
        &self,
        sample: &Sample<'_>,
        stretches: FinishedStretches,
    ) -> Result<(), Failure> {
        let following = self.options.sentences.iter();
        let unfinished = UnfinishedMotion {
            prompt: &self.options.prompt,
            seed: sample.seed,
            seconds: following.fold(self.options.seconds, |sum, next| sum + next.seconds),
            stretches,
        };
        let writing = &self.options.writing;
        unfinished.write(sample.outputs, writing, self.source, self.console)
    }
}

/// Returns the files of every sample, after a check whether they can be written.
fn sample_files(
    options: &GenerateArguments,
    seeds: &[u64],
) -> Result<Vec<Vec<OutputFile>>, Failure> {
    for output in &options.out {
        output.check()?;
    }
    for (place, output) in options.out.iter().enumerate() {
        if options.out[..place].contains(output) {
            let message = format!("--out {output} is given twice");
            return Err(Failure::new(FailureCode::Usage, message));
        }
    }
    let files_of_seed = |seed: &u64| match options.samples {
        1 => options.out.clone(),
        _ => options
            .out
            .iter()
            .map(|output| output.numbered(*seed))
            .collect(),
    };
    Ok(seeds.iter().map(files_of_seed).collect())
}

/// Returns the seed of every sample.
fn seeds(options: &GenerateArguments) -> Result<Vec<u64>, Failure> {
    let last = options.seed.checked_add(u64::from(options.samples) - 1);
    let message = format!("the last of {} seeds is too large", options.samples);
    let last = last.ok_or_else(|| Failure::new(FailureCode::Usage, message))?;
    Ok((options.seed..=last).collect())
}

/// Returns the facts about the generation of a motion that its files contain.
pub fn generation_facts(
    seed: u64,
    generation: &Generation,
    pass: &PassArguments,
    source: &ModelSource,
) -> Map<String, Value> {
    let preset = { pass.preset }.map_or(source.model.preset(), PresetName::preset);
    let licence = source.model.licence().map(ToString::to_string);
    let facts = json!({
        "prompt": generation.sentences[0].prompt,
        "seed": seed,
        "seconds": generation.guided.seconds(),
        "goals": generation.goals.to_string(),
        "model": source.name,
        "licence": licence,
        "preset": preset.name(),
        "steps": generation.steps,
        "emphasis": pass.emphasis,
        "body": pass.body.unwrap_or(BodyName::of(preset.guidance().body)).name(),
        "temporal_smoothing": source.temporal_smoothing_frames(),
        "text_scale": source.model.text_scale().scale,
        "text_scale_until": source.model.text_scale().until,
        "sampler": source.model.sampling_method().name(),
        "cut_tokens": generation.cut_tokens,
        "unseen_words": generation.unseen_words,
        "stand_in": generation.stand_in,
        "loop": generation.guided.loop_travel().is_some(),
        "loop_travel": generation.guided.loop_travel(),
        "root_motion": generation.guided.root_motion().name(),
        "loss": generation.loss,
    });
    let mut facts = facts.as_object().cloned().unwrap_or_default();
    if generation.sentences.len() > 1 {
        let is_guided = !generation.loss.is_empty();
        let series = [
            ("baseline", &generation.baseline_laban),
            ("target", &generation.target),
            ("guided", &generation.guided_laban),
        ];
        let series = &series[..if is_guided { 3 } else { 1 }];
        let sentences = generation.sentences.iter().map(|sentence| {
            let laban = series.iter().map(|(name, series)| {
                let section = series.section(sentence.frames.clone());
                ((*name).to_owned(), report::section_summaries(&section))
            });
            json!({
                "prompt": sentence.prompt,
                "from": seconds(sentence.frames.start),
                "until": seconds(sentence.frames.end),
                "goals": sentence.goals.to_string(),
                "laban": laban.collect::<Map<String, Value>>(),
            })
        });
        facts.insert("sentences".into(), sentences.collect());
    }
    facts
}

/// Formats the measurements of a motion and the names of its files.
fn format_result(scene: &Scene, outputs: &[OutputFile], json: bool) -> String {
    let files: Vec<String> = outputs.iter().map(OutputFile::to_string).collect();
    if json {
        let mut summary = report::summary_json(scene);
        summary.remove("loss");
        summary.insert("files".into(), files.into());
        return Value::from(summary).to_string();
    }
    let table = match (&scene.motions[..], &scene.target) {
        ([baseline, guided], Some(target)) => {
            report::guidance_table(scene, baseline, guided, target)
        }
        _ => report::measurement_table(scene.main()) + &report::caption_table(scene.main()),
    };
    format!("{}\n{table}{}", scene.heading(), files.join("\n"))
}

/// Returns a notice about words of the prompt that the model does not know, if there are any.
fn unseen_words_notice(generation: &Generation) -> Option<String> {
    if let Some(sentence) = &generation.stand_in {
        return Some(format!(
            "The model knows no word that says how to move: the motion is that of \"{sentence}\"."
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
