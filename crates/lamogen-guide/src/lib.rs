//! Two-pass Laban guidance of a diffusion model: noise schedule, DDIM, Adam on the text embedding
