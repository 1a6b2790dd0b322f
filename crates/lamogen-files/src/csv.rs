//! Writing Laban series as CSV, for spreadsheets, pandas and R.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use lamogen_laban::{Component, LabanSeries};
use lamogen_motion::{FRAMES_PER_SECOND, TimedCaption, write_atomically};

/// The error of a CSV file that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
#[allow(missing_docs)]
pub struct CsvError {
    pub path: PathBuf,
    pub reason: io::Error,
}

/// Formats Laban series side by side, each with its name, as CSV text.
///
/// The first line has the column names, and every other line has one frame. The columns are `seconds`, `frame` (from 0),
/// and for each series `weight` (m²/frame²), `time` (m/frame²), `flow` (m/frame³) and `shape` (m³), with frames of 1/20 s.
/// The columns of a named series are called `name_weight` and so on; a series with an empty name has the column names
/// without a prefix. If there are captions, the column `caption` after `frame` has the one that holds at the frame. If a
/// series is shorter than another one, its last cells are empty.
///
/// Numbers have a decimal point in every locale, and as many digits as are needed to read the same 32-bit number back.
///
/// ```
/// use lamogen_files::csv::laban;
/// use lamogen_laban::{LabanOptions, LabanSeries};
/// use lamogen_motion::Motion;
///
/// let motion = Motion::from_joints(vec![[[0.0; 3]; 22]; 2])?;
/// let series = LabanSeries::of(&motion, &LabanOptions::default(), &burn::tensor::Device::flex());
/// assert_eq!(
///     laban(&[("", &series)], &[]),
///     "seconds,frame,weight,time,flow,shape\n0,0,0,0,0,0\n0.05,1,0,0,0,0\n"
/// );
/// # Ok::<(), lamogen_motion::MotionError>(())
/// ```
pub fn laban(series: &[(&str, &LabanSeries)], captions: &[TimedCaption]) -> String {
    let mut text = String::from("seconds,frame");
    if !captions.is_empty() {
        text.push_str(",caption");
    }
    for (name, _) in series {
        for component in Component::ALL {
            let word = component.to_string().to_lowercase();
            let column = match name.is_empty() {
                true => word,
                false => format!("{name}_{word}"),
            };
            text.push(',');
            text.push_str(&quote_cell(&column));
        }
    }
    text.push('\n');
    let frames = series.iter().map(|(_, series)| series.frames().len()).max();
    for frame in 0..frames.unwrap_or(0) {
        let seconds = frame as f32 / FRAMES_PER_SECOND;
        write!(text, "{seconds},{frame}").expect("a string takes all");
        if !captions.is_empty() {
            let caption = TimedCaption::position(captions, frame);
            text.push(',');
            text.push_str(&caption.map_or(String::new(), |at| quote_cell(&captions[at].text)));
        }
        for (_, series) in series {
            for component in Component::ALL {
                text.push(',');
                if let Some(row) = series.frames().get(frame) {
                    let value = row[component.index()];
                    write!(text, "{value}").expect("a string takes all");
                }
            }
        }
        text.push('\n');
    }
    text
}

/// Writes Laban series as CSV to a file, in the format of [`laban`].
///
/// # Errors
///
/// If the file cannot be written. In this case, no incomplete file is left.
pub fn write_laban(
    path: impl AsRef<Path>,
    series: &[(&str, &LabanSeries)],
    captions: &[TimedCaption],
) -> Result<(), CsvError> {
    let path = path.as_ref();
    let text = laban(series, captions);
    write_atomically(path, |file| file.write_all(text.as_bytes())).map_err(|reason| CsvError {
        path: path.to_owned(),
        reason,
    })
}

/// Quotes a cell by the rules of RFC 4180 if necessary.
fn quote_cell(cell: &str) -> String {
    match cell.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Tensor;

    fn series<const N: usize>(rows: [[f32; 4]; N]) -> LabanSeries {
        LabanSeries::from_tensor(Tensor::from(rows))
    }

    #[test]
    fn one_series_has_bare_columns() {
        let series = series([[0.0, 0.0, 0.0, 0.125], [0.1, 1e-12, 123456.79, 1.0 / 3.0]]);
        assert_eq!(
            laban(&[("", &series)], &[]),
            "seconds,frame,weight,time,flow,shape\n\
             0,0,0,0,0,0.125\n\
             0.05,1,0.1,0.000000000001,123456.79,0.33333334\n"
        );
    }

    #[test]
    fn several_series_stand_side_by_side_and_short_ones_leave_cells_empty() {
        let long = series([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]);
        let short = series([[0.5; 4]]);
        assert_eq!(
            laban(&[("baseline", &long), ("a \"b\", c", &short)], &[]),
            "seconds,frame,baseline_weight,baseline_time,baseline_flow,baseline_shape,\
             \"a \"\"b\"\", c_weight\",\"a \"\"b\"\", c_time\",\"a \"\"b\"\", c_flow\",\"a \"\"b\"\", c_shape\"\n\
             0,0,1,2,3,4,0.5,0.5,0.5,0.5\n\
             0.05,1,5,6,7,8,,,,\n"
        );
    }

    #[test]
    fn every_frame_has_its_caption() {
        let caption = TimedCaption::new;
        let captions = [caption("walks, slowly", 0..1), caption("jumps", 1..2)];
        assert_eq!(
            laban(&[("", &series([[0.5; 4]; 3]))], &captions),
            "seconds,frame,caption,weight,time,flow,shape\n\
             0,0,\"walks, slowly\",0.5,0.5,0.5,0.5\n\
             0.05,1,jumps,0.5,0.5,0.5,0.5\n\
             0.1,2,,0.5,0.5,0.5,0.5\n"
        );
    }

    #[test]
    fn every_number_reads_back_as_it_was() {
        let rows: [[f32; 4]; 3] = [
            [f32::MIN_POSITIVE, 1.0e-45, 0.1 + 0.2, 3.402_823_5e38],
            [16_777_217.0, 0.333_333_34, 2.7e-7, 9.999_999e-5],
            [1.0, 1e10, 1e-10, 0.0],
        ];
        let text = laban(&[("", &series(rows))], &[]);
        for (line, row) in text.lines().skip(1).zip(rows) {
            let cells: Vec<f32> = line
                .split(',')
                .skip(2)
                .map(|x| x.parse().unwrap())
                .collect();
            assert_eq!(cells, row);
        }
    }

    #[test]
    fn the_error_names_a_file_that_cannot_be_written() {
        let error =
            write_laban("no/such/folder/a.csv", &[("", &series([[0.0; 4]]))], &[]).unwrap_err();
        assert!(
            error.to_string().contains("no/such/folder/a.csv"),
            "{error}"
        );
    }
}
