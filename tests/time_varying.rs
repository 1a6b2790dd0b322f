//! explore
use lamogen::{Component, Device, Factor, LaMoGen, Request, ScaleCurve, Summary, Guidance};

#[test]
fn explore() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let emphasis: f32 = std::env::var("EMPH").map(|x| x.parse().unwrap()).unwrap_or(1.0);
    let steps: usize = std::env::var("STEPS").map(|x| x.parse().unwrap()).unwrap_or(50);
    for (component, more, less) in [(Component::Weight, 1.5, 0.5), (Component::Shape, 1.5, 0.5)] {
        for orders in [["0:M 2:L", "0:L 2:M"]] {
            let cases: Vec<(&str, u64)> = ["a person walks forward", "a person waves with the left hand", "a person dances", "a person jumps", "a person runs in a circle", "a person kicks with the right leg"]
                .iter().flat_map(|&p| [1u64, 2, 3].map(|s| (p, s))).collect();
            let mut all = vec![];
            for order in orders {
                let text = order.replace("M", &format!("{more}")).replace("L", &format!("{less}"));
                let scale = ScaleCurve::default().with(component, Factor::parse(component, &text).unwrap());
                let requests: Vec<Request> = cases.iter().map(|&(p, s)| Request::new(p).seed(s).seconds(4.0).steps(steps).scale(scale.clone())
                    .guidance(Guidance { emphasis, ..Guidance::fast() })).collect();
                let results = model.generate_all(&requests).unwrap();
                all.push((text, results));
            }
            for (i, case) in cases.iter().enumerate() {
                let mut line = format!("{component} {case:?}:");
                let mut r = vec![];
                for (text, results) in &all {
                    let x = &results[i];
                    let m = |s: &lamogen::LabanSeries, range| s.section(range).summary(Summary::Mean)[component.index()];
                    let ratios = [0..40, 40..80].map(|range| m(&x.guided_laban, range.clone()) / m(&x.baseline_laban, range));
                    line += &format!("  [{text}] {:.2} {:.2} (loss {:.2})", ratios[0], ratios[1], x.loss.last().unwrap() / x.loss[0]);
                    r.push(ratios);
                }
                line += &format!("   contrast {:.2} {:.2}", r[0][0] / r[1][0], r[1][1] / r[0][1]);
                println!("{line}");
            }
        }
    }
}
