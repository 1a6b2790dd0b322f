//! Text-to-motion denoisers as burn modules: CLIP text tower, MotionDiffuse, checkpoints, tokenizers
