//! TorchScript archives, which hold a program beside the weights.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Returns whether a file is an archive that `torch.jit.save` wrote, such as the files that OpenAI publishes of CLIP.
///
/// Such an archive is a zip with the constants of a program, `constants.pkl`, in its top folder. The names of a zip's entries
/// stand in the directory at its end.
pub(super) fn is_torchscript(path: &Path) -> io::Result<bool> {
    /// Beyond the directories of all archives of networks of this kind: some thousand entries.
    const DIRECTORY_BYTES: u64 = 1 << 20;
    const ZIP: [u8; 4] = *b"PK\x03\x04";
    const CONSTANTS: &[u8] = b"/constants.pkl";
    let mut file = File::open(path)?;
    let (length, mut start) = (file.metadata()?.len(), [0; ZIP.len()]);
    if length < ZIP.len() as u64 {
        return Ok(false);
    }
    file.read_exact(&mut start)?;
    if start != ZIP {
        return Ok(false);
    }
    let mut directory = Vec::new();
    file.seek(SeekFrom::Start(length.saturating_sub(DIRECTORY_BYTES)))?;
    file.read_to_end(&mut directory)?;
    // Each entry of the directory begins with a header, whose signature is followed by sizes and then by the name.
    const ENTRY: &[u8] = b"PK\x01\x02";
    const NAME: usize = 46;
    let entries = (0..directory.len()).filter(|&place| directory[place..].starts_with(ENTRY));
    let mut names = entries.filter_map(|place| {
        let length = directory.get(place + 28..place + 30)?;
        let length = usize::from(u16::from_le_bytes([length[0], length[1]]));
        directory.get(place + NAME..place + NAME + length)
    });
    Ok(names.any(|name| name.ends_with(CONSTANTS)))
}

/// Describes a TorchScript archive in the place of a state dict, with the command that makes one of it.
pub(super) fn describe_torchscript(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    format!(
        "expected a state dict, found a TorchScript archive, a program with weights. Save its state dict: \
         python -c \"import torch; torch.save(torch.jit.load('{name}', map_location='cpu').state_dict(), 'clip.pt')\""
    )
}
