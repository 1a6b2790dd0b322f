//! Generation of many motions, of which some may fail.

use std::ops::ControlFlow;

use lamogen::{Error, Generation, LaMoGen, Progress, Request};

/// Generates the motions of several requests together. If one fails, the others are generated without it. The result
/// has, for each request, its motion or the reason of the failure.
pub fn generate_each(
    model: &LaMoGen,
    requests: &[Request],
    observer: &mut dyn FnMut(&Progress<'_>),
) -> Result<Vec<Result<Generation, String>>, Error> {
    let mut results: Vec<Option<Result<Generation, String>>> =
        requests.iter().map(|_| None).collect();
    loop {
        let pending: Vec<usize> = { 0..requests.len() }
            .filter(|&place| results[place].is_none())
            .collect();
        if pending.is_empty() {
            break;
        }
        let pending_requests: Vec<Request> = pending
            .iter()
            .map(|&place| requests[place].clone())
            .collect();
        let generations = model.generate_all_with(&pending_requests, &mut |progress| {
            observer(progress);
            ControlFlow::Continue(())
        });
        match generations {
            Ok(all) => {
                for (place, generation) in pending.into_iter().zip(all) {
                    results[place] = Some(Ok(generation));
                }
            }
            Err(Error::Failed(error)) => {
                for (place, generation) in error.partial.finished {
                    results[pending[place]] = Some(Ok(generation));
                }
                results[pending[error.which.index]] = Some(Err(error.reason.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
    let results = results.into_iter();
    Ok(results
        .map(|result| result.expect("no request is pending"))
        .collect())
}
