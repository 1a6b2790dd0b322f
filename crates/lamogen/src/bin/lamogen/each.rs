//! Many motions, of which some may fail.

use std::ops::ControlFlow;

use lamogen::{Error, Generation, LaMoGen, Progress, Request};

/// Generates requests together. One that fails is left out, and the others are made without it: each gets its motion, or the reason
/// why there is none.
pub fn generate_each(
    model: &LaMoGen,
    requests: &[Request],
    observer: &mut dyn FnMut(&Progress<'_>),
) -> Result<Vec<Result<Generation, String>>, Error> {
    let mut results: Vec<Option<Result<Generation, String>>> =
        requests.iter().map(|_| None).collect();
    loop {
        let open: Vec<usize> = { 0..requests.len() }
            .filter(|&place| results[place].is_none())
            .collect();
        if open.is_empty() {
            break;
        }
        let part: Vec<Request> = open.iter().map(|&place| requests[place].clone()).collect();
        let made = model.generate_all_with(&part, &mut |progress| {
            observer(progress);
            ControlFlow::Continue(())
        });
        match made {
            Ok(all) => {
                for (place, generation) in open.into_iter().zip(all) {
                    results[place] = Some(Ok(generation));
                }
            }
            Err(Error::Failed(error)) => {
                for (place, generation) in error.partial.finished {
                    results[open[place]] = Some(Ok(generation));
                }
                results[open[error.which.index]] = Some(Err(error.reason.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
    let whole = results.into_iter();
    Ok(whole.map(|result| result.expect("all are made")).collect())
}
