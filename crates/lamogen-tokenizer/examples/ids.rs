//! Ids of the texts on standard input, one JSON string a line, as JSON lists.

use std::io::BufRead;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let begun = std::time::Instant::now();
    let tokenizer = lamogen_tokenizer::Tokenizer::clip(1 << 14);
    let built = begun.elapsed();
    for line in std::io::stdin().lock().lines() {
        let text: String = serde_json::from_str(&line?)?;
        let mut ids = tokenizer.encode(&text)?.ids;
        let length = ids
            .iter()
            .position(|&id| id == 49407)
            .map_or(0, |_| ids.iter().rposition(|&id| id != 0).unwrap_or(0) + 1);
        ids.truncate(length);
        println!("{}", serde_json::to_string(&ids)?);
    }
    eprintln!("built in {built:?}, all in {:?}", begun.elapsed());
    Ok(())
}
