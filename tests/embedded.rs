//! What tags do to the motions of the embedded model.

use lamogen::motion::Jitter;
use lamogen::{
    Coherence, Component, Device, Generation, Guidance, LaMoGen, Preset, Request, Scale, Summary,
    Tag,
};

const PROMPTS: [&str; 4] = [
    "a person jumps",
    "a person walks forward",
    "a person waves with the left hand",
    "a person dances",
];
const SEEDS: [u64; 2] = [1, 2];

fn model() -> LaMoGen {
    LaMoGen::embedded(&Device::flex()).unwrap()
}

fn change(result: &Generation, component: Component, summary: Summary) -> f32 {
    let [before, after] = [&result.baseline_laban, &result.guided_laban]
        .map(|laban| laban.summary(summary)[component.index()]);
    after / before - 1.0
}

#[test]
fn all_components_follow_their_tags_for_every_prompt_and_seed() {
    let model = model();
    for tag in Tag::ALL {
        let cases: Vec<(&str, u64)> = PROMPTS
            .iter()
            .flat_map(|prompt| SEEDS.map(|seed| (*prompt, seed)))
            .collect();
        let requests: Vec<Request> = cases
            .iter()
            .map(|&(prompt, seed)| {
                Request::new(prompt)
                    .tag(tag)
                    .seed(seed)
                    .frames(40)
                    .steps(50)
            })
            .collect();
        let component = tag.component();
        for (case, result) in cases.iter().zip(model.generate_all(&requests).unwrap()) {
            let [maximum, mean] =
                [Summary::Maximum, Summary::Mean].map(|s| change(&result, component, s));
            let report = format!(
                "{case:?} {tag}: {component} {:+.0}% by maximum, {:+.0}% by mean, {:+.0}% asked",
                100.0 * maximum,
                100.0 * mean,
                100.0 * (tag.scale() - 1.0)
            );
            println!("{report}");
            // Of what is asked: measured 0.54 to 1.11 by the mean, 0.36 to 1.11 by the maximum.
            let asked = tag.scale() - 1.0;
            assert!((0.4..1.3).contains(&(mean / asked)), "{report}");
            assert!((0.2..1.4).contains(&(maximum / asked)), "{report}");
            let (first, last) = (result.loss[0], result.loss[result.loss.len() - 1]);
            assert!(last < first, "{report}: loss {first} to {last}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_motion_and_another_another() {
    let model = model();
    let request = Request::new("a person jumps")
        .tag(Tag::Strong)
        .frames(40)
        .steps(10);
    let first = model.generate(&request.clone().seed(5)).unwrap();
    let again = model.generate(&request.clone().seed(5)).unwrap();
    let other = model.generate(&request.seed(6)).unwrap();
    assert_eq!(first.guided, again.guided);
    assert_eq!(first.loss, again.loss);
    assert!(first.guided.distance(&other.guided) > 0.01);
}

#[test]
fn without_a_learning_rate_the_guided_motion_is_the_baseline_exactly() {
    let guidance = Guidance {
        learning_rate: 0.0,
        ..Guidance::fast()
    };
    let request = Request::new("a person jumps")
        .tag(Tag::Strong)
        .guidance(guidance);
    let result = model().generate(&request.frames(50).steps(12)).unwrap();
    assert_eq!(result.guided, result.baseline);
    assert_eq!(result.loss.len(), 12);
}

#[test]
fn a_neutral_scale_still_moves_the_embedding() {
    // Early predictions differ from the finished baseline, so the loss is not 0.
    let request = Request::new("a person jumps").scale(Scale::NEUTRAL);
    let result = model().generate(&request.frames(40).steps(12)).unwrap();
    assert_eq!(result.target, result.baseline_laban);
    assert!(result.loss[0] > 0.0);
    assert_ne!(result.guided, result.baseline);
}

#[test]
fn without_tags_the_text_alone_is_given() {
    let result = model()
        .generate(&Request::new("a person bows").frames(40).steps(8))
        .unwrap();
    assert_eq!(result.guided, result.baseline);
    assert_eq!(result.target, result.baseline_laban);
    assert!(result.loss.is_empty());
}

#[test]
fn a_batch_gives_the_motions_of_single_calls() {
    let model = model().with_batch_size(3);
    let request = |prompt: &str, tag, frames, seed| {
        Request::new(prompt)
            .tag(tag)
            .frames(frames)
            .seed(seed)
            .steps(20)
    };
    let steps_alone = Guidance {
        finish: None,
        ..Guidance::precise()
    };
    // Each update takes up the rounding of those before it. Where joints rest, a finish hardly knows which way to move them.
    let (closely, finished) = (1e-4, 4e-3);
    let requests = [
        (request("a person jumps", Tag::Strong, 60, 1), finished),
        (
            request("a person walks forward", Tag::Near, 43, 2),
            finished,
        ),
        (Request::new("a person runs").frames(50).steps(20), closely),
        (
            request("a person waves with the right hand", Tag::Light, 75, 3),
            finished,
        ),
        // Other steps, other guidance and a fourth of one kind: batches of their own.
        (
            request("a person jumps", Tag::Far, 60, 4).steps(10),
            finished,
        ),
        (
            request("a person jumps", Tag::Sudden, 60, 5).preset(Preset::Paper),
            closely,
        ),
        (request("a person bows", Tag::Free, 90, 6), finished),
        (
            request("a person waves with the right hand", Tag::Light, 75, 3)
                .guidance(steps_alone.clone()),
            closely,
        ),
        (
            request("a person bows", Tag::Free, 90, 6).guidance(steps_alone),
            closely,
        ),
    ];
    let (requests, bounds): (Vec<Request>, Vec<f32>) = requests.into_iter().unzip();
    let together = model.generate_all(&requests).unwrap();
    assert_eq!(together.len(), requests.len());
    for ((request, together), bound) in requests.iter().zip(&together).zip(bounds) {
        let alone = model.generate(request).unwrap();
        for (alone, together, bound) in [
            (&alone.baseline, &together.baseline, closely),
            (&alone.guided, &together.guided, bound),
        ] {
            assert_eq!(alone.frames(), together.frames());
            let pairs = alone.joints().as_flattened().as_flattened().iter();
            let others = together.joints().as_flattened().as_flattened();
            let largest = pairs
                .zip(others)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            println!("{largest} m: {request:?}");
            assert!(largest < bound, "{request:?}: {largest}");
        }
    }
}

#[test]
fn smoothed_predictions_make_frames_agree() {
    let requests = ["a person walks forward", "a person runs"].map(|prompt| {
        let request = Request::new(prompt).tag(Tag::Strong).frames(60);
        request.seed(3).steps(30)
    });
    let jitter = |coherence| {
        let model = model().with_coherence(coherence).unwrap();
        let motions = model.generate_all(&requests).unwrap();
        let ankles = |motion| Jitter::of(motion).ankles;
        let pairs = motions.iter();
        let pairs = pairs.map(|result| (ankles(&result.baseline), ankles(&result.guided)));
        pairs.collect::<Vec<_>>()
    };
    let (alone, together) = (jitter(None), jitter(Some(Coherence::default())));
    for (alone, together) in alone.iter().zip(&together) {
        println!("ankles, mm a frame squared: {alone:?}, smoothed {together:?}");
        assert!(together.0 < 0.7 * alone.0 && together.1 < 0.7 * alone.1);
        assert!(together.0 < 90.0 && together.1 < 90.0);
    }
}

#[test]
fn the_licence_is_shown() {
    let model = model();
    let licence = model.licence().unwrap();
    assert_eq!(licence.name, "CC-BY-NC-4.0");
    assert!(licence.is_non_commercial());
    assert!(
        licence
            .to_string()
            .contains("Bandai-Namco-Research-Motiondataset")
    );
}
