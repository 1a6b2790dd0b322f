//! From a sentence and a few words of Laban movement analysis to human motion
