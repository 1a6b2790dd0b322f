//! Laban movement analysis of motion: Weight, Time, Flow and Shape, tags, targets and loss, differentiable
