//! The table of the largest values, which is visible without a script.

use lamogen_laban::{Component, TimeSummary};

use super::markup::escape;
use crate::LabanCurve;

/// Returns a table of the largest values over time, with a row for each component and a column for each curve. From the
/// second curve on, values are followed by the change relative to the first curve. The text is empty if there are no
/// curves.
pub(super) fn table(curves: &[LabanCurve<'_>]) -> String {
    let Some(first) = curves.first() else {
        return String::new();
    };
    let first = first.series.summary(TimeSummary::Maximum);
    let heads = curves
        .iter()
        .map(|curve| format!("<th scope=\"col\"><bdi>{}</bdi></th>", escape(curve.label)));
    let rows = Component::ALL.map(|component| {
        let index = component.index();
        let cells = curves.iter().enumerate().map(|(place, curve)| {
            let value = curve.series.summary(TimeSummary::Maximum)[index];
            // Adding 0 turns a rounded -0 into 0.
            let change = (100.0 * (value / first[index] - 1.0)).round() + 0.0;
            match place > 0 && change.is_finite() {
                true => format!("<td>{value:.4} <small>{change:+.0} %</small></td>"),
                false => format!("<td>{value:.4}</td>"),
            }
        });
        format!(
            "<tr><th scope=\"row\">{component}</th>{}</tr>\n",
            cells.collect::<String>()
        )
    });
    format!(
        "<details id=\"numbers\"><summary>Largest values over time</summary>\n<table>\n<thead><tr><th></th>{}</tr></thead>\n\
         <tbody>\n{}</tbody>\n</table>\n</details>\n",
        heads.collect::<String>(),
        rows.concat()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Tensor;
    use lamogen_laban::LabanSeries;

    #[test]
    fn changes_are_relative_to_the_first_curve() {
        let series = |rows: [[f32; 4]; 2]| LabanSeries::from_tensor(Tensor::from(rows));
        let before = series([[1.0, 0.0, 2.0, 4.0], [2.0, 0.0, 1.0, 4.0]]);
        let after = series([[3.0, 0.5, 1.0, 4.0], [0.0, 0.0, 1.0, 4.0]]);
        let table = table(&[
            LabanCurve::baseline(&before),
            LabanCurve {
                label: "<strong>",
                ..LabanCurve::guided(&after)
            },
        ]);
        assert!(
            table.contains("Weight</th><td>2.0000</td><td>3.0000 <small>+50 %</small></td>"),
            "{table}"
        );
        assert!(
            table.contains("Flow</th><td>2.0000</td><td>1.0000 <small>-50 %</small></td>"),
            "{table}"
        );
        // Relative to 0 there is no change in percent.
        assert!(
            table.contains("Time</th><td>0.0000</td><td>0.5000</td>"),
            "{table}"
        );
        assert!(table.contains("&lt;strong&gt;"), "{table}");
        assert_eq!(super::table(&[]), "");
    }
}
