//! The report on generated motions: success rates, failures, and the quality of the motions.

use std::fmt::Write;

use lamogen_motion::{FootSliding, Jitter, Joint, JointTurning, Motion};
use serde::Serialize;

use super::measurements::Measurements;
use super::sentences::{Phrasing, Sentence};
use super::verdict::Verdict;

/// The results of one motion that was generated from a sentence.
#[derive(Clone, Debug, Serialize)]
pub struct TruthTrial {
    /// The index of the sentence in the report.
    pub sentence: usize,
    /// The seed of the initial noise.
    pub seed: u64,
    /// Whether all checks of the sentence hold.
    pub holds: bool,
    /// The verdict of each check.
    pub verdicts: Vec<Verdict>,
    /// The quality of the motion.
    pub quality: Quality,
    /// All measurements of the motion.
    pub measured: Measurements,
}

/// Measures of how real a motion looks, whatever its action is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// The greatest angle that the pelvis turns from one frame to the next, degrees.
    pub pelvis_turn: f32,
    /// The mean jerk of all joints, m/s³ (see [`Jitter`]).
    pub jerk: f32,
    /// The share of the motion in which a standing foot slides, 0 to 1 (see [`FootSliding`]).
    pub sliding_share: f32,
    /// The mean speed of a standing foot, m/s.
    pub sliding_speed: f32,
}

impl Quality {
    /// Measures a motion on its joint positions, and on the rotations that are written to files.
    pub fn of(motion: &Motion) -> Quality {
        let (jitter, sliding) = (Jitter::of(motion), FootSliding::of(motion));
        let turning = JointTurning::of(&motion.rotations());
        Quality {
            pelvis_turn: turning.largest(Joint::Pelvis).degrees,
            jerk: jitter.jerk,
            sliding_share: sliding.ratio,
            sliding_speed: sliding.speed,
        }
    }

    /// Returns whether the pelvis turns more than 60 degrees between two frames, which no real body does.
    pub fn snaps(&self) -> bool {
        self.pelvis_turn > super::limits::PELVIS_SNAP
    }
}

/// Sentences with the results of the motions that were generated from them.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The sentences.
    pub sentences: Vec<Sentence>,
    /// The results of the motions.
    pub trials: Vec<TruthTrial>,
}

/// The number of motions that do what their sentence says, of a number of motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SuccessRate {
    /// The number of motions that do.
    pub hold: usize,
    /// The number of all motions.
    pub of: usize,
}

impl SuccessRate {
    /// Returns the share of motions that do what their sentence says, 0 to 1; `None` if there are no motions.
    pub fn ratio(self) -> Option<f32> {
        (self.of > 0).then(|| self.hold as f32 / self.of as f32)
    }

    /// Returns the share in percent; a dash if there are no motions.
    fn percent(self) -> String {
        match self.ratio() {
            Some(ratio) => format!("{:.0} %", 100.0 * ratio),
            None => "–".into(),
        }
    }
}

impl Report {
    /// Returns a report without motions.
    pub fn new(sentences: Vec<Sentence>) -> Report {
        Report {
            sentences,
            trials: Vec::new(),
        }
    }

    /// Checks a motion of the sentence with the index `sentence` and adds the result.
    ///
    /// # Panics
    ///
    /// If there is no such sentence.
    pub fn add(&mut self, sentence: usize, seed: u64, motion: &Motion) {
        let measured = Measurements::of(motion);
        let checks = self.sentences[sentence].checks.iter();
        let verdicts: Vec<Verdict> = checks.map(|check| check.judge(&measured)).collect();
        self.trials.push(TruthTrial {
            sentence,
            seed,
            holds: verdicts.iter().all(Verdict::holds),
            verdicts,
            quality: Quality::of(motion),
            measured,
        });
    }

    /// Returns the success rate of the motions of those sentences for which `includes` is true.
    pub fn share(&self, mut includes: impl FnMut(&Sentence) -> bool) -> SuccessRate {
        let mut rate = SuccessRate::default();
        for trial in &self.trials {
            if includes(&self.sentences[trial.sentence]) {
                rate.of += 1;
                rate.hold += usize::from(trial.holds);
            }
        }
        rate
    }

    /// Returns the success rate of all motions.
    pub fn overall(&self) -> SuccessRate {
        self.share(|_| true)
    }

    /// Returns the success rate of the motions of sentences with a phrasing.
    pub fn of_phrasing(&self, phrasing: Phrasing) -> SuccessRate {
        self.share(|sentence| sentence.phrasing == phrasing)
    }

    /// Returns the groups, in the order of the sentences.
    pub fn groups(&self) -> Vec<&str> {
        let mut groups: Vec<&str> = Vec::new();
        for sentence in &self.sentences {
            if !groups.contains(&&*sentence.group) {
                groups.push(&sentence.group);
            }
        }
        groups
    }

    /// Returns the results of the motions of a sentence.
    pub fn trials_of(&self, sentence: usize) -> impl Iterator<Item = &TruthTrial> {
        let trials = self.trials.iter();
        trials.filter(move |trial| trial.sentence == sentence)
    }

    /// Returns the success rate of each sentence, in the order of the sentences.
    pub fn shares(&self) -> Vec<SuccessRate> {
        let rate = |sentence: usize| SuccessRate {
            hold: self.trials_of(sentence).filter(|trial| trial.holds).count(),
            of: self.trials_of(sentence).count(),
        };
        (0..self.sentences.len()).map(rate).collect()
    }

    /// Returns the indices of the sentences for which fewer than half of the motions do what the sentence says.
    pub fn failing(&self) -> Vec<usize> {
        let rates = self.shares().into_iter().enumerate();
        let failing = rates.filter(|(_, rate)| 2 * rate.hold < rate.of);
        failing.map(|(sentence, _)| sentence).collect()
    }

    /// Returns, for the motions of those sentences for which `includes` is true, the number of motions with a snap, the
    /// number of all, and the means of jerk, sliding share and sliding speed.
    fn quality(&self, mut includes: impl FnMut(&Sentence) -> bool) -> (usize, usize, [f32; 3]) {
        let trials = self.trials.iter();
        let trials = trials.filter(|trial| includes(&self.sentences[trial.sentence]));
        let qualities: Vec<Quality> = trials.map(|trial| trial.quality).collect();
        let count = qualities.len();
        let mean = |value: fn(&Quality) -> f32| {
            qualities.iter().map(value).sum::<f32>() / count.max(1) as f32
        };
        let means = [
            mean(|quality| quality.jerk),
            mean(|quality| quality.sliding_share),
            mean(|quality| quality.sliding_speed),
        ];
        let snaps = qualities.iter().filter(|quality| quality.snaps()).count();
        (snaps, count, means)
    }

    /// Returns the whole report as Markdown.
    pub fn markdown(&self) -> String {
        let mut page = String::from("# Does it do what the sentence says\n\n");
        page.push_str(&self.summary());
        page.push_str("\n## Every sentence\n\n| does | sentence | what is not so, seed by seed |\n|---|---|---|\n");
        for (index, (sentence, rate)) in self.sentences.iter().zip(self.shares()).enumerate() {
            let faults: Vec<String> = self.trials_of(index).filter_map(describe_faults).collect();
            let (hold, of, text) = (rate.hold, rate.of, &sentence.text);
            writeln!(page, "| {hold}/{of} | {text} | {} |", faults.join("; "))
                .expect("writing to a string works");
        }
        page
    }

    /// Returns the tables alone as Markdown: success rates by group and phrasing, failing sentences, quality.
    pub fn summary(&self) -> String {
        let mut page = String::from(
            "The share of motions that do all that their sentence says.\n\n\
             | group | sentences | all | training | novel |\n|---|---|---|---|---|\n",
        );
        let mut row = |name: &str, includes: &dyn Fn(&Sentence) -> bool| {
            let count = self
                .sentences
                .iter()
                .filter(|sentence| includes(sentence))
                .count();
            let [training, novel] = Phrasing::ALL.map(|phrasing| {
                let rate =
                    self.share(|sentence| includes(sentence) && sentence.phrasing == phrasing);
                rate.percent()
            });
            let all = self.share(includes).percent();
            writeln!(page, "| {name} | {count} | {all} | {training} | {novel} |")
                .expect("writing to a string works");
        };
        for group in self.groups() {
            row(group, &|sentence| sentence.group == group);
        }
        row("**all**", &|_| true);
        let failing = self.failing();
        page.push_str("\nSentences of which fewer than half of the motions do what they say: ");
        writeln!(page, "{}.\n", failing.len()).expect("writing to a string works");
        let rates = self.shares();
        for index in failing {
            let (sentence, rate) = (&self.sentences[index], rates[index]);
            let checks: Vec<String> = sentence.checks.iter().map(ToString::to_string).collect();
            writeln!(
                page,
                "- {}/{} {} ({}): {}",
                rate.hold,
                rate.of,
                sentence.text,
                sentence.phrasing,
                checks.join(", ")
            )
            .expect("writing to a string works");
        }
        page.push_str(
            "\n| motions of | pelvis turns more than 60° between two frames | jerk, m/s³ | feet slide, share | speed of standing feet, m/s |\n\
             |---|---|---|---|---|\n",
        );
        let mut row = |name: &str, includes: &dyn Fn(&Sentence) -> bool| {
            let (snaps, count, [jerk, share, speed]) = self.quality(includes);
            writeln!(
                page,
                "| {name} | {snaps} of {count} | {jerk:.0} | {share:.3} | {speed:.3} |"
            )
            .expect("writing to a string works");
        };
        for group in self.groups() {
            row(group, &|sentence| sentence.group == group);
        }
        row("**all**", &|_| true);
        page
    }
}

/// Returns the terms that do not hold in a motion; `None` if all checks hold.
fn describe_faults(trial: &TruthTrial) -> Option<String> {
    if trial.holds {
        return None;
    }
    let verdicts = trial.verdicts.iter();
    let faults = verdicts.flat_map(Verdict::faults).map(ToString::to_string);
    Some(faults.collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::read_sentences;
    use lamogen_motion::JOINTS;

    fn report() -> Report {
        let table = "still | training | 1 | a person stands | stays\n\
                     still | novel | 1 | a statue | stays\n\
                     run | novel | 1 | a rocket | runs\n";
        let mut report = Report::new(read_sentences(table).unwrap());
        let still = Motion::from_joints(vec![[[0.0, 1.0, 0.0]; JOINTS]; 20]).unwrap();
        let gone = |frame: usize| [[0.0, 1.0, 0.2 * frame as f32]; JOINTS];
        let gone = Motion::from_joints((0..20).map(gone).collect()).unwrap();
        report.add(0, 0, &still);
        report.add(0, 1, &gone);
        report.add(1, 0, &gone);
        report.add(1, 1, &gone);
        report.add(2, 0, &gone);
        report.add(2, 1, &gone);
        report
    }

    #[test]
    fn shares_are_counted_by_group_and_phrasing() {
        let report = report();
        assert_eq!(report.overall(), SuccessRate { hold: 3, of: 6 });
        assert_eq!(
            report.of_phrasing(Phrasing::Training),
            SuccessRate { hold: 1, of: 2 }
        );
        assert_eq!(
            report.of_phrasing(Phrasing::Novel),
            SuccessRate { hold: 2, of: 4 }
        );
        assert_eq!(report.groups(), ["still", "run"]);
    }

    #[test]
    fn a_sentence_fails_of_which_fewer_than_half_hold_and_the_report_says_why() {
        let report = report();
        assert_eq!(report.failing(), [1]);
        let page = report.markdown();
        assert!(page.contains("- 0/2 a statue (novel): stays"), "{page}");
        assert!(page.contains("spread 3.80 (at most 0.8)"), "{page}");
        assert!(page.contains("| run | 1 | 100 % | – | 100 % |"), "{page}");
    }

    #[test]
    fn nothing_generated_has_no_share() {
        let report = Report::new(Vec::new());
        assert_eq!(report.overall().ratio(), None);
        assert!(report.summary().contains('–'));
    }
}
