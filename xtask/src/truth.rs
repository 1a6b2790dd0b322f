//! Checks whether the motions of a model do what everyday sentences say, and validates the checks on real motions.

use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen::{Body, Guidance, Request};
use lamogen_data::{Dataset, Entry, LoadOptions, Split};
use lamogen_eval::truth::{
    Captions, Clip, Measurements, Phrasing, Report, Sentence, Validation, captioned, evidence,
    read_sentences, sentences,
};
use lamogen_files::ReadOptions;
use lamogen_motion::{Motion, write_atomically};
use serde_json::json;

use crate::subject::Subject;

/// The length of the sentence before those that are judged.
const LEAD_SECONDS: f32 = 2.0;

/// The options of the checks.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// Motions of every sentence, from as many seeds.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=100))]
    pub seeds: u64,
    /// Judge the motions of the network itself instead of those of the rigid body that users get.
    #[arg(long)]
    pub network: bool,
    /// Folder for truth.json and truth.md.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Judge these sentences instead, a file in the form of lamogen-eval/src/truth/sentences.txt: `group | phrasing | seconds | sentence |
    /// checks` a line.
    #[arg(long, value_name = "FILE", conflicts_with = "validate")]
    pub sentences: Option<PathBuf>,
    /// Judge captions of this split of the data set instead, at the length of their motions; what each has to do follows from what its motion
    /// shows.
    #[arg(long, value_name = "SPLIT", requires = "data", conflicts_with_all = ["validate", "sentences"], value_parser = |name: &str| name.parse::<Split>())]
    pub captions: Option<Split>,
    /// Only sentences of this group, several times for several.
    #[arg(long)]
    pub group: Vec<String>,
    /// Let every motion go on from that of this file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["validate", "network", "lead"])]
    pub after: Option<PathBuf>,
    /// Let every motion be the second of two sentences, after two seconds of this one.
    #[arg(long, value_name = "SENTENCE", conflicts_with_all = ["validate", "network"])]
    pub lead: Option<String>,
    /// Judge real motions instead, and the checks by them.
    #[arg(long, requires = "data")]
    pub validate: bool,
    /// Folder of the data set with the real motions.
    #[arg(long)]
    pub data: Option<PathBuf>,
    /// Further captions that the model was trained on (see `lamogen pack --more-captions`): novel sentences have to be unlike these as well.
    #[arg(long, value_name = "FILE", requires = "validate")]
    pub more_captions: Option<PathBuf>,
}

/// Generates motions of every sentence without tags, checks them and writes the report. Returns a summary to be printed;
/// `progress` receives one line of text for each sentence.
///
/// # Errors
///
/// If there is no such group, the model cannot be read, a motion cannot be generated, or the report cannot be written.
pub fn run(
    options: &Options,
    device: &Device,
    progress: &mut dyn FnMut(String),
) -> Result<String, Box<dyn Error>> {
    let suite = match (&options.sentences, options.captions, &options.data) {
        (None, Some(split), Some(data)) => captions(data, split)?,
        (Some(path), ..) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
            let sentences = read_sentences(&text);
            let sentences = sentences.map_err(|error| format!("{}: {error}", path.display()))?;
            if sentences.is_empty() {
                return Err(format!("{}: expected sentences, found none", path.display()).into());
            }
            sentences
        }
        _ => sentences(),
    };
    let all = Report::new(suite.clone());
    let groups = all.groups();
    if let Some(unknown) = { options.group.iter() }.find(|group| !groups.contains(&group.as_str()))
    {
        return Err(format!(
            "--group: expected one of {}, found {unknown}",
            groups.join(", ")
        )
        .into());
    }
    let model = options.subject.open(device)?;
    let is_selected =
        |sentence: &Sentence| options.group.is_empty() || options.group.contains(&sentence.group);
    let sentences: Vec<Sentence> = suite.into_iter().filter(is_selected).collect();
    let mut report = Report::new(sentences.clone());
    // Motions are fitted to the rigid body, whatever the preset of the model. The rest of guidance has no effect without tags.
    let guidance = Guidance {
        body: Body::Rig,
        ..model.preset().guidance()
    };
    let read = |path| lamogen_files::read(path, &ReadOptions::default());
    let after = options.after.as_ref().map(read).transpose()?;
    for (place, sentence) in sentences.iter().enumerate() {
        let requests: Vec<Request> = (0..options.seeds)
            .map(|seed| {
                let own = Request::new(&sentence.text).seconds(sentence.seconds);
                let request = match (&options.lead, &after) {
                    (Some(lead), _) => Request::new(lead).seconds(LEAD_SECONDS).then(own),
                    (None, Some(after)) => own.after(&after.motion),
                    (None, None) => own,
                };
                let request = request.guidance(guidance.clone());
                options.subject.with_steps(request).seed(seed)
            })
            .collect();
        let generations = model.generate_all(&requests)?;
        for (seed, generation) in generations.iter().enumerate() {
            let motion = match options.network {
                true => &generation.network.baseline,
                false => &generation.baseline,
            };
            let own = generation.sentences.last();
            match own.filter(|_| options.lead.is_some()) {
                Some(own) => {
                    let rotations = motion.rotations().between(own.frames.clone());
                    report.add(place, seed as u64, &Motion::from_rotations(rotations)?);
                }
                None => report.add(place, seed as u64, motion),
            }
        }
        let passed = report.trials_of(place).filter(|trial| trial.holds).count();
        progress(format!("{passed}/{} {}", options.seeds, sentence.text));
    }
    if let Some(folder) = &options.out {
        let subject = &options.subject;
        let file = json!({
            "model": subject.model.as_deref().unwrap_or(Path::new("embedded")),
            "steps": subject.steps(&model),
            "temporal_smoothing": model.temporal_smoothing().map(|temporal_smoothing| json!({ "frames": temporal_smoothing.frames, "until": temporal_smoothing.until })),
            "text_scale": model.text_scale().scale,
            "text_scale_until": model.text_scale().until,
            "seeds": options.seeds,
            "after": options.after,
            "lead": options.lead,
            "motions_of": if options.network { "network" } else { "body" },
            "overall": report.overall(),
            "training": report.of_phrasing(Phrasing::Training),
            "novel": report.of_phrasing(Phrasing::Novel),
            "sentences": report.sentences,
            "motions": report.trials,
        });
        write(folder, "truth.json", &format!("{file:#}\n"))?;
        write(folder, "truth.md", &report.markdown())?;
    }
    Ok(report.summary())
}

/// Applies every check to the real motions of all splits. Returns the report to be printed, and whether all checks are good enough
/// and all sentences have the phrasing that they state.
///
/// # Errors
///
/// If the data set cannot be read, or the report cannot be written.
pub fn validate(
    data: &Path,
    more_captions: Option<&Path>,
    out: Option<&Path>,
) -> Result<(String, bool), Box<dyn Error>> {
    let mut dataset = Dataset::open(data, &LoadOptions::default(), &mut |_| ())?;
    let clips = clips(&dataset, dataset.entries())?;
    let mut validations: Vec<Validation> = evidence()
        .iter()
        .map(|evidence| evidence.validate(&clips))
        .collect();
    let worst = |validation: &Validation| validation.true_share.min(1.0 - validation.false_share);
    validations.sort_by(|a, b| worst(a).total_cmp(&worst(b)));
    let mut page = String::from(
        "| check | holds where it should | of | holds where it should not | of |\n|---|---|---|---|---|\n",
    );
    for row in &validations {
        let mark = if row.is_valid() {
            ""
        } else {
            " **not good enough**"
        };
        writeln!(
            page,
            "| {}{mark} | {:.3} | {} | {:.3} | {} |",
            row.check, row.true_share, row.true_clips, row.false_share, row.false_clips
        )?;
    }
    // Further captions are added only now, since the evidence for the checks comes from the motions' own captions.
    if let Some(path) = more_captions {
        dataset.add_captions(path, 0)?;
    }
    let captions = dataset
        .split(Split::Train)
        .flat_map(|entry| &entry.captions);
    let captions = Captions::new(captions.map(|caption| &*caption.text));
    let sentences = sentences();
    let (mut wrong, mut new_words, mut novel) = (0, 0, 0);
    for sentence in &sentences {
        let novelty = captions.novelty(sentence);
        if !novelty.allows(sentence.phrasing) {
            wrong += 1;
            let (phrasing, text) = (sentence.phrasing, &sentence.text);
            writeln!(page, "\nnot {phrasing}: {text} ({novelty:?})")?;
        }
        if sentence.phrasing == Phrasing::Novel {
            novel += 1;
            new_words += usize::from(!novelty.words.is_empty());
        }
    }
    let valid = validations.iter().filter(|row| row.is_valid()).count();
    writeln!(
        page,
        "\n{valid} of {} checks are good enough. {} sentences, {novel} of them novel, {new_words} of these with a word that no \
         caption for training has; {wrong} phrased otherwise than they say.",
        validations.len(),
        sentences.len(),
    )?;
    if let Some(folder) = out {
        let clips = clips.iter().map(|clip| {
            json!({ "name": clip.name, "content": clip.content, "captions": clip.captions, "measured": clip.measured })
        });
        let clips: Vec<_> = clips.collect();
        let file = json!({ "checks": validations, "clips": clips });
        write(folder, "validation.json", &file.to_string())?;
        write(folder, "validation.md", &page)?;
    }
    Ok((page, valid == validations.len() && wrong == 0))
}

/// Returns the captions of a split as sentences, with the checks that their motions pass.
fn captions(data: &Path, split: Split) -> Result<Vec<Sentence>, Box<dyn Error>> {
    /// The number of motions for every check.
    const MOTIONS: usize = 4;
    let dataset = Dataset::open(data, &LoadOptions::default(), &mut |_| ())?;
    let sentences = captioned(&clips(&dataset, dataset.split(split))?, MOTIONS);
    if sentences.is_empty() {
        return Err(format!(
            "{}: no motion of the split {split} shows what a check looks at",
            data.display()
        )
        .into());
    }
    Ok(sentences)
}

/// Measures the motions of some entries.
fn clips<'a>(
    dataset: &Dataset,
    entries: impl IntoIterator<Item = &'a Entry>,
) -> Result<Vec<Clip>, Box<dyn Error>> {
    let clips = entries.into_iter().map(|entry| {
        let motion = dataset.motion(entry)?;
        let captions = entry.captions.iter().map(|caption| caption.text.clone());
        Ok(Clip {
            name: entry.name.clone(),
            content: entry.content.clone().unwrap_or_default(),
            seconds: motion.seconds(),
            styled: entry.style.is_some(),
            captions: captions.collect(),
            measured: Measurements::of(&motion),
        })
    });
    clips.collect()
}

/// Writes a file to a folder, which is created if it does not exist.
fn write(folder: &Path, name: &str, text: &str) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let path = folder.join(name);
    write_atomically(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| format!("cannot write {}: {error}", path.display()).into())
}
