//! MDM, the Human Motion Diffusion Model (Tevet et al. 2023, arXiv 2209.14916), and DiP (Tevet et al. 2025, arXiv
//! 2410.03441).
//!
//! ```text
//! trans_enc   e = embed_text(CLIP's sentence)    ──+ time──▶ a token before the frames ──self-attention──▶ clean motion
//! trans_dec   e = embed_text(DistilBERT's words) ──+ time──▶ tokens that the frames attend to ───────────▶ clean motion
//! DiP         the same, after 20 frames of prefix that it continues by 40
//! ```
//!
//! The layers are those of PyTorch's `TransformerEncoderLayer` and `TransformerDecoderLayer`, normalised after each part.
//! Guidance can move `e`, the gains and biases of the norms for each motion, or an offset of the conditioning tokens at the
//! input of each layer.

mod attention;
mod conditioning;
mod config;
#[cfg(feature = "flex")]
mod cpu;
mod distilbert;
mod layer;
mod network;
mod positions;
mod sentence;
mod text;
mod training;

pub use config::{MdmArchitecture, MdmConfig, TextEncoderKind};
pub use distilbert::DistilBertConfig;
pub use network::{Mdm, MdmContext};
pub use text::{MdmText, MdmTextConfig};
