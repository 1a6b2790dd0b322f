//! One seed, one motion: bit for bit, on any number of threads.

use std::ops::ControlFlow;

use lamogen::{Body, Device, Guidance, LaMoGen, Motion, Pass, Preset, Request, RootMotion, Tag};

#[test]
fn a_seed_gives_the_same_motion_on_any_number_of_threads() {
    let requests = [
        Request::new("a person jumps")
            .tag(Tag::Strong)
            .frames(120)
            .seed(7),
        Request::new("a person walks forward")
            .tag(Tag::Near)
            .frames(40)
            .seed(8),
        Request::new("a person waves").frames(77).seed(9),
    ]
    .map(|request| request.steps(8));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let model = LaMoGen::embedded(&Device::flex()).unwrap();
            let results = model.generate_all(&requests).unwrap();
            let motions = results
                .into_iter()
                .flat_map(|result| [result.baseline, result.guided]);
            motions.collect::<Vec<Motion>>()
        })
    };
    let first = run(1);
    for threads in [1, 2, 3, 7] {
        assert!(
            run(threads) == first,
            "{threads} threads gave another motion than one"
        );
    }
}

/// Generates a motion, and returns it with the number of steps of its first pass.
fn generate(model: &LaMoGen, request: &Request) -> ([Motion; 2], usize) {
    let mut steps = 0;
    let generation = model.generate_with(request, &mut |progress| {
        steps += usize::from(progress.step.pass == Pass::Baseline);
        ControlFlow::Continue(())
    });
    let generation = generation.unwrap();
    ([generation.baseline, generation.guided], steps)
}

#[test]
fn a_kept_baseline_gives_the_same_motion_and_only_where_all_but_the_goals_is_the_same() {
    let fresh = LaMoGen::embedded(&Device::flex()).unwrap();
    let keeping = LaMoGen::embedded(&Device::flex())
        .unwrap()
        .with_kept_baselines(2);
    let walk = Request::new("a person walks").frames(40).steps(4).seed(3);
    let network = Guidance {
        body: Body::Network,
        ..Preset::Precise.guidance()
    };
    for (request, steps) in [
        (walk.clone().tag(Tag::Strong), 4),
        (walk.clone().tag(Tag::Near), 0),
        (walk.clone(), 0),
        (walk.clone().root_motion(RootMotion::None).tag(Tag::Free), 0),
        (walk.clone().seed(4).tag(Tag::Near), 4),
        (walk.clone().tag(Tag::Light), 0),
        // The one that has not been used for longest makes room.
        (walk.clone().frames(41).tag(Tag::Near), 4),
        (walk.clone().seed(4), 4),
        (walk.clone().steps(5), 5),
        (walk.clone().looped(true), 4),
        (walk.clone().guidance(network).tag(Tag::Near), 4),
        (Request::new("a person runs").frames(40).steps(4).seed(3), 4),
    ] {
        let (motions, made) = generate(&keeping, &request);
        assert_eq!(made, steps, "{request:?}");
        assert!(motions == generate(&fresh, &request).0, "{request:?}");
    }
}
