//! temp
use lamogen::*;
fn main() {
    let m = LaMoGen::embedded(&Device::flex()).unwrap();
    for p in [
        "a person jumps",
        "a person walks forward",
        "a person waves with the right hand",
    ] {
        for t in Tag::ALL {
            let t0 = std::time::Instant::now();
            let r = m.generate(&Request::new(p).tag(t).seed(7)).unwrap();
            let (b, g) = (
                r.baseline_laban.summary(Summary::Maximum),
                r.guided_laban.summary(Summary::Maximum),
            );
            let (bm, gm) = (
                r.baseline_laban.summary(Summary::Mean),
                r.guided_laban.summary(Summary::Mean),
            );
            println!(
                "{p:20} {t:10} max {:?} mean {:?} d {:.3} loss {:.2}->{:.2} {:?}",
                std::array::from_fn::<_, 4, _>(|i| (g[i] / b[i] * 100.0).round() / 100.0),
                std::array::from_fn::<_, 4, _>(|i| (gm[i] / bm[i] * 100.0).round() / 100.0),
                r.guided.distance(&r.baseline),
                r.loss[0],
                r.loss.last().unwrap(),
                t0.elapsed()
            );
        }
    }
}
