//! A report of headings, texts, tables and pictures, written as Markdown with separate pictures or as one HTML file.

use std::fmt::Write;

/// A part of a report.
pub enum ReportBlock {
    Heading(String),
    Text(String),
    Table {
        header: Vec<String>,
        rows: Vec<Vec<String>>,
    },
    Picture {
        /// The name of the picture's file, without extension.
        name: String,
        caption: String,
        svg: String,
    },
}

impl ReportBlock {
    pub fn heading(text: impl Into<String>) -> ReportBlock {
        ReportBlock::Heading(text.into())
    }

    pub fn text(text: impl Into<String>) -> ReportBlock {
        ReportBlock::Text(text.into())
    }

    /// Makes a picture. Its file is named by the title.
    pub fn picture(title: &str, caption: impl Into<String>, svg: String) -> ReportBlock {
        ReportBlock::Picture {
            name: title.to_lowercase().replace(' ', "-"),
            caption: caption.into(),
            svg,
        }
    }

    pub fn table<const N: usize>(header: [&str; N], rows: Vec<Vec<String>>) -> ReportBlock {
        ReportBlock::Table {
            header: header.map(str::to_owned).into(),
            rows,
        }
    }
}

/// Formats a report as Markdown. The pictures are links to files in `folder`.
pub fn markdown(title: &str, blocks: &[ReportBlock], folder: &str) -> String {
    let mut out = format!("# {title}\n");
    for block in blocks {
        out.push('\n');
        match block {
            ReportBlock::Heading(text) => writeln!(out, "## {text}"),
            ReportBlock::Text(text) => writeln!(out, "{text}"),
            ReportBlock::Table { header, rows } => {
                let line = |cells: &[String]| {
                    let cells = cells.iter().map(|cell| cell.replace('|', "\\|"));
                    format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
                };
                let rule = format!("|{}\n", "---|".repeat(header.len()));
                let rows: String = rows.iter().map(|row| line(row)).collect();
                write!(out, "{}{rule}{rows}", line(header))
            }
            ReportBlock::Picture { name, caption, .. } => {
                writeln!(out, "![{caption}]({folder}/{name}.svg)")
            }
        }
        .expect("strings can be written to");
    }
    out
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#111827;background:#fff}\
table{border-collapse:collapse;margin:1rem 0;display:block;overflow-x:auto}td,th{border:1px solid #d1d5db;padding:.25rem .6rem;text-align:right}\
td:first-child,th:first-child{text-align:left}th{background:#f3f4f6}figure{margin:1rem 0}figure svg{max-width:100%;height:auto}\
figcaption{color:#4b5563}";

/// Formats a report as one HTML file that contains the pictures.
pub fn html(title: &str, blocks: &[ReportBlock]) -> String {
    let title = escape_html(title);
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n<h1>{title}</h1>\n"
    );
    for block in blocks {
        match block {
            ReportBlock::Heading(text) => writeln!(out, "<h2>{}</h2>", escape_html(text)),
            ReportBlock::Text(text) => {
                let mut paragraphs = text.split("\n\n");
                paragraphs.try_for_each(|text| writeln!(out, "<p>{}</p>", escape_html(text)))
            }
            ReportBlock::Table { header, rows } => {
                let line = |cells: &[String], kind: &str| {
                    let cells = cells.iter().map(|cell| {
                        // Non-breaking spaces keep a number and its deviation on one line.
                        let cell = escape_html(cell).replace(" ± ", "\u{a0}±\u{a0}");
                        format!("<{kind}>{cell}</{kind}>")
                    });
                    format!("<tr>{}</tr>\n", cells.collect::<String>())
                };
                let rows: String = rows.iter().map(|row| line(row, "td")).collect();
                writeln!(out, "<table>\n{}{rows}</table>", line(header, "th"))
            }
            ReportBlock::Picture { caption, svg, .. } => {
                // An SVG inside HTML has no XML declaration.
                let svg = svg.find("<svg").map_or("", |start| &svg[start..]);
                let caption = escape_html(caption);
                writeln!(
                    out,
                    "<figure>{svg}<figcaption>{caption}</figcaption></figure>"
                )
            }
        }
        .expect("strings can be written to");
    }
    out
}

/// Escapes the characters with a meaning in HTML.
fn escape_html(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_formats_contain_and_escape_all_blocks() {
        let blocks = [
            ReportBlock::heading("Table <1>"),
            ReportBlock::text("One & two.\n\nThree."),
            ReportBlock::table(["a", "b|c"], vec![vec!["1 ± 3".into(), "<2>".into()]]),
            ReportBlock::Picture {
                name: "curve".into(),
                caption: "A curve".into(),
                svg: "<?xml version=\"1.0\"?><svg><path/></svg>".into(),
            },
        ];
        let text = markdown("Report", &blocks, "pictures");
        let expected = "# Report\n\n## Table <1>\n\nOne & two.\n\nThree.\n\n| a | b\\|c |\n|---|---|\n| 1 ± 3 | <2> |\n\n![A curve](pictures/curve.svg)\n";
        assert_eq!(text, expected);
        let page = html("Report", &blocks);
        for part in [
            "<h2>Table &lt;1&gt;</h2>",
            "<p>One &amp; two.</p>\n<p>Three.</p>",
            "<th>b|c</th>",
            "<td>1\u{a0}±\u{a0}3</td>",
            "<td>&lt;2&gt;</td>",
            "<figure><svg><path/></svg>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<?xml"));
    }
}
