//! One seed, one motion: bit for bit, on any number of threads.

use lamogen::{Device, LaMoGen, Motion, Request, Tag};

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
