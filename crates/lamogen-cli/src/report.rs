//! Measurements of motions, as text and as JSON.

use std::fmt::Write;
use std::ops::Range;

use lamogen::motion::{BoneDrift, FootSliding, JointTurn};
use lamogen::{
    COMPONENTS, Component, FRAMES_PER_SECOND, GeneratedSentence, Goals, JOINTS, Joint,
    LabanOptions, LabanSeries, Motion, PartLaban, PlaceOutcome, TimeSummary,
};
use serde_json::{Map, Value, json};

use crate::scene::{Scene, SceneMotion, seconds};

/// The number of peaks that the text lists.
const PEAKS: usize = 3;

/// Returns the complete JSON of a scene: its facts, and every motion with measurements, series and joint positions.
pub fn scene_json(scene: &Scene) -> Value {
    let mut whole = measurement_json(scene);
    let motions = whole.get_mut("motions").and_then(Value::as_array_mut);
    for (motion, scene_motion) in motions.into_iter().flatten().zip(&scene.motions) {
        motion["joints"] = joint_positions(&scene_motion.motion);
    }
    whole.into()
}

/// Returns the JSON of a scene with the measurements of every frame, but without joint positions.
pub fn measurement_json(scene: &Scene) -> Map<String, Value> {
    let mut whole = scene_facts(scene);
    let motions = scene.motions.iter().map(|scene_motion| {
        let mut motion = motion_measurements(scene_motion);
        motion.insert("series".into(), laban_series(&scene_motion.laban));
        Value::from(motion)
    });
    whole.insert("motions".into(), motions.collect());
    let target = scene.asked_target().map(|target| {
        json!({
            "laban": without_free(laban_summaries(target), scene),
            "series": without_free(laban_series(target), scene),
        })
    });
    whole.insert("target".into(), target.into());
    whole
}

/// Returns the Laban features of the parts of the body that have goals of their own, and of the rest. Returns `None`
/// if no part has goals.
fn part_features(scene: &Scene) -> Option<Value> {
    let parts = scene.parts.iter().map(|part| {
        let mut laban = Map::new();
        for (which, series) in [
            ("baseline", &part.baseline),
            ("target", &part.target),
            ("guided", &part.guided),
        ] {
            let mut summaries = laban_summaries(series);
            // Shape is measured on the whole body only.
            if let Some(summaries) = summaries.as_object_mut() {
                summaries.remove(&component_key(Component::Shape));
            }
            laban.insert(which.into(), summaries);
        }
        json!({ "part": part.end_effectors.to_string(), "laban": laban })
    });
    let parts: Vec<Value> = parts.collect();
    (!parts.is_empty()).then(|| parts.into())
}

/// Returns how near the main motion comes to the places that were asked for, in metres. Returns `None` if there are none.
fn place_outcomes(scene: &Scene) -> Option<Value> {
    let places = scene.places.iter().map(|place| {
        json!({
            "place": place.name,
            "seconds": place.seconds,
            "asked_m": place.asked,
            "reached_m": place.reached,
            "off_m": place.distance(),
        })
    });
    let places: Vec<Value> = places.collect();
    (!places.is_empty()).then(|| places.into())
}

/// Returns the JSON of a scene without the numbers of every frame.
pub fn summary_json(scene: &Scene) -> Map<String, Value> {
    let mut whole = scene_facts(scene);
    let motions = scene
        .motions
        .iter()
        .map(|scene_motion| Value::from(motion_measurements(scene_motion)));
    whole.insert("motions".into(), motions.collect());
    if let Some(target) = scene.asked_target() {
        let laban = without_free(laban_summaries(target), scene);
        whole.insert("target".into(), json!({ "laban": laban }));
    }
    whole
}

/// Removes the components that may become anything from a JSON object with a value for every component.
fn without_free(mut values: Value, scene: &Scene) -> Value {
    if let Some(values) = values.as_object_mut() {
        for component in Component::ALL {
            if scene.free[component.index()] {
                values.remove(&component_key(component));
            }
        }
    }
    values
}

/// Returns the facts about a scene, without its motions.
fn scene_facts(scene: &Scene) -> Map<String, Value> {
    let mut whole = Map::new();
    let generator = concat!("lamogen ", env!("CARGO_PKG_VERSION"));
    whole.insert("generator".into(), generator.into());
    whole.insert("title".into(), scene.title.as_str().into());
    whole.extend(scene.facts.clone());
    whole.extend(part_features(scene).map(|parts| ("parts".to_owned(), parts)));
    whole.extend(place_outcomes(scene).map(|places| ("places".to_owned(), places)));
    whole.insert("frames_per_second".into(), FRAMES_PER_SECOND.into());
    whole
}

/// Returns the measurements of a motion, in metres and seconds.
fn motion_measurements(scene_motion: &SceneMotion) -> Map<String, Value> {
    let (sliding, drift) = (
        FootSliding::of(&scene_motion.motion),
        BoneDrift::of(&scene_motion.motion),
    );
    let measured = json!({
        "label": scene_motion.label,
        "frames": scene_motion.motion.frames(),
        "seconds": scene_motion.motion.seconds(),
        "laban": laban_summaries(&scene_motion.laban),
        "foot_sliding": {
            "ratio": sliding.ratio,
            "left_m": sliding.distance[0],
            "right_m": sliding.distance[1],
            "speed_m_s": sliding.speed,
        },
        "bone_drift": {
            "largest_m": drift.largest(),
            "joint": drift.worst.name(),
            "seconds": seconds(drift.frame),
            "lengths_m": Joint::ALL.into_iter().map(|joint| (joint.name().to_owned(), drift.lengths[joint.index()].into()))
                .collect::<Map<String, Value>>(),
        },
        "turning": turning_json(scene_motion),
    });
    measured.as_object().cloned().unwrap_or_default()
}

/// Returns how far joints turn from one frame to the next, in degrees.
fn turning_json(scene_motion: &SceneMotion) -> Value {
    let turning = scene_motion.turning();
    let measurements = |mean: f32, largest: JointTurn| {
        json!({
            "mean_deg": mean,
            "largest_deg": largest.degrees,
            "joint": largest.joint.name(),
            "seconds": seconds(largest.frame),
        })
    };
    let joints = Joint::ALL.into_iter().map(|joint| {
        let mut measured = measurements(turning.mean(joint), turning.largest(joint));
        // The name of the joint is the key already.
        if let Some(measured) = measured.as_object_mut() {
            measured.remove("joint");
        }
        (joint.name().to_owned(), measured)
    });
    let joints: Map<String, Value> = joints.collect();
    let mut whole = measurements(
        turning.mean_without_pelvis(),
        turning.largest_without_pelvis(),
    );
    whole["rotations"] = match scene_motion.has_file_turning() {
        true => "file".into(),
        false if scene_motion.motion.is_rigid() => "rig".into(),
        false => "solved".into(),
    };
    whole["pelvis"] = joints[Joint::Pelvis.name()].clone();
    whole["joints"] = joints.into();
    whole
}

/// Returns the maximum over time, the mean over time and the peaks of every component.
fn laban_summaries(laban: &LabanSeries) -> Value {
    let mut summaries = section_summaries(laban);
    for component in Component::ALL {
        let values: Vec<f32> = laban.component(component).collect();
        let peaks = laban.peaks(component).into_iter();
        let peaks = peaks.map(|frame| json!({ "seconds": seconds(frame), "value": values[frame] }));
        summaries[component_key(component)]["peaks"] = peaks.collect();
    }
    summaries
}

/// Returns the maximum and the mean of every component, without the moments of peaks, which are those of a whole motion.
pub fn section_summaries(section: &LabanSeries) -> Value {
    let [maxima, means] = maxima_and_means(section);
    by_component(|component| {
        let at = component.index();
        json!({ "maximum": maxima[at], "mean": means[at] })
    })
}

/// Returns the maximum and the mean over time of every component.
fn maxima_and_means(laban: &LabanSeries) -> [[f32; COMPONENTS]; 2] {
    [TimeSummary::Maximum, TimeSummary::Mean].map(|summary| laban.summary(summary))
}

/// Returns the values of every component at every frame.
fn laban_series(laban: &LabanSeries) -> Value {
    by_component(|component| laban.component(component).collect())
}

/// Returns a JSON object with a value for every component.
fn by_component(value: impl Fn(Component) -> Value) -> Value {
    let named = Component::ALL.map(|component| (component_key(component), value(component)));
    Value::Object(named.into_iter().collect())
}

/// Returns the JSON key of a component: its name in lower case.
pub fn component_key(component: Component) -> String {
    component.to_string().to_lowercase()
}

/// Returns the positions of the joints in metres, rounded to a tenth of a millimetre.
fn joint_positions(motion: &Motion) -> Value {
    let round = |x: f32| (f64::from(x) * 1e4).round() / 1e4;
    let pose = |pose: &[[f32; 3]; JOINTS]| json!(pose.map(|point| point.map(round)).to_vec());
    motion.joints().iter().map(pose).collect()
}

/// Formats the measurements of a motion as a table.
pub fn measurement_table(scene_motion: &SceneMotion) -> String {
    let (sliding, drift) = (
        FootSliding::of(&scene_motion.motion),
        BoneDrift::of(&scene_motion.motion),
    );
    let laban = &scene_motion.laban;
    let [maxima, means] = maxima_and_means(laban);
    let mut text = format!(
        "{:<12} {:>10} {:>10}   {:13} peaks at\n",
        "", "maximum", "mean", "unit"
    );
    for component in Component::ALL {
        let at = component.index();
        let peaks = laban.peaks(component).into_iter().take(PEAKS);
        let peaks: Vec<String> = peaks
            .map(|frame| format!("{:.2} s", seconds(frame)))
            .collect();
        writeln!(
            text,
            "{component:<12} {:>10} {:>10}   {:13} {}",
            format_value(maxima[at]),
            format_value(means[at]),
            component.unit(),
            peaks.join(", ")
        )
        .expect("a string takes all");
    }
    writeln!(
        text,
        "body size    {:.2} m along the bones from ankle to hip and from pelvis to head",
        body_size(&drift)
    )
    .expect("a string takes all");
    writeln!(
        text,
        "sliding feet {:.0} % of the steps; {:.2} m left, {:.2} m right; {:.2} m/s while they stand",
        100.0 * sliding.ratio,
        sliding.distance[0],
        sliding.distance[1],
        sliding.speed
    )
    .expect("a string takes all");
    writeln!(
        text,
        "bone drift   {:.1} mm at most ({}, {:.2} s)",
        1e3 * drift.largest(),
        drift.worst.name(),
        seconds(drift.frame)
    )
    .expect("a string takes all");
    let turning = scene_motion.turning();
    let (largest, pelvis) = (
        turning.largest_without_pelvis(),
        turning.largest(Joint::Pelvis),
    );
    writeln!(
        text,
        "turning      {:.1}° a frame on average; largest {:.0}° ({}, {:.2} s); pelvis {:.1}°, largest {:.0}° ({:.2} s)",
        turning.mean_without_pelvis(),
        largest.degrees,
        largest.joint.name(),
        seconds(largest.frame),
        turning.mean(Joint::Pelvis),
        pelvis.degrees,
        seconds(pelvis.frame)
    )
    .expect("a string takes all");
    text
}

/// Returns the size of the body along its bones in metres; that of an adult is 1.48.
fn body_size(bones: &BoneDrift) -> f32 {
    use Joint::*;
    let along = [LeftKnee, LeftAnkle, Spine1, Spine2, Spine3, Neck, Head];
    along.map(|joint| bones.lengths[joint.index()]).iter().sum()
}

/// Formats a number with four decimal places; numbers below 0.001 are written with an exponent.
fn format_value(number: f32) -> String {
    match number != 0.0 && number.abs() < 1e-3 {
        true => format!("{number:.2e}"),
        false => format!("{number:.4}"),
    }
}

/// Formats a table of the Laban features of two motions.
pub fn comparison_table(columns: [&str; 2], before: &LabanSeries, after: &LabanSeries) -> String {
    let all = Component::ALL.into_iter().map(|c| (c, false));
    format_comparison(columns, before, after, None, all)
}

/// Formats tables of the guided motion of a scene beside the baseline: of the whole body, and of the parts of the body
/// that have goals of their own.
pub fn guidance_table(
    scene: &Scene,
    baseline: &SceneMotion,
    guided: &SceneMotion,
    target: &LabanSeries,
) -> String {
    let (before, after) = (&baseline.laban, &guided.laban);
    let columns = ["baseline", "guided"];
    let captions = &guided.captions;
    let tables = match captions.is_empty() {
        true => {
            let all = Component::ALL.into_iter().zip(scene.free);
            let table = format_comparison(columns, before, after, Some(target), all);
            table + &part_tables(&scene.parts)
        }
        // What was asked of one sentence says nothing about the largest values of the whole motion.
        false => {
            let sentences = scene.sentences.iter().zip(captions);
            let tables = sentences.map(|(GeneratedSentence { frames, goals, .. }, caption)| {
                let [before, after, target] =
                    [before, after, target].map(|series| series.section(frames.clone()));
                let rows = Component::ALL.into_iter().map(|c| (c, goals.is_free(c)));
                let table = format_comparison(columns, &before, &after, Some(&target), rows);
                let parts = parts_of_sentence(scene, goals, frames);
                format!("{caption}\n{table}{}", part_tables(&parts))
            });
            tables.collect::<Vec<String>>().join("\n")
        }
    };
    tables + &place_table(&scene.places)
}

/// Formats the largest and the mean values of a motion in the frames of each caption; nothing if it has none.
pub fn caption_table(scene_motion: &SceneMotion) -> String {
    let mut text = String::new();
    for caption in &scene_motion.captions {
        let section = scene_motion.laban.section(caption.frames.clone());
        let [maxima, means] = maxima_and_means(&section);
        text += &format!("\n{caption}\n");
        for component in Component::ALL {
            let at = component.index();
            let [maximum, mean] = [maxima[at], means[at]].map(format_value);
            let unit = component.unit();
            writeln!(text, "{component:<12} {maximum:>10} {mean:>10}   {unit}")
                .expect("a string takes all");
        }
    }
    text
}

/// Returns the features, in the frames of a sentence, of those parts of the body that it has goals for, and of the rest.
fn parts_of_sentence(scene: &Scene, goals: &Goals, frames: &Range<usize>) -> Vec<PartLaban> {
    let sets = goals.terms(&LabanOptions::default().end_effectors);
    let has_goals = |part: &&PartLaban| {
        let mut sets = sets.iter().skip(1);
        sets.any(|term| term.end_effectors == part.end_effectors)
    };
    let parts = scene.parts.iter().filter(has_goals);
    parts.map(|part| part.section(frames.clone())).collect()
}

/// Formats a table of the places that were asked for, with what was reached.
fn place_table(places: &[PlaceOutcome]) -> String {
    if places.is_empty() {
        return String::new();
    }
    let numbers = |values: [Option<f32>; 3]| {
        let values = values.into_iter().flatten();
        let values: Vec<String> = values.map(|x| format!("{x:.2}")).collect();
        values.join(", ")
    };
    let mut text = format!(
        "\n{:24} {:>18} {:>18} {:>9}\n",
        "place, metres", "asked", "reached", "off"
    );
    for place in places {
        let (asked, reached) = (place.asked, place.reached);
        // A place of a path has no height.
        let reached = std::array::from_fn(|axis| asked[axis].map(|_| reached[axis]));
        writeln!(
            text,
            "{:24} {:>18} {:>18} {:>6.1} cm",
            format!("{} at {} s", place.name, place.seconds),
            numbers(asked),
            numbers(reached),
            100.0 * place.distance()
        )
        .expect("a string takes all");
    }
    text
}

/// Formats a table for each part of the body that has goals of its own.
fn part_tables(parts: &[PartLaban]) -> String {
    let parts = parts.iter().map(|part| {
        let PartLaban {
            end_effectors,
            baseline,
            target,
            guided,
            ..
        } = part;
        let columns = ["baseline", "guided"];
        let efforts = Component::EFFORTS.into_iter().map(|c| (c, false));
        let table = format_comparison(columns, baseline, guided, Some(target), efforts);
        format!("\n{end_effectors}\n{table}")
    });
    parts.collect()
}

/// Formats a table of the Laban features before and after a change, and of the target, if there is one.
///
/// `components` are the rows of the table, each with whether the component may become anything; the table marks those.
fn format_comparison(
    columns: [&str; 2],
    before: &LabanSeries,
    after: &LabanSeries,
    target: Option<&LabanSeries>,
    components: impl Iterator<Item = (Component, bool)> + Clone,
) -> String {
    let mut text = String::new();
    for (summary, title) in [
        (TimeSummary::Maximum, "maximum over time"),
        (TimeSummary::Mean, "mean over time"),
    ] {
        let [before, after] = [before, after].map(|laban| laban.summary(summary));
        let target = target.map(|laban| laban.summary(summary));
        let asked = target.map(|_| format!(" {:>10} {:>9}", "target", "asked"));
        writeln!(
            text,
            "{title:18} {:>12} {:>12} {:>9}{}",
            columns[0],
            columns[1],
            "change",
            asked.unwrap_or_default()
        )
        .expect("a string takes all");
        for (component, is_free) in components.clone() {
            let at = component.index();
            let asked = target.map(|target: [f32; COMPONENTS]| match is_free {
                true => format!(" {:>10} {:>9}", "any", ""),
                false => format!(
                    " {:>10} {:>9}",
                    format_value(target[at]),
                    format_change(before[at], target[at])
                ),
            });
            writeln!(
                text,
                "{component:18} {:>12} {:>12} {:>9}{}",
                format_value(before[at]),
                format_value(after[at]),
                format_change(before[at], after[at]),
                asked.unwrap_or_default()
            )
            .expect("a string takes all");
        }
    }
    text
}

/// Formats the relative change of a value in percent.
fn format_change(before: f32, after: f32) -> String {
    match before > 0.0 {
        // Adding 0.0 turns a change of -0 into one of +0.
        true => format!("{:+.0}%", (100.0 * (after / before - 1.0)).round() + 0.0),
        false => "–".into(),
    }
}
