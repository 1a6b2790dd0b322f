//! What is measured of motions, as text and as JSON.

use std::fmt::Write;

use lamogen::motion::{BoneDrift, FootSliding, JointTurn};
use lamogen::{
    COMPONENTS, Component, FRAMES_PER_SECOND, JOINTS, Joint, LabanSeries, Motion, PartLaban,
    TimeSummary,
};
use serde_json::{Map, Value, json};

use crate::scene::{Scene, Shown, seconds};

/// Peaks that are named.
const PEAKS: usize = 3;

/// Everything about a scene: its facts, and every motion with measures, series and joints.
pub fn everything(scene: &Scene) -> Value {
    let mut whole = measured(scene);
    let motions = whole.get_mut("motions").and_then(Value::as_array_mut);
    for (motion, shown) in motions.into_iter().flatten().zip(&scene.motions) {
        motion["joints"] = joints(&shown.motion);
    }
    whole.into()
}

/// Everything that is measured of a scene, frame by frame, without the joints themselves.
pub fn measured(scene: &Scene) -> Map<String, Value> {
    let mut whole = facts(scene);
    let motions = scene.motions.iter().map(|shown| {
        let mut motion = measures(shown);
        motion.insert("series".into(), series(&shown.laban));
        Value::from(motion)
    });
    whole.insert("motions".into(), motions.collect());
    let target = scene.target.as_ref();
    whole.insert(
        "target".into(),
        target.map_or(
            Value::Null,
            |target| json!({ "laban": summaries(target), "series": series(target) }),
        ),
    );
    whole
}

/// Laban features of the parts that have goals of their own, and of the rest.
fn parts(scene: &Scene) -> Option<Value> {
    let parts = scene.parts.iter().map(|part| {
        let mut laban = Map::new();
        for (which, series) in [
            ("baseline", &part.baseline),
            ("target", &part.target),
            ("guided", &part.guided),
        ] {
            let mut found = summaries(series);
            // Shape is that of the whole body.
            if let Some(found) = found.as_object_mut() {
                found.remove(&name(Component::Shape));
            }
            laban.insert(which.into(), found);
        }
        json!({ "part": part.end_effectors.to_string(), "laban": laban })
    });
    let parts: Vec<Value> = parts.collect();
    (!parts.is_empty()).then(|| parts.into())
}

/// A scene's facts and measures without the numbers of every frame.
pub fn summary(scene: &Scene) -> Map<String, Value> {
    let mut whole = facts(scene);
    let motions = scene
        .motions
        .iter()
        .map(|shown| Value::from(measures(shown)));
    whole.insert("motions".into(), motions.collect());
    if let Some(target) = &scene.target {
        whole.insert("target".into(), json!({ "laban": summaries(target) }));
    }
    whole
}

fn facts(scene: &Scene) -> Map<String, Value> {
    let mut whole = Map::new();
    let generator = concat!("lamogen ", env!("CARGO_PKG_VERSION"));
    whole.insert("generator".into(), generator.into());
    whole.insert("title".into(), scene.title.as_str().into());
    whole.extend(scene.facts.clone());
    whole.extend(parts(scene).map(|parts| ("parts".to_owned(), parts)));
    whole.insert("frames_per_second".into(), FRAMES_PER_SECOND.into());
    whole
}

/// What is measured of a motion, in metres and seconds.
pub fn measures(shown: &Shown) -> Map<String, Value> {
    let (sliding, drift) = (FootSliding::of(&shown.motion), BoneDrift::of(&shown.motion));
    let measured = json!({
        "label": shown.label,
        "frames": shown.motion.frames(),
        "seconds": shown.motion.seconds(),
        "laban": summaries(&shown.laban),
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
        "turning": turning(shown),
    });
    measured.as_object().cloned().unwrap_or_default()
}

/// How fast joints turn, in degrees from one frame to the next.
fn turning(shown: &Shown) -> Value {
    let turning = shown.turning();
    let of = |mean: f32, largest: JointTurn| {
        json!({
            "mean_deg": mean,
            "largest_deg": largest.degrees,
            "joint": largest.joint.name(),
            "seconds": seconds(largest.frame),
        })
    };
    let joints = Joint::ALL.into_iter().map(|joint| {
        let mut measured = of(turning.mean(joint), turning.largest(joint));
        // It stands under its name.
        if let Some(measured) = measured.as_object_mut() {
            measured.remove("joint");
        }
        (joint.name().to_owned(), measured)
    });
    let joints: Map<String, Value> = joints.collect();
    let mut whole = of(turning.mean_but_pelvis(), turning.largest_but_pelvis());
    whole["rotations"] = match shown.turns_as_its_file() {
        true => "file".into(),
        false if shown.motion.is_rigid() => "rig".into(),
        false => "solved".into(),
    };
    whole["pelvis"] = joints[Joint::Pelvis.name()].clone();
    whole["joints"] = joints.into();
    whole
}

fn summaries(laban: &LabanSeries) -> Value {
    let (maxima, means) = (
        laban.summary(TimeSummary::Maximum),
        laban.summary(TimeSummary::Mean),
    );
    by_component(|component| {
        let at = component.index();
        let values: Vec<f32> = laban.component(component).collect();
        let peaks = laban.peaks(component).into_iter();
        let peaks = peaks.map(|frame| json!({ "seconds": seconds(frame), "value": values[frame] }));
        json!({ "maximum": maxima[at], "mean": means[at], "peaks": peaks.collect::<Vec<_>>() })
    })
}

fn series(laban: &LabanSeries) -> Value {
    by_component(|component| laban.component(component).collect())
}

fn by_component(value: impl Fn(Component) -> Value) -> Value {
    let named = Component::ALL.map(|component| (name(component), value(component)));
    Value::Object(named.into_iter().collect())
}

pub fn name(component: Component) -> String {
    component.to_string().to_lowercase()
}

/// Metres to a tenth of a millimetre are exact enough.
fn joints(motion: &Motion) -> Value {
    let tenths = |x: f32| (f64::from(x) * 1e4).round() / 1e4;
    let pose = |pose: &[[f32; 3]; JOINTS]| json!(pose.map(|point| point.map(tenths)).to_vec());
    motion.joints().iter().map(pose).collect()
}

/// What a motion measures, for people.
pub fn text(shown: &Shown) -> String {
    let (sliding, drift) = (FootSliding::of(&shown.motion), BoneDrift::of(&shown.motion));
    let laban = &shown.laban;
    let (maxima, means) = (
        laban.summary(TimeSummary::Maximum),
        laban.summary(TimeSummary::Mean),
    );
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
            value(maxima[at]),
            value(means[at]),
            component.unit(),
            peaks.join(", ")
        )
        .expect("a string takes all");
    }
    writeln!(
        text,
        "body size    {:.2} m along the bones from ankle to hip and from pelvis to head",
        size(&drift)
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
    let turning = shown.turning();
    let (largest, pelvis) = (turning.largest_but_pelvis(), turning.largest(Joint::Pelvis));
    writeln!(
        text,
        "turning      {:.1}° a frame on average; largest {:.0}° ({}, {:.2} s); pelvis {:.1}°, largest {:.0}° ({:.2} s)",
        turning.mean_but_pelvis(),
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

/// The body's size in metres; 1.48 on an adult.
fn size(bones: &BoneDrift) -> f32 {
    use Joint::*;
    let along = [LeftKnee, LeftAnkle, Spine1, Spine2, Spine3, Neck, Head];
    along.map(|joint| bones.lengths[joint.index()]).iter().sum()
}

/// A number with four places, or as many as it takes to see something.
fn value(number: f32) -> String {
    match number != 0.0 && number.abs() < 1e-3 {
        true => format!("{number:.2e}"),
        false => format!("{number:.4}"),
    }
}

/// Two series beside each other.
pub fn comparison(columns: [&str; 2], before: &LabanSeries, after: &LabanSeries) -> String {
    let all = Component::ALL.into_iter().map(|c| (c, false));
    compared(columns, before, after, None, all)
}

/// The guided motion of a scene beside the baseline, and its parts that have goals of their own.
pub fn guided(scene: &Scene, baseline: &Shown, guided: &Shown, target: &LabanSeries) -> String {
    let all = Component::ALL.into_iter().zip(scene.free);
    let (before, after) = (&baseline.laban, &guided.laban);
    let table = compared(["baseline", "guided"], before, after, Some(target), all);
    table + &parts_compared(scene)
}

/// The parts of the body.
fn parts_compared(scene: &Scene) -> String {
    let parts = scene.parts.iter().map(|part| {
        let PartLaban {
            end_effectors,
            baseline,
            target,
            guided,
            ..
        } = part;
        let columns = ["baseline", "guided"];
        let efforts = Component::EFFORTS.into_iter().map(|c| (c, false));
        let table = compared(columns, baseline, guided, Some(target), efforts);
        format!("\n{end_effectors}\n{table}")
    });
    parts.collect()
}

/// The first series, what came out, and what was asked for; components that may become anything are marked.
fn compared(
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
                    value(target[at]),
                    change(before[at], target[at])
                ),
            });
            writeln!(
                text,
                "{component:18} {:>12} {:>12} {:>9}{}",
                value(before[at]),
                value(after[at]),
                change(before[at], after[at]),
                asked.unwrap_or_default()
            )
            .expect("a string takes all");
        }
    }
    text
}

fn change(before: f32, after: f32) -> String {
    match before > 0.0 {
        // A change that rounds to nothing has no sign of its own.
        true => format!("{:+.0}%", (100.0 * (after / before - 1.0)).round() + 0.0),
        false => "–".into(),
    }
}
