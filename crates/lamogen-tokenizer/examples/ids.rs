//! Prints CLIP's token ids of the texts on standard input, to compare them with the ids of another tokenizer.
//!
//! Each line of the input is a JSON string. Each line of the output is a JSON list of ids without padding.
//!
//! ```text
//! echo '"a person jumps"' | cargo run --release -p lamogen-tokenizer --example ids [context length]
//! ```

use std::error::Error;
use std::io::{BufRead, Write};

use lamogen_tokenizer::Tokenizer;

fn main() -> Result<(), Box<dyn Error>> {
    let context_length = match std::env::args().nth(1) {
        Some(length) => length.parse()?,
        None => 77,
    };
    let tokenizer = Tokenizer::clip(context_length);
    let mut output = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let text: String = serde_json::from_str(&line?)?;
        let mut ids = tokenizer.encode(&text)?.ids;
        // The loop stops at the end token, because its id is not 0.
        while ids.last() == Some(&0) {
            ids.pop();
        }
        writeln!(output, "{}", serde_json::to_string(&ids)?)?;
    }
    Ok(())
}
